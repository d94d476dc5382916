"""Where growth rates pass zero along a parameter, and where they end: brackets for a root finder, found on a grid.

    growths(value)   growth rates in falling order [1/s], zero where growth is none; None where nothing slides steadily

The grid is refined where a rate bends so much that it could reach zero between two values, and up to the edges of
stretches in which something slides. Two crossings of one rate closer together than the grid can still be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Growths = Callable[[float], Array | None]
EDGE = 1e-9  # of the gap between two values: how closely the end of a stretch is found
_DEPTH = 6  # halvings of a gap in which a rate could reach zero
_CUSP = 4.0  # times the steps to both sides, growth may rise to a peak between: it bends like a root where modes meet
_LEVEL = 1e-9


class Bracket(NamedTuple):
    """Rate number `k` changes its sign between `a` and `b`.

    how   passes   it passes zero between them
          begins   it is none at one of them: a motion without damping begins to grow, which leaves zero between them
          ends     it is zero at b, where the stretch ends, and below zero at a
    """

    k: int
    a: float
    b: float
    how: Literal["passes", "begins", "ends"] = "passes"


def refined(values: Sequence[float], growths: Growths) -> list[float]:
    """`values` with those between them that have to be looked at, in their order."""
    grid = [values[0]]
    for a, b in pairwise(values):
        grid += [*_between(a, b, growths, _DEPTH), b]
    return grid


def stretches(grid: Sequence[float], growths: Growths) -> list[list[float]]:
    """The values of a grid at which something slides, cut where nothing does."""
    found: list[list[float]] = [[]]
    for value in grid:
        if growths(value) is not None:
            found[-1].append(value)
        elif found[-1]:
            found.append([])
    return [one for one in found if one]


def _between(a: float, b: float, growths: Growths, depth: int) -> list[float]:
    """Values to look at between a and b, in their order."""
    at_a, at_b, middle = growths(a), growths(b), 0.5 * (a + b)
    if at_a is None and at_b is not None:
        inside, outside = edge(b, a, lambda value: growths(value) is not None)
        return [outside, inside, *_between(inside, b, growths, depth)]
    if at_a is not None and at_b is None:
        inside, outside = edge(a, b, lambda value: growths(value) is not None)
        return [*_between(a, inside, growths, depth), inside, outside]
    here = growths(middle)
    left = right = (at_a is None) != (here is None)
    if at_a is not None and at_b is not None and here is not None and depth > 0:
        count = min(len(at_a), len(here), len(at_b))
        first, half, last = at_a[:count], here[:count], at_b[:count]
        bend = np.abs(half - 0.5 * (first + last))
        left, right = _could(first, half, bend), _could(half, last, bend)
    return [
        *(_between(a, middle, growths, depth - 1) if left else ()),
        middle,
        *(_between(middle, b, growths, depth - 1) if right else ()),
    ]


def _could(a: Array, b: Array, bend: Array) -> bool:
    """Whether a rate of one sign at both ends could have the other between: a parabola bends a quarter as much here."""
    return bool(np.any((a * b > 0.0) & (np.minimum(np.abs(a), np.abs(b)) <= bend)))


def edge(inside: float, outside: float, holds: Callable[[float], bool]) -> tuple[float, float]:
    """The last value on the way from `inside` to `outside` where `holds` is true, and the first where it is not."""
    least = EDGE * abs(outside - inside)
    while abs(outside - inside) > least and (middle := 0.5 * (inside + outside)) not in (inside, outside):
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside, outside


def brackets(stretch: Sequence[float], growths: Growths) -> Iterator[Bracket]:
    """Every sign change of every rate along a stretch."""
    if len(stretch) < 2:
        return
    tables = [growths(value) for value in stretch]
    count = min(len(one) for one in tables if one is not None)
    for k in range(count):
        x = sorted({*stretch, *_islands(stretch, k, growths)}, reverse=stretch[0] > stretch[-1])
        yield from _passing(k, x, [_sign(growths, value, k) for value in x])


def _sign(growths: Growths, value: float, k: int) -> int:
    rates = growths(value)
    return int(np.sign(rates[k])) if rates is not None and k < len(rates) else 0


def _islands(x: Sequence[float], k: int, growths: Growths) -> Iterator[float]:
    """Values between those of the grid at which rate number k has another sign than on both sides."""
    from scipy.optimize import minimize_scalar

    def growth(value: float) -> float:
        rates = growths(value)
        return float(rates[k]) if rates is not None and k < len(rates) else 0.0

    at = [growth(value) for value in x]
    for i in range(1, len(x) - 1):
        sign = 1.0 if at[i] > 0.0 else -1.0
        left, here, right = (sign * g for g in at[i - 1 : i + 2])
        least = 0.0 < here < min(left, right) * (1.0 - _LEVEL)
        if least and here < _CUSP * (max(left, right) - here):  # a bend that could reach zero beside this value
            ends = sorted((x[i - 1], x[i + 1]))
            options = {"xatol": 1e-6 * (ends[1] - ends[0])}
            found = minimize_scalar(
                lambda v, s=sign: s * growth(float(v)), bounds=ends, method="bounded", options=options
            )
            if found.fun < 0.0:
                yield float(found.x)


def _passing(k: int, x: Sequence[float], signs: Sequence[int]) -> Iterator[Bracket]:
    """Neighbours between which the sign of rate k changes. A lone zero is a value that is a critical one by chance."""
    clear = [i for i, sign in enumerate(signs) if sign]
    for i, j in pairwise(clear):
        if signs[i] != signs[j] and j - i <= 2:
            yield Bracket(k, x[i], x[j])
    for i, (a, b) in enumerate(pairwise(signs)):
        beyond = i - 1 if a == 0 else i + 2
        lone = 0 <= beyond < len(x) and signs[beyond] != 0
        if {a, b} == {0, 1} and not lone:
            yield Bracket(k, x[i], x[i + 1], "begins")
    for end, beside in ((0, 1), (-1, -2)):
        if signs[end] == 0 and signs[beside] == -1:
            yield Bracket(k, x[beside], x[end], "ends")
