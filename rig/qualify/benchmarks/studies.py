"""Benchmark of studies: points per second, the gain by a second worker, locally and with dask, and the cost of a point.

P1     tests/problems/p1.toml for 100 s, RMS of the displacement, over the load
loop   the pendulum with sensors and controller for 2 s, RMS of the velocity, over the gain of its controller
empty  units that compute nothing: what distributing, saving and reading a point costs

One worker, two, and two of dask take turns, for some seconds each; efficiencies are medians over the rounds.

The rate of a work of many units with different numbers of workers, in turns: this machine's own speed changes.

A rate counts from the instant at which every worker has finished a unit to the end of the last one: workers take
seconds to start, whatever follows. Of a unit that is under way at the first instant, only the rest counts.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rig.analysis.pool import Arrays, Work, carry_out, temporary
from rig.analysis.studies import prepared
from rig.scenes import load


class Workers(NamedTuple):
    """`number` worker processes of this machine, or of a dask cluster that is started for them."""

    number: int
    cluster: str = ""


@dataclass(frozen=True)
class Rate:
    """Units per second, and the time to the first result [s]."""

    units: float
    start: float


def timed(work: Work, unit: int) -> Arrays:
    """Compute a unit; return its result with process, begin and end. The clock is the same in all processes."""
    begin = time.monotonic()
    arrays = work.compute(unit)
    return arrays | {"#times": np.array([os.getpid(), begin, time.monotonic()])}


def rate(work: Work, workers: Workers) -> Rate:
    """Measure a work with one kind of workers."""
    began = time.monotonic()
    every = Work(partial(timed, work), range(work.total), prepare=work.prepare)
    with temporary(every) as store:
        results = carry_out(every, store, workers.number, apart=True, cluster=workers.cluster)
    process, begin, end = np.array([arrays["#times"] for arrays in results.values()]).T
    first = max(end[process == pid].min() for pid in np.unique(process))
    counted = np.clip(end - np.maximum(begin, first), 0.0, None) / (end - begin)
    return Rate(float(counted.sum() / (end.max() - first)), float(end.min() - began))


def rounds(make: Callable[[int], Work], kinds: Sequence[Workers], units: int, count: int) -> list[list[Rate]]:
    """Measure kinds of workers in turns, `count` times; return [kind][round].

    `make`: returns the work with a number of units; each worker gets `units` of them.
    """
    rates: list[list[Rate]] = [[] for _ in kinds]
    for turn in range(count):
        order = range(len(kinds)) if turn % 2 == 0 else reversed(range(len(kinds)))
        for k in order:
            rates[k].append(rate(make(units * kinds[k].number), kinds[k]))
    return rates


def compared(rates: Sequence[Rate], single: Sequence[Rate], workers: int) -> dict[str, Any]:
    """Return medians over rounds: rate, start, and efficiency, the gain over a `single` one for each of `workers`."""
    gains = [a.units / (workers * b.units) for a, b in zip(rates, single)]
    return {
        "units": float(np.median([a.units for a in rates])),
        "start": float(np.median([a.start for a in rates])),
        "efficiency": float(np.median(gains)),
        "least": min(gains),
        "greatest": max(gains),
    }


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
    rates = rounds(lambda count: points(what, count), kinds, units, _FEW if quick else _ROUNDS)
    names = ("one", "two", "dask")
    return {name: compared(some, rates[0], kind.number) for name, kind, some in zip(names, kinds, rates)} | {
        "units": units,
        "rounds": len(rates[0]),
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
