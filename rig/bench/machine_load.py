"""What kept the processors of this machine busy beside a run (Linux), and what to do if its frames were late."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping

from rig.bench import pace

BUSY = 0.15
"""Share of the processors' time from which on the machine counts as busy. # chosen: one core of six"""


class MachineLoad:
    """Measures from its construction on; this process and its children that have ended do not count as others."""

    def __init__(self) -> None:
        self._begin = _now()

    def shares(self) -> dict[str, float]:
        """Share of the processors' time that other programs took, and the host of a virtual machine; empty: unknown."""
        if self._begin is None or (now := _now()) is None:
            return {}
        wall, others, host = (after - before for before, after in zip(self._begin, now))
        whole = wall * (os.cpu_count() or 1)
        return {"others": min(max(others / whole, 0.0), 1.0), "host": min(host / whole, 1.0)} if wall > 0 else {}


def _now() -> tuple[int, int, int] | None:
    """Wall time, processor time of other programs, and that taken by the host [ns]."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    spent, children = pace.spent(), resource.getrusage(resource.RUSAGE_CHILDREN)
    if spent.others < 0:
        return None
    ours = round(1e9 * (children.ru_utime + children.ru_stime))
    return time.perf_counter_ns(), spent.others - ours, pace.stolen_ns()


def advice(verdict: str, late_share: float, shares: Mapping[str, float]) -> str:
    """Return why frames were late and what to do, in one line; "" if the timing is valid or nothing was late."""
    if verdict == "VALID" or not late_share or not shares:
        return ""
    taken = [
        f"{who} took {shares[name]:.0%}"
        for name, who in (("others", "other programs"), ("host", "the host of this machine"))
        if shares[name] >= 0.01
    ]
    if sum(shares.values()) < BUSY:
        return "the machine was not busy; rig doctor measures what makes frames late"
    return (
        f"the machine is busy: {' and '.join(taken)} of its processors' time; "
        "end other programs and run again, or use rig simulate, which needs no clock"
    )
