"""What a run of a case has come to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class OutOfTime(Exception):
    """The cell has used up its time box."""


@dataclass
class Found:
    """What a run came to. Events: (time [s], what). `stuck`: share of the ticks in which every contact sticks."""

    events: list[tuple[float, str]] = field(default_factory=list)
    count: int = 0
    ticks: int = 0
    stuck: float = 0.0
    stuck_now: bool = False
    negative_power: float = 0.0
    outside_cone: float = 0.0
    pulling: float = 0.0
    held: float = 0.0
    """Largest pull [N] of a contact that cannot open: of a rig whose scene leaves separation out."""
    creep: float = 0.0
    not_finite: int = 0
    energy: float = 0.0
    ridden: bool = False
    """The rig is a film of points: its energy closes by the square of the step."""
    pace: float = 1.0
    """Share of the clock's pace that the scene asks for."""
    most_events: int = 0
    burst: int = 0
    """Frames run without a wait after a pause."""
    ended: dict[str, float] = field(default_factory=dict)
    began: dict[str, float] = field(default_factory=dict)
    largest: dict[str, float] = field(default_factory=dict)
    trials: int = 0
    opened: int = 0
    seconds: float = 0.0
    """Of processor time, all in all."""
    carrying: float = 0.0
    """Of these, what the plant has taken; the others built it and looked at what it did."""
    notes: list[str] = field(default_factory=list)
    slips: list[Array] = field(default_factory=list)
    """Of methods that have no mode for sticking: the largest slip speed of any contact at every step."""
