"""Comparison of all solvers, alternating: error of event times over the cost of a run, for this rig and each installed
peer.

The error is the largest difference of a mode change's time from the reference, as a share of the period; infinite if
changes were missed or invented. Our own methods are compared with another of our methods (rig.qualify.cost.references),
the peers with our best. For each setting the best of the rounds counts, because other work on the machine only makes a
run longer.
"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from oscillator import Oscillator
from solvers import PEERS, STEP_NS, Run, by_rig

from rig.analysis.cycles.motion_measures import TIGHTEST, Setting, eligible, ladder
from rig.scenes.scene import Scene
from rig.stability.report import fastest_eigenvalue

ROUNDS = 3
TURN = 0.02  # s for each setting in a round
OURS = "friction-rig"


@dataclass(frozen=True)
class Entry:
    """One setting of one peer: error of event times (of a period), real-time factor; `fault`: why it cannot run."""

    peer: str
    setting: str
    error: float
    factor: float
    fault: str = ""


def race(scene: Scene, rounds: int = ROUNDS) -> list[Entry]:
    """Run all solvers on a mass on a belt: Coulomb or Stribeck friction, constant load and speed, stuck at first."""
    o, system = Oscillator.of(scene), scene.assemble().system()
    first = Setting("exact") if system.linear else Setting("dopri5", TIGHTEST)
    best, other = (by_rig(scene, s, o.seconds)() for s in (first, Setting("rk4", step_ns=STEP_NS // 100)))
    runners: list[tuple[Entry, Run, Sequence[float]]] = []
    for method in (*(name for name, why in eligible(system).items() if not why), *(["dop853"] * (not system.linear))):
        for own in ladder(method, scene, fastest_eigenvalue(system)):
            entry = Entry(OURS, str(own), math.inf, math.nan)
            runners.append((entry, by_rig(scene, own, o.seconds), best if method == "rk4" else other))
    absent: list[Entry] = []
    for peer in PEERS:
        if importlib.util.find_spec(peer.package) is None:
            absent.append(Entry(peer.name, "", math.inf, math.nan, "is not installed"))
            continue
        for rung in peer.ladder:
            entry = Entry(peer.name, f"{rung[0]} at {rung[1]:.0e}", math.inf, math.nan)
            runners.append((entry, peer.prepare(o, rung), best))
    errors = [_error(run(), truth) for _, run, truth in runners]  # the first run compiles
    times = np.full(len(runners), math.inf)
    for _ in range(rounds):
        for i, (_, run, _) in enumerate(runners):
            times[i] = min(times[i], _timed(run))
    return [
        *(
            replace(entry, error=error, factor=o.seconds / spent)
            for (entry, *_), error, spent in zip(runners, errors, times.tolist())
        ),
        *absent,
    ]


def _timed(run: Run) -> float:
    """The shortest processor time [s] of the runs that fit into `TURN`, at least one."""
    end, best = time.process_time() + TURN, math.inf
    while (begin := time.process_time()) < end:
        run()
        best = min(best, time.process_time() - begin)
    return best


def _error(events: Sequence[float], truth: Sequence[float]) -> float:
    if len(events) != len(truth) or len(truth) < 4:
        return math.inf
    return float(np.abs(np.subtract(events, truth)).max() / (truth[-1] - truth[-3]))


def cheapest(entries: Sequence[Entry], target: float) -> list[Entry]:
    """Return for each peer the fastest setting that meets `target`, this project first; else the one with the best
    error.
    """
    out = []
    for peer in dict.fromkeys(entry.peer for entry in entries):
        mine = [entry for entry in entries if entry.peer == peer]
        enough = [entry for entry in mine if entry.error <= target]
        out.append(max(enough, key=lambda entry: entry.factor) if enough else min(mine, key=lambda entry: entry.error))
    return out
