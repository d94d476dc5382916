"""Rigs that the protocol and the limits will need, built in advance.

A changed parameter needs a new matrix, and so does the safe value of an actuator without a command state. Building
takes tens of milliseconds, for which a frame of a paced run has no time. Both are known from the scene, so all these
rigs are built before the first frame.

Each rig is built from the previous one. If an operator changes the rig during the run, none of them fits any more; they
are built again in another thread, one at a time (`rig.bench.rebuild` states what that costs).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from itertools import islice

from rig.bench.experiment import Experiment
from rig.bench.rebuild import PAUSE_S
from rig.bench.rig_variant import Build, RigVariant, Wanted
from rig.errors import RigError
from rig.scenes.protocol import Set
from rig.scenes.sections import values_of
from rig.scenes.step_sequences import unrolled

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
    stateless = {name for name, one in runner.inputs.items() if not (one.state or one.write)}
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
    """The rigs for the safe state after a limit is exceeded (`rig.bench.exchange.Exchange.give_up`), from `at` on."""
    runner = experiment.runner
    inputs = runner.inputs if at is None else runner.inputs | at.assembly.inputs
    for name, one in inputs.items() if experiment.scene.limits else ():
        if not (one.state or one.write) and one.safe != values[name]:
            at = runner.variants.build(Wanted({name: one.safe}), at)
            yield at
