"""The rate of a work of many units with different numbers of workers, in turns: this machine's own speed changes.

A rate counts from the instant at which every worker has finished a unit to the end of the last one: workers take
seconds to start, whatever follows. Of a unit that is under way at the first instant, only the rest counts.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rig.analysis.pool import Arrays, Work, carry_out, temporary


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
    found = work.compute(unit)
    return found | {"#times": np.array([os.getpid(), begin, time.monotonic()])}


def rate(work: Work, workers: Workers) -> Rate:
    """Measure a work with one kind of workers."""
    began = time.monotonic()
    every = Work(partial(timed, work), range(work.total), prepare=work.prepare)
    with temporary(every) as store:
        found = carry_out(every, store, workers.number, apart=True, cluster=workers.cluster)
    process, begin, end = np.array([one["#times"] for one in found.values()]).T
    first = max(end[process == one].min() for one in np.unique(process))
    counted = np.clip(end - np.maximum(begin, first), 0.0, None) / (end - begin)
    return Rate(float(counted.sum() / (end.max() - first)), float(end.min() - began))


def rounds(make: Callable[[int], Work], kinds: Sequence[Workers], units: int, count: int) -> list[list[Rate]]:
    """Measure kinds of workers in turns, `count` times; return [kind][round].

    `make`: returns the work with a number of units; each worker gets `units` of them.
    """
    found: list[list[Rate]] = [[] for _ in kinds]
    for turn in range(count):
        order = range(len(kinds)) if turn % 2 == 0 else reversed(range(len(kinds)))
        for k in order:
            found[k].append(rate(make(units * kinds[k].number), kinds[k]))
    return found


def compared(found: Sequence[Rate], one: Sequence[Rate], workers: int) -> dict[str, Any]:
    """Return medians over the rounds: rate, start, and efficiency, the gain over `one` worker for each of `workers`."""
    gains = [a.units / (workers * b.units) for a, b in zip(found, one)]
    return {
        "units": float(np.median([a.units for a in found])),
        "start": float(np.median([a.start for a in found])),
        "efficiency": float(np.median(gains)),
        "least": min(gains),
        "greatest": max(gains),
    }
