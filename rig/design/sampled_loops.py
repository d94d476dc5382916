"""Control loops around the linearised rig, exactly discretised: controllers, sensors, delays, sample and hold.

Over the common period L of all loops the rig is linear between instants that are known beforehand. In each loop

    sample    y = gain (direct c x + filter), taken `delay` of the sensor before it is published
    update    xi, u = controller(xi, y), the controller's own arithmetic without its limits
    command   takes effect `delay` of the loop later, held until the next

so one period maps z = [rig, filters, commands in effect, commands and samples under way, controllers] by a matrix:
`closed` gives that of all loops together, `sampled` that of one loop, open where its controller reads:

    z(k+1) = F z(k) + G y'(k),   y(k) = H z(k)         closed with y' = y

Eigenvalues of a closed matrix are exp(lambda L), equal to those of the simulation for motions within all limits,
without noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.design import Feedback
from rig.design.linearised import Plant, arithmetic
from rig.sensors.chain.front_end import FrontEnd

Array = NDArray[np.float64]
_MOST_STATES = 2000  # of loops closed together: beyond, the eigenvalues take minutes


class ControlLoop(NamedTuple):
    """A controller, the output that its sensor `reads` with its front end, and the delay [ns] of its commands."""

    feedback: Feedback
    reads: str
    end: FrontEnd
    delay_ns: int

    def period(self) -> int:
        """The longer one [ns] of the periods of its controller and its sensor.

        Raises ValueError if neither is a multiple of the other, and for a sensor with echoes.
        """
        if self.end.echoes:
            raise ValueError(
                "sensor: has echoes, which the model of a loop does not contain; paths = [] in its table removes them"
            )
        own = self.feedback.period_ns
        between = self.end.period_ns
        if own < between:
            period = round(between)
            fits = self.end.instants.even and period % own == 0
        else:
            period = own
            fits = self.end.instants.fit(own)
        if not fits:
            near = " or ".join(f"{1e9 / p:g} Hz" for p in _near(own, between))
            raise ValueError(
                f"period: {own / 1e6:g} ms and the {between / 1e6:g} ms between samples are not multiples of each "
                f"other, so that the loop has no common period. It has one if the sensor samples at {near}"
            )
        return period


class Closed(NamedTuple):
    """The matrix of one period [s] of all loops; the first `own` states belong to the rig."""

    matrix: Array
    period: float
    own: int


@dataclass(frozen=True)
class Sampled:
    """The loop cut at its measurement; `period` L [s], `states`: names of z, of which the first `own` belong to the
    rig.
    """

    F: Array
    G: Array
    H: Array
    period: float
    states: tuple[str, ...]
    own: int

    def closed(self, gain: float = 1.0) -> Array:
        """Return the matrix of one period with `gain` times the controller's own gain."""
        return self.F + gain * np.outer(self.G, self.H)


def closed(plant: Plant, loops: Sequence[ControlLoop]) -> Closed:
    """Return the matrix of the rig with all `loops` closed.

    Raises ValueError as `ControlLoop.period`, and for loops that repeat too late together.
    """
    period = _Period(plant, loops)
    if period.size > _MOST_STATES:
        raise ValueError(
            f"period: the loops repeat after {period.length / 1e6:g} ms, with {period.size} states; at most "
            f"{_MOST_STATES}. Periods and delays that are multiples of each other need fewer"
        )
    return Closed(period.matrix(), period.length * 1e-9, period.own)


def sampled(plant: Plant, loop: ControlLoop, newer: int | None = 0) -> Sampled:
    """Return one `loop` around the rig, cut where its controller reads.

    `newer`: which command takes effect, counted in periods from the one whose delay is over; None: none does, and the
    actuator holds the one before.
    Raises ValueError as `ControlLoop.period`.
    """
    period = _Period(plant, [loop])
    rows = period.matrix(cut=True, newer=newer)
    [of_loop] = period.loops
    states = (*plant.states, *of_loop.names())
    return Sampled(rows[:, :-1], rows[:, -1], of_loop.published[:-1], period.length * 1e-9, states, period.own)


class _Delayed:
    """A value that is formed at an instant `at` of the period [ns] and takes effect `wait` periods later, at `then`.

    `places`: in z, of those under way, the oldest first. `newest`: row of the one that is formed in this period.
    """

    def __init__(self, at: int, then: int, wait: int) -> None:
        self.at = at
        self.then = then
        self.wait = wait
        self.places = slice(0)
        self.newest = np.zeros(0)

    def arriving(self, rows: Array, newer: int = 0) -> Array:
        """The row of the value that takes effect, or of the one that was formed `newer` periods after it."""
        return rows[self.places][newer].copy() if self.wait > newer else self.newest


class _LoopInPeriod:
    """A loop in the period: its delayed values, its places in z, and its sample.

    `reading`: the sample as a row over the states that flow; `published`: the row of the one that its controller gets.
    """

    def __init__(self, loop: ControlLoop, plant: Plant, period: int) -> None:
        self.end = loop.end
        self.controller = arithmetic(loop.feedback)
        self.drive = plant.inputs.index(loop.feedback.drives[0])
        self.output = plant.outputs.index(loop.reads)
        self.blocks, self.out = _filter(loop.end)
        self.commands: list[_Delayed] = []
        for at in range(0, period, loop.feedback.period_ns):
            wait, then = divmod(at + loop.delay_ns, period)
            self.commands.append(_Delayed(at, then, wait))
        self.samples: list[_Delayed] = []
        for then in range(0, period, loop.period()):
            before, at = divmod(then - loop.end.delay_ns, period)
            self.samples.append(_Delayed(at, then, -before))
        self.filter = self.command = self.states = slice(0)
        self.reading = self.published = np.zeros(0)

    def names(self) -> Iterator[str]:
        """The names of the states of z behind those of the rig, for one loop."""
        yield from (f"sensor {i}" for i in range(len(self.out)))
        yield "command"
        commands = sum(value.wait for value in self.commands)
        samples = sum(value.wait for value in self.samples)
        yield from (f"command under way {i}" for i in range(commands))
        yield from (f"sample under way {i}" for i in range(samples))
        yield from (f"controller {i}" for i in range(len(self.controller[0])))


class _Action(IntEnum):
    """What happens in a period; at one instant in this order. A sensor that averages begins anew at RESET."""

    SAMPLE = 0
    PUBLISH = 1
    UPDATE = 2
    COMMAND = 3
    RESET = 4


class _Instant(NamedTuple):
    """What happens to a value of a loop at an instant of the period [ns]."""

    at: int
    action: _Action
    loop: _LoopInPeriod
    value: _Delayed


class _Period:
    """One period of all loops: its `length` [ns], the places in z, and the motion between instants.

    The first `flowing` states move there by the `generator`: the rig, the filters, and the commands, which are held.
    """

    def __init__(self, plant: Plant, loops: Sequence[ControlLoop]) -> None:
        self.length = math.lcm(*(loop.period() for loop in loops))
        self.loops = [_LoopInPeriod(loop, plant, self.length) for loop in loops]
        self.own = self.size = len(plant.states)
        for loop in self.loops:
            loop.filter = self._places(len(loop.out))
        for loop in self.loops:
            loop.command = self._places(1)
        self.flowing = self.size
        for loop in self.loops:
            for value in (*loop.commands, *loop.samples):
                value.places = self._places(value.wait)
        for loop in self.loops:
            loop.states = self._places(len(loop.controller[0]))
        self.generator = np.zeros((self.flowing, self.flowing))
        self.generator[: self.own, : self.own] = plant.A
        for loop in self.loops:
            self.generator[: self.own, loop.command] = plant.B[:, [loop.drive]]
            self._connect(loop, plant)

    def _places(self, count: int) -> slice:
        """The places of `count` more states in z."""
        self.size += count
        return slice(self.size - count, self.size)

    def _connect(self, loop: _LoopInPeriod, plant: Plant) -> None:
        """Connect the sensor of a loop to its output of the rig."""
        output = np.zeros(self.flowing)
        output[: self.own] = plant.C[loop.output]
        for other in self.loops:
            output[other.command] = plant.D[loop.output, other.drive]
        at = loop.filter.start
        for block in loop.blocks:
            here = slice(at, at + len(block))
            self.generator[here, here] = block
            self.generator[at] += output
            at += len(block)
        reading = (0.0 if loop.end.averages else loop.end.direct) * output
        reading[loop.filter] = loop.out
        loop.reading = loop.end.gain * reading

    def _instants(self) -> list[_Instant]:
        """What happens, in order; the first of it at 0, where every loop publishes a sample."""
        happens = []
        for loop in self.loops:
            for value in loop.samples:
                happens.append(_Instant(value.at, _Action.SAMPLE, loop, value))
                happens.append(_Instant(value.then, _Action.PUBLISH, loop, value))
                if loop.end.averages:
                    begin = (value.at - round(loop.end.period_ns)) % self.length
                    happens.append(_Instant(begin, _Action.RESET, loop, value))
            for value in loop.commands:
                happens.append(_Instant(value.at, _Action.UPDATE, loop, value))
                happens.append(_Instant(value.then, _Action.COMMAND, loop, value))
        return sorted(happens, key=lambda instant: instant[:2])

    def matrix(self, cut: bool = False, newer: int | None = 0) -> Array:
        """The matrix from z at the beginning of the period to z at its end.

        `cut`: of one loop, with one column more, for y' that its controller reads instead of its sample. `newer`: as
        in `sampled`.
        """
        from scipy.linalg import expm

        @cache
        def flow(ns: int) -> Array:
            return np.asarray(expm(self.generator * (ns * 1e-9)))

        rows = np.eye(self.size, self.size + cut)
        outside = np.zeros(self.size + cut)
        outside[-1] = 1.0
        instants = self._instants()
        nexts = [*(instant.at for instant in instants[1:]), self.length]
        for (at, action, loop, value), until in zip(instants, nexts):
            match action:
                case _Action.SAMPLE:
                    value.newest = loop.reading @ rows[: self.flowing]
                case _Action.PUBLISH:
                    loop.published = value.arriving(rows)
                case _Action.UPDATE:
                    A, b, c, d = loop.controller
                    xi = rows[loop.states]
                    y = outside if cut else loop.published
                    value.newest = c @ xi + d * y
                    rows[loop.states] = A @ xi + np.outer(b, y)
                case _Action.COMMAND if newer is not None:
                    rows[loop.command] = value.arriving(rows, newer)
                case _Action.RESET:
                    rows[loop.filter.stop - 1] = 0.0
            if until > at:
                rows[: self.flowing] = flow(until - at) @ rows[: self.flowing]
        for loop in self.loops:
            for value in (*loop.commands, *loop.samples):
                if value.wait:  # values under way move up by one place
                    rows[value.places] = np.vstack([rows[value.places][1:], value.newest])
        return rows


def _near(own: int, between: float) -> list[float]:
    """The sample periods [ns] next to `between` that have a common period with a controller of period `own` [ns]."""
    many = between > own
    ratio = between / own if many else own / between
    return [own * n if many else own / n for n in (math.ceil(ratio), math.floor(ratio))]


def _filter(end: FrontEnd) -> tuple[list[Array], list[float]]:
    """The filter of a front end: the matrix of each pole, whose first state the output drives, and the row of
    the measurement over these states.
    """
    blocks: list[Array] = []
    out: list[float] = []
    for pole, residue in zip(end.poles, end.residues):
        pair = 2.0 if pole.imag else 1.0
        if pole.imag:
            real = np.array([[pole.real, -pole.imag], [pole.imag, pole.real]])
        else:
            real = np.array([[pole.real]])
        blocks.append(real)
        out += [pair * residue.real, -pair * residue.imag][: len(real)]
    if end.averages:
        blocks.append(np.zeros((1, 1)))
        out.append(1e9 / end.period_ns)
    return blocks, out
