"""All control loops of a rig closed together, each sampled with its own period, discretised exactly.

As rig.design.linearised has it for one loop: between the instants of samples, updates and commands the rig is linear.
The common period L is the least multiple of the periods of all loops. It maps

    z = [rig, filters of the sensors, commands in effect, commands and samples under way, controllers]

by a matrix whose eigenvalues are exp(lambda L).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.design import Feedback
from rig.design.linearised import Plant, arithmetic, common_period, filter_blocks
from rig.sensors.chain.front_end import FrontEnd

Array = NDArray[np.float64]
_MOST_STATES = 2000  # beyond, the eigenvalues take minutes
_SAMPLE, _PUBLISH, _UPDATE, _COMMAND, _RESET = range(5)  # what happens first at one instant


class Loop(NamedTuple):
    """A controller, the output that its sensor `reads` with its front end, and the delay [ns] of its commands."""

    feedback: Feedback
    reads: str
    end: FrontEnd
    delay_ns: int


class Closed(NamedTuple):
    """The matrix of one period [s] of all loops; the first `own` states belong to the rig."""

    matrix: Array
    period: float
    own: int


class _Queue(NamedTuple):
    """Values under way, the oldest first, and the row that joins them at the end of the period."""

    rows: slice
    newest: list[Array]


def closed(plant: Plant, loops: Sequence[Loop]) -> Closed:
    """Return the matrix of the rig with all `loops` closed.

    Raises ValueError for periods that have no common one, and as `rig.design.linearised.sampled`.
    """
    period = math.lcm(*(common_period(loop.feedback, loop.end) for loop in loops))
    made = _Period(plant, loops, period)
    return Closed(made.matrix(), period * 1e-9, len(plant.states))


class _Period:
    """One period of all loops, instant by instant. Every quantity is a row over z at the beginning."""

    def __init__(self, plant: Plant, loops: Sequence[Loop], period: int) -> None:
        self.period = period
        self.flows: dict[int, Array] = {}
        n = len(plant.states)
        counts = [_filter_states(loop.end) for loop in loops]
        self.continuous = n + sum(counts)
        first = self.continuous + len(loops)
        queued = 0
        controllers = [arithmetic(loop.feedback) for loop in loops]
        happens: list[tuple[int, int, Callable[[], None]]] = []
        lines: list[tuple[int, int]] = []
        for loop in loops:
            for place in (*_samples(loop, period), *_updates(loop, period)):
                lines.append((place.wait, queued))
                queued += place.wait
        own = sum(len(A) for A, *_ in controllers)
        size = first + queued + own
        if size > _MOST_STATES:
            raise ValueError(
                f"period: the loops repeat after {period / 1e6:g} ms, with {size} states; at most {_MOST_STATES}. "
                "Periods and delays that are multiples of each other need fewer"
            )
        self.rows = np.eye(size)
        self.generator = np.zeros((first, first))
        self.generator[:n, :n] = plant.A
        self.queues: list[_Queue] = []
        self.published = [np.zeros(size) for _ in loops]
        at = n
        xi = first + queued
        line = iter(lines)
        for i, (loop, count, controller) in enumerate(zip(loops, counts, controllers)):
            command = self.continuous + i
            filters = slice(at, at + count)
            states = slice(xi, xi + len(controller[0]))
            self.generator[:n, command] = plant.B[:, plant.inputs.index(loop.feedback.drives[0])]
            reading = self._reading(plant, loops, loop, filters)
            for place in _samples(loop, period):
                queue = self._queue(first, *next(line), size)
                happens.append((place.at, _SAMPLE, partial(self._sample, queue, reading)))
                happens.append((place.then, _PUBLISH, partial(self._publish, i, queue)))
                if loop.end.averages:
                    before = round(place.at - loop.end.period_ns) % period
                    happens.append((before, _RESET, partial(self._reset, filters.stop - 1)))
            for place in _updates(loop, period):
                queue = self._queue(first, *next(line), size)
                happens.append((place.at, _UPDATE, partial(self._update, i, queue, states, controller)))
                happens.append((place.then, _COMMAND, partial(self._command, command, queue)))
            at += count
            xi = states.stop
        self.actions = sorted(happens, key=lambda action: action[:2])

    def _reading(self, plant: Plant, loops: Sequence[Loop], loop: Loop, filters: slice) -> Array:
        """The sample of a loop as a row over the continuous states and the commands; its filter joins the generator."""
        n = len(plant.states)
        over = np.zeros(len(self.generator))
        output = plant.outputs.index(loop.reads)
        over[:n] = plant.C[output]
        for j, other in enumerate(loops):
            over[self.continuous + j] = plant.D[output, plant.inputs.index(other.feedback.drives[0])]
        blocks, out = filter_blocks(loop.end)
        at = filters.start
        for block in blocks:
            here = slice(at, at + len(block))
            self.generator[here, here] = block
            self.generator[at] += over
            at += len(block)
        reading = (0.0 if loop.end.averages else loop.end.direct) * over
        reading[filters] = out
        return np.asarray(loop.end.gain * reading)

    def _queue(self, first: int, wait: int, before: int, size: int) -> _Queue:
        self.queues.append(_Queue(slice(first + before, first + before + wait), [np.zeros(size)]))
        return self.queues[-1]

    def matrix(self) -> Array:
        """The map of z over one period."""
        now = 0
        for at, _, act in self.actions:
            self._flow(at - now)
            act()
            now = at
        self._flow(self.period - now)
        for rows, newest in self.queues:
            if rows.stop > rows.start:  # values under way move up by one place
                self.rows[rows] = np.vstack([self.rows[rows][1:], newest[0]])
        return self.rows

    def _flow(self, ns: int) -> None:
        from scipy.linalg import expm

        if not ns:
            return
        if ns not in self.flows:
            self.flows[ns] = expm(self.generator * (ns * 1e-9))
        count = len(self.generator)
        self.rows[:count] = self.flows[ns] @ self.rows[:count]

    def _sample(self, queue: _Queue, reading: Array) -> None:
        queue.newest[0] = reading @ self.rows[: len(reading)]

    def _publish(self, i: int, queue: _Queue) -> None:
        self.published[i] = self._oldest(queue)

    def _update(self, i: int, queue: _Queue, states: slice, controller: tuple[Array, Array, Array, float]) -> None:
        A, b, c, d = controller
        xi = self.rows[states]
        queue.newest[0] = c @ xi + d * self.published[i]
        self.rows[states] = A @ xi + np.outer(b, self.published[i])

    def _command(self, command: int, queue: _Queue) -> None:
        self.rows[command] = self._oldest(queue)

    def _oldest(self, queue: _Queue) -> Array:
        rows = queue.rows
        return np.array(self.rows[rows.start]) if rows.stop > rows.start else queue.newest[0]

    def _reset(self, state: int) -> None:
        self.rows[state] = 0.0


class _Place(NamedTuple):
    """Something that begins at an instant of the period [ns], and takes effect `wait` periods later at `then`."""

    at: int
    then: int
    wait: int


def _updates(loop: Loop, period: int) -> list[_Place]:
    """The updates of a controller, and the instants at which their commands take effect."""
    places = []
    for at in range(0, period, loop.feedback.period_ns):
        wait, then = divmod(at + loop.delay_ns, period)
        places.append(_Place(at, then, wait))
    return places


def _samples(loop: Loop, period: int) -> list[_Place]:
    """The samples of a sensor that a controller gets, and the instants at which they are published."""
    places = []
    for then in range(0, period, common_period(loop.feedback, loop.end)):
        before, at = divmod(then - loop.end.delay_ns, period)
        places.append(_Place(at, then, -before))
    return places


def _filter_states(end: FrontEnd) -> int:
    return sum(len(block) for block in filter_blocks(end)[0])
