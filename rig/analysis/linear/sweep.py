"""The eigenvalues of a rig along one of its parameters: branches, and the critical values where growth changes sign.

At a critical value a mode of steady sliding begins or stops to grow; the stability on both sides belongs to it. The
real parts of all eigenvalues in falling order are continuous functions of the parameter, even where branches cross or
coalesce. Therefore a critical value is a root of one of these functions. It is found to the rounding of the key (Brent)
without following a branch. Where friction falls with a kink, growth may jump over zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from rig.analysis.linear import eigenvalue_curves as curves
from rig.analysis.linear.modes import dithers, motion
from rig.analysis.linear.modes_report import shape_text
from rig.results import Column, Result, Table
from rig.scenes.axis import Axis, fixed
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene
from rig.structure.eigenvalues import DAMPED

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Kind = Literal["flutter", "divergence", "jump", "jamming"]
JUMP = 1e-3  # of the growth beside it: the residual at a root of a continuous function is far smaller
_SAME = 1e-9  # of the axis: critical values of one kind this close belong to one mode, a pair of eigenvalues
_MEETS = 0.25  # two frequencies meet at less than this share of their largest distance on the axis, [chosen]
_NEAR = 0.03  # and at less than this share of the frequency [chosen]


@dataclass(frozen=True)
class Critical:
    """A value of the key at which a mode stops or begins to grow, and the mode there.

    kind          flutter (an oscillation), divergence (a monotone growth), jump (growth leaps over zero), jamming
                  (friction takes up all of the inertia; no mode, branch -1)
    becomes       what this mode becomes as the key rises: "unstable" or "stable"
    branch        number of its branch in the sweep; `frequency` [Hz]
    shape         amplitude of each state; the one with most of the energy is 1; `energy`: share of each coordinate and
                  network state in the energy (rig.analysis.linear.modes); `regions`: of bodies instead
    below, above  number of growing eigenvalues just below and just above the value, of all modes; None where there is
                  no steady sliding or the axis ends
    """

    value: float
    kind: Kind
    becomes: Literal["unstable", "stable"]
    frequency: float
    branch: int
    shape: dict[str, complex]
    energy: dict[str, float]
    below: int | None = None
    above: int | None = None
    regions: Mapping[str, float] = field(default_factory=dict)

    @property
    def sides(self) -> str:
        """Stability of the whole rig on both sides of the value, in words."""
        if self.kind == "jamming":
            return f"jams {'above' if self.becomes == 'unstable' else 'below'}"
        if self.below == self.above == 0:
            return "the growth stays below rounding on both sides"
        if self.below and self.above:
            grow = "eigenvalue grows" if self.below == 1 else "eigenvalues grow"
            return f"unstable on both sides: {self.below} {grow} below, {self.above} above"
        if self.above is None:
            return "no result above" if self.below is None else f"{'un' * bool(self.below)}stable below"
        return f"{'un' * bool(self.above)}stable above"


class Gap(NamedTuple):
    """The range from `start` to `end` of the axis, ends included, without steady sliding: `note`, and reason `why`."""

    start: float
    end: float
    note: str
    why: str


class CriticalValues(NamedTuple):
    """Critical values in rising order, gaps in the order of the axis, and the widest distance between two values
    examined.
    """

    critical: tuple[Critical, ...]
    gaps: tuple[Gap, ...]
    resolution: float


def search(values: Sequence[float], rates: Complex, spectra: curves.Spectra) -> CriticalValues:
    """Find all critical values between the ends of `values`. `rates` [value, branch]: the branches of the sweep."""

    @lru_cache(maxsize=4096)
    def growths(value: float) -> curves.Growth | None:
        spectrum = spectra(value)
        if not spectrum.counts:
            return None
        large = len(spectrum.names) > curves.LARGE
        return curves.Growth(spectrum.rates.real, curves.none(spectrum.rates), large)

    def look(grid: list[float]) -> CriticalValues:
        known: list[Critical] = list(_jamming(grid, spectra))
        for stretch in curves.stretches(grid, growths):
            for bracket in curves.brackets(stretch, growths):
                critical = _at(spectra, bracket, curves.root(bracket, growths), values, rates)
                span = _SAME * abs(values[-1] - values[0])
                if not any(abs(c.value - critical.value) <= span and c.kind == critical.kind for c in known):
                    known.append(critical)
        known.sort(key=lambda critical: critical.value)
        resolution = max(abs(b - a) for a, b in pairwise(grid))
        return CriticalValues(tuple(_with_sides(known, grid, spectra)), tuple(_gaps(grid, spectra)), resolution)

    return curves.looked(values, growths, look)


def _with_sides(known: list[Critical], grid: Sequence[float], spectra: curves.Spectra) -> Iterator[Critical]:
    """Add what grows below and above, up to the next value of the grid or the next critical value."""
    places = sorted({*grid, *(critical.value for critical in known)})
    for critical in known:
        at = places.index(critical.value)
        below = above = None
        if at > 0:
            below = _beside(critical.value, places[at - 1], spectra)
        if at + 1 < len(places):
            above = _beside(critical.value, places[at + 1], spectra)
        yield replace(critical, below=below, above=above)


def _beside(value: float, near: float, spectra: curves.Spectra) -> int | None:
    """Number of growing eigenvalues half-way to the next value; None where they are not valid.

    Raises Hole if there is no steady sliding there.
    """
    middle = 0.5 * (value + near)
    between = spectra(middle)
    if between.counts:
        return int(np.count_nonzero(between.rates.real > curves.none(between.rates)))
    if spectra(value).counts and spectra(near).counts:
        raise curves.Hole(middle)
    return None


def _gaps(grid: Sequence[float], spectra: curves.Spectra) -> Iterator[Gap]:
    """Ranges without steady sliding, and why."""
    notes = [spectra(value).note for value in grid]
    least = curves.EDGE * abs(grid[-1] - grid[0])
    starts = [i for i in range(len(grid)) if i == 0 or notes[i] != notes[i - 1]]
    for first, beyond in pairwise([*starts, len(grid)]):
        note = notes[first]
        if not note:
            continue

        def holds(value: float, note: str = note) -> bool:
            return spectra(value).note == note

        last = beyond - 1
        start = grid[first]
        if first:
            start, _ = curves.edge(start, grid[first - 1], holds, least)
        end = grid[last]
        if beyond < len(grid):
            end, _ = curves.edge(end, grid[beyond], holds, least)
        yield Gap(start, end, note, spectra(grid[(first + last) // 2]).why)


def _jamming(grid: Sequence[float], spectra: curves.Spectra) -> Iterator[Critical]:
    """Values at which the determinant of the mass matrix with friction changes its sign."""
    from scipy.optimize import brentq

    def inertia(value: float) -> float:
        return spectra(value).inertia

    for a, b in pairwise(grid):
        first = inertia(a)
        other = inertia(b)
        if first * other < 0.0 or (first and not other):
            low, high = sorted((a, b))
            root = float(brentq(inertia, low, high, xtol=1e-300, rtol=curves.RELATIVE))
            rises = (other > first) == (b > a)
            yield Critical(root, "jamming", "stable" if rises else "unstable", 0.0, -1, {}, {})


def _at(
    spectra: curves.Spectra, bracket: curves.Bracket, root: float, values: Sequence[float], rates: Complex
) -> Critical:
    """The critical value at the root of a bracket."""
    k, a, b, how = bracket
    low, high = sorted((a, b))
    at = spectra(root)
    below = float(spectra(low).rates[k].real)
    above = float(spectra(high).rates[k].real)
    jumps = how == "passes" and abs(at.rates[k].real) > JUMP * min(abs(below), abs(above))
    grown = at
    if jumps:
        grown = spectra(high if above > 0.0 else low)
    upper = k  # of the pair
    if not grown.rates[k].imag >= 0.0:
        upper = int(np.abs(grown.rates - grown.rates[k].conj()).argmin())
    rate = grown.rates[upper]
    vector = grown.right[: grown.own, upper]
    kind: Kind = "flutter" if rate.imag else "divergence"
    if jumps:
        kind = "jump"
    rests = kind == "divergence"  # its rate at the root is rounding error
    shape, energy = motion(grown.names[: grown.own], vector, grown.energy, 0.0 if rests else rate, grown.coordinates)
    near = int(np.abs(np.array(values) - root).argmin())
    distance = np.where(np.isfinite(rates[near]), np.abs(rates[near] - rate), np.inf)
    return Critical(
        value=root,
        kind=kind,
        becomes="unstable" if above > below else "stable",
        frequency=float(rate.imag / (2.0 * np.pi)),
        branch=int(distance.argmin()),
        shape=shape,
        energy=energy,
    )


@dataclass(frozen=True)
class Sweep(Result):
    """Eigenvalues `rates` [value, branch] at the values of `axis`; NaN where a branch does not exist.

    `shapes` [value, branch, state]: amplitudes in the order of `states`. `exists` [value]: whether the rig slides
    steadily, and `notes` [value] what makes the eigenvalues invalid. `gaps`: ranges without steady sliding, and why.
    `resolution`: critical values closer together than this may be missed. `loop`: the controller whose loop is closed,
    "" for none. `fixed`: the main parameters that the sweep holds constant, in words.
    `belief`: lines on what the controllers are told of the rig.
    `friction`: how a scene with dither is analysed, in words. Of a reduced structure: `errors` [value, branch], the
    estimated relative error of each rate, NaN where there is none; `outside` [value]: in which numbers a value lies
    outside of the range that the reduction holds for, in words. Both are empty for other rigs. Its heavily damped
    rates are left out. `left_out`: the controllers that do not act, in words.
    """

    FIGURE: ClassVar = "rig.analysis.linear.figures:sweep_figure"

    scene: str
    axis: Axis
    rates: Complex
    shapes: Complex
    states: tuple[str, ...]
    exists: NDArray[np.bool_]
    notes: tuple[str, ...]
    critical: tuple[Critical, ...]
    gaps: tuple[Gap, ...]
    resolution: float
    loop: str = ""
    fixed: str = ""
    friction: str = ""
    belief: tuple[str, ...] = ()
    errors: Array = field(default_factory=lambda: np.zeros((0, 0)))
    outside: tuple[str, ...] = ()
    left_out: str = ""

    @property
    def growth(self) -> Array:
        """Growth rates [value, branch] in 1/s; of a complex pair only the upper one."""
        return np.where(self._upper, self.rates.real, np.nan)

    @property
    def frequency(self) -> Array:
        """Frequencies [value, branch] in Hz."""
        return np.where(self._upper, self.rates.imag / (2.0 * math.pi), np.nan)

    @property
    def _upper(self) -> NDArray[np.bool_]:
        return np.asarray(self.rates.imag >= -curves.ROUNDING * np.abs(self.rates))

    @property
    def largest(self) -> Array:
        """The largest growth rate at each value [1/s]."""
        return np.array([max(row[np.isfinite(row)], default=math.nan) for row in self.rates.real])

    def partner(self, critical: Critical) -> int | None:
        """Return the branch whose frequency meets that of the critical mode (mode coupling); None if there is none.

        The two are near each other beside the critical value, and apart somewhere else on the axis.
        """
        if critical.kind != "flutter" or critical.branch < 0:
            return None
        hertz = np.where(self.frequency > 0.0, self.frequency, np.nan)
        gaps = np.abs(hertz - hertz[:, [critical.branch]])
        gaps[:, critical.branch] = np.nan
        beside = np.abs(np.array(self.axis.values) - critical.value).argsort()[:2]
        least = np.min(np.where(np.isfinite(gaps), gaps, np.inf)[beside], axis=0)
        most = np.max(np.where(np.isfinite(gaps), gaps, 0.0), axis=0)
        meets = (least < _MEETS * most) & (least < _NEAR * critical.frequency)
        if not meets.any():
            return None
        return int(np.where(meets, least, np.inf).argmin())

    def pair(self, critical: Critical) -> tuple[float, ...]:
        """Return the frequencies [Hz], at the begin of the axis, of the two modes that meet; () if none does."""
        partner = self.partner(critical)
        if partner is None:
            return ()
        both = self.frequency[:, sorted((critical.branch, partner))]
        known = both[np.isfinite(both).all(axis=1)]
        return tuple(sorted(known[0].tolist())) if known.size else ()

    def facts(self) -> dict[str, Any]:
        """Return axis, branches, critical values and gaps."""
        branches = []
        for k, (growth, frequency) in enumerate(zip(self.growth.T, self.frequency.T)):
            if np.isfinite(growth).any():
                branch = {"growth": growth.tolist(), "frequency": frequency.tolist()}
                if self.errors.size:
                    branch["error"] = self.errors[:, k].tolist()
                branches.append(branch)
        critical_values = []
        for critical in self.critical:
            shape = {name: [v.real, v.imag] for name, v in critical.shape.items()}
            values = {**vars(critical), "shape": shape, "pair": list(self.pair(critical))}
            if not critical.regions:
                del values["regions"]
            critical_values.append(values)
        content = {
            "scene": self.scene,
            "loop": self.loop or None,
            "friction": self.friction or None,
            "key": self.axis.key,
            "unit": self.axis.unit,
            "values": list(self.axis.values),
            "exists": self.exists.tolist(),
            "notes": list(self.notes),
            "largest": self.largest.tolist(),
            "branches": branches,
            "critical": critical_values,
            "gaps": [gap._asdict() for gap in self.gaps],
            "resolution": self.resolution,
            "belief": list(self.belief),
            "left_out": self.left_out,
        }
        if any(self.outside):
            content["outside"] = list(self.outside)
        return content

    def shown(self) -> Iterator[str | Table]:
        """Yield the critical values, the gaps, and the largest growth over the axis."""
        axis = self.axis
        what = f"the loop of {self.loop}" if self.loop else "steady sliding"
        if self.friction:
            what += f", {self.friction},"
        yield f"{self.scene}: {what} over {axis.label}"
        yield from (f"  {line}" for line in self.belief)
        if self.left_out:
            yield f"  {self.left_out}"
        for critical in self.critical:
            yield from self._critical_lines(critical)
        if not self.critical:
            where = "where the rig slides steadily" if self.gaps else "between these ends"
            yield f"  no critical value {where}"
        for gap in self.gaps:
            line = f"  {gap.note} {self._span(gap)}"
            yield f"{line}: {gap.why}" if gap.why else line
        yield from self._estimated()
        yield f"  sampled every {axis.text(self.resolution, 3)}; critical values closer together may be missed\n"
        yield self._table()

    def _critical_lines(self, critical: Critical) -> Iterator[str]:
        """A critical value, the modes that meet there, and the shape of the mode."""
        what = critical.sides
        if critical.kind != "jamming":
            at = f" at {critical.frequency:.6g} Hz" if critical.frequency else ""
            what = f"{critical.kind}{at}, {critical.sides}"
        yield f"  {self.axis.text(critical.value, 12)}: {what}"
        if pair := self.pair(critical):
            both = " and ".join(f"{hertz:.5g}" for hertz in pair)
            yield f"    the modes of {both} Hz meet (frequencies at {self.axis.text(self.axis.values[0])})"
        if critical.energy:
            shape = shape_text(critical.shape, critical.energy, critical.regions)
            yield f"    {shape} (share of the energy)"

    def _table(self) -> Table:
        """The table over the axis; with a column of estimated errors if they are known."""
        estimated = bool(self.errors.size)
        columns = [
            self.axis.column(),
            Column("largest growth", "1/s", ".6g"),
            Column("frequency", "Hz", ".6g"),
            Column("growing modes", digits=".0f"),
            *[Column("largest error", "1", ".1e")] * estimated,
            Column("note"),
        ]
        rows = []
        for i, (value, rates, note) in enumerate(zip(self.axis.values, self.rates, self.notes)):
            remarks = [note] if note else []
            if any(self.outside[i : i + 1]):
                remarks.append("outside of the trained range")
            values: list[float | None] = [None, None, None]
            error = None
            known = rates[np.isfinite(rates)]
            if known.size:
                top = rates[int(np.nanargmax(rates.real))]
                hertz = abs(top.imag) / (2.0 * math.pi)
                growing = int(np.count_nonzero((known.real > curves.none(known)) & (known.imag >= 0.0)))
                values = [float(top.real), hertz, growing]
                if estimated:
                    errors = self.errors[i][np.isfinite(self.errors[i])]
                    error = max(errors, default=None)
            rows.append([value, *values, *[error] * estimated, ", ".join(remarks)])
        return Table("rows", columns, rows)

    def _estimated(self) -> Iterator[str]:
        """The largest estimated error with its place, and what lies outside of the trained range."""
        if np.isfinite(self.errors).any():
            i, k = np.unravel_index(int(np.nanargmax(self.errors)), self.errors.shape)
            hertz = abs(self.rates[i, k].imag) / (2.0 * math.pi)
            at = self.axis.text(self.axis.values[int(i)])
            yield f"  largest estimated error of an eigenvalue: {self.errors[i, k]:.1e} at {at}, {hertz:.6g} Hz"
        elif self.errors.size:
            yield "  warning: errors of the eigenvalues are not estimated: the files of the matrices are not there"
        yield from [f"  warning: {sentence}" for sentence in self.outside if sentence][-1:]

    def _span(self, gap: Gap) -> str:
        start, end = (self.axis.text(value) for value in gap[:2])
        return f"at {start}" if start == end else f"from {start} to {end}"


def sweep(scene: Scene, axis: Axis) -> Sweep:
    """Compute the eigenvalues of `scene` at its sliding equilibrium over `axis`, and the critical values between its
    ends. With a key of the dither, or if the scene switches its dither on, the friction is averaged over it.
    """
    dithered = dithers(scene, axis.key)

    def spectrum(value: float) -> curves.Spectrum:
        return curves.equilibrium(axis.at(scene, value), bool(dithered))

    how = {None: "", True: "friction averaged over the dither", False: "without the dither"}[dithered]
    with threadpool_limits(1, "blas"):  # a hundred rows take twice as long with two threads
        swept = along(scene.name, axis, spectrum, fixed=fixed(scene, [axis]))
    critical = tuple(_placed(value, axis.at(scene, value.value), swept.states) for value in swept.critical)
    return replace(swept, friction=how, left_out=left_out(scene), critical=critical)


def _placed(critical: Critical, scene: Scene, states: Sequence[str]) -> Critical:
    """The same with the bodies or node sets of the structure of `scene` that move."""
    stated = scene.stated
    if stated is None:
        return critical
    return replace(critical, regions=stated.shares(critical.shape, critical.energy, states))


def along(name: str, axis: Axis, spectrum_at: curves.Spectra, loop: str = "", fixed: str = "") -> Sweep:
    """Compute the sweep of anything that has a spectrum at each value of an axis."""
    spectra = lru_cache(maxsize=4096)(spectrum_at)
    spectra_at = [spectra(value) for value in axis.values]
    rates, order = _branches(axis.values, spectra_at, spectra)
    critical = search(axis.values, rates, spectra)
    states = tuple(dict.fromkeys(name for spectrum in spectra_at for name in spectrum.names))
    column = {state: i for i, state in enumerate(states)}
    shapes = np.zeros((*rates.shape, len(states)), np.complex128)
    for row, spectrum, places in zip(shapes, spectra_at, order):
        columns = [column[state] for state in spectrum.names]
        row[np.ix_(list(places.values()), columns)] = spectrum.right[:, list(places)].T
    errors = _errors(spectra_at, order, rates.shape)
    if errors.size:  # a reduction does not hold for heavily damped modes
        rates[(rates.real < 0.0) & (np.abs(rates.real) > DAMPED * np.abs(rates.imag))] = complex(math.nan, math.nan)
    return Sweep(
        scene=name,
        axis=axis,
        rates=rates,
        shapes=shapes,
        states=states,
        exists=np.array([spectrum.exists for spectrum in spectra_at]),
        notes=tuple(spectrum.note for spectrum in spectra_at),
        critical=critical.critical,
        gaps=critical.gaps,
        resolution=critical.resolution,
        loop=loop,
        fixed=fixed,
        errors=errors,
        outside=tuple(spectrum.outside for spectrum in spectra_at) if errors.size else (),
    )


def _errors(spectra_at: list[curves.Spectrum], order: list[dict[int, int]], shape: tuple[int, ...]) -> Array:
    """Estimated errors [value, branch], NaN where there is none; empty if no spectrum estimates them."""
    if not any(spectrum.errors for spectrum in spectra_at):
        return np.full((0, 0), math.nan)
    errors = np.full(shape, math.nan)
    for row, spectrum, places in zip(errors, spectra_at, order):
        known = spectrum.errors() if spectrum.errors is not None and places else ()
        if len(known):
            for i, place in places.items():
                row[place] = known[i]
    return errors


def _branches(
    values: tuple[float, ...], spectra_at: list[curves.Spectrum], spectra: curves.Spectra
) -> tuple[Complex, list[dict[int, int]]]:
    """Rates [value, branch], and for each value the branch of each of its rates."""
    order: list[dict[int, int]] = []
    count = 0
    for k, spectrum in enumerate(spectra_at):
        places: dict[int, int] = {}
        if k and spectrum.counts and spectra_at[k - 1].counts:
            on = curves.follow(spectra, values[k - 1], spectra_at[k - 1], values[k], spectrum)
            places = {int(on[i]): place for i, place in order[-1].items() if on[i] >= 0}
        for i in range(len(spectrum.rates) if spectrum.counts else 0):
            if i not in places:
                places[i] = count
                count += 1
        order.append(places)
    rates = np.full((len(spectra_at), count), complex(math.nan, math.nan))
    for row, spectrum, places in zip(rates, spectra_at, order):
        for i, place in places.items():
            row[place] = spectrum.rates[i]
    return rates, order
