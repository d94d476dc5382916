"""The eigenvalues of a scene followed along a parameter, and the zeros of their growth rates.

Two spectra are paired by the modal assurance criterion (MAC) of their left and right eigenvectors and by the distance
of the eigenvalues:

    MAC_ij = |(l_i r'_j)(l'_j r_i)| / |(l_i r_i)(l'_j r'_j)|      one for the same mode, whatever the units

Zeros of growth rates, and ends of the ranges in which they exist, are bracketed on a grid, then found as roots of

    growths(value)   growth rates in falling order [1/s], and the size below which each is zero; None without steady
                     sliding

The grid is refined where the curvature of a rate allows a zero between two values, and up to the edges of stretches
with steady sliding. A function that finds no steady sliding between two values of a stretch raises a `Hole`. Then the
grid is refined up to the edges of the hole and searched again, so that no root lies in a range without steady sliding.
Two crossings of one rate that are closer together than the grid can still be missed, and so can a hole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.linear.modes import Slow, at_rest, missing, under_dither
from rig.design.linearised import energy_form
from rig.errors import Singular
from rig.model.assembly import Accuracy
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
SURE = 0.7  # MAC of a pair that needs no smaller step
# Why eigenvalues are invalid, or there are none
NOTHING = "no steady sliding"
OPENS = "the contact would open"
JAMS = "jams"
SLOW = "the dither is not fast"
DEPTH = 8  # most halvings of a step between two values whose pairs are not certain
Scan = TypeVar("Scan")
RELATIVE = 4.0 * float(np.finfo(float).eps)  # finest relative tolerance of a root
NEUTRAL = 1e-9  # of |lambda|: growth below this is zero
ROUNDING = 1e-12  # of the largest |lambda|
EDGE = 1e-9  # of the gap between two values: tolerance of the end of a stretch
_DEPTH = 6  # most halvings of a gap in which a rate could reach zero
_SEARCH = 3  # halvings of a gap without steady sliding at both ends
_GOLDEN = 0.381966  # of the larger part of a bracket: golden section
_CUSP = 4.0  # a minimum below this multiple of the rise beside it may reach zero: growth has a kink where modes meet
_LEVEL = 1e-9  # of a rate: beside values that differ by less it has no minimum
LARGE = 64  # states of a rig: beyond, a step far from zero is not examined in its middle
_SAFE = 4.0  # times the bend that the values around a step show
_FIRST = 2.0**-10  # of the way from a hole to the next value of the grid: the first step
_BESIDE = (2.0**-3, 2.0**-6, 2.0**-9)  # of the way from the end of a stretch to the next value of the grid


class Spectrum(NamedTuple):
    """Eigenvalues `rates` [i], least stable first, right and left vectors [state, i], names of the states.

    The first `own` states belong to the rig, and the first of these are its `coordinates`. `exists`: whether steady
    sliding exists there; `counts`: whether the eigenvalues are valid; `note`: what makes them invalid, with the reason
    `why` in words. `inertia`: determinant of the mass matrix with friction over that without; below zero the rig jams.
    `energy`: rig.design.linearised.energy_form over the first states; empty if it is not known. `errors`: of a reduced
    structure: returns the estimated relative error [i] of each rate, NaN where there is none; `outside`: which numbers
    lie outside of the range that the reduction holds for, in words.
    """

    rates: Complex
    right: Complex
    left: Complex
    names: tuple[str, ...]
    coordinates: int
    own: int
    exists: bool = True
    counts: bool = True
    note: str = ""
    inertia: float = 1.0
    why: str = ""
    energy: Array = np.zeros((0, 0))
    errors: Callable[[], Array] | None = None
    outside: str = ""


Spectra = Callable[[float], Spectrum]


@dataclass(frozen=True)
class Growth:
    """Growth rates in falling order [1/s], and for each the size that rounding can cause: below it the rate is zero.

    `large`: of a rig with so many states that a spectrum takes long.
    """

    rates: Array
    none: Array
    large: bool = False

    def sign(self, k: int) -> int:
        """Return the sign of rate number k; 0 if it is zero or does not exist."""
        return int(np.sign(self.clear[k])) if k < len(self.rates) else 0

    @cached_property
    def clear(self) -> Array:
        """The rates, with those below rounding set to zero."""
        return np.where(np.abs(self.rates) > self.none, self.rates, 0.0)


Growths = Callable[[float], Growth | None]


class Hole(Exception):
    """There is no steady sliding at `value`, which lies between two values of a stretch."""

    def __init__(self, value: float) -> None:
        super().__init__(value)
        self.value = value


class Bracket(NamedTuple):
    """Rate number `k` changes its sign between `a` and `b`.

    how   passes   it passes zero between them
          begins   it is zero at one of them: an undamped mode begins to grow, which leaves zero between them
          ends     it is zero at b, where the stretch ends, and below zero at a
    """

    k: int
    a: float
    b: float
    how: Literal["passes", "begins", "ends"] = "passes"


def of_matrix(A: Array) -> tuple[Complex, Complex, Complex]:
    """Return eigenvalues, least stable first, right and left vectors [state, i] of A."""
    from scipy.linalg import eig

    values, left, right = eig(A, left=True, right=True)
    order = np.lexsort((-values.imag, -values.real))
    return values[order], right[:, order], left[:, order].conj()


def sliding(at: Steady, up_to: float = np.inf) -> Spectrum:
    """Return the spectrum of steady sliding up to a frequency [Hz]."""
    rates, right, left = of_matrix(at.A[np.ix_(at.moving, at.moving)])
    kept = np.abs(rates.imag) <= 2.0 * np.pi * up_to
    rates = rates[kept]
    right = right[:, kept]
    left = left[:, kept]
    names = tuple(at.system.names[i] for i in at.moving)
    nq = len(at.system.coordinates)
    why = "" if at.exists else missing(at)
    energy = energy_form(at)[np.ix_(at.moving, at.moving)]
    note = _note(at)
    return Spectrum(rates, right, left, names, nq, len(names), at.exists, at.counts, note, at.inertia, why, energy)


def _note(at: Steady) -> str:
    """What makes the eigenvalues of sliding invalid; "" if nothing does."""
    if at.inertia <= 0.0:
        return JAMS
    if at.exists:
        return ""
    return OPENS if at.counts and not at.beyond else NOTHING


def pairs(a: Spectrum, b: Spectrum) -> tuple[NDArray[np.int64], bool]:
    """Return for each rate of `a` the index of its continuation in `b` (-1: none), and whether all pairs are
    certain.
    """
    from scipy.optimize import linear_sum_assignment

    if a.names == b.names:
        across = a.left.T @ b.right
        back = b.left.T @ a.right
        size_a = np.abs(np.sum(a.left * a.right, axis=0))
        size_b = np.abs(np.sum(b.left * b.right, axis=0))
        sizes = size_a[:, None] * size_b[None, :]
        mac = np.minimum(np.abs(across * back.T) / np.maximum(sizes, 1e-300), 1.0)
    else:
        mac = np.ones((len(a.rates), len(b.rates)))
    far = np.abs(a.rates[:, None] - b.rates[None, :])
    size = max(float(np.abs(a.rates).max(initial=0.0)), float(np.abs(b.rates).max(initial=0.0)), 1e-300)
    rows, columns = linear_sum_assignment(1.0 - mac + far / size)
    partners = np.full(len(a.rates), -1, dtype=np.int64)
    partners[rows] = columns
    return partners, bool(np.all(mac[rows, columns] > SURE)) and len(a.rates) == len(b.rates)


def follow(spectra: Spectra, x: float, a: Spectrum, y: float, b: Spectrum, depth: int = DEPTH) -> NDArray[np.int64]:
    """Return the `pairs` of spectrum a at x and spectrum b at y, with as many values between as certainty needs."""
    partners, sure = pairs(a, b)
    if sure or depth == 0:
        return partners
    middle = 0.5 * (x + y)
    half = spectra(middle)
    if not half.counts or len(half.rates) != len(a.rates):
        return partners
    first = follow(spectra, x, a, middle, half, depth - 1)
    second = follow(spectra, middle, half, y, b, depth - 1)
    return np.where(first >= 0, second[first], -1)


def equilibrium(scene: Scene, dithered: bool = False) -> Spectrum:
    """Return the spectrum of a scene at its sliding equilibrium, without controllers.

    `dithered`: with the friction averaged over its dither, else with dither off.
    """
    try:
        if dithered:
            return sliding(under_dither(scene))
        assembly, at = at_rest(scene)
        spectrum = sliding(at, assembly.up_to)
        if assembly.accuracy is not None:
            moving = at.A[np.ix_(at.moving, at.moving)]
            errors = partial(_errors, assembly.accuracy, moving, spectrum.rates)
            spectrum = spectrum._replace(errors=errors, outside="; ".join(assembly.outside))
        return spectrum
    except Slow as error:
        return absent(SLOW, str(error))
    except Singular as error:
        return absent(JAMS, "friction takes up all of the inertia", 0.0) if error.jams else absent(NOTHING, error.why)


def _errors(accuracy: Callable[[Array, bool], Accuracy], jacobian: Array, rates: Complex) -> Array:
    return accuracy(jacobian, True).of(rates)


def absent(note: str, why: str, inertia: float = 1.0) -> Spectrum:
    """Return the empty spectrum of a place without steady sliding."""
    none = np.zeros((0, 0), dtype=np.complex128)
    return Spectrum(none.diagonal(), none, none, (), 0, 0, False, False, note, inertia, why)


def none(rates: NDArray[np.complex128]) -> Array:
    """Return the growth rate [1/s] of each mode below which it is zero: rounding error of an undamped mode."""
    size = np.abs(rates)
    return np.asarray(np.maximum(NEUTRAL * size, ROUNDING * size.max(initial=0.0)))


def looked(values: Sequence[float], growths: Growths, look: Callable[[list[float]], Scan]) -> Scan:
    """Return the result of `look` on the refined grid of `values`; where it raises a `Hole`, the grid is cut there
    first.
    """
    grid = refined(values, growths)
    while True:
        try:
            return look(grid)
        except Hole as hole:
            grid = _cut(grid, hole.value, growths)


def _cut(grid: Sequence[float], hole: float, growths: Growths) -> list[float]:
    """The grid with the edges of the range without steady sliding around `hole`."""
    falls = grid[0] > grid[-1]
    i = next(i for i, value in enumerate(grid) if (value < hole if falls else value > hole))
    a, b = grid[i - 1 : i + 1]
    edges = [a, _beside(hole, a, growths), hole, _beside(hole, b, growths), b]
    around = refined(list(dict.fromkeys(edges)), growths)
    return [*grid[: i - 1], *around, *grid[i + 1 :]]


def _beside(hole: float, end: float, growths: Growths) -> float:
    """The first value with steady sliding on the way from a hole to `end`, in steps that double.

    The search for the edge begins close to the hole, because other holes may lie between it and the end.
    """
    share = _FIRST
    while share < 1.0:
        value = hole + share * (end - hole)
        if growths(value) is not None:
            return value
        share *= 2.0
    return end


def growth_at(value: float, growths: Growths) -> Growth:
    """Return the growth at a value inside of a stretch. Raises Hole if there is no steady sliding."""
    growth = growths(value)
    if growth is None:
        raise Hole(value)
    return growth


def root(bracket: Bracket, growths: Growths) -> float:
    """Return the value in a bracket at which its rate passes zero, to rounding (Brent). Raises Hole."""
    from scipy.optimize import brentq

    k, a, b, how = bracket
    if how == "ends":
        return b

    def growth(value: float) -> float:
        rates = growth_at(value, growths)
        return float(rates.rates[k] - (rates.none[k] if how == "begins" else 0.0))

    return float(brentq(growth, a, b, xtol=1e-15 * max(abs(a), abs(b)), rtol=RELATIVE, maxiter=200))


def roots(values: Sequence[float], growths: Growths) -> list[float]:
    """Return the values between those of a grid, ends included, at which a rate passes zero."""

    def look(grid: list[float]) -> list[float]:
        return [root(bracket, growths) for part in stretches(grid, growths) for bracket in brackets(part, growths)]

    return looked(values, growths, look)


def grows(growth: Growth | None) -> bool:
    """Return whether the fastest rate grows; False without steady sliding."""
    return growth is not None and growth.sign(0) > 0


def limits(values: Sequence[float], growths: Growths) -> list[tuple[float, bool]]:
    """Return the values from which on, as they rise, the one rate of `growths` grows (True) or no longer does (False):
    there it passes zero, or steady sliding ends. What is narrower than `EDGE` of the range of `values` is left out.
    """

    def look(grid: list[float]) -> list[tuple[float, bool]]:
        limits: list[tuple[float, bool]] = []
        for a, b in pairwise(sorted(grid)):
            below = growths(a)
            above = growths(b)
            if (below is None or above is None) and grows(below) != grows(above):
                limits.append((a if below is None else b, grows(above)))
        for stretch in stretches(grid, growths):
            passed = [bracket for bracket in brackets(stretch, growths) if bracket.how != "ends"]
            limits += [(root(bracket, growths), grows(growths(max(bracket.a, bracket.b)))) for bracket in passed]
        return sorted(limits)

    return list(_wide(looked(values, growths, look), EDGE * abs(values[-1] - values[0])))


def _wide(limits: list[tuple[float, bool]], least: float) -> Iterator[tuple[float, bool]]:
    """The limits without those of bands of growth that are narrower than `least`."""
    left = iter(limits)
    for limit in left:
        following = next(left, None) if limit[1] else None
        if following is not None and following[0] - limit[0] <= least:
            continue
        yield limit
        if following is not None:
            yield following


def refined(values: Sequence[float], growths: Growths) -> list[float]:
    """Return `values` and the values between them that have to be examined, in their order."""
    grid = [values[0]]
    for i, (a, b) in enumerate(pairwise(values)):
        if not _straight(values[max(i - 1, 0) : i + 3], growths):
            grid += _between(a, b, growths, _DEPTH)
        grid.append(b)
    return grid


def _straight(values: Sequence[float], growths: Growths) -> bool:
    """Whether the values around a step show, without one inside of it, that no rate of a large rig reaches zero there.

    `values`: evenly spaced, those of the step and one on each side; each spectrum of a large rig takes long.
    """
    around = [growths(value) for value in values]
    if len(around) < 4 or any(growth is None or not growth.large for growth in around):
        return False
    rates = [growth.clear for growth in around if growth is not None]
    count = min(map(len, rates))
    before, a, b, after = (rate[:count] for rate in rates)
    bend = _SAFE / 8.0 * np.maximum(np.abs(before - 2.0 * a + b), np.abs(a - 2.0 * b + after))
    clear = np.minimum(np.abs(a), np.abs(b)) > bend
    return bool(np.all((a * b > 0.0) & clear))


def stretches(grid: Sequence[float], growths: Growths) -> list[list[float]]:
    """Return the values of a grid with steady sliding, split where there is none."""
    parts: list[list[float]] = [[]]
    for value in grid:
        if growths(value) is not None:
            parts[-1].append(value)
        elif parts[-1]:
            parts.append([])
    return [part for part in parts if part]


def _between(a: float, b: float, growths: Growths, depth: int) -> list[float]:
    """Values to examine between a and b, in their order."""
    at_a = growths(a)
    at_b = growths(b)
    middle = 0.5 * (a + b)
    if at_a is None and at_b is not None:
        inside, outside = edge(b, a, lambda value: growths(value) is not None)
        near = _approach(b, inside, growths, depth)[::-1]
        return [*_between(a, outside, growths, depth), outside, inside, *near]
    if at_a is not None and at_b is None:
        inside, outside = edge(a, b, lambda value: growths(value) is not None)
        return [*_approach(a, inside, growths, depth), inside, outside, *_between(outside, b, growths, depth)]
    at_middle = growths(middle)
    left = right = (at_a is None) != (at_middle is None) or (at_middle is None and depth > _DEPTH - _SEARCH)
    if at_a is not None and at_b is not None and at_middle is not None and depth > 0:
        count = min(len(growth.rates) for growth in (at_a, at_middle, at_b))
        first, half, last = (growth.clear[:count] for growth in (at_a, at_middle, at_b))
        bend = np.abs(half - 0.5 * (first + last))
        left = _could(first, half, bend)
        right = _could(half, last, bend)
    return [
        *(_between(a, middle, growths, depth - 1) if left else ()),
        middle,
        *(_between(middle, b, growths, depth - 1) if right else ()),
    ]


def _approach(far: float, end: float, growths: Growths, depth: int) -> list[float]:
    """Values to examine between `far` and the end of a stretch, beside which growth changes fastest."""
    beside = [end + share * (far - end) for share in _BESIDE]
    return [*_between(far, beside[0], growths, depth), *beside]


def _could(a: Array, b: Array, bend: Array) -> bool:
    """Whether a rate of one sign at both ends could change sign between them: a parabola bends a quarter as
    much here.
    """
    near = np.minimum(np.abs(a), np.abs(b)) <= bend
    return bool(np.any((a * b > 0.0) & near))


def edge(inside: float, outside: float, holds: Callable[[float], bool], least: float = 0.0) -> tuple[float, float]:
    """Return the last value from `inside` to `outside` at which `holds` is true, and the first at which it is not, by
    halving. `least`: their distance, by default `EDGE` of the way.
    """
    least = least or EDGE * abs(outside - inside)
    while abs(outside - inside) > least:
        middle = 0.5 * (inside + outside)
        if middle in (inside, outside):
            break
        if holds(middle):
            inside = middle
        else:
            outside = middle
    return inside, outside


def brackets(stretch: Sequence[float], growths: Growths) -> Iterator[Bracket]:
    """Yield every sign change of every rate along a stretch. Raises Hole."""
    if len(stretch) < 2:
        return
    count = min(len(growth_at(value, growths).rates) for value in stretch)
    for k in range(count):
        x = sorted({*stretch, *_islands(stretch, k, growths)}, reverse=stretch[0] > stretch[-1])
        yield from _passing(k, x, [growth_at(value, growths).sign(k) for value in x])


def _islands(x: Sequence[float], k: int, growths: Growths) -> Iterator[float]:
    """Values between those of the grid at which rate number k has another sign than on both sides."""

    def growth(value: float) -> float:
        rates = growth_at(value, growths).clear
        return float(rates[k]) if k < len(rates) else 0.0

    at = [growth(value) for value in x]
    for i in range(1, len(x) - 1):
        sign = 1.0 if at[i] > 0.0 else -1.0
        left, least, right = (sign * g for g in at[i - 1 : i + 2])
        if 0.0 < least < min(left, right) * (1.0 - _LEVEL):
            value = _dip(x[i - 1 : i + 2], (left, least, right), lambda v, s=sign: s * growth(v))  # type: ignore[misc]
            if value is not None:
                yield value


def _dip(x: Sequence[float], f: tuple[float, float, float], of: Callable[[float], float]) -> float | None:
    """A value at which a function is below zero, from three values `x` with a least one `f` > 0 in the middle; or None.

    The golden section goes on while the bend is one that could reach zero beside the least value, even with a cusp.
    """
    a, m, b = x
    left, least, right = f
    close = 1e-6 * abs(b - a)
    while 0.0 < least < _CUSP * (max(left, right) - least) and abs(b - a) > close:
        upwards = abs(b - m) > abs(m - a)
        new = m + _GOLDEN * ((b if upwards else a) - m)
        value = of(new)
        if value < least and upwards:
            a, left = m, least
            m, least = new, value
        elif value < least:
            b, right = m, least
            m, least = new, value
        elif upwards:
            b, right = new, value
        else:
            a, left = new, value
    return m if least < 0.0 else None


def _passing(k: int, x: Sequence[float], signs: Sequence[int]) -> Iterator[Bracket]:
    """Neighbours between which the sign of rate k changes. A single zero is a value that happens to be critical."""
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
