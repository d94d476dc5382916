"""First runs with nothing compiled, of this version and of another, one after the other: the pendulum, then a scene
that needs other kernels, then `rig tool warmup` from nothing.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

SCENES = ("pendulum", "disc_slider")
ROOT = Path(__file__).resolve().parents[1]
WARMUP = "from rig.machine import scheduling; from rig.qualify import doctor; doctor.warmup(workers=scheduling.cores())"
"""What `rig tool warmup` does, by names that other versions have too."""


class Spent(NamedTuple):
    """Wall time and processor time [s]."""

    wall: float
    processor: float


def compared(there: Path) -> dict[str, dict[str, float]]:
    """Return for each run of this version its times [s], and their ratios to those of the checkout `there`."""
    return {
        name: {
            "wall_s": ours.wall,
            "processor_s": ours.processor,
            "wall": ours.wall / theirs.wall,
            "processor": ours.processor / theirs.processor,
        }
        for (name, ours), theirs in zip(_runs(ROOT).items(), _runs(there).values())
    }


def _runs(checkout: Path) -> dict[str, Spent]:
    """The times of each run of one version, and of the two scenes together."""
    with tempfile.TemporaryDirectory() as store, tempfile.TemporaryDirectory() as other:
        times = {scene: _run(checkout, store, "simulate", scene, "--duration", "1") for scene in SCENES}
        both = Spent(*(sum(column) for column in zip(*times.values())))
        return {**times, "both": both, "warmup": _spent(checkout, other, "-c", WARMUP)}


def _run(checkout: Path, kernels: str, *words: str) -> Spent:
    return _spent(checkout, kernels, "-m", "rig", *words)


def _spent(checkout: Path, kernels: str, *words: str) -> Spent:
    path = os.pathsep.join([str(checkout), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "RIG_KERNELS": kernels, "RIG_OWN_PROCESS": "1"}
    begin, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, *words], cwd=kernels, env=environment, check=True, capture_output=True)
    after = os.times()
    return Spent(time.perf_counter() - begin, sum(after[2:4]) - sum(before[2:4]))
