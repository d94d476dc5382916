"""The rehearsal: simulates the protocol before a paced run, so that its frames need not build or compile anything.

A mode set takes milliseconds to build when it is first visited, and a frame lasts one. So the protocol is first
simulated in this process with all controllers, as fast as possible. The paced run visits nearly the same mode sets; its
commands arrive one frame later. The rehearsal also loads or compiles all code that a frame calls, and the code for a
controller that joins and is not in the scene: compiling takes a minute, for which no frame has time. Controllers that
the plant process calls in short frames are compiled here and compared with Python's answers.

It also measures the processor time of frames, so that a pace that does not hold on this machine is known before the
start (rig.bench.live.frame_cost).
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rig import controllers, design
from rig.bench.live.frame_cost import FrameCost
from rig.bench.live.outcome import Job
from rig.bench.live.pace import length
from rig.bench.live.timing import Interruptions
from rig.bench.run.local_controllers import CALLS, CompiledControllers, asked_often
from rig.bench.run.rig_variants import Wanted
from rig.bench.run.runner import PlantRunner
from rig.bench.run.simulate import begun, carry_on
from rig.controllers.blocks.base import Controller, is_elsewhere
from rig.errors import ControllerFailed, ExitCode, NumericsError, RigError
from rig.quantities import run_length_ns
from rig.scenes.scene import Scene

FATAL = [
    getattr(signal, name) for name in ("SIGSEGV", "SIGABRT", "SIGFPE", "SIGILL", "SIGALRM") if hasattr(signal, name)
]
"""Signals of code that crashes, and of a library in C that does not return (rig.controllers.c)."""
_NAME = 80  # bytes for the name of a controller, which has up to 64 characters
LONGEST_S = 3.0
"""Longest duration of a rehearsal [s]. # chosen: all but one of the shipped scenes need less"""
PART_NS = 100_000_000
"""Simulated time [ns] of a part of the protocol that is measured or passed over as a whole."""
PIECES = 100
"""Most pieces that are measured in a part."""
PARTS = 20
"""Measured parts after which they are twice as far apart. # chosen: the first two seconds are measured as a whole"""


@contextmanager
def marked(path: Path | None) -> Iterator[None]:
    """Keep in the file `path`, until the end of the block, the name of the controller that is being called.

    Controllers run in this process here, and one that crashes takes it along. Without a file nobody else could tell
    which one: this process writes it to standard error as its last words. So it does if the disk of the file is full.
    """
    if path is None or not _has_room(path):
        calling = [""]
        put = partial(calling.__setitem__, 0)
        with _last_words(lambda: calling[0]), _heard(put):
            yield
        return
    with path.open("r+b", buffering=0) as file:
        with _heard(lambda name: os.pwrite(file.fileno(), f"{name}\n".encode(), 0)):
            yield
        file.truncate(0)


def _has_room(path: Path) -> bool:
    """Make the file with room for each name; whether it could be written."""
    try:
        path.write_bytes(b"\n" * _NAME)
    except OSError:
        return False
    return True


@contextmanager
def _heard(call: Callable[[str], object]) -> Iterator[None]:
    CALLS.append(call)
    try:
        yield
    finally:
        CALLS.remove(call)


@contextmanager
def _last_words(calling: Callable[[], str]) -> Iterator[None]:
    """Name the controller whose code ends this process by a fatal signal, such as SIGSEGV, and exit with code 1."""
    if sys.platform == "win32":
        yield
        return
    libc = ctypes.CDLL(None)
    libc.signal.restype = ctypes.c_void_p
    libc.signal.argtypes = (ctypes.c_int, ctypes.c_void_p)

    def fatal(number: int) -> None:  # a second such signal within it kills this process
        name = signal.Signals(number).name
        who = f"the code of controller {calling()}" if calling() else "a library"
        what = "does not return" if name == "SIGALRM" else "has crashed"
        os.write(2, f"{who} {what}, which ends this process ({name})\n".encode())
        os._exit(ExitCode.FAILED)

    kept = ctypes.CFUNCTYPE(None, ctypes.c_int)(fatal)  # as long as it may be called
    handler = ctypes.cast(kept, ctypes.c_void_p)
    former = {number: libc.signal(number, handler) for number in FATAL}
    try:
        yield
    finally:
        for number, before in former.items():
            libc.signal(number, before)


@dataclass(frozen=True)
class Rehearsal:
    """What a rehearsal finds: the mode sets in the order of their first visits, and the cost of frames.

    `cost`: None if the plant did not get through a frame.
    """

    sets: tuple[int, ...]
    cost: FrameCost | None


def rehearse(scene: Scene, job: Job, longest_s: float = LONGEST_S) -> Rehearsal:
    """Simulate the protocol of `scene` for at most `longest_s` of wall time, without that for compiling."""
    working = {}
    for name, description in design.described(scene).items():
        if name not in scene.in_plant and getattr(scene.controllers[name], "kind", "") == "c":
            continue  # a crash is that of its own process
        if is_elsewhere(controllers.controller_class(scene.controllers[name])):
            continue  # its law would advance
        with suppress(RigError):  # a controller that cannot start says why in its own process; the run does not need it
            working[name] = controllers.restored(description)
            if name in scene.in_plant and length(scene, job.pace) > 1:
                asked_often(working[name])
    try:
        rehearsed = _Frames(scene, job, working, longest_s)
        rehearsed.run()
    except ControllerFailed:  # the controller says why in the run
        rehearsed = _Frames(scene, job, {}, longest_s)
        rehearsed.run()
    _joined(rehearsed.runner)
    return Rehearsal(rehearsed.runner.motion.mode_sets.keys, rehearsed.cost)


def visited(scene: Scene, job: Job, longest_s: float = LONGEST_S) -> tuple[int, ...]:
    """The mode sets that the protocol of `scene` visits; some may be missing after `longest_s` of wall time."""
    return rehearse(scene, job, longest_s).sets


class _Frames:
    """The frames of a rehearsal: in parts of the protocol as in the run, one piece after the other, with their times.

    Between two measured parts the plant is simulated as fast as possible. They are farther apart the longer the
    rehearsal lasts, so that a long protocol is measured to its end.
    """

    def __init__(self, scene: Scene, job: Job, working: Mapping[str, Controller], longest_s: float) -> None:
        self._scene = scene
        self._longest_ns = round(longest_s * 1e9)
        duration_ns = scene.duration_ns if job.duration is None else run_length_ns(job.duration)
        self._experiment, self._working = begun(scene, working, duration_ns, measured={})
        self.runner = self._experiment.runner
        self._compiled = CompiledControllers(self._experiment)
        inside = scene.controllers.keys() if job.in_lockstep else scene.in_plant  # in lockstep the plant waits for all
        self._inside = [asked for asked in self._working if asked.name in inside]
        self._outside = [asked for asked in self._working if asked.name not in inside]
        self._piece = length(scene, job.pace)
        self._window = max(PART_NS // scene.frame_ns, self._piece)
        self._interruptions = Interruptions()
        self._begun_ns = 0
        self._means_ns: list[float] = []
        self._whole = False

    @property
    def cost(self) -> FrameCost | None:
        """The cost of the frames so far; None if none was measured."""
        if not self._means_ns:
            return None
        return FrameCost(tuple(self._means_ns), self.runner.t_ns * 1e-9, self._whole)

    def run(self) -> None:
        """Simulate the protocol. Raises ControllerFailed."""
        self._begun_ns = time.perf_counter_ns()
        window = 0
        with self._interruptions.watched(), suppress(NumericsError):  # the frames up to there count
            while not self._over():
                part = self.runner.tick // self._window
                if part >= window:
                    window = part + 2 ** (len(self._means_ns) // PARTS)
                    goes_on = self._measure()
                else:
                    goes_on = self._pass_over()
                if not goes_on:
                    self._whole = True
                    break
        self._experiment.end()

    def _over(self) -> bool:
        """Whether the rehearsal has lasted long enough."""
        now = time.perf_counter_ns()
        compiling_ns = self._interruptions.within("compile", self._begun_ns, now)
        return now - self._begun_ns - compiling_ns >= self._longest_ns

    def _pass_over(self) -> bool:
        """Simulate up to the end of this part as fast as possible, and return whether the run goes on."""
        if not self._experiment.begin():
            return False
        runner = self.runner
        until = min(self._experiment.until(), runner.tick + self._window - runner.tick % self._window)
        carry_on(self._experiment, self._working, until, self._compiled)
        return True

    def _measure(self) -> bool:
        """Simulate at most `PIECES` pieces as a run does, with the mean time of a frame; whether the run goes on."""
        frames = 0
        spent_ns = 0
        goes_on = True
        for _ in range(PIECES):
            piece = self._timed_piece()
            if piece is None:
                goes_on = False
                break
            frames += piece[0]
            spent_ns += piece[1]
            if self._over():
                break
        if frames:
            self._means_ns.append(spent_ns / frames)
        return goes_on

    def _timed_piece(self) -> tuple[int, int] | None:
        """Frames and processor time [ns] of the next piece; None at the end of the run.

        No frames count if something was built or compiled in it, which a run does before.
        """
        runner = self.runner
        motion = self.runner.motion
        built = len(motion.mode_sets.sets)
        begun_ns = time.perf_counter_ns()
        tick = runner.tick
        begin_ns = time.thread_time_ns()
        if not self._experiment.begin():
            return None
        spent_ns = time.thread_time_ns() - begin_ns
        for asked in self._outside:
            asked.answer()
        until = min(tick + self._piece - tick % self._piece, self._experiment.until())
        begin_ns = time.thread_time_ns()
        carry_on(self._experiment, self._inside, until, self._compiled)
        spent_ns += time.thread_time_ns() - begin_ns
        for asked in self._outside:
            asked.catch_up(runner.tick)
        same = runner.motion is motion and len(motion.mode_sets.sets) == built
        interrupted = self._interruptions.within("compile", begun_ns, time.perf_counter_ns())
        return (runner.tick - tick, spent_ns) if same and not interrupted else (0, 0)


def _joined(runner: PlantRunner) -> None:
    """Load or compile what is needed when a controller joins that drives an actuator without a controller so far."""
    for actuator in runner.lacking(runner.inputs):
        with suppress(RigError):
            if runner.variants.build(Wanted(driven=(actuator,))).ready.system.n > runner.motion.system.n:
                return  # kernels depend only on the number of states
