"""A new matrix takes time: rigs with other matrices are built beside the frames of a paced run.

A changed parameter, the resistance of a shunt and the frequency of dither are coefficients of a matrix, not states: a
new value needs a new rig (`rig.bench.run.rig_variants`). Building takes 3 to 15 ms for one body and seconds for a
plate, for which no frame has time. So rigs are built in another thread, one at a time, and take effect at the tick at
which they are ready; the recording contains this tick.

    in advance    rigs that the protocol and the limits will need are built before the first frame (`PreparedRigs`)
    who waits     the protocol (`PostponedSteps`) and operators, in order of arrival (`Builds.ready`)
    spare time    commands of controllers (`CommandedRigs`), and what is prepared again after the rig was changed

A variant is built from the present rig. If the rig changes meanwhile, the variant is useless and must be built again.
Therefore commands of controllers, which request new rigs again and again, are served only while nobody waits; otherwise
requests would make each other start again for ever. Building holds the interpreter lock at times and makes some frames
late, so at most one build in spare time begins in `PAUSE_S`.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

from rig.bench.run.actions import Action, Apply, Change, Move, Switch
from rig.bench.run.journal import Journal
from rig.bench.run.protocol import Protocol
from rig.bench.run.rig_variants import RigVariant, Wanted
from rig.bench.run.runner import PlantRunner
from rig.errors import RigError
from rig.machine.scheduling import anywhere, stand_back
from rig.scenes.protocol import Set
from rig.scenes.scene import Scene
from rig.scenes.sections import unrolled, values_of

PAUSE_S = 0.5
"""Least time between the starts of two builds in spare time. # chosen: each makes one or two frames of 1 ms late, on
two cores"""
MOST = 32
"""Most changes of the protocol that are prepared, each of which takes some tens of milliseconds. # chosen"""
LOOKED_AT = 10_000
"""Most steps of the protocol that are searched for changes. # chosen"""
WAITS = "waits"
GOES_ON = "goes on"
NEVER = "never"
"""Kinds of the events of a step that waits for its matrices."""

Make = Callable[[], list[RigVariant]]


class Builds:
    """Builds rigs for requesters; `runner` keeps the rigs."""

    def __init__(self, runner: PlantRunner) -> None:
        self.apart = False
        """Whether rigs are built in another thread; otherwise they are built at once and nobody waits."""
        self._variants = runner.variants
        self._order: dict[object, None] = {}  # requesters that wait, in order of arrival
        # For whom a rig is being built, and what becomes of it.
        self._build: tuple[object, Future[list[RigVariant]]] | None = None
        self._due = 0.0  # earliest time of the next build in spare time [s on the monotonic clock]

    @property
    def awaited(self) -> bool:
        """Whether a requester waits. Then no other caller should change the rig."""
        return bool(self._order)

    def join(self, who: object) -> None:
        """Append requester `who` to the queue."""
        self._order.setdefault(who)

    def leave(self, who: object) -> None:
        """Remove requester `who` from the queue."""
        self._order.pop(who, None)

    def ready(self, who: object, wanted: Callable[[], Sequence[Wanted]], later: Iterable[Wanted] = ()) -> bool:
        """Whether the rigs that `who` needs, one after the other, are built. If not, `who` waits and asks again.

        `later`: rigs that are probably needed next and are built with them. Raises RigError if a rig cannot be built,
        and whatever `wanted` raises; then `who` no longer waits.
        """
        new = who not in self._order
        self.join(who)
        try:
            first = who is next(iter(self._order))
            if first:
                self.collect(who)
            needed = wanted() if first or new else ()
            if not self.apart:
                self._variants.keep(self._variants.build_all(needed))
            ready = bool(first or new) and self._variants.has(needed)
            if first and not ready and self._build is None:
                self._begin(who, partial(self._variants.build_all, needed, tuple(later)))
        except Exception:
            self.leave(who)
            raise
        if ready:
            self.leave(who)
        return ready

    def in_spare_time(self, who: object, make: Make) -> bool:
        """Begin a build if nobody waits, no other build goes on, and the pause after the last one is over."""
        begins = not self._order and self._build is None and time.monotonic() >= self._due
        if begins:
            self._due = time.monotonic() + PAUSE_S
            self._begin(who, make)
        return begins

    def collect(self, who: object) -> None:
        """Keep the rigs of a build that is done. Raises what it raised if it was begun for `who`."""
        if self._build is not None and self._build[1].done():
            whose, build = self._build
            self._build = None
            if whose == who or build.exception() is None:
                self._variants.keep(build.result())

    def _begin(self, who: object, make: Make) -> None:
        future: Future[list[RigVariant]] = Future()

        def build() -> None:
            anywhere()
            stand_back(0)  # not a lower priority: at times it holds the interpreter lock, for which the plant waits
            try:
                future.set_result(make())
            except Exception as fault:
                future.set_exception(fault)

        self._build = who, future
        threading.Thread(target=build, name="variant", daemon=True).start()


class CommandedRigs:
    """The rigs for commands to actuators of `runner`; a value without a valid rig is reported and ignored.

    If a controller sends new values faster than rigs are built, the newest value with a rig takes effect; value and
    tick are recorded like those of any other command.
    """

    def __init__(self, runner: PlantRunner, journal: Journal, builds: Builds) -> None:
        self._runner = runner
        self._journal = journal
        self._builds = builds
        self._asked: dict[str, float] = {}  # actuator -> the value whose rig was begun last
        self._faulty: dict[str, float] = {}

    def possible(self, drives: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
        """The values that can be in force at this tick: if another rig is needed, the value of the newest one built."""
        return tuple([self._newest(drive, value) for drive, value in zip(drives, values)])

    def _newest(self, drive: str, value: float) -> float:
        runner = self._runner
        builds = self._builds
        if not runner.rebuilds(drive, value):
            self._asked.pop(drive, None)
            return value
        if not builds.awaited:
            asked = self._asked.get(drive, value)
            try:
                builds.collect((drive, asked))
            except RigError as fault:
                self._faulty[drive] = asked
                self._journal.repeated("refused", f"{drive} = {asked:g} is commanded, and cannot be: {fault}")
            for built in (value, asked):
                if runner.variants.has([Wanted({drive: built})]):
                    return built
            make = partial(runner.variants.build_all, [Wanted({drive: value})])
            if self._faulty.get(drive) != value and builds.in_spare_time((drive, value), make):
                self._asked[drive] = value
        return float(runner.values[drive])


class Waiting(NamedTuple):
    """A waiting action of the protocol: its number among all actions, and the tick at which it was due."""

    number: int
    tick: int
    action: Action


class PostponedSteps:
    """The actions of a protocol that wait for their matrices. `wants(action)` returns the rigs that it needs in order.

    Most of these rigs are built in advance, but not if the rig was changed a moment ago, or if a controller that
    commands a coefficient is disconnected. Then the step takes effect at the tick at which its rig is ready. The
    recording contains both ticks in its `events`, and a re-simulation waits as long. A step that still waits when the
    run ends never takes effect; an event says so. A step whose rig is already built takes it at its tick, so that the
    times of an experiment are exact whenever possible.
    """

    def __init__(
        self,
        runner: PlantRunner,
        journal: Journal,
        wants: Callable[[Action], Sequence[Wanted]],
        builds: Builds,
        events: Iterable[Mapping[str, Any]],
    ) -> None:
        self.never: list[str] = []
        """Actions that never took effect, in words."""
        self._runner = runner
        self._journal = journal
        self._wants = wants
        self._builds = builds
        self._number = 0
        self._waiting: deque[Waiting] = deque()
        self._count = self._longest = 0  # number of actions that have waited, and the longest wait [ticks]
        # Number of an action that waited in the recording -> the tick at which it took effect.
        self._until: dict[int, float] = {}
        for event in events:
            if event["kind"] in (WAITS, GOES_ON):
                self._until[event["data"]["action"]] = event["tick"] if event["kind"] == GOES_ON else math.inf

    def has_to_wait(self, action: Action) -> bool:
        """Whether an action must wait; then `due` yields it later."""
        number = self._number
        self._number += 1
        waits = number in self._until
        if self._builds.apart and self._rebuilds(action):  # in the order of the protocol
            waits = bool(self._waiting) or not self._runner.variants.has(self._wants(action))
        if waits:
            self._count += 1
            self._waiting.append(Waiting(number, self._runner.tick, action))
            if self._builds.apart:
                self._builds.join(self)
            self._note(WAITS, number, f"{_text(action)} waits until its matrices are built")
        return waits

    def due(self) -> Iterator[Action]:
        """Actions that have waited and take effect at this tick."""
        while self._waiting:
            number, tick, action = self._waiting[0]
            if not (self._ready() if self._builds.apart else self._until[number] <= self._runner.tick):
                return
            self._waiting.popleft()
            self._longest = max(self._longest, self._runner.tick - tick)
            self._note(GOES_ON, number, f"{_text(action)} has its matrices and takes effect")
            yield action

    def until(self) -> int | None:
        """The tick at which the next action takes effect in a re-simulation; None if none waits."""
        tick = self._until.get(self._waiting[0].number, math.inf) if self._waiting else math.inf
        return int(tick) if tick < math.inf else None

    def step_back(self) -> None:
        """In a pause nothing takes effect: let other requests build first."""
        self._builds.leave(self)

    def end(self) -> None:
        """At the end of the protocol: actions that still wait never take effect."""
        self._builds.leave(self)
        for number, tick, action in self._waiting:
            self._longest = max(self._longest, self._runner.tick - tick)
            text = f"{_text(action)} of t = {tick * self._runner.frame_ns * 1e-9:g} s never took effect"
            self.never.append(text)
            self._note(NEVER, number, text)
        self._waiting.clear()

    def to_json(self) -> dict[str, Any]:
        """Number of actions that have waited, the longest wait [s], and how many never took effect; empty if none."""
        longest = self._longest * self._runner.frame_ns * 1e-9
        return {"waited": self._count, "longest_s": longest, "never": len(self.never)} if self._count else {}

    def _note(self, kind: str, number: int, text: str) -> None:
        self._journal.note(kind, text, by="protocol", action=number)

    def _rebuilds(self, action: Action) -> bool:
        """Whether an action may need other matrices."""
        if isinstance(action, Apply | Move):
            return self._runner.coefficient(action.name)
        return isinstance(action, Switch) or (isinstance(action, Change) and not action.key.startswith("controllers."))

    def _ready(self) -> bool:
        """Whether the rigs of the first waiting action are built, together with those of other actions of its tick."""
        first = self._waiting[0]
        others = (other.action for other in islice(self._waiting, 1, None) if other.tick == first.tick)
        later = (wanted for action in others for wanted in self._wants(action))
        try:
            return self._builds.ready(self, lambda: self._wants(first.action), later)
        except RigError:  # raised again and reported when the action is carried out
            return True


def _text(action: Action) -> str:
    if isinstance(action, Switch):
        return f"{'connect' if action.on else 'disconnect'} {action.controller}"
    if isinstance(action, Change):
        return f"{action.key} = {action.value:g}"
    assert isinstance(action, Apply | Move)  # no other action may need other matrices
    return f"{action.name} = {action.value if isinstance(action, Apply) else action.to:g}"


class PreparedRigs:
    """Builds in advance the rigs that the protocol and the limits of `scene` will need: all before the first frame.

    Each rig is built from the previous one. If the rig is changed in another way during the run, none of them fits any
    more; `look` builds them again.
    """

    def __init__(self, scene: Scene, runner: PlantRunner, protocol: Protocol, builds: Builds) -> None:
        self._scene = scene
        self._runner = runner
        self._protocol = protocol
        self._builds = builds
        self._begin()
        while made := self._next(self._rigs):
            runner.variants.keep(made)

    def _begin(self) -> None:
        """Start with the present rig."""
        self._rigs = self._needed()
        self._known = [self._runner.scene]  # scenes of the initial rig and of those that are built
        self._due = time.monotonic() + 2.0 * PAUSE_S  # while the rig is changed again and again, nothing is built

    def look(self) -> None:
        """Start again if the rig was changed, and build the next rig in another thread when it is due."""
        if not any(self._runner.scene is known for known in self._known):
            self._begin()
        elif time.monotonic() >= self._due and not self._builds.awaited:
            self._builds.collect(self)
            self._builds.in_spare_time(self, partial(self._next, self._rigs))

    def _next(self, rigs: Iterator[RigVariant]) -> list[RigVariant]:
        with suppress(Exception):  # no rig is left; what this raises is raised again and reported at its tick
            variant = next(rigs)
            self._known.append(variant.scene)
            return [variant]
        if rigs is self._rigs:
            self._due = math.inf
        return []

    def _needed(self) -> Iterator[RigVariant]:
        """The rig in its safe state, then after each further change of the protocol, also with its safe state."""
        runner = self._runner
        values = dict(runner.values)
        yield from self._safe(None, values)
        stateless = set(filter(runner.coefficient, runner.inputs))
        parameters = dict(values_of(self._scene.parameters)).keys() - runner.inputs.keys() | stateless
        first = self._protocol.begun
        steps = islice(unrolled(self._scene.protocol), first, first + LOOKED_AT)  # the protocol may repeat for ever
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
                yield from self._safe(at, values)

    def _safe(self, at: RigVariant | None, values: Mapping[str, float]) -> Iterator[RigVariant]:
        """The rigs for the safe state after a limit is exceeded (`rig.bench.run.exchange.Exchange.give_up`)."""
        inputs = self._runner.inputs if at is None else self._runner.inputs | at.assembly.inputs
        for name, actuator in inputs.items() if self._scene.limits else ():
            if not (actuator.state or actuator.write) and actuator.safe != values[name]:
                at = self._runner.variants.build(Wanted({name: actuator.safe}), at)
                yield at
