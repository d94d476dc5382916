"""Curves of special points over two parameters: the boundaries of sliding, stick-slip and both.

Hopf points are roots of growth rates at each value of the second parameter. Every other special point is followed from
the value of the scene in both directions: the cycle a little before it is carried to the next value of the second
parameter, and from there along its branch to the zero of the same distance. Each is saved while it is computed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.branches.compute import ROOT, SAVE, Computation, Job, driven_by, raw_of, rebuilt, unfit
from rig.analysis.branches.places import FAILURES, Place, place, solved, stepped
from rig.analysis.branches.result import TURNS, named
from rig.analysis.branches.trace import SPECIAL, Measure, of_distance, zero
from rig.analysis.cycles.return_map import CLOSED_TO, FLAT, Family
from rig.analysis.linear.sweep import sweep
from rig.analysis.pool import Progress, Store, Work, digest, packed, unpacked
from rig.errors import UsageError
from rig.printable import distinct
from rig.results import Column, Result, Table
from rig.scenes.axis import Axis
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
_BEFORE = 0.03  # along the branch, before a special point: where a cycle is carried from
_AHEAD = 0.003  # along the branch: the first step back to it
_SMALL = 1e-4  # of a step: difference for the tangent
_LEAST = 1e-3  # of the whole way: the shortest step
_SAME = 1e-6  # of the parameter: special points that are closer together are one
_TRACK = 4  # cycles from which the next is extrapolated
_NEARLY = 0.999  # of the way to a value: no step for the rest


@dataclass(frozen=True)
class Curve:
    """A special point over the second parameter: its values (SI) at `second`; `why` it ends before the range does."""

    kind: str
    contact: str
    second: tuple[float, ...]
    first: tuple[float, ...]
    why: str = ""

    @classmethod
    def of(cls, kind: str, contact: str, points: Iterable[tuple[float, float]], why: str = "") -> Curve:
        """The curve of points (second, first parameter), in any order."""
        ordered = sorted(points)
        return cls(kind, contact, tuple(q for q, _ in ordered), tuple(p for _, p in ordered), why)

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

    def listed(self) -> Table:
        """Return a row for each point; parameters in SI."""
        rows = [(c.name, q, p) for c in self.curves for q, p in zip(c.second, c.first)]
        return Table("points", (Column("curve"), self.second.column(), self.axis.column()), rows)

    def shown(self) -> Iterator[str | Table]:
        """Yield the special points at each value of the second parameter."""
        yield f"{self.scene.name}: special points over {self.axis.label} and {self.second.label}"
        if alone := left_out(self.scene):
            yield f"  {alone}"
        yield ""
        names = distinct((curve.name for curve in self.curves), "{} ({})")
        known = [dict(zip(curve.second, curve.first)) for curve in self.curves]
        rows = []
        for value in self.second.values:
            rows.append((value, *(points.get(value) for points in known)))
        yield Table("specials", [self.second.column(), *(self.axis.column(name, ".10g") for name in names)], rows)
        for curve in self.curves:
            if curve.why:
                yield f"  {curve.name}: {curve.why}"

    def facts(self) -> dict[str, Any]:
        """Return the curves; parameters in SI."""
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
    family = Family(job.scene, [job.axis, second])
    with store.open(_work(job, second)):
        saved = {unit: unpacked(arrays) for unit, arrays in store.load().items()}
        value_of_scene = job.scene.values()[second.key][0]
        start = float(np.clip(value_of_scene, min(second.values), max(second.values)))
        if 0 not in saved:
            hopf = _hopf_points(job, second)
            saved[0] = {"hopf": hopf, "specials": list(_specials(job, second, start))}
            store.save({0: packed(saved[0])})
        out = [Curve.of("hopf", "", points) for points in saved[0]["hopf"]]
        specials = saved[0]["specials"]
        above = sorted(v for v in second.values if v >= start)
        below = sorted(v for v in second.values if v < start)
        done = 0
        for number, special in enumerate(specials):
            if special["last"] is None:
                known = [(start, special["p"])] if start in second.values else []
                why = f"not followed from {start:.6g}: {special['why']}"
                out.append(Curve.of(special["kind"], special["contact"], known, why))
                continue
            parts: dict[float, float] = {}
            whys: list[str] = []
            for way, values in enumerate((above, below[::-1])):
                unit = 1 + 2 * number + way
                follower = _Follower(special, family, start, values, saved.get(unit))
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
                if follower.why:
                    whys.append(follower.why)
            out.append(Curve.of(special["kind"], special["contact"], parts.items(), "; ".join(whys)))
    if not out:
        raise UsageError(f"{job.scene.name}: no special point lies in this range of {job.axis.key}")
    return Curves(job.scene, job.axis, second, tuple(out), store.folder)


def curves_store(job: Job, second: Axis, root: Path = ROOT) -> Store:
    """Return the store of the curves of a job under `root`."""
    return Store.of(_work(job, second), root)


def _work(job: Job, second: Axis) -> Work:
    if second.key == job.axis.key:
        raise UsageError(f"{second.key}: is on both axes")
    if faults := [*unfit(job.scene, second)]:
        raise UsageError("\n".join(f"{job.scene.name}: --second: {fault}" for fault in faults))
    identity = repr([job.work.digest, second.key, second.values])
    shown = {name: getattr(second, name) for name in ("key", "unit", "values", "shown")}
    about = {**job.work.about, "axes": [*job.work.about["axes"], shown]}
    return replace(job.work, name=f"{job.scene.name}-curves", digest=digest(job.scene, identity), about=about)


def _hopf_points(job: Job, second: Axis) -> list[list[tuple[float, float]]]:
    """The Hopf points (second, first parameter): the first of each value, the second of each value, and so on."""
    by_number: list[list[tuple[float, float]]] = []
    for q in second.values:
        swept = sweep(second.at(job.scene, q), job.axis)
        values = [critical.value for critical in swept.critical if critical.kind == "flutter"]
        for number, value in enumerate(values):
            if number == len(by_number):
                by_number.append([])
            by_number[number].append((q, value))
    return by_number


def _specials(job: Job, second: Axis, q: float) -> Iterator[dict[str, Any]]:
    """The special points of the cycles at a value of the second parameter, each once, as JSON values: with the cycle a
    little before it, or why it cannot be followed.
    """
    computed = Computation(replace(job, scene=second.at(job.scene, q)))
    computed.run()
    seen: list[float] = []
    for special in computed.specials:
        usable = special.kind in ("fold", "canard") or special.name is not None
        if not usable or any(abs(special.p - p) <= _SAME * abs(p) for p in seen):
            continue
        seen.append(special.p)
        kind = TURNS.get(special.kind, special.kind) if special.turns else special.kind
        last = None
        why = special.why
        if CLOSED_TO * special.at.magnified < 1.0:
            try:
                last = raw_of(stepped(special.at, -_BEFORE)) | {"others": [q]}
            except FAILURES as error:
                why = " ".join(str(error).split())
        yield {"kind": kind, "contact": special.contact, "name": special.name, "p": special.p, "last": last, "why": why}


class _Follower:
    """A special point followed over values of the second parameter in one direction; `why` it ends before the last."""

    def __init__(
        self, special: dict[str, Any], family: Family, start: float, values: list[float], saved: dict[str, Any] | None
    ) -> None:
        name = special["name"]
        self.measure = SPECIAL["fold"] if name is None else of_distance((name[0], name[1], name[2]))
        self.values = values
        self.least = _LEAST * abs((values or [start])[-1] - start)
        saved = saved or {"points": [], "q": start, "last": special["last"], "why": ""}
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
            best, p, _ = zero(stepped(at, _AHEAD), _AHEAD, at, self.measure)
            self.last = stepped(best, -_BEFORE)
            self.q = target
            if target != self.track[-1][0]:
                self.track.append((target, self.last.u))
        except (*FAILURES, KeyError):
            if abs(step) < 2.0 * self.least:
                raise
            if abs(step) <= abs(self.track[-1][0] - self.track[-2:][0][0]):
                self.track = self.track[-1:]
            return 0.5 * step
        if target == value:
            self.points[value] = p
        return 2.0 * step


def _carried(at: Place, track: Sequence[tuple[float, Array]], value: float, measure: Measure) -> Place:
    """The cycle at another value of the second parameter, on the plane across the branch through a guess: what those
    before it lead to, or the tangent in this parameter from the first one.
    """
    q = track[-1][0]
    if len(track) > 1:
        known = track[-_TRACK:]
        terms = []
        for a, u in known:
            weight = math.prod((value - b) / (a - b) for b, _ in known if b != a)
            terms.append(weight * u)
        guess = np.sum(terms, axis=0)
    else:
        small = _SMALL * (value - q)
        beside = at.map.at(q + small).end(at.u)
        slope = np.zeros(len(at.u))
        if beside.met == at.end.met:
            slope[:-2] = (at.map.ends(at.u, beside) - at.map.ends(at.u, at.end)).ravel() / small
        M = np.vstack([at.map.matrix(at.u, at.d, at.map.along(at.u)), at.t])
        guess = at.u - np.linalg.lstsq(M, slope, rcond=FLAT)[0] * (value - q)
    map = at.map.at(value)
    new = place(map, *solved(at, guess, map, track[0][1]), at.t)
    measure.of(new)
    return new
