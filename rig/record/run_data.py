"""What a run holds, as plain data; `rig.record.run.Run` adds what is done with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import time_ns
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import ControllerFailed, LogError
from rig.scenes.faults import close

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


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
    window: str = ""
    """Why only a window of the run was recorded: the trigger in words. Empty for a recording from its begin on."""
    begin_ns: int = 0
    """Simulated time of the begin of a window [ns]."""
    checkpoints: dict[int, bytes] = field(default_factory=dict)
    """Frame -> state of plant and instruments at its begin, where a run can be continued (rig.bench.checkpoint)."""
    sealed: bool = True
    """Whether checksums prove every byte of the recording; those of older versions have no digest."""

    def __post_init__(self) -> None:
        self.signals, self.units = Channels(self.signals), Channels(self.units)
        self.measurements, self.commands = Channels(self.measurements), Channels(self.commands)

    def scene_text(self) -> str:
        """Return the scene as JSON; raises rig.errors.LogError if damage to the recording removed it."""
        if not self.scene:
            raise LogError(f"the recording has lost its scene: {self.damage}")
        return self.scene

    def output(self, name: str) -> Reals:
        """Return the output `name` of the rig at `time`, [n]; NaN if a damaged recording has lost it."""
        return self.signals[name] if name in self.signals else np.full(self.time.size, np.nan)

    def recorded(self, name: str) -> Samples:
        """Return signal `name` at the times [ns] at which it was recorded.

        A damaged recording may have fewer samples of one signal than of another; lost rows are NaN in `signals`.
        """
        t_ns, v = np.rint(self.time * 1e9).astype(np.int64), self.signals[name]
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
