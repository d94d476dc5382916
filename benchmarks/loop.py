"""Benchmark of the loop over the bus, beside bare round trips measured alternately.

Plant at 1 kHz with the vibrometer at 10 kHz in blocks, one controller, recorder, viewer bridge. A paced run gives
losses, the age of commands when they take effect, and the time from the plant's put to the command in its queue. A
lockstep run gives the time of a tick. Both are compared with a bare round trip over the bus to a process that only
answers.
"""

from __future__ import annotations

import lzma
import runpy
import shutil
import statistics
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from rig.bench.live import supervise
from rig.errors import BusError
from rig.qualify.doctor import round_trips
from rig.scenes.loader import load

CHANGES = {"sensors.vibrometer.rate": "10000 Hz", "sensors.vibrometer.ideal": False}
ROUNDS = 5
ROOT = Path(__file__).parents[1]


def beside_bare(
    rounds: int = ROUNDS, lockstep_s: float = 3.0, paced_s: float = 6.0, bare_s: float = 1.0
) -> dict[str, Any]:
    """Measure short runs in lockstep and paced, alternating with bare round trips over the bus; times in us.

    In each round, a tick in lockstep and the paced run's median from put to command are divided by the mean of the
    bare medians before and after; the ratios `over_bare` are the medians over the rounds. `bare` is the round trip of
    `rig tool doctor`, with a pause before each. `back_to_back` is one directly after the other, which finds warm
    caches: a tick in lockstep is also compared with it. `publish`: mean publishing time of a frame in the paced runs.
    Raises BusError if bare round trips cannot be measured.
    """
    times: dict[str, list[float]] = {"lockstep": [], "paced": [], "publish": []}
    bare, back_to_back = [_bare(bare_s)], [_bare(bare_s, paced=False)]
    for _ in range(rounds):
        summary = _run(lockstep_s, pace=None)
        times["lockstep"].append(1e6 * summary["wall_seconds"] / summary["ticks"])
        back_to_back.append(_bare(bare_s, paced=False))
        summary = _run(paced_s, web=True)
        times["paced"].append(summary["round_trip"]["p50"])
        times["publish"].append(summary["timing"]["spans"]["publish"]["mean"])
        bare.append(_bare(bare_s))
    ratios = {
        "lockstep": over_bare(times["lockstep"], bare),
        "lockstep_back_to_back": over_bare(times["lockstep"], back_to_back),
        "paced": over_bare(times["paced"], bare),
    }
    times |= {"bare": bare, "back_to_back": back_to_back}
    medians: dict[str, Any] = {f"{name}_us": statistics.median(values) for name, values in times.items()}
    return medians | {
        "over_bare": {name: statistics.median(values) for name, values in ratios.items()},
        "rounds_us": times,
    }


def over_bare(times: list[float], around: list[float]) -> list[float]:
    """Each of `times` over the mean of the two of `around` that were measured before and after it."""
    return [2.0 * time / (before + after) for time, before, after in zip(times, around, around[1:])]


def paced(seconds: float) -> dict[str, Any]:
    """Return timing and losses of a paced run of the loop, with recorder and viewer bridge."""
    summary = _run(seconds, web=True)
    trip = summary["round_trip"]
    controllers = {}
    for name, counts in summary["loop"].items():
        controllers[name] = {key: counts[key] for key in ("taken", "late", "oldest")}
    return _timing(summary) | {
        "step_to_command_ms": {name: trip[name] / 1e3 for name in ("p50", "p99")},
        "controllers": controllers,
    }


def plate() -> dict[str, Any]:
    """Return timing and losses of a paced run of the plate under a slider on 40 points, over its whole protocol, in
    steps of 2 us, with recorder and viewer bridge.
    """
    return _timing(_run(None, "plate", {}, web=True))


def disc(seconds: float = 10.0) -> dict[str, Any]:
    """Return timing and losses of the squealing disc of docs/structure.md: eight points with friction on matrices of
    CalculiX in steps of 1 us, two sensors at 20 kHz, recorder, pace 1.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for scene in (ROOT / "docs").glob("disc_*.toml"):
            shutil.copy(scene, folder)
        runpy.run_path(str(ROOT / "docs" / "disc_with_pads.py"))["write"](folder)
        for packed in (ROOT / "tests" / "data" / "disc_with_pads").glob("*.xz"):
            (folder / packed.stem).write_bytes(lzma.decompress(packed.read_bytes()))
        return _timing(_run(seconds, str(folder / "disc_squeal.toml"), {}))


def measured(quick: bool, seconds: float) -> dict[str, Any]:
    """Return all of them, with a paced run of the loop over `seconds`."""
    short, longer = beside_bare(2 if quick else ROUNDS), paced(seconds)
    longer["over_bare"] = 1e3 * longer["step_to_command_ms"]["p50"] / short["bare_us"]
    return {"short": short, "paced": longer, "plate": plate(), "disc": disc()}


def _timing(summary: dict[str, Any]) -> dict[str, Any]:
    timing = summary["timing"]
    return {
        "verdict": summary["verdict"],
        "late_share": timing["late_share"],
        "stolen_share": timing["stolen_share"],
        "lost": sum(summary["lost"].values()),
        "lateness_us": {name: timing["lateness"][name] for name in ("p50", "p99", "max")},
    }


def _run(
    seconds: float | None, name: str = "belt_normal_force", changes: dict[str, Any] = CHANGES, **how: Any
) -> dict[str, Any]:
    """The summary of a run of a scene."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "bench.mcap"
        return supervise.run(load(name, changes), duration=seconds, out=out, say=lambda _: None, **how).to_json()


def _bare(seconds: float, *, paced: bool = True) -> float:
    """Median of bare round trips over the bus [us]."""
    trips, _, fault = round_trips(seconds, paced=paced)
    if fault:
        raise BusError(fault)
    return float(np.median(trips)) / 1e3
