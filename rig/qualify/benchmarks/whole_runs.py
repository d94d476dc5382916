"""Benchmark of whole runs of `rig simulate` with sensors, controller, protocol and outputs, and of the process
start.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import rig
from rig.bench import controller_in_process
from rig.qualify.warmup import warmup
from rig.scenes.scene import Scene

SQUEAL = {
    "start.velocity": 0.2,
    "sensors.microphone.kind": "microphone",
    "sensors.microphone.rate": 50e3,
    "sensors.voltage.kind": "voltmeter",
    "sensors.voltage.rate": 50e3,
}


class Case(NamedTuple):
    """Runs of `short` and `long` seconds; their difference excludes the cost of start and end."""

    title: str
    scene: str
    changes: Mapping[str, Any]
    short: float
    long: float
    compiled: bool = False
    """Whether controllers are compiled, however short the run is."""


LOOP = {"controllers.nf.enable_at": 0.0}
CASES = {
    "open": Case(
        "belt, four sensors, no controller",
        "belt",
        {"sensors.strain.kind": "strain_gauge", "sensors.strain.rate": 1000.0},
        20.0,
        120.0,
    ),
    "python": Case("belt, closed loop at 1 kHz, controller in Python", "belt_normal_force", LOOP, 10.0, 60.0),
    "compiled": Case("the same, controller compiled", "belt_normal_force", LOOP, 10.0, 60.0, compiled=True),
    "squeal": Case("brake that squeals, three instruments at 50 kHz", "brake_shunt", SQUEAL, 1.0, 3.0),
    "disc_slider": Case("slider on a flexible disc, stick-slip", "disc_slider", {}, 1.0, 3.0),
    "plate": Case("plate of 40 modes under a slider on 40 points that open and close", "plate", {}, 0.2, 0.8),
    "plate_96": Case("the same, 96 points", "plate_96", {}, 0.2, 0.8),
}


def simulate(rounds: int = 5) -> dict[str, Any]:
    """Return the real-time factor of the pendulum with sensors and controller, in this process, kernels compiled."""
    scene = rig.load("pendulum")
    rig.simulate(scene, 1.0)
    best, length = float("inf"), 0.0
    for _ in range(rounds):
        begin = time.perf_counter()
        length = float(rig.simulate(scene).time[-1])
        best = min(best, time.perf_counter() - begin)
    return {"seconds": length, "wall": best, "rtf": length / best}


def marginal(rounds: int = 5) -> dict[str, float]:
    """Return the real-time factor of a further second of each case, in processor time, the cases alternating."""
    scenes = {name: rig.load(case.scene, dict(case.changes)) for name, case in CASES.items()}
    best: dict[tuple[str, float], float] = {}
    for turn in range(rounds + 1):  # the first one compiles
        for name, case in CASES.items():
            for seconds in (case.short, case.long):
                taken = _taken(scenes[name], seconds, case.compiled)
                if turn:
                    best[name, seconds] = min(best.get((name, seconds), taken), taken)
    return {
        name: (case.long - case.short) / (best[name, case.long] - best[name, case.short])
        for name, case in CASES.items()
    }


def _taken(scene: Scene, seconds: float, compiled: bool) -> float:
    """Processor time of a run [s]."""
    worth, controller_in_process.WORTH = controller_in_process.WORTH, 0 if compiled else sys.maxsize
    try:
        begin = time.process_time()
        rig.simulate(scene, seconds)
        return time.process_time() - begin
    finally:
        controller_in_process.WORTH = worth


def start(rounds: int = 5) -> dict[str, Any]:
    """Return the wall time of `rig simulate pendulum --duration 10` as a new process, after `rig warmup`."""
    warmup(names=["pendulum"])
    command = [sys.executable, "-m", "rig", "simulate", "pendulum", "--duration", "10"]
    times = []
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(time.perf_counter() - begin)
    return {"wall": min(times[1:]), "worst": max(times[1:])}
