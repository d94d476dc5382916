"""Benchmark of a map of 100 x 100 points with run-up and run-down: its rate, and the gain by a second core."""

from __future__ import annotations

from typing import Any

from rig.analysis.map import job
from rig.analysis.map.compute import units
from rig.qualify.benchmarks.rates import Workers, rate
from rig.scenes import load

SCENE = "lever"
X, Y = "drive.speed=0.5 rpm:8 rpm:{}", "load.force=10 N:30 N:{}"


def efficiency(points: int, scene: str = SCENE, x: str = X, y: str = Y) -> dict[str, Any]:
    """Return points per second of a map of `points` x `points` with one and two workers, and the efficiency."""
    work = units(job(load(scene), x.format(points), y.format(points), runs=("up", "down")))
    one, two = (rate(work, Workers(workers)).units * points for workers in (1, 2))
    return {"points": points**2, "one": one, "two": two, "efficiency": two / (2.0 * one)}
