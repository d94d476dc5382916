"""The rehearsal: simulates the protocol before a paced run, so that its frames need not build or compile anything.

A mode set takes milliseconds to build when it is first visited, and a frame lasts one. So the protocol is first
simulated in this process with all controllers, as fast as possible. The paced run visits nearly the same mode sets; its
commands arrive one frame later. The rehearsal also loads or compiles all code that a frame calls, and the code for a
controller that joins and is not in the scene: compiling takes a minute, for which no frame has time. Controllers that
the plant process calls in short frames are compiled here and compared with Python's answers.

`rig.bench.live.rehearsal` builds the rigs that the protocol and the limits will need.

Rigs that the protocol and the limits will need, built in advance.

A changed parameter needs a new matrix, and so does the safe value of an actuator without a command state. Building
takes tens of milliseconds, for which a frame of a paced run has no time. Both are known from the scene, so all these
rigs are built before the first frame.

Each rig is built from the previous one. If an operator changes the rig during the run, none of them fits any more; they
are built again in another thread, one at a time (`rig.bench.run.builds` states what that costs).
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from pathlib import Path

from rig import controllers, design
from rig.bench.live.outcome import Job
from rig.bench.live.pace import length
from rig.bench.run.builds import PAUSE_S
from rig.bench.run.experiment import Experiment
from rig.bench.run.local_controllers import CALLS, asked_often
from rig.bench.run.rig_variants import Build, RigVariant, Wanted
from rig.bench.run.runner import PlantRunner
from rig.bench.run.simulate import carry_out
from rig.errors import ControllerFailed, ExitCode, RigError
from rig.quantities import run_length_ns
from rig.scenes.protocol import Set
from rig.scenes.scene import Scene
from rig.scenes.sections import unrolled, values_of

MOST, LOOKED_AT = 32, 10_000
"""Most changes of the protocol that are prepared, each of which takes some tens of milliseconds, and most steps that
are searched for them. # chosen"""


class PreparedRigs:
    """Builds these rigs for the plant runner of `experiment`, all of them before the first frame."""

    def __init__(self, experiment: Experiment) -> None:
        self._experiment, self._runner = experiment, experiment.runner
        self._build: Build[RigVariant] | None = None
        self._rigs: Iterator[RigVariant] | None = None
        self._begin()
        for variant in rigs(experiment):
            self._keep(variant)
        self._rigs = None

    def _begin(self) -> None:
        """Start with the present rig."""
        self._rigs = rigs(self._experiment)
        self._known = [self._runner.scene]
        """Scenes of the initial rig and of those that are built."""
        self._due = time.monotonic() + 2.0 * PAUSE_S  # while the rig is changed again and again, nothing is built

    def look(self) -> None:
        """Start again if the rig was changed, and build the next rig in another thread when it is due."""
        if self._build is not None:
            if not self._build.done:
                return
            try:
                self._keep(self._build.result())
            except Exception:  # no rig is left; any other exception is raised again and reported at its tick
                self._rigs = None
            self._build = None
        if not any(self._runner.scene is known for known in self._known):
            self._runner.variants.forget()
            self._begin()
        elif self._rigs is not None and time.monotonic() >= self._due and not self._experiment.builds.awaited:
            self._due = time.monotonic() + PAUSE_S
            self._build = Build(partial(next, self._rigs), apart=True)

    def _keep(self, variant: RigVariant) -> None:
        self._runner.variants.keep(variant)
        self._known.append(variant.scene)


def rigs(experiment: Experiment) -> Iterator[RigVariant]:
    """The rig in its safe state, then the rig after each further change of the protocol, also with its safe state."""
    runner = experiment.runner
    values = dict(runner.values)
    yield from _safe(experiment, None, values)
    stateless = {name for name, actuator in runner.inputs.items() if not (actuator.state or actuator.write)}
    parameters = dict(values_of(experiment.scene.parameters)).keys() - runner.inputs.keys() | stateless
    first = experiment.protocol.begun
    steps = islice(unrolled(experiment.scene.protocol), first, first + LOOKED_AT)  # the protocol may repeat for ever
    changes = (step for step in steps if isinstance(step, Set) and step.target in parameters)
    at: RigVariant | None = None
    for step in islice(changes, MOST):
        to = step.to
        if step.target in stateless:
            to = min(max(float(to), runner.inputs[step.target].low), runner.inputs[step.target].high)
        with suppress(RigError):  # the change is refused at its tick, and the run continues without it
            at = runner.variants.build(Wanted({step.target: to}), at)
            yield at
            values |= at.wanted.parameters
            yield from _safe(experiment, at, values)


def _safe(experiment: Experiment, at: RigVariant | None, values: Mapping[str, float]) -> Iterator[RigVariant]:
    """The rigs for the safe state after a limit is exceeded (`rig.bench.run.exchange.Exchange.give_up`), from `at`
    on.
    """
    runner = experiment.runner
    inputs = runner.inputs if at is None else runner.inputs | at.assembly.inputs
    for name, actuator in inputs.items() if experiment.scene.limits else ():
        if not (actuator.state or actuator.write) and actuator.safe != values[name]:
            at = runner.variants.build(Wanted({name: actuator.safe}), at)
            yield at


FATAL = [signal.SIGSEGV, signal.SIGABRT, signal.SIGFPE, signal.SIGILL]
"""Signals of code that crashes, on every system."""
LONGEST_S = 3.0
"""Longest duration of a rehearsal [s]. # chosen: all but one of the shipped scenes need less"""


@contextmanager
def marked(path: Path | None) -> Iterator[None]:
    """Keep in the file `path`, until the end of the block, the name of the controller that is being called.

    Controllers run in this process here, and one that crashes takes it along. Without a file nobody else could tell
    which one: this process writes it to standard error as its last words.
    """
    if path is None:
        calling = [""]
        put = partial(calling.__setitem__, 0)
        with _last_words(lambda: calling[0]), _heard(put):
            yield
        return
    with path.open("wb", buffering=0) as file:
        with _heard(lambda name: os.pwrite(file.fileno(), f"{name}\n".encode(), 0)):
            yield
        file.truncate(0)


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
        os.write(2, f"{who} has crashed, which ends this process ({name})\n".encode())
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
