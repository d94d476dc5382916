"""The rehearsal: simulates the protocol before a paced run, so that its frames need not build or compile anything.

A mode set takes milliseconds to build when it is first visited, and a frame lasts one. So the protocol is first
simulated in this process with all controllers, as fast as possible. The paced run visits nearly the same mode sets; its
commands arrive one frame later. The rehearsal also loads or compiles all code that a frame calls, and the code for a
controller that joins and is not in the scene: compiling takes a minute, for which no frame has time. Controllers that
the plant process calls in short frames are compiled here and compared with Python's answers.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from rig import controllers, design
from rig.bench.live.outcome import Job
from rig.bench.live.pace import length
from rig.bench.run.local_controllers import CALLS, asked_often
from rig.bench.run.rig_variants import Wanted
from rig.bench.run.runner import PlantRunner
from rig.bench.run.simulate import carry_out
from rig.errors import ControllerFailed, ExitCode, RigError
from rig.quantities import run_length_ns
from rig.scenes.scene import Scene

FATAL = [
    getattr(signal, name) for name in ("SIGSEGV", "SIGABRT", "SIGFPE", "SIGILL", "SIGALRM") if hasattr(signal, name)
]
"""Signals of code that crashes, and of a library in C that does not return (rig.controllers.c)."""
_NAME = 80  # bytes for the name of a controller, which has up to 64 characters
LONGEST_S = 3.0
"""Longest duration of a rehearsal [s]. # chosen: all but one of the shipped scenes need less"""


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
    libc.signal.restype, libc.signal.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)

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


def visited(scene: Scene, job: Job, longest_s: float = LONGEST_S) -> tuple[int, ...]:
    """The mode sets that the protocol of `scene` visits, in the order of their first visits.

    The rehearsal ends after `longest_s` of wall time, and then some may be missing. The first 0.1 s of simulated time
    does not count, because kernels are loaded or compiled in it.
    """
    working = {}
    for name, description in design.described(scene).items():
        if name not in scene.in_plant and getattr(scene.controllers[name], "kind", "") == "c":
            continue  # a crash is that of its own process
        with suppress(RigError):  # a controller that cannot start says why in its own process; the run does not need it
            working[name] = controllers.restored(description)
            if name in scene.in_plant and length(scene, job.pace) > 1:
                asked_often(working[name])
    duration_ns = scene.duration_ns if job.duration is None else run_length_ns(job.duration)
    begun: list[float] = []

    def stop() -> str:
        now = time.perf_counter()
        begun.append(now)
        return "rehearsed" if now - begun[0] >= longest_s else ""

    try:
        rehearsed = carry_out(scene, working, duration_ns, stop=stop)
        failed = rehearsed.failed is not None
    except ControllerFailed:
        failed = True
    if failed:  # the controller says why in the run
        begun.clear()
        rehearsed = carry_out(scene, {}, duration_ns, stop=stop)
    _joined(rehearsed.runner)
    return rehearsed.runner.motion.mode_sets.keys


def _joined(runner: PlantRunner) -> None:
    """Load or compile what is needed when a controller joins that drives an actuator without a controller so far."""
    for actuator in runner.lacking(runner.inputs):
        with suppress(RigError):
            if runner.variants.build(Wanted(driven=(actuator,))).ready.system.n > runner.motion.system.n:
                return  # kernels depend only on the number of states
