"""Rigs that the protocol and the limits will need, built in advance.

A changed parameter needs a new matrix, and so does the safe value of an actuator without a command state. Building
takes tens of milliseconds, for which a frame of a paced run has no time. Both are known from the scene, so all these
rigs are built before the first frame.

Each rig is built from the previous one. If somebody changes the rig during the run, none of them fits any more; they
are built again in another thread, one at a time (`rig.bench.rebuild` states what that costs).
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
"""Most changes of the protocol that are prepared, each of which takes some tens of milliseconds, and most steps that
are searched for them. # chosen"""


class Upcoming:
    """Builds these rigs for the plant runner of `operation`: all of them when it is created, before the first frame."""

    def __init__(self, operation: Operation) -> None:
        self._operation, self._runner = operation, operation.runner
        self._build: Build[Variant] | None = None
        self._rigs: Iterator[Variant] | None = None
        self._begin()
        for variant in rigs(operation):
            self._keep(variant)
        self._rigs = None

    def _begin(self) -> None:
        """Start with the present rig."""
        self._rigs = rigs(self._operation)
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
            self._runner.forget()
            self._begin()
        elif self._rigs is not None and time.monotonic() >= self._due and not self._operation.builds.awaited:
            self._due = time.monotonic() + PAUSE_S
            self._build = Build(partial(next, self._rigs), apart=True)

    def _keep(self, variant: Variant) -> None:
        self._runner.keep(variant)
        self._known.append(variant.scene)


def rigs(operation: Operation) -> Iterator[Variant]:
    """The rig in its safe state, then the rig after each further change of the protocol, also with its safe state."""
    runner = operation.runner
    values = dict(runner.values)
    yield from _safe(operation, None, values)
    stateless = {name for name, one in runner.inputs.items() if not (one.state or one.write)}
    parameters = dict(leaves(operation.scene.parameters)).keys() - runner.inputs.keys() | stateless
    first = operation.protocol.begun
    steps = islice(walk(operation.scene.protocol), first, first + LOOKED_AT)  # the protocol may repeat for ever
    changes = (step for step in steps if isinstance(step, Set) and step.target in parameters)
    at: Variant | None = None
    for step in islice(changes, MOST):
        to = step.to
        if step.target in stateless:
            to = min(max(float(to), runner.inputs[step.target].low), runner.inputs[step.target].high)
        with suppress(RigError):  # the change is refused at its tick, and the run continues without it
            at = runner.variant(Wanted({step.target: to}), at)
            yield at
            values |= at.wanted.parameters
            yield from _safe(operation, at, values)


def _safe(operation: Operation, at: Variant | None, values: Mapping[str, float]) -> Iterator[Variant]:
    """The rigs for the safe state after a limit is exceeded (`rig.bench.exchange.Exchange.give_up`), from `at` on."""
    runner = operation.runner
    inputs = runner.inputs if at is None else runner.inputs | at.assembly.inputs
    for name, one in inputs.items() if operation.scene.limits else ():
        if not (one.state or one.write) and one.safe != values[name]:
            at = runner.variant(Wanted({name: one.safe}), at)
            yield at
