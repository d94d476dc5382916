"""Benchmark of a map of 100 x 100 points with run-up and run-down: its time, and the gain by a second core."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

SCENE = "lever"
X, Y = "drive.speed=0.5 rpm:8 rpm:{}", "load.force=10 N:30 N:{}"


def efficiency(points: int, scene: str = SCENE, x: str = X, y: str = Y) -> dict[str, Any]:
    """Return wall times [s] of a map of `points` x `points` with one and two workers, kernels compiled, and the
    efficiency.
    """
    from rig import load
    from rig.analysis.map import chart, job

    loaded = load(scene)
    with tempfile.TemporaryDirectory() as folder:
        chart(job(loaded, x.format(4), y.format(4), runs=("up", "down")), Path(folder), 2)
        wall = {}
        for workers in (1, 2):
            asked = job(loaded, x.format(points), y.format(points), runs=("up", "down"))
            begin = time.perf_counter()
            chart(asked, Path(folder) / str(workers), workers)
            wall[workers] = time.perf_counter() - begin
    return {"points": points**2, "wall": wall, "efficiency": wall[1] / (2.0 * wall[2])}
