"""Benchmark of whole runs of `rig simulate`: sensors, controller, protocol, outputs; and of the start of a process."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import rig
from rig.bench.run import local_controllers
from rig.qualify.bug_report import warmup
from rig.scenes.scene import Scene


class Run(NamedTuple):
    """Runs of `short` and `long` seconds; their difference excludes the cost of start and end."""

    title: str
    scene: str
    changes: Mapping[str, Any]
    short: float
    long: float
    floor: float
    """Smallest real-time factor."""
    compiled: bool = False
    """Whether controllers are compiled, however short the run is."""


STRAIN = {"sensors.strain.kind": "strain_gauge", "sensors.strain.rate": 1000.0}
LOOP = {"controllers.nf.enable_at": 0.0}
SQUEAL = {
    "start.velocity": 0.2,
    "sensors.microphone.kind": "microphone",
    "sensors.microphone.rate": 50e3,
    "sensors.voltage.kind": "voltmeter",
    "sensors.voltage.rate": 50e3,
}
RUNS = {
    "open": Run("belt, four sensors, no controller", "belt", STRAIN, 20.0, 120.0, 2000.0),
    "python": Run("belt, closed loop, controller in Python", "belt_normal_force", LOOP, 10.0, 60.0, 250.0),
    "compiled": Run("the same, controller compiled", "belt_normal_force", LOOP, 10.0, 60.0, 1500.0, compiled=True),
    "squeal": Run("brake that squeals, three instruments at 50 kHz", "brake_shunt", SQUEAL, 1.0, 3.0, 10.0),
    "disc_slider": Run("slider on a flexible disc, stick-slip", "disc_slider", {}, 1.0, 3.0, 1.5),
    "plate": Run("plate of 40 modes under a slider on 40 points", "plate", {}, 0.2, 0.8, 1.5),
    "plate_96": Run("the same, 96 points", "plate_96", {}, 0.2, 0.8, 0.5),
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
    """Return the real-time factor of a further second of each run, in processor time, the runs alternating."""
    scenes = {name: rig.load(run.scene, dict(run.changes)) for name, run in RUNS.items()}
    best: dict[tuple[str, float], float] = {}
    for turn in range(rounds + 1):  # the first one compiles
        for name, run in RUNS.items():
            for seconds in (run.short, run.long):
                taken = _taken(scenes[name], seconds, run.compiled)
                if turn:
                    best[name, seconds] = min(best.get((name, seconds), taken), taken)
    return {name: (run.long - run.short) / (best[name, run.long] - best[name, run.short]) for name, run in RUNS.items()}


def _taken(scene: Scene, seconds: float, compiled: bool) -> float:
    """Processor time of a run [s]."""
    worth, local_controllers.WORTH = local_controllers.WORTH, 0 if compiled else sys.maxsize
    try:
        begin = time.process_time()
        rig.simulate(scene, seconds)
        return time.process_time() - begin
    finally:
        local_controllers.WORTH = worth


def start(rounds: int = 5) -> dict[str, Any]:
    """Return the wall time [s] of `rig simulate pendulum --duration 10` as a new process, after `rig warmup`."""
    warmup(names=["pendulum"])
    command = [sys.executable, "-m", "rig", "simulate", "pendulum", "--duration", "10"]
    times = []
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(time.perf_counter() - begin)
    return {"wall": min(times[1:]), "worst": max(times[1:])}
