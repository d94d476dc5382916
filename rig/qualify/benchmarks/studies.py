"""Benchmark of studies: points per second, the gain by a second worker, locally and with dask, and the cost of a point.

P1     tests/problems/p1.toml for 100 s, RMS of the displacement, over the load
loop   the pendulum with sensors and controller for 2 s, RMS of the velocity, over the gain of its controller
empty  units that compute nothing: what distributing, saving and reading a point costs

Rates are those of rig.qualify.benchmarks.rates.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from rig.analysis.pool import Arrays, Work
from rig.analysis.studies import prepared
from rig.qualify.benchmarks.rates import rate
from rig.scenes import load

P1 = Path(__file__).parents[3] / "tests" / "problems" / "p1.toml"
_WALL, _QUICK = 40.0, 8.0  # s of one worker


@dataclass(frozen=True)
class Empty:
    """Units whose result is a row of a study, computed in no time, as a work (rig.analysis.pool)."""

    total: int
    name = "empty"
    digest = ""

    def prepare(self) -> None:
        """Nothing is compiled."""

    def compute(self, unit: int) -> Arrays:
        """Return the row."""
        return {"values": np.zeros(3), "units": np.array(["m", "s", "1"]), "reason": np.array("")}

    def failed(self, unit: int, why: str) -> Arrays:
        """Return the row."""
        return self.compute(unit)

    def to_json(self) -> str:
        """Return the work as JSON text."""
        return json.dumps({"total": self.total})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the work of a text by `to_json`."""
        return cls(json.loads(text)["total"])


def points(what: str, count: int) -> Work:
    """Return the study "P1" or "loop" with `count` points."""
    if what == "P1":
        scene = load(str(P1))
        return prepared(scene, {"load.force": f"9 N:11 N:{count}"}, ["run.rms"], duration=100.0)
    scene = load("pendulum")
    return prepared(scene, {"controllers.nf.gain": f"100 N*s/m:400 N*s/m:{count}"}, ["run.rms"], duration=2.0)


def measured(what: str, quick: bool, dask: bool) -> dict[str, Any]:
    """Return the rates with one and two workers and the efficiency, and with `dask` those of two workers of dask."""
    one = rate(points(what, 40), 1)
    count = max(int(one.units * (_QUICK if quick else _WALL)), 40)
    work = points(what, count)
    one, two = rate(work, 1), rate(work, 2)
    found = {"points": count, "one": vars(one), "two": vars(two), "efficiency": two.units / (2.0 * one.units)}
    if dask:
        both = rate(work, 2, "local")
        found |= {"dask": vars(both), "efficiency_dask": both.units / (2.0 * one.units)}
    return found


def overhead_ms(quick: bool) -> float:
    """Return what an empty point costs with two workers [ms]."""
    return 1e3 / rate(Empty(5_000 if quick else 50_000), 2).units
