"""The outcome of a run of a case."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class OutOfTime(Exception):
    """The cell has reached its time limit."""


@dataclass
class Found:
    """The outcome of a run. Events: (time [s], what). `stuck`: share of the ticks in which every contact sticks."""

    events: list[tuple[float, str]] = field(default_factory=list)
    count: int = 0
    ticks: int = 0
    stuck: float = 0.0
    stuck_now: bool = False
    negative_power: float = 0.0
    outside_cone: float = 0.0
    pulling: float = 0.0
    held: float = 0.0
    """Largest pull [N] of a contact that cannot open, in a scene without separation."""
    creep: float = 0.0
    not_finite: int = 0
    measurements: int = 0
    """Samples that the sensors published after the first."""
    energy: float = 0.0
    with_film: bool = False
    """The rig is a film of points: the residual of its energy balance falls with the square of the step."""
    pace: float = 1.0
    """Pace of the clock that the scene states."""
    most_events: int = 0
    burst: int = 0
    """Frames run without a wait after a pause."""
    ended: dict[str, float] = field(default_factory=dict)
    began: dict[str, float] = field(default_factory=dict)
    largest: dict[str, float] = field(default_factory=dict)
    trials: int = 0
    opened: int = 0
    seconds: float = 0.0
    """Processor time in total [s]."""
    carrying: float = 0.0
    """Processor time of the plant alone [s], without building and checking."""
    notes: list[str] = field(default_factory=list)
    slips: list[Array] = field(default_factory=list)
    """For methods without a mode for stick: the largest slip speed of any contact at every step."""
