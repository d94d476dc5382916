"""Benchmark of whole runs of `rig simulate`: sensors, controller, protocol, outputs; and of the start of processes."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import rig
from benchmarks.one_contact import over_exact
from rig.bench.run import local_controllers
from rig.bench.run.before import findings
from rig.qualify.doctor import warmup
from rig.scenes.scene import Scene


class Run(NamedTuple):
    """Runs of `short` and `long` seconds; their difference excludes the cost of start and end."""

    title: str
    scene: str
    changes: Mapping[str, Any]
    short: float
    long: float
    most: float
    """Largest time over that of the pendulum's exact kernel."""
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
    "open": Run("belt, four sensors, no controller", "belt", STRAIN, 20.0, 120.0, 120.0),
    "python": Run("belt, closed loop, controller in Python", "belt_normal_force", LOOP, 10.0, 60.0, 600.0),
    "compiled": Run("the same, controller compiled", "belt_normal_force", LOOP, 10.0, 60.0, 150.0, compiled=True),
    "squeal": Run("brake that squeals, three instruments at 50 kHz", "brake_shunt", SQUEAL, 1.0, 3.0, 20_000.0),
    "disc_slider": Run("slider on a flexible disc, stick-slip", "disc_slider", {}, 1.0, 3.0, 20_000.0),
    "plate": Run("plate of 40 modes under a slider on 40 points", "plate", {}, 0.2, 0.8, 80_000.0),
    "plate_96": Run("the same, 96 points", "plate_96", {}, 0.2, 0.8, 200_000.0),
}


WITH_MEMORY = ("rate_state", "lugre", "stick_time", "contact_temperature")
"""Friction laws whose belts are examined before a run."""


def before(rounds: int = 5) -> dict[str, float]:
    """Return the processor time [s] of the stability report of a belt by law: its least one of `rounds`."""
    least = {}
    for law in WITH_MEMORY:
        scene = rig.load(f"belt_{law}")
        system = scene.assemble().system()
        times = []
        for _ in range(rounds):
            begin = time.process_time()
            findings(scene, system)
            times.append(time.process_time() - begin)
        least[f"{law}_s"] = min(times)
    return least


def simulate(rounds: int = 5) -> dict[str, Any]:
    """Return the real-time factor of the pendulum with sensors and controller in processor time, kernels compiled, and
    its time over that of the exact kernel.
    """
    scene = rig.load("pendulum")
    rig.simulate(scene, 1.0)
    best, length = float("inf"), 0.0
    for _ in range(rounds):
        begin = time.process_time()
        length = float(rig.simulate(scene).time[-1])
        best = min(best, time.process_time() - begin)
    return {"seconds": length, "processor_s": best, **over_exact({"run": length / best})["run"]}


def marginal(rounds: int = 5) -> dict[str, dict[str, float]]:
    """Return the real-time factor of a further second of each run, in processor time, the runs alternating, and its
    time over that of the pendulum's exact kernel.
    """
    scenes = {name: rig.load(run.scene, dict(run.changes)) for name, run in RUNS.items()}
    best: dict[tuple[str, float], float] = {}
    for turn in range(rounds + 1):  # the first one compiles
        for name, run in RUNS.items():
            for seconds in (run.short, run.long):
                taken = _taken(scenes[name], seconds, run.compiled)
                if turn:
                    best[name, seconds] = min(best.get((name, seconds), taken), taken)
    return over_exact(
        {name: (run.long - run.short) / (best[name, run.long] - best[name, run.short]) for name, run in RUNS.items()}
    )


def _taken(scene: Scene, seconds: float, compiled: bool) -> float:
    """Processor time of a run [s]."""
    worth, local_controllers.WORTH = local_controllers.WORTH, 0 if compiled else sys.maxsize
    try:
        begin = time.process_time()
        rig.simulate(scene, seconds)
        return time.process_time() - begin
    finally:
        local_controllers.WORTH = worth


BARE = "numpy"
STARTS = {
    BARE: ("-c", "import numpy"),
    "list": ("-m", "rig", "list"),
    "simulate": ("-m", "rig", "simulate", "belt", "--duration", "0.1"),
    "recorder": ("-c", "import rig.record.recorder"),
}
"""New processes, by name: what they do."""


def start(rounds: int = 5) -> dict[str, Any]:
    """Return the processor time [s] of new processes, median of `rounds` in turns after `rig tool warmup`, and that of
    each over the time of Python with numpy.
    """
    warmup(names=["belt"])
    own = os.environ | {"RIG_OWN_PROCESS": "1"}  # as the command sets it for its processes
    own.pop("PYTHONDONTWRITEBYTECODE", None)  # or each start would compile edited sources of rig anew
    times: dict[str, list[float]] = {name: [] for name in STARTS}
    for _ in range(rounds + 1):  # the first ones read the files
        for name, words in STARTS.items():
            before = os.times()
            subprocess.run([sys.executable, *words], check=True, capture_output=True, env=own)
            after = os.times()
            times[name].append(sum(after[2:4]) - sum(before[2:4]))
    seconds = {name: statistics.median(taken[1:]) for name, taken in times.items()}
    return {f"{name}_s": taken for name, taken in seconds.items()} | {
        "over_numpy": {name: taken / seconds[BARE] for name, taken in seconds.items()}
    }
