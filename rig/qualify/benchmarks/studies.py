"""Benchmark of studies: points per second, the gain by a second worker, locally and with dask, and the cost of a point.

P1     tests/problems/p1.toml for 100 s, RMS of the displacement, over the load
loop   the pendulum with sensors and controller for 2 s, RMS of the velocity, over the gain of its controller
empty  units that compute nothing: what distributing, saving and reading a point costs

One worker, two, and two of dask take turns, for some seconds each; efficiencies are medians over the rounds.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from rig.analysis.pool import Arrays, Work, carry_out, temporary
from rig.analysis.studies import prepared
from rig.qualify.benchmarks.rates import Workers, compared, rate, rounds
from rig.scenes import load

P1 = Path(__file__).parents[3] / "tests" / "problems" / "p1.toml"
ONE, TWO, DASK = Workers(1), Workers(2), Workers(2, "local")
_ROUND, _ROUNDS = 6.0, 5  # s of a round
_QUICK, _FEW = 3.0, 3


def row(unit: int) -> Arrays:
    """Return a row of a study, computed in no time."""
    return {"values": np.zeros(3), "units": np.array(["m", "s", "1"]), "reason": np.array("")}


def points(what: str, count: int) -> Work:
    """Return the study "P1" or "loop" with `count` points."""
    if what == "P1":
        scene = load(str(P1))
        return prepared(scene, {"load.force": f"9 N:11 N:{count}"}, ["run.rms"], duration=100.0).work
    scene = load("pendulum")
    return prepared(scene, {"controllers.nf.gain": f"100 N*s/m:400 N*s/m:{count}"}, ["run.rms"], duration=2.0).work


def measured(what: str, quick: bool, dask: bool) -> dict[str, Any]:
    """Return what `compared` says about one worker and two, and with `dask` about two workers of dask."""
    kinds = [ONE, TWO, *([DASK] if dask else [])]
    alone = rate(points(what, 40), ONE).units
    units = max(int(alone * (_QUICK if quick else _ROUND)), 40)
    found = rounds(lambda count: points(what, count), kinds, units, _FEW if quick else _ROUNDS)
    names = ("one", "two", "dask")
    return {name: compared(some, found[0], kind.number) for name, kind, some in zip(names, kinds, found)} | {
        "units": units,
        "rounds": len(found[0]),
    }


def overhead_ms(quick: bool) -> float:
    """Return what an empty point costs with two workers [ms], from the first result to the last one read again."""
    work = Work(row, range(5_000 if quick else 50_000))
    told: list[tuple[float, int]] = []
    with temporary(work) as store:
        carry_out(work, store, 2, lambda done, _: told.append((time.perf_counter(), done)), apart=True)
    end = time.perf_counter()
    first, count = next((at, done) for at, done in told if done)
    return 1e3 * (end - first) / (work.total - count)
