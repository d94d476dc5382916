"""What is done before a paced run, so that its frames need not do it.

A mode set takes milliseconds to build when it is first visited, and a frame has one. So the protocol is first carried
out in this process, controllers and all, as fast as it goes. A paced run visits the same mode sets, or nearly so, since
its commands arrive a frame later. What a frame calls is loaded or compiled on the way, and so is what it calls once a
controller has joined that the scene does not know: compiling takes a minute, for which no frame has time.

A change of a parameter is a new matrix, and so is the safe value of an actuator without a command state. Both are
known from the scene, and the rigs that come of them are built before the first frame.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import suppress
from itertools import islice

import controllers
from rig.bench.job import Job
from rig.bench.operation import Operation
from rig.bench.protocol import walk
from rig.bench.simulate import carry_out
from rig.bench.stand import Stand
from rig.bench.variant import Variant, Wanted
from rig.errors import RigError
from rig.scenes.protocol import Set
from rig.scenes.scene import Scene, leaves

LONGEST_S = 3.0
"""Longest time that a rehearsal of the protocol may take. # chosen: all but one of the shipped scenes need less"""

MOST, LOOKED_AT = 32, 10_000
"""Changes of the protocol that are prepared, each of which takes some tens of milliseconds, and steps that are looked
at for them. # chosen"""


def visited(scene: Scene, job: Job, longest_s: float = LONGEST_S) -> tuple[int, ...]:
    """The mode sets that the protocol of `scene` visits, in the order of their first visits.

    All of them, if it takes no longer than `longest_s` on the wall clock after the first tenth of a second of simulated
    time, in which kernels are loaded or compiled.
    """
    working = {}
    for name, section in scene.controllers.items():
        with suppress(RigError):  # one that cannot begin says why in its own process; the run goes on without
            working[name] = controllers.restored(controllers.described(section, job.numbers.get(name, {})))
    duration_ns = scene.duration_ns if job.duration is None else round(job.duration * 1e9)
    begun: list[float] = []

    def stop() -> str:
        now = time.perf_counter()
        begun.append(now)
        return "rehearsed" if now - begun[0] >= longest_s else ""

    stand = carry_out(scene, working, duration_ns, stop=stop).stand
    _joined(stand)
    return stand.motion.slots.keys


def prepare(operation: Operation, sets: Iterable[int]) -> None:
    """Build mode sets, the rig after each change of the protocol, and each of these rigs in its safe state."""
    stand, at = operation.stand, None
    stand.motion.foresee(sets)
    _prepare_safe(operation, at)
    stateless = {name for name, one in stand.inputs.items() if not (one.state or one.write)}
    parameters = dict(leaves(operation.scene.parameters)).keys() - stand.inputs.keys() | stateless
    steps = islice(walk(operation.scene.protocol), LOOKED_AT)  # it may repeat itself forever
    changes = (step for step in steps if isinstance(step, Set) and step.target in parameters)
    for step in islice(changes, MOST):
        to = step.to
        if step.target in stateless:
            to = min(max(float(to), stand.inputs[step.target].low), stand.inputs[step.target].high)
        with suppress(RigError):  # it is refused at its tick, and the run goes on without
            at = stand.prepare(Wanted({step.target: to}), at)
            _prepare_safe(operation, at)


def _prepare_safe(operation: Operation, at: Variant | None) -> None:
    """Build what it takes to give up when a limit is passed (`rig.bench.exchange.Exchange.give_up`)."""
    stand = operation.stand
    for name, one in stand.inputs.items() if operation.scene.limits else ():
        if stand.rebuilds(name, one.safe):
            at = stand.prepare(Wanted({name: one.safe}), at)


def _joined(stand: Stand) -> None:
    """Load or compile what is needed when a controller joins that drives an actuator which nobody drives so far."""
    for actuator in stand.lacking(stand.inputs):
        with suppress(RigError):
            if stand.variant(Wanted(driven=(actuator,))).ready.system.n > stand.motion.system.n:
                return  # kernels are made for a number of states, whatever these are
