"""Who comes first on a processor: plant and controllers of a paced run, at once on waking."""

from __future__ import annotations

import ctypes
import os
import platform
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rig.placement import of_bus

_SETATTR = {"x86_64": 314, "aarch64": 274}  # sched_setattr of <asm/unistd.h>
_TURN_NS = 100_000
_PATIENCE_US = 200_000
_NO_PAUSE = f"a thread left no pause for {_PATIENCE_US / 1e6:g} s"
_THREADS = Path("/proc/self/task")

PLANT, CONTROLLER = 19, 18
"""Real-time priorities: on a machine with one processor the plant goes on while a controller computes.

Threads of the bus are one above their process: answers are sent while a controller goes on to compute, and not in one
burst when it pauses, of which the plant would lose what it has no room for.
"""
AGAIN_S = 1.0
"""How long a process that has fallen back waits before it asks for real-time scheduling again; doubled each time."""


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


def cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # a system on which it may use all
        return os.cpu_count() or 1


class Ahead:
    """Real-time scheduling of all threads of this process; `ahead` enters and leaves it."""

    def __init__(self, priority: int, fell_back: Callable[[], object]) -> None:
        self.why = ""
        """Why this process is not scheduled in real time now; "" if it is."""
        self.falls = 0
        """How often it fell back to ordinary scheduling."""
        self.fallen_ns = 0
        """How long it was scheduled so in all, up to the last return [ns]."""
        self._priority, self._tell = priority, fell_back
        self._since = 0
        self._again: threading.Timer | None = None
        self._over = False

    @property
    def told(self) -> str:
        """For a summary: "" if all was in real time, else why not, or how often and how long."""
        if not self.falls:
            return self.why
        times = "once" if self.falls == 1 else f"{self.falls} times"
        long = f", for {self.fallen_ns / 1e9:.2g} s" if not self.why else ", and stayed there"
        return f"in real time, but fell back {times}{long}: {_NO_PAUSE}"

    def enter(self) -> None:
        """Ask for it. The limit is set again each time: the kernel raises it by a second when it is exceeded."""
        import resource

        hard = resource.getrlimit(resource.RLIMIT_RTTIME)[1]
        resource.setrlimit(resource.RLIMIT_RTTIME, (_PATIENCE_US, hard))
        self.why = _schedule(os.SCHED_FIFO, self._priority)

    def fall_back(self, *_: object) -> None:
        """Handler of SIGXCPU: give way, and come back after a second; after two the next time, and so on."""
        _schedule(os.SCHED_OTHER, 0)
        if self._over:
            return
        self.why, self._since = _NO_PAUSE, time.monotonic_ns()
        self._again = threading.Timer(AGAIN_S * 2**self.falls, self._regain)
        self._again.daemon = True
        self._again.start()
        self.falls += 1
        self._tell()

    def _regain(self) -> None:
        self.enter()
        self.fallen_ns += time.monotonic_ns() - self._since

    def leave(self) -> None:
        """Back to ordinary scheduling for good."""
        self._over = True
        if self._again is not None:
            self._again.cancel()
            self._again.join()
        _schedule(os.SCHED_OTHER, 0)


@contextmanager
def ahead(priority: int, fell_back: Callable[[], object] = lambda: None) -> Iterator[Ahead]:
    """Real-time scheduling of all threads of this process, where the system allows it: see `why` of what it yields.

    It needs root or a limit `rtprio`. A process that then computes for 0.2 s without a pause would keep the others from
    the processor: it falls back to ordinary scheduling for a second or more, and `fell_back` is called, in the main
    thread. Only the main thread can enter; elsewhere nothing changes.
    """
    found = Ahead(priority, fell_back)
    if sys.platform != "linux":
        found.why = "no real-time scheduling: this system has none that is known here"
        yield found
        return
    if threading.current_thread() is not threading.main_thread():
        found.why = "no real-time scheduling: not the main thread"
        yield found
        return
    import resource

    handler, limits = signal.signal(signal.SIGXCPU, found.fall_back), resource.getrlimit(resource.RLIMIT_RTTIME)
    try:
        found.enter()
        yield found
    finally:
        found.leave()
        resource.setrlimit(resource.RLIMIT_RTTIME, limits)
        signal.signal(signal.SIGXCPU, handler)


def _schedule(policy: int, priority: int) -> str:
    """Put every thread of this process under `policy`; "" or why that is not allowed."""
    for thread in _THREADS.iterdir():
        try:
            above = policy == os.SCHED_FIFO and of_bus(thread)
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority + above))
        except ProcessLookupError:  # it has just ended
            pass
        except OSError as fault:
            return f"no real-time scheduling: {fault.strerror}"
    return ""


def stand_back(nice: int) -> None:
    """Never compete with the plant: no real-time class inherited from it, and a lower priority."""
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, 0, nice)
