"""Agreement of a recording with its re-simulation, sample by sample.

With the same sources and processor every bit must be the same. Otherwise kernels round differently, and the outputs
must agree to `ELSEWHERE` of their range, measurements to the resolution of their instrument.

If contact points open, this holds up to the first opening: up to there the motion is stable against rounding. After it
the motion is chaotic: samples soon differ, and only statistics can agree (`compared`). Each of their tolerances is
about twice the spread of runs of the shipped plate whose initial states differ by rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rig.record.compare import common_instants
from rig.record.provenance import provenance
from rig.record.run import Integers, Reals, Run
from rig.record.statistics import ACCELERATION, Statistic, first_opening, statistics
from rig.scenes.scene import Scene

ELSEWHERE = 1e-6
"""Largest deviation, as a share of the range of a signal, with other sources or another processor. # chosen"""
NOTHING = 1e-12
"""Values below this share of the largest signal with the same unit count as rounding errors of zero. # chosen"""
MOVED = 1e-3
"""Largest share of the instants whose mode sets may differ on another processor: events move by rounding errors, a few
of them past an instant. # chosen"""
ROUNDED = frozenset({"processor", "blas", "numba", "python"})
"""What rounds differently but has the same sources, and therefore the same events and numbers of mode sets."""
MODE_SET = "mode set"
_PLACE = ("kernel", "processor", "blas", "numba", "python")

BEFORE = 1e-5
"""Largest deviation up to the first opening, as a share of the range of a signal. Points that stick and slip in the
last milliseconds before it amplify a rounding error to 4e-7. # chosen"""
ONSET = 0.01
"""Largest difference between the times of the first opening, as a share of that time. # chosen"""
SHORTEST = 0.1
"""Shortest time span whose statistics are compared [s]. # chosen: 0.03 s have twice the spread"""
FEWEST = 1000
"""Fewest samples of outputs whose statistics are compared: with 20 the RMS is uncertain by 16 %. # chosen"""
RMS = 1.5
"""Largest factor between the RMS of accelerations. # chosen"""
BAND = 2.0
"""Largest factor between the RMS of accelerations in one band. # chosen"""
MEAN = 0.1
"""Largest difference between the means of the contact fraction. # chosen"""
LEAST = 0.15
"""Largest difference between the least values of the contact fraction. # chosen"""
# Largest difference between ranges of the pressure centre, as a share of the longest range. # chosen
RANGE = 0.5


def changed_place(run: Run) -> list[str]:
    """The differences between this machine and that of the recording: sources, processor, linear algebra, versions.

    A recording of a version that did not state its BLAS counts as one with the BLAS of this machine.
    """
    here = provenance(0)
    return [key for key in _PLACE if run.provenance.get(key, here[key] if key == "blas" else None) != here[key]]


def duration_ns(run: Run) -> int:
    """Simulated time of the recording: whole frames up to its last sample."""
    last = [int(t_ns[-1]) for t_ns, _ in run.measurements.values() if t_ns.size]
    last += [round(float(run.time[-1]) * 1e9)] if run.time.size else []
    return -(-max(last, default=0) // run.frame_ns) * run.frame_ns


class Agreement(NamedTuple):
    """Number of values compared; largest deviation, as a share of the range of its signal; the first one, as text."""

    compared: int
    deviation: float
    first: str


def agreement(pairs: Iterable[Pair], scene: Scene, elsewhere: bool, until: float = math.inf) -> Agreement:
    """Agreement of the samples before `until` [s]; with `elsewhere` measurements may differ by their resolution."""
    compared = 0
    deviation = 0.0
    first = ""
    for name, t_ns, recorded, simulated, nothing in pairs:
        count = int(np.searchsorted(t_ns, until * 1e9 - 0.5)) if until < math.inf else t_ns.size
        compared += count
        apart = recorded[:count].view(np.uint64) != simulated[:count].view(np.uint64)
        if apart.any():
            values = recorded[:count]
            others = simulated[:count]
            size = float(np.nanmax(np.abs(values - others), initial=0.0))
            size -= max(_resolution(scene, name), nothing) if elsewhere else 0.0
            size = max(size, 0.0) / (float(np.nanmax(np.abs(recorded), initial=0.0)) or 1.0)
            lacking = not math.isfinite(size) or (np.isnan(values) != np.isnan(others)).any()
            deviation = math.inf if lacking else max(deviation, size)
            if not first:
                at = int(np.argmax(apart))
                t = t_ns[at] * 1e-9
                first = f"{name} differs at t = {t:.9g} s: {float(recorded[at])!r} and {float(simulated[at])!r}"
    return Agreement(compared, deviation, first)


def _resolution(scene: Scene, name: str) -> float:
    """Resolution of the instrument behind `name` ("meas/<sensor>"); 0 for values that no instrument has rounded."""
    kind, _, sensor = name.partition("/")
    return float(scene.sensors[sensor].front_end().resolution) * (1.0 + 1e-9) if kind == "meas" else 0.0


class Pair(NamedTuple):
    """Values of both runs at the same instants; below `nothing` a value is a rounding error of zero."""

    name: str
    t_ns: Integers
    recorded: Reals
    simulated: Reals
    nothing: float


def pairs(run: Run, again: Run, modes: bool = False) -> Iterator[Pair]:
    """Values of both runs at the same instants: sensors, outputs and, with `modes`, mode sets.

    Sensors and outputs that only one of them has are left out: `unknown` names those of the recording.
    """
    largest: dict[str, float] = {}
    for name, v in run.signals.items():
        size = float(np.nanmax(np.abs(v), initial=0.0))
        unit = run.units.get(name, "")
        largest[unit] = max(largest.get(unit, 0.0), size)
    for name, (t_ns, v) in run.measurements.items():
        if name in again.measurements:
            yield _common(f"meas/{name}", t_ns, v, *again.measurements[name], 0.0)
    for name in (name for name in run.signals if name in again.signals):
        nothing = NOTHING * largest[run.units.get(name, "")]
        yield _common(name, *run.recorded(name), *again.recorded(name), nothing)
    if modes and run.mode.size:
        t_ns = np.rint(run.time * 1e9).astype(np.int64)
        u_ns = np.rint(again.time * 1e9).astype(np.int64)
        yield _common(MODE_SET, t_ns, run.mode.astype(np.float64), u_ns, again.mode.astype(np.float64), 0.0)


def unknown(run: Run, again: Run) -> list[str]:
    """Faults: sensors and outputs in the recording that its scene does not have here, and sensors that it lacks."""
    sensors = run.measurements.keys()
    here = again.measurements.keys()
    strange = run.signals.keys() - again.signals.keys()
    faults = [f"the sensor {name} is recorded, but not in the scene" for name in sensors - here]
    faults += [f"the sensor {name} is in the scene, but not recorded" for name in here - sensors]
    for name in strange:
        faults.append(f"the output {name} is recorded, but the rig of the scene has none of this name here")
    if again.signals and not run.signals:
        faults.append("no output of the rig is recorded")
    if run.frame_ns != again.frame_ns:
        faults.append(f"its frames are {run.frame_ns * 1e-6:g} ms, those of its scene {again.frame_ns * 1e-6:g} ms")
    return sorted(faults)


def other_mode_sets(run: Run, again: Run, end_ns: int) -> list[str]:
    """A fault if more than the share `MOVED` of the mode sets up to `end_ns` differ; for runs of the same sources."""
    for name, t_ns, recorded, simulated, _ in pairs(run, again, modes=True):
        if name != MODE_SET:
            continue
        count = int(np.searchsorted(t_ns, end_ns, "right"))
        if count == 0:
            continue
        apart = recorded[:count] != simulated[:count]
        differing = int(apart.sum())
        if differing > MOVED * count:
            t = t_ns[int(np.argmax(apart))] * 1e-9
            instants = f"{differing} of {count} instants differ ({MOVED * count:.0f} are allowed)"
            return [f"the mode sets of {instants}, first at t = {t:.9g} s"]
    return []


def _common(name: str, t_ns: Integers, v: Reals, u_ns: Integers, u: Reals, nothing: float) -> Pair:
    shared, here, there = common_instants(t_ns, u_ns)
    return Pair(name, shared, np.ascontiguousarray(v[here]), np.ascontiguousarray(u[there]), nothing)


class Compared(NamedTuple):
    """One statistic of a recording and of its re-simulation; `allowed`: the tolerance in words."""

    recorded: Statistic
    simulated: float
    allowed: str
    agrees: bool

    def __str__(self) -> str:
        statistic = self.recorded
        unit = "" if self.recorded.unit == "1" else f" {self.recorded.unit}"
        return f"{statistic.name}: {statistic.value:.4g} and {self.simulated:.4g}{unit} ({self.allowed})"


class Openings(NamedTuple):
    """Time of the first opening of a point [s] in the recording and in its re-simulation; None: never."""

    recorded: float | None
    simulated: float | None

    @classmethod
    def of(cls, run: Run, again: Run) -> Openings:
        """The first openings of a recording and its re-simulation."""
        return cls(first_opening(run), first_opening(again))

    @property
    def first(self) -> float | None:
        """The earlier time; None if no point opens in either run."""
        return min((time for time in self if time is not None), default=None)

    def fault(self, step: float) -> str:
        """Why the times do not agree; "" if they do. `step`: time between samples of the recording [s]."""
        if self.recorded is None and self.simulated is None:
            return ""
        if self.recorded is None or self.simulated is None:
            times = ["never" if time is None else f"at t = {time:.6g} s" for time in self]
            return f"a contact point opens first {times[0]} in the recording and {times[1]} here"
        if abs(self.recorded - self.simulated) <= ONSET * self.recorded + step:
            return ""
        return (
            f"a contact point opens first at t = {self.recorded:.6g} s in the recording and at {self.simulated:.6g} s "
            f"here; {100 * ONSET:g} % are allowed"
        )


def compared(run: Run, again: Run, first: float, last: float) -> Iterator[Compared]:
    """Compare all statistics with a tolerance from `first` to `last` [s].

    Outputs of the plant are compared at the instants that both runs have: the recording of a live run has 200 per
    second. With fewer than `FEWEST` such instants only sensors are compared, which have all of their samples.
    """
    here = {statistic.name: statistic for statistic in statistics(_thinned(again, run, first, last), first, last)}
    both = [
        statistic for statistic in statistics(_thinned(run, again, first, last), first, last) if statistic.name in here
    ]
    longest = max(
        (max(statistic.value, here[statistic.name].value) for statistic in both if statistic.kind == "range"),
        default=0.0,
    )
    factors = {"rms": RMS, "band": BAND}
    distances = {"mean": MEAN, "least": LEAST, "range": RANGE * longest}
    for statistic in both:
        value = here[statistic.name].value
        kind = statistic.kind
        low, high = sorted((statistic.value, value))
        if kind in factors and statistic.unit == ACCELERATION:
            yield Compared(statistic, value, f"factor {factors[kind]:g}", high <= factors[kind] * low)
        elif kind in distances:
            most = distances[kind]
            allowed = f"within {most:.2g} {statistic.unit}" if kind == "range" else f"within {most:g}"
            yield Compared(statistic, value, allowed, high - low <= most)


def _thinned(run: Run, beside: Run, first: float, last: float) -> Run:
    """`run` with its outputs only at the instants of `beside`; without outputs if these are fewer than `FEWEST`."""
    t_ns, other = (np.rint(each.time * 1e9).astype(np.int64) for each in (run, beside))
    here = np.isin(t_ns, other, assume_unique=True)
    inside = here & (run.time >= first) & (run.time <= last)
    enough = np.count_nonzero(inside) >= FEWEST
    signals = {name: v[here] for name, v in run.signals.items()} if enough else {}
    return replace(run, time=run.time[here], signals=signals)
