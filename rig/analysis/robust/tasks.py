"""The units of work of a design: growths of rigs, ascents to a worst rig, designs polished against a set of rigs, parts
of a box examined.

A search asks for many of them at once and gets their results in order; a pool computes them (rig.analysis.pool). Each
is a function of its numbers alone, so that neither the number of workers nor an interruption changes a result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.pool import Arrays
from rig.analysis.robust.box import Limit
from rig.analysis.robust.certificate import Examination, NoProof
from rig.analysis.robust.descent import ascend, polish
from rig.analysis.robust.growth import Growth, NoSliding

Array = NDArray[np.float64]
Units = Mapping[int, tuple[float, ...]]
_GROWTHS, _ASCENT, _POLISH, _DIVIDED = range(4)
_ASCENDED, _STEPS = 10, 8  # steps of an ascent and of a polish, about
_CHUNK = 64  # rigs of a unit: 0.1 to 0.3 s
_EXAMINED = 32  # boxes whose polynomials are kept


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

    `carry_out`: computes units (number -> numbers that it is given) and returns the results of all of them. `next`: the
    number of the first one.
    """

    def __init__(
        self, growth: Growth, limits: Sequence[Limit], carry_out: Callable[[Units], list[Arrays]], next: int = 0
    ) -> None:
        self.growth = growth
        self.limits = limits
        self.count = 0
        """Rigs that were assembled so far."""
        self.next = next
        """Number of the next unit."""
        self._carry_out = carry_out

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

    def divided(self, x: Array, parts: Sequence[Array], limit: float, most: int) -> list[Arrays]:
        """What is known of rigs of design x in `parts` [part][4, uncertain], each the two corners of a box and its own
        within that: results of `rig.analysis.robust.certificate.Examination.divided`, or "why" there is none.
        """
        return self._ask([(_DIVIDED, *x.tolist(), *part.ravel().tolist(), limit, most) for part in parts])

    def rigs(self, given: Sequence[float]) -> int:
        """About how many rigs a unit assembles."""
        d, m = len(self.growth.box.free), len(self.growth.box.uncertain)
        if given[0] == _GROWTHS:
            return (len(given) - 1) // (d + m)
        return _ASCENDED * (m + 1) if given[0] == _ASCENT else _STEPS * (d + 2) * ((len(given) - 1 - d) // m)

    def _ask(self, given: Sequence[tuple[float, ...]]) -> list[Arrays]:
        units = dict(enumerate(given, self.next))
        self.next += len(units)
        results = self._carry_out(units)
        self.count += sum(int(result["count"]) for result in results)
        return results


class Computer:
    """Computes units. The matrices of boxes, as polynomials, are kept for the other parts of each."""

    def __init__(self, growth: Growth, limits: Sequence[Limit]) -> None:
        self._growth = growth
        self._limits = limits
        self._examined: dict[tuple[float, ...], Examination] = {}

    def __call__(self, given: Sequence[float]) -> Arrays:
        """Return the result of one unit: `given` are its kind and its numbers."""
        growth = self._growth
        kind, *numbers = given
        x, rest = np.split(np.array(numbers), [len(growth.box.free)])
        m = len(growth.box.uncertain)
        before = growth.count
        if kind == _GROWTHS:
            rows = np.array(numbers).reshape(-1, len(x) + m)
            values = np.array([growth.value(*np.split(row, [len(x)])) for row in rows])
            result = {"growth": values[:, 0], "hertz": values[:, 1]}
        elif kind == _ASCENT:
            u, value, hertz = ascend(growth, x, *rest.reshape(3, m))
            result = {"u": u, "growth": np.array(value), "hertz": np.array(hertz)}
        elif kind == _POLISH:
            x, value = polish(growth, x, rest.reshape(-1, m), self._limits)
            result = {"x": x, "value": np.array(value)}
        else:
            result = self._divided(x, rest[:-2].reshape(4, m), *rest[-2:].tolist())
        return {**result, "count": np.array(growth.count - before)}

    def _divided(self, x: Array, part: Array, limit: float, most: float) -> Arrays:
        low, high, first, last = part
        key = (*x.tolist(), *low.tolist(), *high.tolist())
        try:
            if key not in self._examined:
                if len(self._examined) >= _EXAMINED:
                    self._examined.clear()
                self._examined[key] = self._examination(x, low, high, limit)
            return self._examined[key].divided(first, last, int(most))
        except NoSliding as fault:
            return {"why": np.array(f"a rig of the box has no growth: {fault}")}
        except NoProof as fault:
            return {"why": np.array(str(fault))}

    def _examination(self, x: Array, low: Array, high: Array, limit: float) -> Examination:
        growth = self._growth
        middle = growth.matrix(x, 0.5 * (low + high))

        def matrix(u: Array) -> Array:
            return growth.matrix(x, low + (high - low) * u).A

        return Examination(matrix, len(low), limit, growth.band, middle.period, middle.up_to)


def here(growth: Growth, limits: Sequence[Limit] = ()) -> Tasks:
    """Return tasks that this process computes when they are asked for."""
    computer = Computer(growth, limits)
    return Tasks(growth, limits, lambda units: [computer(given) for given in units.values()])
