"""The whole of `rig simulate`: sensors, controller, protocol, exchange, truth kept; and the start of a process."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any

from rig.study.warmup import warmup

SQUEAL = {
    "start.velocity": 0.2,
    "sensors.microphone.kind": "microphone",
    "sensors.microphone.rate": 50e3,
    "sensors.voltage.kind": "voltmeter",
    "sensors.voltage.rate": 50e3,
}


def simulate(rounds: int = 5) -> dict[str, Any]:
    """Real-time factor of the pendulum with sensors and controller, in this process, kernels compiled."""
    return _timed("pendulum", {}, None, rounds)


def squeal(rounds: int = 3, seconds: float = 5.0) -> dict[str, Any]:
    """Real-time factor of the brake with its shunt open, squealing, heard by three instruments at 50 kHz."""
    return _timed("brake_shunt", SQUEAL, seconds, rounds)


def _timed(name: str, changes: Mapping[str, Any], seconds: float | None, rounds: int) -> dict[str, Any]:
    import rig

    scene = rig.load(name, changes)
    rig.simulate(scene, 1.0)
    best, length = float("inf"), 0.0
    for _ in range(rounds):
        begin = time.perf_counter()
        length = float(rig.simulate(scene, seconds).time[-1])
        best = min(best, time.perf_counter() - begin)
    return {"seconds": length, "wall": best, "rtf": length / best}


def start(rounds: int = 5) -> dict[str, Any]:
    """Wall time of `rig simulate pendulum --duration 10` as a new process, after `rig warmup`."""
    warmup(names=["pendulum"])
    command = [sys.executable, "-m", "rig", "simulate", "pendulum", "--duration", "10"]
    times = []
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(time.perf_counter() - begin)
    return {"wall": min(times[1:]), "worst": max(times[1:])}
