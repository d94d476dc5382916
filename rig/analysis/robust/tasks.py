"""The units of work of a design, and the worst rig of a design.

Units are growths of rigs, ascents to a worst rig, designs polished against a set of rigs, and parts of a box examined.
A search asks for many of them at once and gets their results in order; a pool computes them (rig.analysis.pool). Each
is a function of its numbers alone, so that neither the number of workers nor an interruption changes a result.

The worst rig is searched at three levels of each uncertain value, and by ascents from the five best. Corners alone miss
it: it can lie inside of the box. Of more than five values, two levels of all are tried, and three levels of the five
with the largest influence.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.pool import Arrays, Ask
from rig.analysis.robust.box import Limit
from rig.analysis.robust.certificate import Examination, NoProof
from rig.analysis.robust.descent import ascend, polish
from rig.analysis.robust.growth import Growth

Array = NDArray[np.float64]
_GROWTHS, _ASCENT, _POLISH, _EXAMINE = range(4)
CHUNK = 64
"""Rigs of a unit: 0.1 to 0.3 s."""
_KEPT = 32  # boxes whose polynomials are kept
_ALL = 5  # most values of which all have three levels
_STARTS = 5
_APART = 0.15  # of the box, by which starts differ in a value


class Region(NamedTuple):
    """The box that is searched, in coordinates of the stated one: its low and its high end [uncertain]."""

    low: Array
    high: Array


class Found(NamedTuple):
    """Rigs `u` [k, uncertain] with their `growth` [k] in 1/s and its frequency `hertz` [k]."""

    u: Array
    growth: Array
    hertz: Array


class Tasks:
    """Asks for units of work and counts the rigs that were assembled.

    `ask`: computes units (rig.analysis.pool.Ask). `next`: the number of the first one. `progress` gets the number of
    units that are done.
    """

    def __init__(
        self, growth: Growth, limits: Sequence[Limit], ask: Ask, next: int = 0, progress: Callable[[int], object] = bool
    ) -> None:
        self.growth = growth
        self.limits = limits
        self.count = 0
        """Rigs that were assembled so far."""
        self.next = next
        """Number of the next unit."""
        self._carry_out = ask
        self._progress = progress

    def growths(self, x: Array, U: Array) -> Found:
        """The growth of design x [free] with rigs U [k, uncertain]."""
        return _joined(self._ask(_GROWTHS, [(x, U[i : i + CHUNK]) for i in range(0, len(U), CHUNK)]))

    def largest(self, X: Array, U: Array) -> Array:
        """The largest growth [1/s] of each of the designs X [k, free] with any of the rigs U."""
        return np.array([result["growth"].max() for result in self._ask(_GROWTHS, [(x, U) for x in X])])

    def ascents(self, x: Array, U: Array, region: Region) -> Found:
        """The worst rigs of design x that ascents from U [k, uncertain] reach within a region."""
        return _joined(self._ask(_ASCENT, [(x, np.vstack([u, *region])) for u in U]))

    def polished(self, X: Array, U: Array) -> tuple[Array, Array]:
        """The designs [k, free] that descents from X reach against rigs U, and the value of each, the best first."""
        results = self._ask(_POLISH, [(x, U) for x in X])
        values = np.array([float(result["value"]) for result in results])
        order = np.argsort(values, kind="stable")
        return np.array([result["x"] for result in results])[order], values[order]

    def examined(self, x: Array, parts: Sequence[Array]) -> list[Arrays]:
        """What is known of rigs of design x in `parts` [part][4, uncertain], each the two corners of a box and its own
        within that: results of `rig.analysis.robust.certificate.Examination.examined`, or "why" there is none.
        """
        return self._ask(_EXAMINE, [(x, part) for part in parts])

    def _ask(self, kind: int, given: Iterable[tuple[Array, Array]]) -> list[Arrays]:
        numbers = [(kind, *x.tolist(), *of_rigs.ravel().tolist()) for x, of_rigs in given]
        first = self.next
        self.next += len(numbers)
        results = self._carry_out(dict(enumerate(numbers, first)), lambda done: self._progress(first + done))
        self.count += sum(int(result["count"]) for result in results)
        return results


def _joined(results: Sequence[Arrays]) -> Found:
    return Found(*(np.concatenate([result[name] for result in results]) for name in Found._fields))


class Computer:
    """Computes units. Each process makes rigs of its own, by `make`, when it is asked for the first one.

    The matrices of boxes, as polynomials, are kept for the other parts of each. `target` [1/s]: no rig of a box that is
    examined may grow by more.
    """

    def __init__(self, make: Callable[[], Growth], limits: Sequence[Limit], target: float = 0.0) -> None:
        self._make = make
        self._limits = limits
        self._target = target
        self._examined: dict[tuple[float, ...], Examination] = {}

    @cached_property
    def _growth(self) -> Growth:
        return self._make()

    def __call__(self, unit: int, kind: float, *numbers: float) -> Arrays:
        """Return the result of a unit, for its kind and its numbers."""
        growth = self._growth
        x, given = np.split(np.array(numbers), [len(growth.box.free)])
        rigs = given.reshape(-1, len(growth.box.uncertain))
        before = growth.count
        if kind == _EXAMINE:
            result = self._part(x, *rigs)
        elif kind == _POLISH:
            x, value = polish(growth, x, rigs, self._limits)
            result = {"x": x, "value": np.array(value)}
        else:
            found = [ascend(growth, x, *rigs)] if kind == _ASCENT else [(u, *growth.value(x, u)) for u in rigs]
            result = dict(zip(Found._fields, map(np.array, zip(*found))))
        return {**result, "count": np.array(growth.count - before)}

    def _part(self, x: Array, low: Array, high: Array, first: Array, last: Array) -> Arrays:
        """What is known of a part of a box."""
        growth = self._growth
        key = (*x.tolist(), *low.tolist(), *high.tolist())
        try:
            if key not in self._examined:
                if len(self._examined) >= _KEPT:
                    self._examined.clear()
                self._examined[key] = Examination(
                    lambda u: growth.matrix(x, low + (high - low) * u), len(low), self._target, growth.band
                )
            return self._examined[key].examined(first, last)
        except NoProof as fault:
            return {"why": np.array(str(fault))}


def here(growth: Growth, limits: Sequence[Limit] = ()) -> Tasks:
    """Return tasks that this process computes when they are asked for."""
    computer = Computer(lambda: growth, limits)
    return Tasks(growth, limits, lambda units, _: [computer(unit, *given) for unit, given in units.items()])


def whole(count: int) -> Region:
    """Return the region of the stated box of `count` values."""
    return Region(np.zeros(count), np.ones(count))


def worst(tasks: Tasks, x: Array, region: Region | None = None, seeds: Array | None = None) -> Found:
    """Return the worst rigs of design x [free] in a region, the worst first; `seeds` [k, uncertain]: tried as well."""
    centre = tasks.growth.box.centre[None]
    region = whole(centre.shape[1]) if region is None else region
    other = centre if seeds is None else np.vstack([centre, seeds])
    tried = np.vstack([np.clip(other, *region), _levels(tasks.growth, x, region)])
    return ascended(tasks, x, region, tasks.growths(x, np.unique(tried, axis=0)))


def _levels(growth: Growth, x: Array, region: Region) -> Array:
    """The rigs [k, uncertain] from which a search for the worst one begins."""
    low, high = region
    middle = 0.5 * (low + high)
    each = [sorted(set(ends)) for ends in zip(low, middle, high)]
    if len(low) <= _ALL:
        return np.array([*itertools.product(*each)]).reshape(-1, len(low))
    corners = np.array([*itertools.product(*zip(low, high))])
    pieces = growth.pieces(x, middle, of_rig=True, kept=1)
    influence = np.max([np.abs(piece.slope) for piece in pieces], axis=0) if pieces else np.ones(len(low))
    first = np.argsort(-influence * (high - low), kind="stable")[:_ALL]
    grid = np.array([*itertools.product(*(each[i] for i in first))])
    inner = np.tile(middle, (len(grid), 1))
    inner[:, first] = grid
    return np.vstack([corners, inner])


def ascended(tasks: Tasks, x: Array, region: Region, found: Found) -> Found:
    """Return the rigs that ascents from the worst of `found` reach, the worst first."""
    width = np.maximum(region.high - region.low, 1e-300)
    starts: list[Array] = []
    for u in found.u[np.argsort(-found.growth, kind="stable")]:
        if len(starts) < _STARTS and all(np.abs((u - other) / width).max() > _APART for other in starts):
            starts.append(u)
    reached = tasks.ascents(x, np.array(starts), region)
    order = np.argsort(-reached.growth, kind="stable")
    return Found(*(values[order] for values in reached))
