"""Benchmark of a controller on a board: a stand-in on this machine, by UDP, in turns with the shipped controller."""

from __future__ import annotations

import statistics
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from rig.bench.live import supervise
from rig.controllers.runtime.stand_in import started
from rig.design import described
from rig.scenes.loader import load

SHIPPED, ON_BOARD = "belt_normal_force", "belt_device"


def measured(seconds: float, rounds: int) -> dict[str, Any]:
    """Return the time from step to command of paced runs [ms], and steps without an answer of the board.

    `p99_ratio`: that on the board over that of the shipped controller, the median of the rounds.
    """
    runs: dict[str, list[dict[str, Any]]] = {SHIPPED: [], ON_BOARD: []}
    for _ in range(rounds):
        for name, summaries in runs.items():
            summaries.append(_run(name, seconds))
    times = {name: [each["round_trip"]["p99"] / 1e3 for each in summaries] for name, summaries in runs.items()}
    worst = max(runs[ON_BOARD], key=lambda each: ("VALID", "DEGRADED", "INVALID").index(each["verdict"]))
    return {
        "p99_ms": times,
        "p99_ratio": statistics.median([board / own for own, board in zip(times[SHIPPED], times[ON_BOARD])]),
        "missed": sum(each["controllers"]["nf"]["missed"] for each in runs[ON_BOARD]),
        "verdict": worst["verdict"],
    }


def _run(name: str, seconds: float) -> dict[str, Any]:
    """The summary of a paced run of a scene."""
    scene = load(name)
    board: Any = nullcontext()
    if name == ON_BOARD:
        board = started(scene.controllers["nf"].port, described(load(SHIPPED))["nf"])
    with board, tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "bench.mcap"
        return supervise.run(scene, duration=seconds, out=out, say=lambda _: None).to_json()
