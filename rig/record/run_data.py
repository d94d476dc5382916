"""What a run holds, as plain data; `rig.record.run.Run` adds what is done with it.

`signals` has the names by which a user selects its channels, `unknown` answers a name that does not exist. `grid` puts
samples at even times: their places, the gaps between them, and short gaps bridged by straight lines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import pairwise
from time import time_ns
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import ControllerFailed, LogError, UsageError
from rig.record.film_points import listed
from rig.scenes.faults import close

MEASURED = "meas/"
TRUE = "truth/"
"""Prefix of a name that a sensor and a plant output share: it selects the output."""

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

BRIDGED = 4  # samples: the longest gap that a line bridges
# Places of an even grid, for each sample and in all, from which on a recording is taken apart. chosen
_SPARSE = 8
_LARGE = 1 << 20
_TOLD = 5  # stretches that a message lists
_UNEVEN = 0.01  # of a period: times are rounded to nanoseconds, and a period is 1 us at least


def signals(run: RunData) -> dict[str, str]:
    """Return name and unit of every sensor and plant output of a recording."""
    sensors = {name: run.units.get(MEASURED + name, "") for name in run.measurements}
    return listing(sensors, {name: run.units.get(name, "") for name in run.signals})


def listing(sensors: Mapping[str, str], outputs: Mapping[str, str]) -> dict[str, str]:
    """Return the names by which sensors and outputs (name -> unit) are selected, with their units."""
    return {**sensors, **{TRUE * (name in sensors) + name: unit for name, unit in outputs.items()}}


def unknown(name: str, names: Mapping[str, str], where: str = "recording") -> UsageError:
    """Return the error for a name that is not among the `names` [name -> unit] of a recording or a run."""
    near = get_close_matches(name, names, 3, 0.5)
    hint = f"did you mean {', '.join(near)}? " if near else ""
    return UsageError(f"no {name!r} in this {where}: {hint}known: {', '.join(listed(names)) or 'none'}")


class Samples(NamedTuple):
    """The measurements of one sensor: times [ns] and values."""

    t_ns: Integers
    v: Reals


class Channels(dict[str, Any]):
    """Entries by name. An unknown name raises KeyError with the names that are like it."""

    def __missing__(self, name: object) -> Any:
        known = sorted(self)
        inside = [key for key in known if isinstance(name, str) and name in key]
        likely = inside[:3] or close(str(name), known)
        hint = f"did you mean {' or '.join(likely)}? " if likely else ""
        raise KeyError(f"{name!r:.60} is not in this run; {hint}known: {', '.join(known) or 'none'}")


class Commands(NamedTuple):
    """The commands of one controller, as they took effect."""

    tick: Integers
    """Frame at which the plant accepted it."""
    answered: Integers
    """Frame whose measurements it answers."""
    status: Integers
    """0 as sent, 1 clamped or completed, 2 safe values because no command came."""
    values: Reals
    """[commands, drives]"""


@dataclass(repr=False)
class RunData:
    """One run. `signals` are plant outputs at `time`; `units` has the units of signals and of `meas/<sensor>`."""

    scene: str
    """The resolved scene as JSON."""
    step_ns: int
    frame_ns: int
    time: Reals
    """Seconds of simulated time, [n]."""
    signals: dict[str, Reals]
    units: dict[str, str]
    measurements: dict[str, Samples] = field(default_factory=dict)
    commands: dict[str, Commands] = field(default_factory=dict)
    """By controller."""
    events: list[dict[str, Any]] = field(default_factory=list)
    """t_ns, tick, source, kind, text and data (a dict) of each event."""
    energy: dict[str, float] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    mode: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    """Number of the mode set at `time`, [n]; -1 where a recording lost it; empty if it was not recorded."""
    controllers: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Settings of the scene's controllers for their processes (controllers.described); empty if others took part."""
    provenance: dict[str, str] = field(default_factory=dict)
    name: str = ""
    """Name of the run that was recorded."""
    models: tuple[bytes, ...] = ()
    """The reduced models that its scene names."""
    fault: str = ""
    """Why the run is not complete: the numerics or a controller stopped it, or `damage`. Empty for a complete run."""
    failure: ControllerFailed | None = None
    """The error of the controller that stopped the run in this process."""
    damage: str = ""
    """The damage of the recording that it was read from. Empty without damage."""
    recovered: str = ""
    """Losses before the recording was recovered from a damaged one; empty if it was not recovered."""
    began_ns: int = field(default_factory=time_ns)
    """When simulated time was 0, in ns since 1970 (UTC)."""
    untold: str = ""
    """Senders that restarted, so that the losses before are unknown; empty if there are none."""
    on_bus: bool = False
    """Whether it was recorded from the bus, where the events of single contacts are not published."""
    measured: bool = False
    """Whether it is a measurement of a real rig (`rig import`): it has no scene and no outputs of a plant."""
    window: str = ""
    """Why only a window of the run was recorded: the trigger in words. Empty for a recording from its begin on."""
    begin_ns: int = 0
    """Simulated time of the begin of a window [ns]."""
    checkpoints: dict[int, bytes] = field(default_factory=dict)
    """Frame -> state of plant and instruments at its begin, where a run can be continued (rig.bench.run.checkpoint)."""
    sealed: bool = True
    """Whether checksums prove every byte of the recording; those of older versions have no digest."""

    def __post_init__(self) -> None:
        self.signals = Channels(self.signals)
        self.units = Channels(self.units)
        self.measurements = Channels(self.measurements)
        self.commands = Channels(self.commands)

    def scene_text(self) -> str:
        """Return the scene as JSON; raises rig.errors.LogError if damage to the recording removed it."""
        if self.measured:
            raise LogError("it is a measurement: it contains no rig, which this command needs")
        if not self.scene:
            raise LogError(f"the recording has lost its scene: {self.damage}")
        return self.scene

    @property
    def span(self) -> tuple[float, float] | None:
        """First and last recorded time [s] of the outputs, of a measurement that of its sensors; None without any."""
        if self.time.size or not self.measured:
            return (float(self.time[0]), float(self.time[-1])) if self.time.size else None
        times = [t_ns for t_ns, _ in self.measurements.values() if t_ns.size]
        if not times:
            return None
        return min(t_ns[0] for t_ns in times) * 1e-9, max(t_ns[-1] for t_ns in times) * 1e-9

    def output(self, name: str) -> Reals:
        """Return the output `name` of the rig at `time`, [n]; NaN if a damaged recording has lost it."""
        return self.signals[name] if name in self.signals else np.full(self.time.size, np.nan)

    def recorded(self, name: str) -> Samples:
        """Return signal `name` at the times [ns] at which it was recorded.

        A damaged recording may have fewer samples of one signal than of another; lost rows are NaN in `signals`.
        """
        t_ns = np.rint(self.time * 1e9).astype(np.int64)
        v = self.signals[name]
        here = ~np.isnan(v) if self.notes else np.ones(v.size, np.bool_)
        return Samples(t_ns[here], v[here])

    @property
    def plant_events(self) -> list[dict[str, Any]]:
        """Return the events that the plant reported. Other processes on the bus may report anything."""
        return [event for event in self.events if event["source"] == "plant"]

    @property
    def notes(self) -> list[str]:
        """Return warnings that a reader needs before using numbers from the recording."""
        return [note for note in (self.damage, self.recovered) if note]


@dataclass(frozen=True)
class Grid:
    """Samples `v` [n] every `period_ns`, at `t_ns` [n]; missing ones are NaN, their times are computed."""

    t_ns: Integers
    v: Reals
    period_ns: float

    @property
    def rate(self) -> float:
        """Samples per second [Hz]."""
        return 1e9 / self.period_ns


def places(t_ns: Integers) -> Integers:
    """Return the index of each sample from its time [ns], the first being 0; samples may be missing, times are
    rounded.
    """
    gaps = np.diff(t_ns)
    if not gaps.size:
        return np.zeros(t_ns.size, np.int64)
    period = gaps[gaps < 1.5 * gaps.min()].mean()
    return np.concatenate([[0], np.cumsum(np.rint(gaps / period))]).astype(np.int64)


def stretches(t_ns: Integers) -> list[slice]:
    """Return the parts of samples, by their times [ns], that lie far apart: one part for most recordings.

    A recording has parts if an even grid over all of it would be empty for the most part. It is then cut at each gap
    that is longer than its longest run of samples.
    """
    if t_ns.size < 2 or not increasing(t_ns):
        return [slice(0, t_ns.size)]
    at = places(t_ns)
    if at[-1] < max(_SPARSE * at.size, _LARGE):
        return [slice(0, at.size)]
    steps = np.diff(at)
    runs = np.diff(np.concatenate(([0], np.flatnonzero(steps > 1 + BRIDGED) + 1, [at.size])))
    cuts = [0, *(np.flatnonzero(steps > runs.max()) + 1).tolist(), at.size]
    return [slice(a, b) for a, b in pairwise(cuts)]


def stretch_list(t_ns: Integers, parts: Sequence[slice]) -> str:
    """Return the parts of samples in words: "2 stretches, 0 to 2 s and 86400 to 86402 s"."""
    spans = [f"{t_ns[part][0] * 1e-9:.9g} to {t_ns[part][-1] * 1e-9:.9g} s" for part in parts]
    shown = spans if len(spans) <= _TOLD else [*spans[:_TOLD], f"{len(spans) - _TOLD} more"]
    return f"{len(parts)} stretches, {', '.join(shown[:-1])} and {shown[-1]}"


def period(t_ns: Integers) -> float:
    """Return the time between two samples [ns]; 0 for less than two, and for times that do not increase."""
    return float(t_ns[-1] - t_ns[0]) / float(places(t_ns)[-1]) if t_ns.size > 1 and increasing(t_ns) else 0.0


def increasing(t_ns: Integers) -> bool:
    """Return whether each time is later than the one before."""
    return bool((np.diff(t_ns) > 0).all())


def grid(name: str, samples: Samples) -> Grid:
    """Return the samples of `name` on their grid. Raises UsageError for less than two, and for times that are
    uneven or do not increase.
    """
    t_ns, v = samples
    if t_ns.size < 2:
        count = f"{t_ns.size} sample{'s' * (t_ns.size != 1)}"
        raise UsageError(f"{name}: the recording has {count} of it; a rate needs at least two")
    if not increasing(t_ns):
        raise UsageError(f"{name}: its times do not increase; export it without --rate, and not as wav")
    parts = stretches(t_ns)
    if len(parts) > 1:
        raise UsageError(f"{name}: it lies in {stretch_list(t_ns, parts)}; export it without --rate")
    at = places(t_ns)
    step = period(t_ns)
    if np.abs(t_ns - t_ns[0] - at * step).max() > _UNEVEN * step:
        raise UsageError(f"{name}: its times are not evenly spaced; export it without --rate, and not as wav")
    times = t_ns[0] + np.rint(np.arange(at[-1] + 1) * step).astype(np.int64)
    times[at] = t_ns
    values = np.full(times.size, np.nan)
    values[at] = v
    return Grid(times, values, step)


def gaps(v: Reals) -> list[tuple[int, int]]:
    """Return the gaps: index of the first missing (not finite) sample and of the sample after the last one."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ~np.isfinite(v), [False]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def bridge(v: Reals) -> tuple[Reals, int]:
    """Interpolate gaps of up to `BRIDGED` samples linearly; return the samples and the number of interpolated ones."""
    v = v.copy()
    count = 0
    known = np.flatnonzero(np.isfinite(v))
    values = v[known]
    for a, b in gaps(v):
        if b - a <= BRIDGED and 0 < a and b < v.size:
            v[a:b] = np.interp(np.arange(a, b), known, values)
            count += b - a
    return v, count
