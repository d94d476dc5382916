"""Paces a run by the wall clock: frame k is due at start + k frame / pace, however long earlier frames took.

Deadlines are absolute, so a late frame does not delay later ones. A frame that begins more than one frame late is an
overrun. The scene states the policy for overruns:

    catch-up   the next frames run without waiting until the plant is on time again
    skip       the frames of the wall clock that passed are skipped; simulated time falls behind by as many
    slow       the deadlines move: this frame counts as on time, and all later ones are due that much later
    stop       the run ends

If several frames are computed in one piece (`rig.bench.live.pace`), a piece takes the place of a frame here.

If a frame is late by more than `PAUSE`, the process was stopped or the machine is overloaded. Then even catch-up skips
the time and reports it, because a burst of thousands of frames is no meaningful experiment.

What kept the processors of this machine busy beside a run (Linux), and what to do if its frames were late.

Pieces: the frames that a live run computes at once, with one look at the clock and at the bus for all of them.

A frame of 50 us has no time for the bus, and needs none if its controllers work in the plant process. Protocol, limits
and these controllers still act at their ticks. Messages of other processes are read at the first tick of a piece, and
messages about its ticks are sent at its end.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import gcd
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import numpy as np

from rig.bench.live.timing import Timing
from rig.bench.run.experiment import Experiment
from rig.scenes.scene import Scene

# Share of the processors' time from which on the machine counts as busy. # chosen: one core of six
BUSY = 0.15


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
    times, here = spent(), os.times()
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


LONGEST_NS = 1_000_000
"""Longest piece [ns of the wall clock]. # chosen: other processes see less delay from it than from the bus at times"""


def length(scene: Scene, pace: float | None, periods: Collection[int] | None = None) -> int:
    """Number of frames in a piece of `scene` at `pace` (None: without a clock, as at pace 1).

    `periods`: periods [frames] of the controllers in other processes, by default of those in the scene. They get a step
    at the first tick of a piece, so a piece begins at every tick at which one is due. If all controllers are in other
    processes, a piece is one frame, because their commands take effect one frame later.
    """
    if periods is None:
        outside = [section for name, section in scene.controllers.items() if name not in scene.in_plant]
        periods = [section.period // scene.frame_ns for section in outside]
    most = max(int(LONGEST_NS * (pace or 1.0)) // scene.frame_ns, 1)
    if not periods:
        return most
    if not scene.in_plant:
        return 1
    common = gcd(*periods)
    return next(frames for frames in range(min(most, common), 0, -1) if common % frames == 0)


class FrameBatches:
    """The division of a run into pieces of several frames."""

    def __init__(self, experiment: Experiment, pace: float | None) -> None:
        self._runner, self._queues = experiment.runner, experiment.exchange.queues
        self._scene, self._pace = experiment.scene, pace
        self._short = length(self._scene, pace, ()) == 1  # whether every piece is one frame

    @property
    def length(self) -> int:
        """Number of frames in a whole piece, as long as no controller joins or leaves."""
        if self._short:
            return 1
        in_plant = self._scene.in_plant
        return length(self._scene, self._pace, [o.period for name, o in self._queues.items() if name not in in_plant])

    def next(self, timing: Timing) -> int:
        """Number of frames up to the first tick of the next piece; tells `timing` the length of a whole piece."""
        if self._short:
            return 1
        whole = self.length
        timing.resize(whole)
        return whole - self._runner.tick % whole


Policy = Literal["catch-up", "skip", "slow", "stop"]
PAUSE = 250_000_000
"""Longest time [ns] that is caught up. # chosen: a quarter of a second is still a stutter, not a pause."""

_TIMER_SLACK = 29  # PR_SET_TIMERSLACK of <linux/prctl.h>


class Clock(Protocol):
    """A clock that can wait."""

    def now(self) -> int:
        """Monotonic time [ns]."""

    def until(self, deadline: int) -> int:
        """Wait until `deadline` [ns]; returns the time after waiting [ns]."""


@dataclass(frozen=True)
class WallClock:
    """The monotonic clock: sleeps until `spin_ns` before a deadline, then polls the clock (spins)."""

    spin_ns: int = 0

    def now(self) -> int:
        """Time of the monotonic clock [ns]."""
        return time.perf_counter_ns()

    def until(self, deadline: int) -> int:
        """Sleep, then spin until `deadline` [ns]; returns the time after waiting [ns]."""
        left = deadline - self.spin_ns - time.perf_counter_ns()
        if left > 0:
            time.sleep(left * 1e-9)
        now = time.perf_counter_ns()
        while now < deadline:
            now = time.perf_counter_ns()
        return now


class GivenUp(NamedTuple):
    """Time of the wall clock that was skipped before a frame.

    `frames`: frames (pieces) of the wall clock that were skipped.
    """

    frame: int
    late_ns: int
    frames: int


class Pacer:
    """Waits for each frame, or each piece of several frames. `pace`: simulated time over wall time."""

    def __init__(self, frame_ns: int, pace: float, policy: Policy, clock: Clock, pause_ns: int = PAUSE) -> None:
        self.wall_ns = frame_ns / pace
        self.policy, self.pause_ns = policy, pause_ns
        self.frame = -1
        self.waited = False
        """Whether there was time to wait before this frame. If not, the plant was busy until after the deadline."""
        self.given_up: list[GivenUp] = []
        """What was given up since `take_given_up`."""
        self.frames_given_up = 0
        """Number of frames (pieces) of the wall clock that were skipped."""
        self.stopped = False
        """Whether an overrun has ended the run (policy stop)."""
        self._clock = clock
        self._start = 0
        self._first = self._next = 0

    def anchor(self) -> None:
        """Make the next frame due now: at the start, and after an operator's pause."""
        self._start, self._first = self._clock.now(), self._next

    def wait(self, frames: int = 1) -> tuple[int, int]:
        """Wait for the next piece of `frames` frames; returns the time and the lateness [ns]."""
        frame = self.frame = self._next
        self._next = frame + frames
        deadline = self._start + int((frame - self._first) * self.wall_ns)
        now = self._clock.now()
        self.waited = now < deadline
        if self.waited:
            now = self._clock.until(deadline)
        late = now - deadline
        wall_ns = frames * self.wall_ns
        if late > wall_ns:
            self._overrun(late, wall_ns)
        return now, late

    def _overrun(self, late: int, wall_ns: float) -> None:
        if self.policy == "stop":
            self.stopped = True
        elif self.policy != "catch-up" or late > self.pause_ns:
            frames = int(late // wall_ns)
            self.given_up.append(GivenUp(self.frame, late, frames))
            self.frames_given_up += frames
            self._start += late if self.policy == "slow" else int(late // wall_ns * wall_ns)

    def take_given_up(self) -> list[GivenUp]:
        """What was given up since the last call, which the pacer forgets."""
        taken, self.given_up = self.given_up, []
        return taken


class Waiting(NamedTuple):
    """How to wait on this machine, with the measurements [ns] and the reason."""

    spin_ns: int
    sleep_p95: int
    why: str

    @property
    def method(self) -> str:
        """The method: sleep, or hybrid (sleep and spin)."""
        return "hybrid" if self.spin_ns else "sleep"


def lateness(clock: Clock, frame_ns: int, frames: int) -> np.ndarray:
    """Measure the lateness of `frames` waits of `frame_ns`: int64 [frames], ns."""
    late_ns = np.empty(frames, np.int64)
    for i in range(frames):
        deadline = clock.now() + frame_ns
        late_ns[i] = clock.until(deadline) - deadline
    return late_ns


def choose(frame_ns: int, frames: int = 60) -> Waiting:
    """Choose between sleep and sleep with spin by measuring both in turns on this machine, in about 0.15 s.

    Spinning takes a core from other processes, and the scheduler penalises it. It is chosen only if a core is free, if
    it halves the 95th percentile of the lateness, and if it has no more bad frames than sleep alone.
    """
    sharpen_timers()
    each = min(frame_ns, 1_000_000)
    sleep = WallClock()
    before = spent()
    first = lateness(sleep, each, frames // 4)
    spin = int(min(np.quantile(first, 0.95) * 1.5, each / 5))
    slept, spun = [first], []
    for _ in range(3):
        spun.append(lateness(WallClock(spin), each, frames // 4))
        slept.append(lateness(sleep, each, frames // 4))
    return judge(np.concatenate(slept), np.concatenate(spun), spin, each, os.cpu_count() or 1, load(before, spent()))


def judge(slept: np.ndarray, spun: np.ndarray, spin_ns: int, frame_ns: int, cores: int, load: float) -> Waiting:
    """Choose by two sets of lateness [ns], the number of cores and the load on them [cores]."""
    a, b = int(np.quantile(slept, 0.95)), int(np.quantile(spun, 0.95))
    if cores < 2 or load > cores - 1:
        return Waiting(0, a, f"no free core: load {load:.1f} on {cores}")
    bad = frame_ns // 2
    if np.mean(spun > bad) > np.mean(slept > bad):
        return Waiting(0, a, "spinning has more bad frames")
    return Waiting(0, a, "spinning gains nothing") if b > a / 2 else Waiting(spin_ns, a, "spinning is more exact")


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


def sharpen_timers() -> bool:
    """Ask Linux not to extend this thread's sleeps by up to 50 us (to save power); whether it agrees."""
    if sys.platform != "linux":
        return False
    return bool(ctypes.CDLL(None).prctl(_TIMER_SLACK, ctypes.c_ulong(1), 0, 0, 0) == 0)


def stolen_ns() -> int:
    """Processor time [ns] that the host has taken from this virtual machine since its start (Linux); 0 if unknown."""
    with suppress(OSError, ValueError, IndexError):
        return processor_times()[7]
    return 0


def asleep_ns() -> int:
    """Time [ns] for which this machine was suspended since its start; the monotonic clock stops then."""
    if sys.platform != "linux":
        return 0
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.clock_gettime_ns(time.CLOCK_MONOTONIC)
