"""Benchmark of a controller on a board: a stand-in on this machine, by UDP, in turns with the shipped controller.

Each run is told on stderr when it has ended.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from rig.bench.live import supervise
from rig.controllers.runtime.stand_in import started
from rig.design import described
from rig.errors import RigError
from rig.scenes.loader import load

SHIPPED, ON_BOARD = "belt_normal_force", "belt_device"
NAME = "nf"
"""The controller of both."""
START_S = 6.0
"""Time that a run takes besides its duration [s], for the announcement."""


def measured(seconds: float, rounds: int) -> dict[str, Any]:
    """Return the time from step to command of paced runs [ms], and steps without an answer of the board.

    `p99_ratio`: that on the board over that of the shipped controller, the median of the rounds. Raises RigError for a
    run that ends early.
    """
    order = rounds * [SHIPPED, ON_BOARD]
    _say(f"{len(order)} runs of {seconds:g} s, about {len(order) * (seconds + START_S) / 60.0:.1f} minutes")
    runs: dict[str, list[dict[str, Any]]] = {SHIPPED: [], ON_BOARD: []}
    for number, name in enumerate(order, 1):
        summary = _run(name, seconds)
        runs[name].append(summary)
        p99 = summary["round_trip"]["p99"] / 1e3
        missed = summary["controllers"][NAME].get("missed", 0)
        reasons = "; ".join(summary["reasons"])
        _say(f"{number} of {len(order)}, {name}: p99 {p99:.3f} ms, {missed} missed, {summary['verdict']}: {reasons}")
    times = {name: [each["round_trip"]["p99"] / 1e3 for each in summaries] for name, summaries in runs.items()}
    worst = max(runs[ON_BOARD], key=lambda each: ("VALID", "DEGRADED", "INVALID").index(each["verdict"]))
    missed = [each["controllers"][NAME]["missed"] for each in runs[ON_BOARD]]
    return {
        "p99_ms": times,
        "p99_ratio": statistics.median([board / own for own, board in zip(times[SHIPPED], times[ON_BOARD])]),
        "missed_by_run": missed,
        "missed": sum(missed),
        "verdict": worst["verdict"],
    }


def _run(name: str, seconds: float) -> dict[str, Any]:
    """The summary of a paced run of a scene. Raises RigError if it ends early."""
    scene = load(name)
    board: Any = nullcontext()
    if name == ON_BOARD:
        board = started(scene.controllers[NAME].port, described(load(SHIPPED))[NAME])
    with board, tempfile.TemporaryDirectory() as folder:
        outcome = supervise.run(scene, duration=seconds, out=Path(folder) / "bench.mcap", say=_say)
    summary = outcome.to_json()
    if summary["seconds"] < seconds or NAME not in summary["controllers"]:
        why = "; ".join([*summary["reasons"], *summary["died"]])
        raise RigError(f"{name} ended at {summary['seconds']:g} of {seconds:g} s ({summary['ended']}): {why}")
    return summary


def _say(text: str) -> None:
    sys.stderr.write(f"  {text}\n")
    sys.stderr.flush()
