"""Curves of special points over two parameters: the boundaries of sliding, stick-slip and both.

Hopf points are roots of growth rates at each value of the second parameter. Every other special point is followed from
the value of the scene in both directions: the cycle a little before it is carried to the next value of the second
parameter, and from there along its branch to the zero of the same distance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis import eigenvalue_curves
from rig.analysis.axis import Axis
from rig.analysis.branches import begin
from rig.analysis.branches.compute import Job
from rig.analysis.branches.result import TURNS
from rig.analysis.branches.trace import (
    FAILURES,
    Measure,
    Place,
    Special,
    follow,
    of_distance,
    of_turn,
    place,
    stepped,
    zero,
)
from rig.analysis.cycle import limit_cycle
from rig.analysis.map import Map
from rig.analysis.return_map import Carried, Family
from rig.errors import UsageError
from rig.machine.files import csv_table
from rig.printable import columns
from rig.results import Result
from rig.scenes.scene import Scene
from rig.stability.linearisation import steady

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
_BEFORE, _AHEAD = 0.03, 0.003  # along the branch: where a cycle is carried from, and the first step back
_SMALL = 1e-4  # of a step: difference for the tangent
_LEAST = 1e-3  # of the whole way: the shortest step
_POINTS = 300  # of a branch


@dataclass(frozen=True)
class Curve:
    """A special point over the second parameter: its values (SI) at `second`; `why` it ends before the range does."""

    kind: str
    contact: str
    second: tuple[float, ...]
    first: tuple[float, ...]
    why: str = ""

    @property
    def name(self) -> str:
        """What the points are, in words."""
        return f"{self.kind} ({self.contact})" if self.contact else self.kind


@dataclass(frozen=True)
class Curves(Result):
    """Curves over the parameter `axis` and `second`."""

    FIGURE: ClassVar = "rig.analysis.branches.figure:curves_figure"

    scene: Scene
    axis: Axis
    second: Axis
    curves: tuple[Curve, ...]

    def lines(self) -> list[tuple[str, Array, Array]]:
        """Return name, first and second parameter (SI) of each curve, for a figure."""
        return [(curve.name, np.array(curve.first), np.array(curve.second)) for curve in self.curves]

    def over(self, map: Map) -> Figure:
        """Return the figure of a map over the same parameters with these curves."""
        return map.with_lines(self.lines())

    def csv(self) -> str:
        """Return every point as a line of a CSV file; parameters in SI."""
        head = ["curve", self.second.si_label, self.axis.si_label]
        rows = [[c.name, q, p] for c in self.curves for q, p in zip(c.second, c.first)]
        return csv_table([head, *rows]).decode()

    def text(self) -> str:
        """Return the report as text."""
        lines = [f"{self.scene.name}: special points over {self.axis.label} and {self.second.label}", ""]
        rows: list[tuple[str, ...]] = [(self.second.label, *(curve.name for curve in self.curves))]
        known = [dict(zip(curve.second, curve.first)) for curve in self.curves]
        for value in self.second.values:
            cells = (self.axis.text(k[value], 10) if value in k else "" for k in known)
            rows.append((self.second.text(value), *cells))
        lines += columns(rows, "<" + ">" * len(self.curves))
        return "\n".join([*lines, *(f"  {curve.name}: {curve.why}" for curve in self.curves if curve.why)])

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; parameters in SI."""
        return {
            "scene": self.scene.name,
            "key": self.axis.key,
            "second": self.second.key,
            "curves": [asdict(curve) for curve in self.curves],
        }


def curves(job: Job, second: Axis, watch: Callable[[str], object] = lambda text: None) -> Curves:
    """Compute the curves of a job over a second parameter. Raises UsageError if there is no special point to follow."""
    scene, axis = job.scene, job.axis
    at_scene = scene.values()[second.key][0]
    own = float(np.clip(at_scene, min(second.values), max(second.values)))
    watch("Hopf points")
    out = list(_hopf_curves(job, second))
    family = Family(scene, [axis, second])
    for special in _specials(job, family, own):
        parts: dict[float, float] = {}
        whys = []
        for values in (sorted(v for v in second.values if v >= own), sorted(v for v in second.values if v < own)[::-1]):
            whys.append(_followed(special, own, values, parts, watch))
        kind = TURNS.get(special.kind, special.kind) if special.turns else special.kind
        ordered = sorted(parts)
        why = "; ".join(why for why in whys if why)
        out.append(Curve(kind, special.contact, tuple(ordered), tuple(parts[v] for v in ordered), why))
    if not out:
        raise UsageError(f"{scene.name}: no special point lies in this range of {axis.key}")
    return Curves(scene, axis, second, tuple(out))


def _hopf_curves(job: Job, second: Axis) -> Iterator[Curve]:
    """Curves of the Hopf points, the first, second and further one of each value."""
    rows: list[list[float]] = []
    for q in second.values:
        scene = second.at(job.scene, q)
        hopf_values = eigenvalue_curves.roots(job.axis.values, _growths(job, scene))
        rows.append(sorted(dict.fromkeys(float(f"{value:.12g}") for value in hopf_values)))
    for k in range(max(map(len, rows), default=0)):
        there = [(q, row[k]) for q, row in zip(second.values, rows) if len(row) > k]
        yield Curve("hopf", "", tuple(q for q, _ in there), tuple(p for _, p in there))


def _specials(job: Job, family: Family, q: float) -> Iterator[Special]:
    """The special points of the cycles at a value of the second parameter, each once."""
    seen: list[float] = []
    low, high = job.axis.values[0], job.axis.values[-1]
    for first in _beginnings(job, family, q):
        for segment in follow(first, low, high, _POINTS):
            for special in (*segment.specials, *([segment.end] if segment.end else [])):
                usable = special.kind == "fold" or special.name is not None
                new = not any(abs(special.p - p) <= 1e-6 * abs(p) for p in seen)
                if usable and new:
                    seen.append(special.p)
                    yield special


def _beginnings(job: Job, family: Family, q: float) -> Iterator[Place]:
    """First places of cycles at a value of the second parameter: Hopf points, else a simulation."""
    scene = family.rig((job.axis.values[0], q))
    hopf = eigenvalue_curves.roots(job.axis.values, _growths(job, scene))
    for p in hopf:
        flow = family.flow((p, q))
        at = steady(flow.system, flow.key)
        rates, shapes = at.eigenvectors()
        k = int(np.where(rates.imag > 0.0, np.abs(rates.real), np.inf).argmin())
        try:
            yield begin.from_hopf(family, p, at.x, complex(rates[k]), shapes[:, k], (q,))
        except FAILURES:
            continue
    if hopf:
        return
    for value in (0.5 * (job.axis.values[0] + job.axis.values[-1]), job.axis.values[0]):
        cycle = limit_cycle(job.axis.at(scene, value))
        if cycle.found:
            start = begin.Start(value, cycle.state, cycle.period)
            first = begin.from_start(family, start, others=(q,))
            yield first
            yield replace(first, t=-first.t)
            return


def _growths(job: Job, scene: Scene) -> eigenvalue_curves.Growths:
    @lru_cache(maxsize=4096)
    def growths(value: float) -> eigenvalue_curves.Growth | None:
        spectrum = eigenvalue_curves.equilibrium(job.axis.at(scene, value))
        return (
            eigenvalue_curves.Growth(spectrum.rates.real, eigenvalue_curves.none(spectrum.rates))
            if spectrum.counts
            else None
        )

    return growths


def _followed(
    special: Special, own: float, values: list[float], parts: dict[float, float], watch: Callable[[str], object]
) -> str:
    """Follow a special point over values of the second parameter, into `parts`; return why it ends."""
    measure = of_turn if special.name is None else of_distance(special.name)
    q = own
    try:
        last = _back(special.at)
        for value in values:
            watch(f"{special.kind} at {value:.6g}")
            step = value - q
            while q != value or value not in parts:
                target = value if abs(step) >= abs(value - q) else q + step
                try:
                    at = _carried(last, q, target, measure) if target != q else last
                    u, end = stepped(at, _AHEAD, at.end.met)
                    best, p, _ = zero(place(at.map, u, end, at.t), _AHEAD, at, measure)
                    last = _back(best)
                except (*FAILURES, KeyError):
                    step *= 0.5
                    if abs(step) < _LEAST * abs(values[-1] - own):
                        raise
                    continue
                q, step = target, 2.0 * step
                if q == value:
                    parts[value] = p
    except (*FAILURES, KeyError) as error:
        return f"not followed beyond {q:.6g}: {' '.join(str(error).split())}"
    return ""


def _back(at: Place) -> Place:
    """The cycle a little before a special point."""
    u, end = stepped(at, -_BEFORE, at.end.met)
    return place(at.map, u, end, at.t)


def _carried(at: Place, q: float, value: float, measure: Measure) -> Place:
    """The cycle at another value of the second parameter, on the plane across the branch through the tangent in it."""
    n = len(at.u) - 2
    M = np.vstack([at.map.matrix(at.d, at.map.along(at.u)), at.t])
    small = _SMALL * (value - q)
    beside = at.map.at(q + small).end(at.u)
    slope = np.zeros(n + 2)
    if beside.met == at.end.met:
        slope[:n] = (beside.x - at.end.x)[at.flow.moving] / at.map.size / small
    guess = at.u - np.linalg.lstsq(M, slope, rcond=1e-13)[0] * (value - q)

    def plane(v: Array, _: Carried) -> tuple[float, Array]:
        return float(at.t @ (v - guess)), at.t

    map = at.map.at(value)
    u, end = map.newton(guess, plane, guess, at.end.met, first=M)
    new = place(map, u, end, at.t)
    measure(new)
    return new
