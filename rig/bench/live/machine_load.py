"""What kept the processors of this machine busy beside a run (Linux), and what to do if its frames were late."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

# Share of the processors' time from which on the machine counts as busy. # chosen: one core of six
BUSY = 0.15


class MachineLoad:
    """Measures from its construction on; this process and its children that have ended do not count as others."""

    def __init__(self) -> None:
        self._begin = _now()

    def shares(self) -> dict[str, float]:
        """Share of the processors' time that other programs took, and the host of a virtual machine; empty: unknown."""
        now = None if self._begin is None else _now()
        if self._begin is None or now is None:
            return {}
        wall, others, host = (after - before for before, after in zip(self._begin, now))
        whole = wall * (os.cpu_count() or 1)
        return {"others": min(max(others / whole, 0.0), 1.0), "host": min(host / whole, 1.0)} if wall > 0 else {}


def _now() -> tuple[int, int, int] | None:
    """Wall time, processor time of other programs, and that taken by the host [ns]."""
    times = spent()
    here = os.times()
    if times.others < 0:
        return None
    return times.wall, times.others - round(1e9 * (here.children_user + here.children_system)), stolen_ns()


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
        return "the machine was not busy; rig tool doctor measures what makes frames late"
    return (
        f"the machine is busy: {' and '.join(taken)} of its processors' time; "
        "end other programs and run again, or use rig simulate, which needs no clock"
    )


class ProcessorTime(NamedTuple):
    """Processor time spent up to a time of the wall clock; all in ns.

    `others`: processor time of other processes, the system and the host; -1 if unknown.
    """

    wall: int
    others: int


def spent() -> ProcessorTime:
    """Processor time spent up to now (Linux: in steps of 10 ms)."""
    others = -1
    with suppress(OSError, ValueError):
        user, nice, system, _, _, *more = processor_times()
        others = user + nice + system + sum(more) - time.process_time_ns()
    return ProcessorTime(time.perf_counter_ns(), others)


def processor_times() -> list[int]:
    """Time of all processors [ns]: user, nice, system, idle, waiting, interrupts, soft ones, taken by the host (Linux).

    Raises OSError on another system.
    """
    with Path("/proc/stat").open() as file:
        return [int(ticks) * 1_000_000_000 // os.sysconf("SC_CLK_TCK") for ticks in file.readline().split()[1:9]]


def load(before: ProcessorTime, now: ProcessorTime) -> float:
    """Mean number of processors that other processes used between two times; if unknown, the load of the last minute.

    The latter still contains work that has just ended, such as compiling in this process.
    """
    if before.others >= 0 and now.others >= 0 and now.wall > before.wall:
        return max(now.others - before.others, 0) / (now.wall - before.wall)
    with suppress(OSError, AttributeError):  # not on every system
        return os.getloadavg()[0]
    return 0.0


def stolen_ns() -> int:
    """Processor time [ns] that the host has taken from this virtual machine since its start (Linux); 0 if unknown."""
    with suppress(OSError, ValueError, IndexError):
        return processor_times()[7]
    return 0
