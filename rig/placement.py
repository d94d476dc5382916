"""On which cores a live run works.

To wake a thread of another core takes 30 to 100 us in a virtual machine, many times what it takes on the same core
(measured), and a step on its way to a controller and back wakes six. So the threads of the bus and the controllers of a
run share one core, in lockstep with the plant, of which one works at a time. A paced plant computes on another core,
beside them. Readers, and all that is not of the loop, go where the system puts them.
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
"""Threads of Zenoh."""
_LOOK_S = 0.1
_ALLOWED: set[int] = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
ANY = -1
"""No core in particular."""


def choose() -> tuple[int, int]:
    """A core for a plant and one for the bus: the two that are least busy, in 0.1 s; `ANY` where there are no two."""
    allowed = sorted(_ALLOWED)
    if len(allowed) < 2:
        return ANY, ANY
    if len(allowed) > 2:
        before = _idle()
        time.sleep(_LOOK_S)
        rested = {core: now - before.get(core, now) for core, now in _idle().items()}
        allowed.sort(key=lambda core: -rested.get(core, 0))
    return allowed[0], allowed[1]


def _idle() -> dict[int, int]:
    """Time that each core has been idle since the machine started [ticks of the kernel]."""
    found = {}
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/stat").read_text().splitlines():
            name, *times = line.split()
            if name[:3] == "cpu" and name[3:]:
                found[int(name[3:])] = int(times[3]) + int(times[4])
    return found


@contextmanager
def placed(own: int, bus: int) -> Iterator[None]:
    """The calling thread on the core `own`, the threads of the bus on `bus`; `ANY`, or a core that is not: anywhere."""
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
            _put(thread, _ALLOWED)


def anywhere() -> None:
    """The calling thread where the system puts it: for one that a placed thread has started, or that computes long."""
    if _ALLOWED:
        _put(0, _ALLOWED)


def bus_threads() -> list[int]:
    """The threads of the bus in this process, by their numbers."""
    return [int(thread.name) for thread in _THREADS.iterdir() if of_bus(thread)]


def of_bus(thread: Path) -> bool:
    """Whether a thread of /proc/self/task is one of the bus."""
    try:
        return (thread / "comm").read_text().startswith(_BUS)
    except OSError:  # it has just ended
        return False


def _put(thread: int, cores: set[int]) -> None:
    with suppress(OSError):  # it has just ended, or the core is not ours
        os.sched_setaffinity(thread, cores)
