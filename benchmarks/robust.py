"""Benchmark of a robust design: shunt of the squealing brake, four free and four uncertain values, audit included."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from rig.analysis import robust
from rig.scenes.loader import load

_INDUCTANCE = 0.03647488974112161  # H, of the shipped shunt
_FREE = {
    "shunt.resistance": (5.0, 300.0),
    "shunt.inductance": (0.1 * _INDUCTANCE, 1.6 * _INDUCTANCE),
    "shunt.delta": (-0.85, -0.2),
    "springs.bridge.stiffness": "2e7 N/m:8e7 N/m",
}
_UNCERTAIN = {
    "friction.mu": "+-2 %",
    "piezo.capacitance": "+-5 %",
    "shunt.delta": "+-5 %",
    "shunt.inductance": "+-5 %",
}


def measured() -> dict[str, Any]:
    """Return how long the design takes with two workers [s], its rigs, and the growth of the worst one."""
    scene = load("brake_shunt", {"shunt.connected": True})
    job = robust.prepared(scene, _FREE, _UNCERTAIN, "modes.growth", band="2 kHz:5 kHz")
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        found = robust.designed(job, Path(folder), workers=2)
    seconds = time.perf_counter() - began
    return {"design_s": seconds, "rigs": found.found.assembled, "worst_1_per_s": found.worst}
