"""Who comes first on a processor: plant and controllers of a paced run, at once on waking."""

from __future__ import annotations

import ctypes
import os
import platform
import signal
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_SETATTR = {"x86_64": 314, "aarch64": 274}  # sched_setattr of <asm/unistd.h>
_TURN_NS = 100_000
_PATIENCE_US = 200_000
_THREADS = Path("/proc/self/task")

PLANT, CONTROLLER = 20, 19
"""Real-time priorities: on a machine with one processor the plant goes on while a controller computes."""


def come_first() -> bool:
    """Run at once on waking: ask for short turns, which come earlier. Whether the system knows that request.

    Linux 6.12 and later do; it needs no privilege and gains no share of the processor. With six busy processes to a
    core 4 to 8 % of frames with 0.15 ms of work were late, in place of 19 %. Threads that are started afterwards do so.
    """
    number = _SETATTR.get(platform.machine()) if sys.platform == "linux" else None
    if number is None:
        return False
    # struct sched_attr: size, policy (other), flags, nice, priority, runtime (here: length of a turn), deadline, period
    asked = struct.pack("=IIQiIQQQ", 48, 0, 0, os.getpriority(os.PRIO_PROCESS, 0), 0, _TURN_NS, 0, 0)
    return bool(ctypes.CDLL(None).syscall(number, 0, asked, 0) == 0)


@contextmanager
def ahead(priority: int, fell_back: Callable[[], object] = lambda: None) -> Iterator[str]:
    """Real-time scheduling of all threads of this process, where the system allows it; yields "" or why not.

    It needs root or a limit `rtprio`. A process that then computes for 0.2 s without a pause would keep the others from
    the processor: it falls back to ordinary scheduling, and `fell_back` is called, in the main thread. Only the main
    thread can enter; elsewhere nothing changes.
    """
    if sys.platform != "linux":
        yield "no real-time scheduling: this system has none that is known here"
        return
    if threading.current_thread() is not threading.main_thread():
        yield "no real-time scheduling: not the main thread"
        return
    import resource

    def too_long(*_: object) -> None:
        _schedule(os.SCHED_OTHER, 0)
        fell_back()

    handler, limits = signal.signal(signal.SIGXCPU, too_long), resource.getrlimit(resource.RLIMIT_RTTIME)
    try:
        resource.setrlimit(resource.RLIMIT_RTTIME, (_PATIENCE_US, limits[1]))
        yield _schedule(os.SCHED_FIFO, priority)
    finally:
        _schedule(os.SCHED_OTHER, 0)
        resource.setrlimit(resource.RLIMIT_RTTIME, limits)
        signal.signal(signal.SIGXCPU, handler)


def _schedule(policy: int, priority: int) -> str:
    """Put every thread of this process under `policy`; "" or why that is not allowed."""
    for thread in _THREADS.iterdir():
        try:
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
        except ProcessLookupError:  # it has just ended
            pass
        except OSError as fault:
            return f"no real-time scheduling: {fault.strerror}"
    return ""


def stand_back(nice: int) -> None:
    """Never compete with the plant: no real-time class inherited from it, and a lower priority."""
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, nice)
