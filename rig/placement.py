"""Processor cores of a live run.

In a virtual machine, waking a thread on another core takes 30 to 100 us, many times longer than on the same core
(measured), and one step to a controller and back wakes six threads. Therefore the bus threads and the controllers of a
run share one core. In lockstep the plant shares it too, because only one of them works at a time; a paced plant
computes on a second core at the same time. The system places all other processes, such as recorder and viewer.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_THREADS = Path("/proc/self/task")
_BUS = ("rx-", "tx-", "app-", "acc-", "net-")
"""Prefixes of the names of Zenoh's threads."""
_LOOK_S = 0.1
ALLOWED: set[int] = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
ANY = -1
"""No particular core."""


def choose() -> tuple[int, int]:
    """A core for the plant and one for the bus: the two least busy ones, measured over 0.1 s.

    `ANY` for both if this process may use fewer than two cores.
    """
    allowed = sorted(ALLOWED)
    if len(allowed) < 2:
        return ANY, ANY
    if len(allowed) > 2:
        before = idle_times()
        time.sleep(_LOOK_S)
        rested = {core: now - before.get(core, now) for core, now in idle_times().items()}
        allowed.sort(key=lambda core: -rested.get(core, 0))
    return allowed[0], allowed[1]


def idle_times() -> dict[int, int]:
    """Core -> idle time since the machine started [kernel ticks]."""
    found = {}
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/stat").read_text().splitlines():
            name, *times = line.split()
            if name[:3] == "cpu" and name[3:]:
                found[int(name[3:])] = int(times[3]) + int(times[4])
    return found


@contextmanager
def placed(own: int, bus: int) -> Iterator[None]:
    """Keep the calling thread on the core `own` and the bus threads on the core `bus`.

    Does nothing if one of them is `ANY`, and leaves a thread where it is if the core does not exist.
    """
    if ANY in (own, bus) or sys.platform != "linux":
        yield
        return
    _put(0, {own})
    for thread in bus_threads():
        _put(thread, {bus})
    try:
        yield
    finally:
        for thread in (0, *bus_threads()):
            _put(thread, ALLOWED)


def anywhere() -> None:
    """Let the system choose the core of the calling thread: for threads that inherited a core or compute for long."""
    if ALLOWED:
        _put(0, ALLOWED)


def bus_threads() -> list[int]:
    """Ids of the bus threads of this process."""
    return [int(thread.name) for thread in _THREADS.iterdir() if of_bus(thread)]


def of_bus(thread: Path) -> bool:
    """Whether `thread`, a folder of /proc/self/task, is a bus thread."""
    try:
        return (thread / "comm").read_text().startswith(_BUS)
    except OSError:  # the thread has just ended
        return False


def _put(thread: int, cores: set[int]) -> None:
    with suppress(OSError):  # the thread has just ended, or this process may not use the core
        os.sched_setaffinity(thread, cores)
