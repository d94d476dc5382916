"""Comparison of all solvers, alternating: error of event times over the cost of a run, for this rig and each installed
peer.

The error is the largest difference of a mode change's time from the reference, as a share of the period; infinite if
changes were missed or invented. Our own methods are compared with another of our methods (rig.qualify.cost.reference),
the peers with our best. For each setting the best of the rounds counts, because other work on the machine only makes a
run longer.
"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rig.analysis.motion_measures import TIGHTEST, Setting, eligible, ladder
from rig.analysis.pool import Progress
from rig.machine.files import csv_table, write_file
from rig.qualify.cost.peers.oscillator import Oscillator
from rig.qualify.cost.peers.solvers import PEERS, STEP_NS, Run, by_rig
from rig.qualify.cost.report import sheet
from rig.scenes.scene import Scene
from rig.stability.report import fastest_eigenvalue
from rig.view.palette import ALARM, AMBER, BLUE, GREEN, GREY, PURPLE, VERMILION, put

ROUNDS = 5
TURN = 0.05  # s for each setting in a round
OURS = "friction-rig"
ABSENT = "is not installed"


@dataclass(frozen=True)
class Entry:
    """One setting of one peer: error of event times (of a period), real-time factor; `fault`: why it cannot run."""

    peer: str
    setting: str
    error: float
    factor: float
    fault: str = ""


def race(scene: Scene, rounds: int = ROUNDS, report: Progress | None = None) -> list[Entry]:
    """Run all solvers. Raises UsageError if the scene has features that the peers cannot express."""
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
            absent.append(Entry(peer.name, "", math.inf, math.nan, ABSENT))
            continue
        for rung in peer.ladder:
            entry = Entry(peer.name, f"{rung[0]} at {rung[1]:.0e}", math.inf, math.nan, peer.cannot)
            runners.append((entry, peer.prepare(o, rung), best))
    errors = [_error(run(), truth) for _, run, truth in runners]  # the first run compiles
    times = np.full(len(runners), math.inf)
    for turn in range(rounds):
        for i, (_, run, _) in enumerate(runners):
            times[i] = min(times[i], _timed(run))
            if report is not None:
                report(turn * len(runners) + i + 1, rounds * len(runners))
    return [
        *(replace(entry, error=error, factor=o.seconds / spent)
          for (entry, *_), error, spent in zip(runners, errors, times.tolist())),
        *absent,
    ]  # fmt: skip


def _timed(run: Run) -> float:
    """The shortest time [s] of the runs that fit into `TURN`, at least one."""
    end, best = time.perf_counter() + TURN, math.inf
    while (begin := time.perf_counter()) < end:
        run()
        best = min(best, time.perf_counter() - begin)
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


COLUMNS = ("solver", "setting", "error of event times", "real-time factor", "rig is faster by", "")
_COLOURS = (BLUE, GREEN, PURPLE, AMBER, VERMILION, GREY)


def lines(entries: Sequence[Entry], target: float) -> list[tuple[str, ...]]:
    """Return for each solver the fastest setting that meets `target`."""
    best = cheapest(entries, target)
    rows: list[tuple[str, ...]] = []
    for entry in best:
        if math.isnan(entry.factor):
            rows.append((entry.peer, "", "", "", "", entry.fault))
            continue
        short = "" if entry.error <= target else f"does not reach {target:g}"
        ratio = f"{best[0].factor / entry.factor:.0f}" if entry.peer != OURS and not short else ""
        error = f"{entry.error:.1e}" if math.isfinite(entry.error) else "changes missed or invented"
        note = "; ".join(part for part in (short, entry.fault) if part)
        rows.append((entry.peer, entry.setting, error, f"{entry.factor:.3g}", ratio, note))
    return rows


def write(entries: Sequence[Entry], path: Path) -> None:
    """Write the comparison as CSV. Raises OutputError."""
    head = ("solver", "setting", "largest error of event times / period", "real-time factor", "fault")
    write_file(path, csv_table([head, *(vars(entry).values() for entry in entries)]))


def draw(entries: Sequence[Entry], title: str, machine: dict[str, str], target: float, path: Path) -> None:
    """Draw the error of event times over compute time, a curve for each method of each solver."""
    with sheet(f"{title}: beside other solvers", machine) as figure:
        axes = figure.add_subplot()
        for colour, peer in zip(_COLOURS, dict.fromkeys(entry.peer for entry in entries)):
            mine = [entry for entry in entries if entry.peer == peer and math.isfinite(entry.error)]
            marks = iter("osD^v")
            for method in dict.fromkeys(entry.setting.partition(" at ")[0] for entry in mine):
                points = [entry for entry in mine if entry.setting.partition(" at ")[0] == method]
                x, y = [1e3 / entry.factor for entry in points], [entry.error for entry in points]
                axes.plot(x, y, color=colour, marker=next(marks), ms=5, lw=1.2, label=f"{peer} {method}")
            if not mine:
                why = next(entry.fault for entry in entries if entry.peer == peer)
                axes.plot([], [], " ", label=f"{peer}: {why.partition(':')[0]}")
        axes.axhline(target, color=ALARM, lw=1.0, ls=":", label=f"{target:g}")
        axes.set(xscale="log", yscale="log", xlabel="compute in 1 ms of simulated time [us], samples every 1 ms")
        axes.set_ylabel("largest error of event times / period")
        figure.legend(loc="outside lower left", ncols=3)
    put(figure, path)
