"""The whole of `rig simulate pendulum`: sensors, controller, protocol, exchange, truth kept; and its start."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import Any


def simulate(rounds: int = 5) -> dict[str, Any]:
    """Real-time factor of the pendulum with sensors and controller, in this process, kernels compiled."""
    import rig

    scene = rig.load("pendulum")
    rig.simulate(scene, 1.0)
    best = float("inf")
    length = 0.0
    for _ in range(rounds):
        begin = time.perf_counter()
        length = float(rig.simulate(scene).time[-1])
        best = min(best, time.perf_counter() - begin)
    return {"seconds": length, "wall": best, "rtf": length / best}


def start(rounds: int = 5) -> dict[str, Any]:
    """Wall time of `rig simulate pendulum --duration 10` as a new process, kernels compiled."""
    command = [sys.executable, "-m", "rig", "simulate", "pendulum", "--duration", "10"]
    times = []
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(time.perf_counter() - begin)
    return {"wall": min(times[1:]), "worst": max(times[1:])}
