"""The rate of a work of many units, from its first result to its last: the start takes seconds, whatever follows."""

from __future__ import annotations

import time
from dataclasses import dataclass

from rig.analysis.pool import Work, carry_out, temporary


@dataclass(frozen=True)
class Rate:
    """Units per second from the first result to the last, and the time to the first result [s]."""

    units: float
    start: float


def rate(work: Work, workers: int, cluster: str = "") -> Rate:
    """Measure a work with worker processes of this machine, or with a dask cluster that is started for it."""
    told: list[tuple[float, int]] = []
    begin = time.perf_counter()
    with temporary(work) as store:
        carry_out(work, store, workers, lambda done, _: told.append((time.perf_counter(), done)), True, cluster)
    end = time.perf_counter()
    first, count = next((at, done) for at, done in told if done)
    return Rate((work.total - count) / (end - first), first - begin)
