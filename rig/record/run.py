"""What one learns from a run, whether it was simulated in this process or read from a recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import LogError

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class Samples(NamedTuple):
    """What one sensor published: times [ns] and values."""

    t_ns: Integers
    v: Reals


class Commands(NamedTuple):
    """What one controller commanded, as it took effect."""

    tick: Integers
    """Frame at which it was taken over."""
    answered: Integers
    """Frame whose measurement it answers."""
    status: Integers
    """0 as sent, 1 clamped or completed, 2 safe values because no answer came."""
    values: Reals
    """[commands, drives]"""


@dataclass
class Run:
    """One run. `signals` are plant truth at `time`; `units` has the names of signals and `meas/<sensor>`."""

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
    """Number of the contact mode at `time`, [n]; -1 where a recording lost it; empty where it was not recorded."""
    controllers: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Controllers of the scene as their processes need them (controllers.described); empty where others took part."""
    provenance: dict[str, str] = field(default_factory=dict)
    models: tuple[bytes, ...] = ()
    """The reduced models that its scene names."""
    fault: str = ""
    """Why it is not whole: stopped by the numerics, or `damage`. Empty for a whole one."""
    damage: str = ""
    """What is missing or damaged in the recording that it was read from. Empty for a whole one."""
    recovered: str = ""
    """What had been lost before the recording was recovered from a damaged one; empty if it was not."""
    untold: str = ""
    """What is unknown of senders that were followed by another one of their name; empty if nothing is."""
    sealed: bool = True
    """Whether checksums prove every byte of the recording; those of older versions have no digest."""

    def scene_text(self) -> str:
        """The scene as JSON; raises rig.errors.LogError where damage to the recording took it away."""
        if not self.scene:
            raise LogError(f"the recording has lost its scene: {self.damage}")
        return self.scene

    def recorded(self, name: str) -> Samples:
        """Signal `name` at the times [ns] at which it was recorded.

        A damaged recording may hold less of one signal than of another; the rows that it lost are NaN in `signals`.
        """
        t_ns, v = np.rint(self.time * 1e9).astype(np.int64), self.signals[name]
        here = ~np.isnan(v) if self.notes else np.ones(v.size, np.bool_)
        return Samples(t_ns[here], v[here])

    @property
    def told(self) -> list[dict[str, Any]]:
        """The events that the plant told: what happened in the run. Guests of the bus may say anything."""
        return [event for event in self.events if event["source"] == "plant"]

    @property
    def notes(self) -> list[str]:
        """What a reader must know of the recording before trusting numbers made from it."""
        return [told for told in (self.damage, self.recovered) if told]
