"""Processors and scheduling: where processes run, and their time slices.

Plant and controllers of a paced run have real-time scheduling if permitted, else short time slices. The memory of a
paced process is locked, so that the system does not swap it out during a run.

In a virtual machine, waking a thread on another core takes 30 to 100 us, many times longer than on the same core
(measured), and one step to a controller and back wakes six threads. Therefore the bus threads and the controllers of a
run share one core. In lockstep the plant shares it too, because only one of them works at a time; a paced plant
computes on a second core at the same time. The system places all other processes, such as recorder and viewer.
"""

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

_THREADS = Path("/proc/self/task")
_BUS = ("rx-", "tx-", "app-", "acc-", "net-")  # prefixes of the names of Zenoh's threads
_LOOK_S = 0.1  # s between two looks
ALLOWED: set[int] = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
ANY = -1
"""No particular core."""
_all_cores = True

_SETATTR = {"x86_64": 314, "aarch64": 274}  # sched_setattr of <asm/unistd.h>
_TURN_NS = 100_000  # the shortest time slice that Linux grants
_PATIENCE_US = 200_000  # processor time without a pause after which real-time scheduling ends. chosen
_NO_PAUSE = f"a thread left no pause for {_PATIENCE_US / 1e6:g} s"

PLANT = 19
CONTROLLER = 18
"""Real-time priorities. The plant's is higher: with one processor it interrupts a computing controller.

Bus threads have one more than their process. So answers leave while a controller computes further, and not in one
burst when it pauses, of which the plant would lose the part for which it has no space.
"""
# Real-time priority of the bus threads of a recorder: behind plant and controllers, ahead of all other programs.
_RECEIVER = 1
AGAIN_S = 1.0  # time after which a process that fell back asks for real-time scheduling again [s]; doubled each time

# MCL_* of <asm-generic/mman.h>
_CURRENT = 1
_FUTURE = 2
_ON_FAULT = 4


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
    idle = {}
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/stat").read_text().splitlines():
            name, *times = line.split()
            if name[:3] == "cpu" and name[3:]:
                idle[int(name[3:])] = int(times[3]) + int(times[4])
    return idle


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


def stay_on(core: int) -> None:
    """From now on the calling thread uses one core, unless it is `ANY`."""
    if core != ANY:
        _put(0, {core})


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


def come_first() -> bool:
    """Request short time slices, which the system schedules sooner after waking; whether it knows the request.

    Linux 6.12 and later know it. It needs no permission and does not increase the share of the processor. With six busy
    processes per core 4 to 8 % of the frames with 0.15 ms of work were late, instead of 19 % (measured). Threads that
    start afterwards inherit the setting.
    """
    if sys.platform != "linux":
        return False
    number = _SETATTR.get(platform.machine())
    if number is None:
        return False
    # struct sched_attr: size, policy (other), flags, nice, priority, runtime (here: time slice), deadline, period
    asked = struct.pack("=IIQiIQQQ", 48, 0, 0, os.getpriority(os.PRIO_PROCESS, 0), 0, _TURN_NS, 0, 0)
    return bool(ctypes.CDLL(None).syscall(number, 0, asked, 0) == 0)


def keep_to_one_core() -> None:
    """From now on this process uses one core, because processes like it use the others."""
    global _all_cores
    _all_cores = False


def cores() -> int:
    """Number of cores that this process may use."""
    return (len(ALLOWED) or os.cpu_count() or 1) if _all_cores else 1


class Ahead:
    """State of the real-time scheduling of this process and all its threads; the function `ahead` controls it."""

    def __init__(self, priority: int, fell_back: Callable[[], object]) -> None:
        self.why = ""
        """Why this process does not have real-time scheduling now; "" if it has."""
        self.falls = 0
        """How often it fell back to ordinary scheduling."""
        self.fallen_ns = 0
        """Total time in ordinary scheduling after falling back, up to the last return [ns]."""
        self._priority = priority
        self._fell_back = fell_back
        self._since = 0
        self._again: threading.Timer | None = None
        self._over = False

    @property
    def account(self) -> str:
        """Text for the summary: "" if the whole run had real-time scheduling, else why not or how long not."""
        if not self.falls:
            return self.why
        times = "once" if self.falls == 1 else f"{self.falls} times"
        long = f", for {self.fallen_ns / 1e9:.2g} s" if not self.why else ", and stayed there"
        return f"in real time, but fell back {times}{long}: {_NO_PAUSE}"

    def enter(self) -> None:
        """Request real-time scheduling. Sets the limit again: the kernel raises it by 1 s when it is exceeded."""
        import resource

        hard = resource.getrlimit(resource.RLIMIT_RTTIME)[1]
        resource.setrlimit(resource.RLIMIT_RTTIME, (_PATIENCE_US, hard))
        self.why = _schedule(os.SCHED_FIFO, self._priority)

    def fall_back(self, *_: object) -> None:
        """Handler of SIGXCPU: return to ordinary scheduling for `AGAIN_S`, the next time for twice as long, etc."""
        _schedule(os.SCHED_OTHER, 0)
        if self._over:
            return
        self.why = _NO_PAUSE
        self._since = time.monotonic_ns()
        self._again = threading.Timer(AGAIN_S * 2**self.falls, self._regain)
        self._again.daemon = True
        self._again.start()
        self.falls += 1
        self._fell_back()

    def _regain(self) -> None:
        self.fallen_ns += time.monotonic_ns() - self._since  # first: who reads that `why` is empty reads all of it
        self.enter()

    def leave(self) -> None:
        """Return to ordinary scheduling for good."""
        self._over = True
        if self._again is not None:
            self._again.cancel()
            self._again.join()
        _schedule(os.SCHED_OTHER, 0)


@contextmanager
def ahead(priority: int, fell_back: Callable[[], object] = lambda: None) -> Iterator[Ahead]:
    """Give all threads of this process real-time scheduling with `priority`, if the system permits it.

    It needs root or a limit `rtprio`; `Ahead.why` of the yielded object says why it was not permitted. A process that
    computes for 0.2 s without a pause would block the others: it falls back to ordinary scheduling for a second or
    more, and `fell_back` is called in the main thread. Outside the main thread this function changes nothing.
    """
    scheduling = Ahead(priority, fell_back)
    if sys.platform != "linux":
        scheduling.why = "no real-time scheduling: only supported on Linux"
        yield scheduling
        return
    if threading.current_thread() is not threading.main_thread():
        scheduling.why = "no real-time scheduling: not the main thread"
        yield scheduling
        return
    import resource

    handler = signal.signal(signal.SIGXCPU, scheduling.fall_back)
    limits = resource.getrlimit(resource.RLIMIT_RTTIME)
    try:
        scheduling.enter()
        yield scheduling
    finally:
        scheduling.leave()
        resource.setrlimit(resource.RLIMIT_RTTIME, limits)
        signal.signal(signal.SIGXCPU, handler)


def _schedule(policy: int, priority: int) -> str:
    """Set the scheduling policy of all threads of this process; "" or why it is not permitted."""
    for thread in _THREADS.iterdir():
        try:
            above = policy == os.SCHED_FIFO and of_bus(thread)
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority + above))
        except ProcessLookupError:  # it has just ended
            pass
        except OSError as fault:
            return f"no real-time scheduling: {fault.strerror}"
    return ""


def receive_first() -> None:
    """Give the bus threads of this process the lowest real-time priority, if permitted; else they stay as they are.

    They only copy what arrives into memory. Without the processor for longer than a tenth of a second, they let the
    queue of a fast plant overflow: with 16 busy processes on two cores, five recordings of six at 8 MB/s had losses,
    with real-time priority none of six (measured).
    """
    for thread in bus_threads():
        with suppress(OSError, AttributeError):
            os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(_RECEIVER))


def stand_back(nice: int) -> None:
    """Leave the processor to the plant: the calling thread gets ordinary scheduling with `nice`, even if it inherited
    real time. So do threads that it starts later.
    """
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, 0, nice)


@contextmanager
def locked() -> Iterator[str]:
    """Lock all pages that this process uses, now and later; yields "" or the reason why it is not possible.

    Unused pages are not loaded: most of them would be thread stacks and reserved address space. Locking needs root or a
    limit `memlock` of "unlimited": with a finite one the system would refuse memory requested later.
    """
    why = _lock()
    try:
        yield why
    finally:
        if not why:
            ctypes.CDLL(None).munlockall()


def _lock() -> str:
    if sys.platform != "linux":
        return "memory is not locked: only supported on Linux"
    import resource

    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if os.geteuid() != 0 and limit != resource.RLIM_INFINITY:
        return f"memory is not locked: the limit memlock is {limit >> 10} kB; it must be unlimited"
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0:
        return ""
    return f"memory is not locked: {os.strerror(ctypes.get_errno())}"
