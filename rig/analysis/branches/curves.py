"""Curves of special points over two parameters: the boundaries of sliding, stick-slip and both.

Hopf points are roots of growth rates at each value of the second parameter. Every other special point is followed from
the value of the scene in both directions: the cycle a little before it is carried to the next value of the second
parameter, and from there along its branch to the zero of the same distance. Each is saved while it is computed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis import eigenvalue_curves
from rig.analysis.axis import Axis
from rig.analysis.branches import begin
from rig.analysis.branches.compute import ROOT, SAVE, Job, driven_by, raw_of, rebuilt
from rig.analysis.branches.result import TURNS, named
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
from rig.analysis.pool import Progress, Store, Work, digest, packed, unpacked
from rig.analysis.return_map import Family
from rig.bench.free_rig import Carried
from rig.errors import UsageError
from rig.machine.files import csv_table
from rig.printable import columns
from rig.results import Result
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
_BEFORE, _AHEAD = 0.03, 0.003  # along the branch: where a cycle is carried from, and the first step back
_SMALL = 1e-4  # of a step: difference for the tangent
_LEAST = 1e-3  # of the whole way: the shortest step
_POINTS = 300  # of a branch
_TRACK, _NEARLY = 4, 0.999  # cycles from which the next is extrapolated; of the way to a value: no step for the rest


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
        return named(self.kind, self.contact)


@dataclass(frozen=True)
class Curves(Result):
    """Curves over the parameter `axis` and `second`."""

    FIGURE: ClassVar = "rig.analysis.branches.figure:curves_figure"

    scene: Scene
    axis: Axis
    second: Axis
    curves: tuple[Curve, ...]
    folder: Path | None = None

    def lines(self) -> list[tuple[str, Array, Array]]:
        """Return name, first and second parameter (SI) of each curve, for a figure."""
        return [(curve.name, np.array(curve.first), np.array(curve.second)) for curve in self.curves]

    def over(self, map: Any) -> Figure:
        """Return the figure of a map over the same parameters with these curves."""
        figure: Figure = map.with_lines(self.lines())
        return figure

    def csv(self) -> str:
        """Return every point as a line of a CSV file; parameters in SI."""
        head = ["curve", self.second.si_label, self.axis.si_label]
        rows = [[c.name, q, p] for c in self.curves for q, p in zip(c.second, c.first)]
        return csv_table([head, *rows]).decode()

    def text(self) -> str:
        """Return the report as text."""
        lines = [f"{self.scene.name}: special points over {self.axis.label} and {self.second.label}"]
        alone = left_out(self.scene)
        lines += [f"  {alone}", ""] if alone else [""]
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
            "left_out": left_out(self.scene),
            "key": self.axis.key,
            "second": self.second.key,
            "curves": [asdict(curve) for curve in self.curves],
            "folder": str(self.folder) if self.folder else None,
        }


def curves(job: Job, second: Axis, root: Path = ROOT, progress: Progress = lambda done, total: None) -> Curves:
    """Compute the curves of a job over a second parameter; what their folder under `root` holds is not computed again.

    Raises UsageError if there is no special point to follow, and if the folder cannot be used. After an interruption
    the same call continues.
    """
    if forcing := driven_by(job):
        raise UsageError(
            f"{job.scene.name}: {forcing} is on; curves over two parameters of forced motions are not computed"
        )
    store = curves_store(job, second, root)
    work, family = _work(job, second), Family(job.scene, [job.axis, second])
    with store.open(work):
        saved = {unit: unpacked(arrays) for unit, arrays in store.load().items()}
        own = float(np.clip(job.scene.values()[second.key][0], min(second.values), max(second.values)))
        if 0 not in saved:
            saved[0] = {
                "hopf": [list(zip(curve.second, curve.first)) for curve in _hopf_curves(job, second)],
                "specials": [_saved(special) for special in _specials(job, family, own)],
            }
            store.save({0: packed(saved[0])})
        out = [
            Curve("hopf", "", tuple(q for q, _ in points), tuple(p for _, p in points)) for points in saved[0]["hopf"]
        ]
        specials, done = saved[0]["specials"], 0
        for number, special in enumerate(specials):
            if special["last"] is None:
                here = {own: special["p"]} if own in second.values else {}
                what = f"not followed from {own:.6g}: {special['why']}"
                out.append(Curve(special["kind"], special["contact"], tuple(here), tuple(here.values()), what))
                continue
            parts: dict[float, float] = {}
            whys: list[str] = []
            above = sorted(v for v in second.values if v >= own)
            for way, values in enumerate((above, sorted(v for v in second.values if v < own)[::-1])):
                unit = 1 + 2 * number + way
                follower = _Follower(special, family, own, values, saved.get(unit))
                last_saved = time.monotonic()
                try:
                    for _ in follower.run():
                        progress(done + len(follower.points), len(specials) * len(second.values))
                        if time.monotonic() - last_saved > SAVE:
                            store.save({unit: packed(follower.raw())})
                            last_saved = time.monotonic()
                finally:
                    store.save({unit: packed(follower.raw())})
                done += len(values)
                parts |= follower.points
                whys += [follower.why] if follower.why else []
            ordered = sorted(parts)
            out.append(Curve(special["kind"], special["contact"], tuple(ordered), tuple(parts[v] for v in ordered),
                             "; ".join(whys)))  # fmt: skip
    if not out:
        raise UsageError(f"{job.scene.name}: no special point lies in this range of {job.axis.key}")
    return Curves(job.scene, job.axis, second, tuple(out), store.folder)


def curves_store(job: Job, second: Axis, root: Path = ROOT) -> Store:
    """Return the store of the curves of a job under `root`."""
    return Store.of(_work(job, second), root)


def _work(job: Job, second: Axis) -> Work:
    if second.key == job.axis.key:
        raise UsageError(f"{second.key}: is on both axes")
    identity = repr([job.work.digest, second.key, second.values])
    shown = {name: getattr(second, name) for name in ("key", "unit", "values", "shown")}
    about = {**job.work.about, "axes": [*job.work.about["axes"], shown]}
    return replace(job.work, name=f"{job.scene.name}-curves", digest=digest(job.scene, identity), about=about)


def _saved(special: Special) -> dict[str, Any]:
    """A special point as JSON values, with the cycle a little before it; without one if it cannot be followed."""
    kind = TURNS.get(special.kind, special.kind) if special.turns else special.kind
    told = {"kind": kind, "contact": special.contact, "name": special.name, "p": special.p, "last": None}
    try:
        return told | ({"why": special.why} if special.at.map.cuts else {"last": raw_of(_back(special.at))})
    except FAILURES as error:
        return told | {"why": " ".join(str(error).split())}


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
                usable = special.kind in ("fold", "canard") or special.name is not None
                new = not any(abs(special.p - p) <= 1e-6 * abs(p) for p in seen)
                if usable and new:
                    seen.append(special.p)
                    yield special


def _beginnings(job: Job, family: Family, q: float) -> Iterator[Place]:
    """First places of cycles at a value of the second parameter: Hopf points, else a simulation."""
    scene = family.scene_at((job.axis.values[0], q))
    hopf = eigenvalue_curves.roots(job.axis.values, _growths(job, scene))
    for p in hopf:
        try:
            yield begin.from_hopf(family, p, (q,))
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


class _Follower:
    """A special point followed over values of the second parameter in one direction; `why` it ends before the last."""

    def __init__(
        self, special: dict[str, Any], family: Family, own: float, values: list[float], saved: dict[str, Any] | None
    ) -> None:
        name = special["name"]
        self.measure: Measure = of_turn if name is None else of_distance((name[0], name[1], name[2]))
        self.values, self.least = values, _LEAST * abs((values or [own])[-1] - own)
        saved = saved or {"points": [], "q": own, "last": special["last"], "why": ""}
        self.points: dict[float, float] = dict(saved["points"])
        self.q: float = saved["q"]
        self.why: str = saved["why"]
        self.last = rebuilt(family, saved["last"])
        self.track = [(self.q, self.last.u)]  # the cycles a little before the special point, with the second parameter

    def raw(self) -> dict[str, Any]:
        """Return what is computed as JSON values."""
        return {"points": list(self.points.items()), "q": self.q, "last": raw_of(self.last), "why": self.why}

    def run(self) -> Iterator[None]:
        """Compute the points, with a stop after each step."""
        try:
            for value in () if self.why else self.values:
                step = value - self.q
                while value not in self.points:
                    step = self._step(value, step)
                    yield
        except (*FAILURES, KeyError) as error:
            self.why = f"not followed beyond {self.q:.6g}: {' '.join(str(error).split())}"

    def _step(self, value: float, step: float) -> float:
        """Go on to a value, or by a step towards it; return the next step."""
        target = value if abs(step) > _NEARLY * abs(value - self.q) else self.q + step
        try:
            at = _carried(self.last, self.track, target, self.measure) if target != self.q else self.last
            u, end = stepped(at, _AHEAD, at.end.met)
            best, p, _ = zero(place(at.map, u, end, at.t), _AHEAD, at, self.measure)
            self.last, self.q = _back(best), target
            self.track += [(target, self.last.u)] if target != self.track[-1][0] else []
        except (*FAILURES, KeyError):
            if abs(step) < 2.0 * self.least:
                raise
            if abs(step) <= abs(self.track[-1][0] - self.track[-2:][0][0]):
                self.track = self.track[-1:]
            return 0.5 * step
        if target == value:
            self.points[value] = p
        return 2.0 * step


def _back(at: Place) -> Place:
    """The cycle a little before a special point."""
    u, end = stepped(at, -_BEFORE, at.end.met)
    return place(at.map, u, end, at.t)


def _carried(at: Place, track: Sequence[tuple[float, Array]], value: float, measure: Measure) -> Place:
    """The cycle at another value of the second parameter, on the plane across the branch through a guess: what those
    before it lead to, or the tangent in this parameter from the first one.
    """
    q = track[-1][0]
    M = np.vstack([at.map.matrix(at.d, at.map.along(at.u)), at.t])
    if len(track) > 1:
        known = track[-_TRACK:]
        weights = [math.prod((value - b) / (a - b) for b, _ in known if b != a) for a, _ in known]
        guess = np.sum([weight * u for weight, (_, u) in zip(weights, known)], axis=0)
    else:
        small = _SMALL * (value - q)
        beside = at.map.at(q + small).end(at.u)
        slope = np.zeros(len(at.u))
        if beside.met == at.end.met:
            slope[:-2] = (at.map.ends(at.u, beside) - at.map.ends(at.u, at.end)).ravel() / small
        guess = at.u - np.linalg.lstsq(M, slope, rcond=1e-13)[0] * (value - q)

    def plane(v: Array, _: Carried) -> tuple[float, Array]:
        return float(at.t @ (v - guess)), at.t

    map = at.map.at(value)
    u, end = map.newton(guess, plane, track[0][1], at.end.met, first=M)
    new = place(map, u, end, at.t)
    measure(new)
    return new
