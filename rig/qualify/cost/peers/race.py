"""Comparison of all solvers, alternating: error of event times over the cost of a run, for this rig and each installed
peer.

The error is the largest difference of a mode change's time from the reference, as a share of the period; infinite if
changes were missed or invented. Our own methods are compared with another of our methods (rig.qualify.cost.reference),
the peers with our best. For each setting the best of the rounds counts, because other work on the machine only makes a
run longer.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from rig.analysis.motion_measures.settings import TIGHTEST, Setting
from rig.qualify.cost.peers import by_diffrax, by_mujoco, by_pathsim, by_rig, by_scipy, by_sundials
from rig.qualify.cost.peers.oscillator import Oscillator
from rig.scenes.scene import Scene

PEERS: tuple[ModuleType, ...] = (by_scipy, by_sundials, by_diffrax, by_pathsim, by_mujoco)
ROUNDS = 5
TURN = 0.05  # s for each setting in a round
OURS = by_rig.NAME


ABSENT = "is not installed"


@dataclass(frozen=True)
class Entry:
    """One setting of one peer: error of event times (of a period), real-time factor; `fault`: why it cannot run."""

    peer: str
    setting: str
    error: float
    factor: float
    fault: str = ""


def race(scene: Scene, rounds: int = ROUNDS, report: Callable[[int, int], object] | None = None) -> list[Entry]:
    """Run all solvers. Raises UsageError if the scene has features that the peers cannot express."""
    say = report or (lambda done, total: None)
    o = Oscillator.of(scene)
    runners: list[tuple[str, str, Callable[[], list[float]]]] = []
    absent: list[Entry] = []
    for setting in by_rig.settings(scene):
        runners.append((OURS, str(setting), by_rig.prepare(scene, setting, o.seconds)))
    for peer in PEERS:
        try:
            importlib.import_module(peer.PACKAGE)
        except ImportError:
            absent.append(Entry(peer.NAME, "", math.inf, math.nan, ABSENT))
            continue
        for one in peer.ladder():
            runners.append((peer.NAME, f"{one[0]} at {one[1]:.0e}", peer.prepare(o, one)))
    best, other = _references(scene, o)
    found = [run() for _, _, run in runners]  # the first run compiles
    times = np.full(len(runners), math.inf)
    for turn in range(rounds):
        for i, (_, _, run) in enumerate(runners):
            times[i] = min(times[i], _timed(run))
            say(turn * len(runners) + i + 1, rounds * len(runners))
    entries = []
    cannot = {peer.NAME: getattr(peer, "CANNOT", "") for peer in PEERS}
    for (name, how, _), events, spent in zip(runners, found, times.tolist()):
        truth = other if name == OURS and not how.startswith("rk4") else best
        entries.append(Entry(name, how, _error(events, truth), o.seconds / spent, cannot.get(name, "")))
    return entries + absent


def _timed(run: Callable[[], object]) -> float:
    """The shortest time [s] of the runs that fit into `TURN`, at least one."""
    end, best = time.perf_counter() + TURN, math.inf
    while (begin := time.perf_counter()) < end:
        run()
        best = min(best, time.perf_counter() - begin)
    return best


def _references(scene: Scene, o: Oscillator) -> tuple[list[float], list[float]]:
    """Event times of our best method, and of rk4 at its finest step."""
    system = scene.assemble().system()
    first = Setting("exact") if system.linear else Setting("dopri5", TIGHTEST)
    runs = (first, Setting("rk4", step_ns=by_rig.STEP_NS // 100))
    best, other = (by_rig.prepare(scene, one, o.seconds)() for one in runs)
    return best, other


def _error(events: Sequence[float], truth: Sequence[float]) -> float:
    if len(events) != len(truth) or len(truth) < 4:
        return math.inf
    period = (truth[-1] - truth[-3]) if len(truth) > 2 else 1.0
    return float(np.abs(np.subtract(events, truth)).max() / period)


def cheapest(entries: Sequence[Entry], target: float) -> list[Entry]:
    """Return for each peer the fastest setting that meets `target`, this project first; else the one with the best
    error.
    """
    out = []
    for peer in dict.fromkeys(one.peer for one in entries):
        mine = [one for one in entries if one.peer == peer]
        enough = [one for one in mine if one.error <= target]
        out.append(max(enough, key=lambda one: one.factor) if enough else min(mine, key=lambda one: one.error))
    return out
