"""The rigs that the protocol and the limits will ask for, built before they are asked for.

A change of a parameter is a new matrix, and so is the safe value of an actuator without a command state. Building takes
tens of milliseconds, which a frame of a paced run does not have. The scene tells both, so that all these rigs are built
before the first frame.

A rig is built from the one before it. When somebody changes the rig while it runs, none of these fits any more: they
are built again in another thread, one at a time (`rig.bench.rebuild` tells what that costs).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from itertools import islice

from rig.bench.experiment import Operation
from rig.bench.protocol import walk
from rig.bench.rebuild import PAUSE_S
from rig.bench.rig_variant import Build, Variant, Wanted
from rig.errors import RigError
from rig.scenes.protocol import Set
from rig.scenes.scene import leaves

MOST, LOOKED_AT = 32, 10_000
"""Changes of the protocol that are prepared, each of which takes some tens of milliseconds, and steps that are looked
at for them. # chosen"""


class Upcoming:
    """Has the plant runner of `operation` keep these rigs. Made before the first frame, it builds all of them at
    once.
    """

    def __init__(self, operation: Operation) -> None:
        self._operation, self._runner = operation, operation.runner
        self._build: Build[Variant] | None = None
        self._rigs: Iterator[Variant] | None = None
        self._begin()
        for variant in rigs(operation):
            self._keep(variant)
        self._rigs = None

    def _begin(self) -> None:
        """Begin with the rig as it is now."""
        self._rigs = rigs(self._operation)
        self._known = [self._runner.scene]
        """Scenes of the rig that it began with and of those that are built."""
        self._due = time.monotonic() + 2.0 * PAUSE_S  # who changes the rig again and again leaves no time for these

    def look(self) -> None:
        """Begin anew where somebody has changed the rig, and build the next one apart when it is time."""
        if self._build is not None:
            if not self._build.done:
                return
            try:
                self._keep(self._build.result())
            except Exception:  # none is left; what else it may be comes again at its tick, and is told there
                self._rigs = None
            self._build = None
        if not any(self._runner.scene is known for known in self._known):
            self._runner.forget()
            self._begin()
        elif self._rigs is not None and time.monotonic() >= self._due and not self._operation.builds.awaited:
            self._due = time.monotonic() + PAUSE_S
            self._build = Build(partial(next, self._rigs), apart=True)

    def _keep(self, variant: Variant) -> None:
        self._runner.keep(variant)
        self._known.append(variant.scene)


def rigs(operation: Operation) -> Iterator[Variant]:
    """The rig in its safe state, the rig after each change that the protocol still makes, and those in theirs."""
    runner = operation.runner
    values = dict(runner.values)
    yield from _safe(operation, None, values)
    stateless = {name for name, one in runner.inputs.items() if not (one.state or one.write)}
    parameters = dict(leaves(operation.scene.parameters)).keys() - runner.inputs.keys() | stateless
    first = operation.protocol.begun
    steps = islice(walk(operation.scene.protocol), first, first + LOOKED_AT)  # it may repeat itself forever
    changes = (step for step in steps if isinstance(step, Set) and step.target in parameters)
    at: Variant | None = None
    for step in islice(changes, MOST):
        to = step.to
        if step.target in stateless:
            to = min(max(float(to), runner.inputs[step.target].low), runner.inputs[step.target].high)
        with suppress(RigError):  # it is refused at its tick, and the run goes on without
            at = runner.variant(Wanted({step.target: to}), at)
            yield at
            values |= at.wanted.parameters
            yield from _safe(operation, at, values)


def _safe(operation: Operation, at: Variant | None, values: Mapping[str, float]) -> Iterator[Variant]:
    """What it takes to give up when a limit is passed (`rig.bench.exchange.Exchange.give_up`), from `at` on."""
    runner = operation.runner
    inputs = runner.inputs if at is None else runner.inputs | at.assembly.inputs
    for name, one in inputs.items() if operation.scene.limits else ():
        if not (one.state or one.write) and one.safe != values[name]:
            at = runner.variant(Wanted({name: one.safe}), at)
            yield at
