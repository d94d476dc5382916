"""When a motion repeats: its period in the changes of its mode set.

Refusal of analyses that a film of many contact points does not allow.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from rig.errors import UsageError
from rig.motion.motion import Event
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady

REPEAT = 1e-9
"""Largest difference of the times of changes that repeat, over the period."""
MOST = 24
"""Most mode set changes in one cycle."""
_BETTER = 1e-2  # of the smallest difference so far: what a larger number of changes must reach
_TURN = 0.999  # of a turn of the surface: the shortest period on an uneven surface


def repeating(events: list[Event], step: float, repeat: float = REPEAT) -> tuple[int, float]:
    """Return the number of mode set changes after which the last ones repeat, and their relative difference in time.

    It is the smallest number that repeats to `repeat`, else the best one. A larger number counts only if it is far
    better: each round of a cycle that closes only after several rounds looks alike, and so do two rounds of one that is
    still settling. (0, inf) if none repeats. Three cycles are compared, because two could agree by chance.
    """
    best = (0, math.inf)
    events = _in_order(events[-4 * MOST :], step, repeat)
    for count in range(2, min(MOST, len(events) // 3) + 1):
        last = events[-3 * count :]
        names = [event.what for event in last]
        if names[:count] != names[count : 2 * count] or names[count : 2 * count] != names[2 * count :]:
            continue
        t = np.array([time_of(event, last[0].tick, step) for event in last])
        period = t[-1] - t[-1 - count]
        gaps = t[count:] - t[:-count] - period
        drift = float(np.abs(gaps).max() / period) if period > 0.0 else math.inf
        if drift < _BETTER * best[1]:
            best = (count, drift)
        if best[1] <= repeat:
            break
    return best


def _in_order(events: list[Event], step: float, repeat: float) -> list[Event]:
    """The events, simultaneous ones by name: in equal parts of a rig rounding decides which of them is the first."""
    if len(events) < 2:
        return events
    times = [time_of(event, events[0].tick, step) for event in events]
    close = repeat * times[-1] / len(times)
    apart = (b - a > close for a, b in itertools.pairwise(times))
    moments = itertools.accumulate(apart, initial=0)
    in_order = sorted(zip(moments, events), key=lambda pair: (pair[0], pair[1].what))
    return [event for _, event in in_order]


def turn_of(sliding: Steady) -> float:
    """Return the time [s] of one turn of an uneven surface; infinite for an even one."""
    rates = [sector.row @ sliding.modes.A @ sliding.x / sector.period for sector in sliding.system.sectors]
    if not any(rates):
        return math.inf
    return 1.0 / max(abs(float(rate)) for rate in rates)


def all_round(period: float, turn: float) -> bool:
    """Return whether a period covers whole turns of the surface; otherwise the motion repeats only up to the next
    sector.
    """
    return math.isinf(turn) or period >= _TURN * turn


def time_of(event: Event, origin: int, step: float) -> float:
    """Return the time [s] of an event from tick `origin` on, with ticks of `step` [s]."""
    return ((event.tick - origin) + event.place) * step


def refuse(scene: Scene, study: str) -> None:
    """Raise UsageError if `scene` has a film of points, whose motion is chaotic; `study` names the analysis."""
    if scene.assemble().film is not None:
        raise UsageError(
            f"{scene.name}: {study} is not defined for a film of points: after the first opening motion is chaotic, "
            f"and two runs diverge. Compute statistics of several runs: rig study {scene.name} --repeat 8 "
            "--measure run.rms, with -p noise.force=1e-6 if nothing in the scene is random. "
            f"For sliding with all points closed: rig modes {scene.name} --sweep KEY=A:B:N"
        )
