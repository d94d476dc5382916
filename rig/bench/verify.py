"""A recording checked: it is whole, nothing is missing, and it comes out the same when it is simulated again.

The plant is simulated once more from the scene in the file; commands and whatever else came from outside take effect
at the ticks at which they did. On the sources and the processor of the recording every bit must be the same; elsewhere
kernels round otherwise, and the signals must agree to `ELSEWHERE` of their range, samples of an instrument to its
resolution.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rig.bench.simulate import simulate
from rig.kernel import source_key
from rig.record import reader
from rig.record.provenance import provenance
from rig.record.run import Integers, Reals, Run
from rig.scenes.scene import Scene

ELSEWHERE = 1e-6
"""Largest deviation, as a share of the range of a signal, where sources or processor are others. # chosen"""
PLACE = ("kernel", "processor", "numba", "python")


@dataclass(frozen=True)
class Verification:
    """What the check of a recording found."""

    log: str
    seconds: float
    """Simulated time."""
    compared: int
    """Numbers compared."""
    identical: bool
    deviation: float
    """Largest deviation of a signal as a share of its range."""
    elsewhere: tuple[str, ...]
    """What is different here from where it was recorded."""
    faults: tuple[str, ...]
    notes: tuple[str, ...] = ()
    """What does not speak against the recording and should be known."""

    @property
    def passed(self) -> bool:
        """Whether the recording holds."""
        return not self.faults

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {**vars(self), "passed": self.passed}

    def text(self) -> str:
        """For a reader."""
        lines = [f"{self.log}: {'holds' if self.passed else 'does not hold'}"]
        lines += [f"  {told}" for told in (*self.faults, *self.notes)]
        told = "bit by bit" if self.identical else f"to {self.deviation:.1e} of their range"
        lines.append(f"  {self.seconds:g} s simulated again, {self.compared} numbers agree {told}")
        if self.elsewhere and not self.identical:
            lines.append(f"  recorded elsewhere: other {', '.join(self.elsewhere)}")
        return "\n".join(lines)


def verify(log: Path) -> Verification:
    """Check the recording `log`. Raises rig.errors.LogError for a file that is no recording, or has lost its scene."""
    run = reader.open(log)
    scene = Scene.from_json(run.scene_text())
    again = simulate(scene, {}, _duration_ns(run), run.commands, events=run.events)
    here = provenance(scene.seed)
    elsewhere = tuple(key for key in PLACE if run.provenance.get(key) != {**here, "kernel": source_key()}[key])
    compared, deviation, first = 0, 0.0, ""
    for name, t_ns, recorded, simulated in _pairs(run, again):
        compared += recorded.size
        apart = recorded.view(np.uint64) != simulated.view(np.uint64)
        if apart.any():
            size = float(np.nanmax(np.abs(recorded - simulated))) - (_resolution(scene, name) if elsewhere else 0.0)
            size = max(size, 0.0) / (float(np.nanmax(np.abs(recorded))) or 1.0)
            if not first:
                at = int(np.argmax(apart))
                first = (
                    f"{name} parts at t = {t_ns[at] * 1e-9:.9g} s: {float(recorded[at])!r} and {float(simulated[at])!r}"
                )
            deviation = max(deviation, size if np.isfinite(size) else np.inf)
    identical = not first
    faults = list(_gaps(run, again))
    if run.fault not in ("", run.damage, again.fault, again.summary["ended"]):  # a limit ends a run without a fault
        faults.insert(0, run.fault)
    if run.damage:
        faults.insert(0, run.damage)
    if not identical and (not elsewhere or deviation > ELSEWHERE):
        faults.append(first)
    notes = [told for told in (run.recovered, run.untold) if told]
    if not (run.sealed or run.damage):
        notes.append("no digest: an older version recorded it, and damage to its descriptions would not show")
    seconds = _duration_ns(run) * 1e-9
    return Verification(str(log), seconds, compared, identical, deviation, elsewhere, tuple(faults), tuple(notes))


def _resolution(scene: Scene, name: str) -> float:
    """Step of the instrument that `name` ("meas/<sensor>") comes from; 0 for what no instrument has rounded."""
    kind, _, sensor = name.partition("/")
    return float(scene.sensors[sensor].front_end().resolution) * (1.0 + 1e-9) if kind == "meas" else 0.0


def _duration_ns(run: Run) -> int:
    """Simulated time of the recording: whole frames up to its last sample."""
    last = [int(t_ns[-1]) for t_ns, _ in run.measurements.values() if t_ns.size]
    last += [round(float(run.time[-1]) * 1e9)] if run.time.size else []
    return -(-max(last, default=0) // run.frame_ns) * run.frame_ns


def _pairs(run: Run, again: Run) -> Iterator[tuple[str, Integers, Reals, Reals]]:
    """What both have at the same instant: name, times [ns], recorded and simulated values."""
    for name, (t_ns, v) in run.measurements.items():
        yield _common(f"meas/{name}", t_ns, v, *again.measurements[name])
    for name in run.signals:
        yield _common(name, *run.recorded(name), *again.recorded(name))


def _common(name: str, t_ns: Integers, v: Reals, u_ns: Integers, u: Reals) -> tuple[str, Integers, Reals, Reals]:
    shared, one, other = np.intersect1d(t_ns, u_ns, assume_unique=True, return_indices=True)
    return name, shared, np.ascontiguousarray(v[one]), np.ascontiguousarray(u[other])


def _gaps(run: Run, again: Run) -> Iterator[str]:
    """Samples that a sensor published and commands that were in force, and that are not in the file."""
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
