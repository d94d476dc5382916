"""Verifies a recording: it must be complete, and a re-simulation must give the same values.

The plant is simulated again from the scene in the file; commands and other actions from outside take effect at their
recorded ticks. With the same sources and processor every bit must be the same. Otherwise kernels round differently, and
the outputs must agree to `ELSEWHERE` of their range, measurements to the resolution of their instrument. If that fails
because contact points have opened, samples are compared up to the first opening, and statistics after it
(rig.bench.chaotic_runs).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rig.bench.chaotic_runs import BEFORE, SHORTEST, Openings, compared
from rig.bench.simulate import simulate
from rig.kernel import source_key
from rig.record import reader
from rig.record.provenance import provenance
from rig.record.run import Integers, Reals, Run
from rig.scenes.scene import Scene

ELSEWHERE = 1e-6
"""Largest deviation, as a share of the range of a signal, with other sources or another processor. # chosen"""
NOTHING = 1e-12
"""Values below this share of the largest signal with the same unit count as rounding errors of zero. # chosen"""
PLACE = ("kernel", "processor", "numba", "python")


@dataclass(frozen=True)
class Verification:
    """The result of verifying a recording."""

    log: str
    seconds: float
    """Simulated time [s]."""
    compared: int
    """Number of values compared."""
    identical: bool
    deviation: float
    """Largest deviation of a signal as a share of its range."""
    elsewhere: tuple[str, ...]
    """Differences between this machine and that of the recording: sources, processor, versions."""
    faults: tuple[str, ...]
    notes: tuple[str, ...] = ()
    """Notes that the user should know, but that are not faults of the recording."""
    opened: float | None = None
    """Time of the first opening of a contact point [s], if samples were compared only up to there."""
    statistics: tuple[str, ...] = ()
    """Statistics compared after it: of the recording, of the re-simulation, and the tolerance."""

    @property
    def passed(self) -> bool:
        """Whether the recording is verified: no fault was found."""
        return not self.faults

    def to_json(self) -> dict[str, Any]:
        """The result as plain values for JSON."""
        return {**vars(self), "passed": self.passed}

    def text(self) -> str:
        """The result as text."""
        lines = [f"{self.log}: {'holds' if self.passed else 'does not hold'}"]
        lines += [f"  {told}" for told in (*self.faults, *self.notes)]
        told = (
            "bit by bit"
            if not self.deviation and (self.identical or self.opened)
            else f"to {self.deviation:.1e} of their range"
        )
        if self.opened is None:
            lines.append(f"  {self.seconds:g} s simulated again, {self.compared} numbers agree {told}")
        else:
            lines += [
                f"  {self.seconds:g} s simulated again; a contact point opens first at t = {self.opened:.6g} s",
                f"  before: {self.compared} numbers agree {told} ({BEFORE:g} is allowed)",
                "  from there on the motion is chaotic: statistics, recorded and here (what is allowed)",
                *(f"    {one}" for one in self.statistics),
            ]
        if self.elsewhere and not self.identical:
            lines.append(f"  recorded elsewhere: other {', '.join(self.elsewhere)}")
        return "\n".join(lines)


def verify(log: Path) -> Verification:
    """Verify the recording `log`. Raises rig.errors.LogError if the file is no recording or has lost its scene."""
    run = reader.open(log)
    scene = Scene.from_json(run.scene_text())
    again = simulate(scene, {}, _duration_ns(run), run.commands, events=run.events)
    here = provenance(scene.seed)
    elsewhere = [key for key in PLACE if run.provenance.get(key) != {**here, "kernel": source_key()}[key]]
    notes = [told for told in (run.recovered, run.untold) if told]
    if scene.models != Scene.from_json(again.scene).models:
        elsewhere.append("model")
        notes.append("the recording has lost the model of its structure: one that was built here takes its place")
    elif scene.models and not run.models:
        notes.append("the recording has lost the model of its structure; the one that was built here is the same")
    pairs = list(_pairs(run, again))
    found = _agreement(pairs, scene, bool(elsewhere))
    faults = list(_gaps(run, again))
    if run.fault not in ("", run.damage, again.fault, again.summary["ended"]):  # a limit ends a run without a fault
        faults.insert(0, run.fault)
    if run.damage:
        faults.insert(0, run.damage)
    parts: list[str] = []
    allowed = ELSEWHERE
    openings = Openings.of(run, again)
    if found.first and elsewhere and found.deviation > ELSEWHERE and openings.first is not None:
        found, allowed = _agreement(pairs, scene, True, openings.first), BEFORE
        if told := openings.fault(float(np.diff(run.time[:2]).sum())):
            faults.append(told)
        else:
            parts, wrong = _statistics(run, again, openings.first)
            faults += wrong
    if found.first and (not elsewhere or found.deviation > allowed):
        faults.append(found.first)
    if not (run.sealed or run.damage):
        notes.append("no digest: an older version recorded it, and damage to its descriptions would not show")
    return Verification(
        log=str(log),
        seconds=_duration_ns(run) * 1e-9,
        compared=found.compared,
        identical=not found.first and not parts,
        deviation=found.deviation,
        elsewhere=tuple(elsewhere),
        faults=tuple(faults),
        notes=tuple(notes),
        opened=openings.recorded if parts else None,
        statistics=tuple(parts),
    )


class _Agreement(NamedTuple):
    """`deviation`: the largest one, as a share of the range of its signal; `first`: the first one, as text."""

    compared: int
    deviation: float
    first: str


def _agreement(pairs: Iterable[_Pair], scene: Scene, elsewhere: bool, until: float = math.inf) -> _Agreement:
    """Agreement of the samples before `until` [s]; with `elsewhere` measurements may differ by their resolution."""
    compared, deviation, first = 0, 0.0, ""
    for name, t_ns, recorded, simulated, nothing in pairs:
        count = int(np.searchsorted(t_ns, until * 1e9 - 0.5)) if until < math.inf else t_ns.size
        compared += count
        apart = recorded[:count].view(np.uint64) != simulated[:count].view(np.uint64)
        if apart.any():
            size = float(np.nanmax(np.abs(recorded[:count] - simulated[:count])))
            size -= max(_resolution(scene, name), nothing) if elsewhere else 0.0
            size = max(size, 0.0) / (float(np.nanmax(np.abs(recorded))) or 1.0)
            if not first:
                at = int(np.argmax(apart))
                first = (
                    f"{name} parts at t = {t_ns[at] * 1e-9:.9g} s: {float(recorded[at])!r} and {float(simulated[at])!r}"
                )
            deviation = max(deviation, size if np.isfinite(size) else np.inf)
    return _Agreement(compared, deviation, first)


def _statistics(run: Run, again: Run, opened: float) -> tuple[list[str], list[str]]:
    """Statistics compared from the first opening `opened` [s] on, and those that do not agree."""
    end = float(min(run.time[-1], again.time[-1]))
    if end - opened < SHORTEST:
        return [f"{end - opened:.3g} s are too few for statistics ({SHORTEST:g} s are needed): not compared"], []
    found = list(compared(run, again, opened, end))
    return [str(one) for one in found], [f"does not agree: {one}" for one in found if not one.agrees]


def _resolution(scene: Scene, name: str) -> float:
    """Resolution of the instrument behind `name` ("meas/<sensor>"); 0 for values that no instrument has rounded."""
    kind, _, sensor = name.partition("/")
    return float(scene.sensors[sensor].front_end().resolution) * (1.0 + 1e-9) if kind == "meas" else 0.0


def _duration_ns(run: Run) -> int:
    """Simulated time of the recording: whole frames up to its last sample."""
    last = [int(t_ns[-1]) for t_ns, _ in run.measurements.values() if t_ns.size]
    last += [round(float(run.time[-1]) * 1e9)] if run.time.size else []
    return -(-max(last, default=0) // run.frame_ns) * run.frame_ns


class _Pair(NamedTuple):
    """Values of both runs at the same instants; below `nothing` a value is a rounding error of zero."""

    name: str
    t_ns: Integers
    recorded: Reals
    simulated: Reals
    nothing: float


def _pairs(run: Run, again: Run) -> Iterator[_Pair]:
    """Values of both runs at the same instants, sensors first."""
    largest: dict[str, float] = {}
    for name, v in run.signals.items():
        unit = run.units.get(name, "")
        largest[unit] = max(largest.get(unit, 0.0), float(np.nanmax(np.abs(v), initial=0.0)))
    for name, (t_ns, v) in run.measurements.items():
        yield _common(f"meas/{name}", t_ns, v, *again.measurements[name], 0.0)
    for name in run.signals:
        nothing = NOTHING * largest[run.units.get(name, "")]
        yield _common(name, *run.recorded(name), *again.recorded(name), nothing)


def _common(name: str, t_ns: Integers, v: Reals, u_ns: Integers, u: Reals, nothing: float) -> _Pair:
    shared, one, other = np.intersect1d(t_ns, u_ns, assume_unique=True, return_indices=True)
    return _Pair(name, shared, np.ascontiguousarray(v[one]), np.ascontiguousarray(u[other]), nothing)


def _gaps(run: Run, again: Run) -> Iterator[str]:
    """Faults for samples that a sensor published and commands that took effect, but that are not in the file."""
    for way, count in run.summary.get("lost", {}).items():
        if way.startswith("applied/") and way.endswith(" to recorder"):
            name = way.removeprefix("applied/").removesuffix(" to recorder")
            yield f"{count} messages of the commands of {name} were lost on their way: it cannot come out the same"
    for name in run.commands.keys() - again.commands.keys():
        yield f"the commands of {name} are recorded, but not that it was admitted: it cannot come out the same"
    for name, (t_ns, _) in run.measurements.items():
        missing = again.measurements[name].t_ns.size - t_ns.size
        if missing:
            yield f"{missing} samples of {name} are missing"
