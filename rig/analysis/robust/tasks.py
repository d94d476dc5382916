"""The units of work of a design: growths of rigs, ascents to a worst rig, designs polished against a set of rigs.

A search asks for many of them at once and gets their results in order; a pool computes them (rig.analysis.pool). Each
is a function of its numbers alone, so that neither the number of workers nor an interruption changes a result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.pool import Arrays
from rig.analysis.robust.ascent import ascend
from rig.analysis.robust.growth import Growth
from rig.analysis.robust.limits import Limit
from rig.analysis.robust.polish import polish

Array = NDArray[np.float64]
Units = Mapping[int, tuple[float, ...]]
_GROWTHS, _ASCENT, _POLISH = range(3)
_ASCENDED, _STEPS = 10, 8  # steps of an ascent and of a polish, about
_CHUNK = 64  # rigs of a unit: 0.1 to 0.3 s


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

    `carry_out`: computes units (number -> numbers that it is given) and returns the results of all of them.
    """

    def __init__(self, growth: Growth, limits: Sequence[Limit], carry_out: Callable[[Units], list[Arrays]]) -> None:
        self.growth = growth
        self.limits = limits
        self.count = 0
        """Rigs that were assembled so far."""
        self._carry_out = carry_out
        self._next = 0

    def growths(self, X: Array, U: Array) -> Found:
        """The growth of designs X [k, free] with rigs U [k, uncertain]; one design or one rig for all may be given."""
        X, U = np.atleast_2d(X), np.atleast_2d(U)
        count = max(len(X), len(U))
        X = np.broadcast_to(X, (count, X.shape[1]))
        U = np.broadcast_to(U, (count, U.shape[1]))
        both = np.hstack([X, U])
        results = self._ask([(_GROWTHS, *both[i : i + _CHUNK].ravel().tolist()) for i in range(0, count, _CHUNK)])
        growth = np.concatenate([result["growth"] for result in results])
        return Found(U, growth, np.concatenate([result["hertz"] for result in results]))

    def ascents(self, x: Array, U: Array, region: Region) -> Found:
        """The worst rigs of design x that ascents from U [k, uncertain] reach within a region."""
        given = [(_ASCENT, *x.tolist(), *u.tolist(), *region.low.tolist(), *region.high.tolist()) for u in U]
        results = self._ask(given)
        growth = np.array([result["growth"] for result in results])
        return Found(np.array([result["u"] for result in results]), growth, np.array([r["hertz"] for r in results]))

    def polished(self, X: Array, U: Array) -> tuple[Array, Array]:
        """The designs [k, free] that descents from X reach against rigs U, and the value of each, the best first."""
        results = self._ask([(_POLISH, *x.tolist(), *U.ravel().tolist()) for x in X])
        values = np.array([float(result["value"]) for result in results])
        order = np.argsort(values, kind="stable")
        return np.array([result["x"] for result in results])[order], values[order]

    def rigs(self, given: Sequence[float]) -> int:
        """About how many rigs a unit assembles."""
        d, m = len(self.growth.box.free), len(self.growth.box.uncertain)
        if given[0] == _GROWTHS:
            return (len(given) - 1) // (d + m)
        return _ASCENDED * (m + 1) if given[0] == _ASCENT else _STEPS * (d + 2) * ((len(given) - 1 - d) // m)

    def _ask(self, given: Sequence[tuple[float, ...]]) -> list[Arrays]:
        units = dict(enumerate(given, self._next))
        self._next += len(units)
        results = self._carry_out(units)
        self.count += sum(int(result["count"]) for result in results)
        return results


def compute(growth: Growth, limits: Sequence[Limit], given: Sequence[float]) -> Arrays:
    """Compute one unit: its kind and its numbers."""
    kind, *numbers = given
    rest = np.array(numbers)
    d = len(growth.box.free)
    m = len(growth.box.uncertain)
    before = growth.count
    if kind == _GROWTHS:
        rows = rest.reshape(-1, d + m)
        values = np.array([growth.value(row[:d], row[d:]) for row in rows])
        result = {"growth": values[:, 0], "hertz": values[:, 1]}
    elif kind == _ASCENT:
        u, low, high = rest[d:].reshape(3, m)
        u, value, hertz = ascend(growth, rest[:d], u, low, high)
        result = {"u": u, "growth": np.array(value), "hertz": np.array(hertz)}
    else:
        x, value = polish(growth, rest[:d], rest[d:].reshape(-1, m), limits)
        result = {"x": x, "value": np.array(value)}
    return {**result, "count": np.array(growth.count - before)}


def here(growth: Growth, limits: Sequence[Limit] = ()) -> Tasks:
    """Return tasks that this process computes when they are asked for."""

    def carry_out(units: Units) -> list[Arrays]:
        return [compute(growth, limits, given) for given in units.values()]

    return Tasks(growth, limits, carry_out)
