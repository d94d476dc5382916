"""What is done before a paced run, so that its frames need not do it.

A mode set takes milliseconds to build when it is first visited, and a frame has one. So the protocol is first carried
out in this process, controllers and all, as fast as it goes. A paced run visits the same mode sets, or nearly so, since
its commands arrive a frame later. What a frame calls is loaded or compiled on the way, and so is what it calls once a
controller has joined that the scene does not know: compiling takes a minute, for which no frame has time.
Controllers that the plant itself asks in short frames are compiled here and compared with Python's answers.

What the protocol and a limit ask of the rig is known too: `rig.bench.prepared_rigs`.
"""

from __future__ import annotations

import time
from contextlib import suppress

from rig import controllers, design
from rig.bench.controller_in_process import asked_often
from rig.bench.frame_batches import length
from rig.bench.job import Job
from rig.bench.rig_variant import Wanted
from rig.bench.runner import PlantRunner
from rig.bench.simulate import carry_out
from rig.errors import RigError
from rig.scenes.scene import Scene

LONGEST_S = 3.0
"""Longest time that a rehearsal of the protocol may take. # chosen: all but one of the shipped scenes need less"""


def visited(scene: Scene, job: Job, longest_s: float = LONGEST_S) -> tuple[int, ...]:
    """The mode sets that the protocol of `scene` visits, in the order of their first visits.

    All of them, if it takes no longer than `longest_s` on the wall clock after the first tenth of a second of simulated
    time, in which kernels are loaded or compiled.
    """
    working = {}
    for name, told in design.described(scene).items():
        with suppress(RigError):  # one that cannot begin says why in its own process; the run goes on without
            working[name] = controllers.restored(told)
            if name in scene.in_plant and length(scene, job.pace) > 1:
                asked_often(working[name])
    duration_ns = scene.duration_ns if job.duration is None else round(job.duration * 1e9)
    begun: list[float] = []

    def stop() -> str:
        now = time.perf_counter()
        begun.append(now)
        return "rehearsed" if now - begun[0] >= longest_s else ""

    runner = carry_out(scene, working, duration_ns, stop=stop).runner
    _joined(runner)
    return runner.motion.mode_sets.keys


def _joined(runner: PlantRunner) -> None:
    """Load or compile what is needed when a controller joins that drives an actuator which nobody drives so far."""
    for actuator in runner.lacking(runner.inputs):
        with suppress(RigError):
            if runner.variant(Wanted(driven=(actuator,))).ready.system.n > runner.motion.system.n:
                return  # kernels are made for a number of states, whatever these are
