"""Benchmark of studies, and of rig identify.

P1     tests/problems/p1.toml for 100 s, RMS of the displacement, over the load
loop   the pendulum with sensors and controller for 2 s, RMS of the velocity, over the gain of its controller
empty  units that compute nothing: what distributing, saving and reading a point costs
fit    rig identify of four parameters of the belt from three noisy runs of 6 s

One worker, two, two of dask, and two studies with one worker each at the same time take turns, for some seconds each,
because this machine's own speed changes. An efficiency is the rate over that of the two studies, the median of the
rounds.

A rate counts from the instant at which every worker has finished a unit to the end of the last one: workers take
seconds to start, whatever follows. Of a unit that is under way at the first instant, only the rest counts.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.kernels import P1
from rig.analysis.identification import runs
from rig.analysis.identification.identify import identify
from rig.analysis.pool import Arrays, Work, carry_out, temporary
from rig.analysis.studies import prepared
from rig.bench.run.simulate import simulate
from rig.scenes.loader import load


class Workers(NamedTuple):
    """`number` worker processes of this machine, or of a dask cluster that is started for them."""

    number: int
    dask: bool = False


class Rate(NamedTuple):
    """Units per second, and the time to the first result [s]."""

    units: float
    start: float


KINDS = {"alone": Workers(1), "two": Workers(2), "dask": Workers(2, True), "apart": Workers(1)}


def timed(work: Work, unit: int) -> Arrays:
    """Compute a unit; return its result with process, begin and end. The clock is the same in all processes."""
    begin = time.monotonic()
    arrays = work.compute(unit)
    return arrays | {"#times": np.array([os.getpid(), begin, time.monotonic()])}


def rate(work: Work, workers: Workers) -> Rate:
    """Measure a work with one kind of workers."""
    began = time.monotonic()
    every = Work(partial(timed, work), range(work.total), prepare=work.prepare)
    with temporary(every) as store, _cluster(workers) as address:
        results = carry_out(every, store, workers.number, apart=True, cluster=address)
    process, begin, end = np.array([arrays["#times"] for arrays in results.values()]).T
    first = max(end[process == pid].min() for pid in np.unique(process))
    counted = np.clip(end - np.maximum(begin, first), 0.0, None) / (end - begin)
    return Rate(float(counted.sum() / (end.max() - first)), float(end.min() - began))


@contextmanager
def _cluster(workers: Workers) -> Iterator[str]:
    """The address of the scheduler of a dask cluster that is started for `workers`; "" if they need none."""
    if not workers.dask:
        yield ""
        return
    distributed: Any = importlib.import_module("distributed")

    with distributed.LocalCluster(
        n_workers=workers.number, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        yield cluster.scheduler_address


def apart(work: Work) -> Rate:
    """Measure a work that is computed twice at the same time, by one worker each: what this machine gives to two."""
    with ThreadPoolExecutor(2) as both:
        first, second = both.map(lambda _: rate(work, KINDS["alone"]), range(2))
    return Rate(first.units + second.units, max(first.start, second.start))


def compared(rates: Sequence[Rate], others: Sequence[Rate]) -> dict[str, Any]:
    """Return medians over rounds: rate, start, and efficiency, the rate over that of the `others`."""
    gains = [a.units / b.units for a, b in zip(rates, others)]
    units, start = np.median(rates, axis=0).tolist()
    return {
        "points_per_s": units,
        "first_result_s": start,
        "efficiency": float(np.median(gains)),
        "least": min(gains),
        "greatest": max(gains),
    }


def points(what: str, count: int) -> Work:
    """Return the study "P1" or "loop" with `count` points."""
    if what == "P1":
        return prepared(load(str(P1)), {"load.force": f"9 N:11 N:{count}"}, ["run.rms"], duration=100.0).work
    gains = {"controllers.nf.gain": f"100 N*s/m:400 N*s/m:{count}"}
    return prepared(load("pendulum"), gains, ["run.rms"], duration=2.0).work


def measured(quick: bool) -> dict[str, Any]:
    """Return for both studies what `compared` says about each kind of workers, and the cost of an empty point."""
    seconds, rounds = (3.0, 3) if quick else (6.0, 5)
    results: dict[str, Any] = {}
    kinds = {k: workers for k, workers in KINDS.items() if not workers.dask or importlib.util.find_spec("distributed")}
    for what in ("P1", "loop"):
        units = max(int(rate(points(what, 40), KINDS["alone"]).units * seconds), 40)
        rates: dict[str, list[Rate]] = {name: [] for name in kinds}
        for turn in range(rounds):
            for name in list(kinds)[:: 1 if turn % 2 == 0 else -1]:
                work = points(what, units * kinds[name].number)
                rates[name].append(apart(work) if name == "apart" else rate(work, kinds[name]))
        results[what] = {"units": units, "rounds": rounds}
        results[what] |= {name: compared(rates[name], rates["apart"]) for name in kinds}
    return results | {"empty_ms": overhead_ms(5_000 if quick else 50_000)}


def row(unit: int) -> Arrays:
    """Return a row of a study, computed in no time."""
    return {"values": np.zeros(3), "units": np.array(["m", "s", "1"]), "reason": np.array("")}


def overhead_ms(units: int) -> float:
    """Return what an empty point costs with two workers [ms], from the first result to the last one read again."""
    work = Work(row, range(units))
    told: list[tuple[float, int]] = []
    with temporary(work) as store:
        carry_out(work, store, 2, lambda done, _: told.append((time.perf_counter(), done)), apart=True)
    end = time.perf_counter()
    first, count = next((at, done) for at, done in told if done)
    return 1e3 * (end - first) / (work.total - count)


KEYS = {"friction.mu_static": 0.55, "friction.mu_dynamic": 0.16, "friction.speed_scale": 0.045, "body.damping": 2.2}


def identified() -> dict[str, Any]:
    """Return how long a fit with two workers takes [s], and its evaluations."""
    entries = []
    for number, (speed, force) in enumerate(((0.05, 16.0), (0.1, 26.0), (0.1, 16.0))):
        settings = {"drive.speed": speed, "load.force": force}
        own = KEYS | settings | {"start.velocity": speed, "limits": "none", "noise.force": 0.01, "seed": number}
        run = simulate(load("belt", own), {}, duration_ns=6_000_000_000)
        columns = {"laser": {"reads": "displacement", "offset": "free"}}
        entries.append({"run": run, "name": f"run {number}", "skip": "1 s", "set": settings, "columns": columns})
    task = runs.prepared(load("belt"), entries, {key: (0.2 * value, 5.0 * value) for key, value in KEYS.items()})
    began = time.perf_counter()
    found = identify(task, workers=2)
    return {"fit_s": time.perf_counter() - began, "evaluations": found.best.evaluations}
