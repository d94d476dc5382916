"""Builds of rigs with other matrices in a paced run: in another thread, and what waits for them.

Builds the rigs for which the protocol and operators wait in a paced run, in another thread, in order of arrival.

A variant is built from the present rig. If the rig changes meanwhile, the variant is useless and must be built again.
Therefore only one request is built at a time, that of the longest waiting requester. Commands of controllers
(`rig.bench.run.builds`), which request new rigs again and again, wait until no other request waits; otherwise requests
would make each other start again for ever. A protocol step whose rig is already built takes it at its tick, so that the
times of an experiment are exact whenever possible.

Commands of controllers that need another matrix, in a paced run.

The resistance of a shunt or the frequency of dither is a coefficient of a matrix, not a state: a new value needs a new
rig (`rig.bench.run.rig_variants`), and no frame has time to build it. Rigs are built in another thread, one at a time,
and a command takes effect when its rig is ready. Building holds the interpreter lock at times and makes some frames
late, so at most one build begins in `PAUSE_S`. If a controller sends new values faster, the newest value with a rig
takes effect; value and tick are recorded like those of any other command. While the protocol or an operator waits for a
rig, none is built or used here, because their rig would not fit any more.

Protocol steps of a paced run that need other matrices: each waits until its rig is built, which takes many frames.

Most of these rigs are built in advance (`rig.bench.live.rehearsal`), but not if the rig was changed a moment ago, or if
a controller that commands a coefficient is disconnected. Then the step takes effect at the tick at which its rig is
ready. The recording contains both ticks, and a re-simulation waits as long. A step that still waits when the run ends
never takes effect; an event says so.
"""

from __future__ import annotations

import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

from rig.bench.run.journal import Journal
from rig.bench.run.protocol import Action, Apply, Change, Move, Switch
from rig.bench.run.rig_variants import Build, RigVariant, Wanted
from rig.bench.run.runner import PlantRunner
from rig.errors import RigError


class Builds:
    """Builds rigs for requesters in order of arrival; `runner` keeps the rigs."""

    def __init__(self, runner: PlantRunner) -> None:
        self.apart = False
        """Whether rigs are built in another thread; otherwise they are built at once and nobody waits."""
        self._runner = runner
        self._order: dict[object, None] = {}
        """Requesters that wait, in order of arrival."""
        self._build: Build[list[RigVariant]] | None = None
        """The build for the first requester."""

    @property
    def awaited(self) -> bool:
        """Whether a requester waits. Then no other caller should change the rig."""
        return bool(self._order)

    def join(self, who: object) -> None:
        """Append requester `who` to the queue."""
        self._order.setdefault(who)

    def leave(self, who: object) -> None:
        """Remove requester `who` from the queue."""
        if self._is_first(who):
            self._build = None
        self._order.pop(who, None)

    def ready(self, who: object, wanted: Callable[[], Sequence[Wanted]], later: Iterable[Wanted] = ()) -> bool:
        """Whether the rigs that `who` needs, one after the other, are built. If not, `who` waits and asks again.

        `later`: rigs that are probably needed next and are built with them. Raises RigError if a rig cannot be built,
        and whatever `wanted` raises; then `who` no longer waits.
        """
        new = who not in self._order
        self.join(who)
        try:
            ready = self._ready(wanted, later) if self._is_first(who) else new and self._runner.variants.has(wanted())
        except Exception:
            self.leave(who)
            raise
        if ready:
            self.leave(who)
        return ready

    def _is_first(self, who: object) -> bool:
        return who is next(iter(self._order), None)

    def _ready(self, wanted: Callable[[], Sequence[Wanted]], later: Iterable[Wanted]) -> bool:
        while self._build is None or self._build.done:
            build, self._build = self._build, None
            for variant in build.result() if build is not None else ():
                self._runner.variants.keep(variant)
            if self._runner.variants.has(needed := wanted()):
                return True
            self._build = Build(partial(self._made, needed, tuple(later)), self.apart)
        return False

    def _made(self, needed: Sequence[Wanted], later: Iterable[Wanted]) -> list[RigVariant]:
        found = self._runner.variants.build_all(needed)
        try:
            for one in later:
                found.append(self._runner.variants.build(one, found[-1] if found else None))
        except RigError:  # reported when the rig is needed
            pass
        return found


PAUSE_S = 0.5
"""Least time between the starts of two builds. # chosen: each makes one or two frames of 1 ms late, on two cores"""


class Rebuild:
    """Builds the rigs for commands to actuators of `runner`; a value without a valid rig is reported and ignored."""

    def __init__(self, runner: PlantRunner, journal: Journal, builds: Builds) -> None:
        self._runner, self._journal, self._builds = runner, journal, builds
        self._faulty: dict[str, float] = {}
        self._build: Build[RigVariant] | None = None
        self._drive, self._value = "", 0.0
        self._due = 0.0
        """Earliest time of the next build [s on the monotonic clock]."""

    @property
    def done(self) -> bool:
        """Whether `possible` may return something else than in its last call."""
        if self._builds.awaited:
            return False
        return self._build.done if self._build is not None else time.monotonic() >= self._due

    @property
    def building(self) -> bool:
        """Whether a rig is being built."""
        return self._build is not None and not self._build.done

    def possible(self, drives: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
        """The values that can be in force at this tick: if another rig is needed, the value of the newest one built."""
        needed = [self._runner.rebuilds(drive, value) for drive, value in zip(drives, values)]
        if self._build is not None and self._build.done and self._drive not in itertools.compress(drives, needed):
            self._build = None  # no longer needed
        return tuple([self._newest(d, v) if rebuilds else v for d, v, rebuilds in zip(drives, values, needed)])

    def _newest(self, drive: str, value: float) -> float:
        runner, build, now = self._runner, self._build, float(self._runner.values[drive])
        if self._builds.awaited:
            return now
        taken = None
        if build is not None and build.done and self._drive == drive:
            self._build = None
            try:
                if build.result().before is runner.scene:
                    taken, now = build.result(), self._value
                    runner.variants.keep(taken)
            except RigError as fault:
                self._faulty[drive] = self._value
                self._journal.repeated("refused", f"{drive} = {self._value:g} is commanded, and cannot be: {fault}")
        wanted = value != now and self._faulty.get(drive) != value
        if wanted and self._build is None and time.monotonic() >= self._due:
            self._due = time.monotonic() + PAUSE_S
            self._drive, self._value = drive, value
            self._build = Build(partial(runner.variants.build, Wanted({drive: value}), taken), apart=True)
        return now


WAITS, GOES_ON, NEVER = "waits", "goes on", "never"


class Waiting(NamedTuple):
    """A waiting action of the protocol: its number among all actions, and the tick at which it was due."""

    number: int
    tick: int
    action: Action


class PostponedSteps:
    """The waiting actions of a protocol. `wants(action)` returns the rigs that it needs, one after the other.

    `events`: those of a recorded run, which determine how long actions wait; in a paced run `builds` builds the rigs.
    """

    def __init__(
        self,
        runner: PlantRunner,
        journal: Journal,
        wants: Callable[[Action], list[Wanted]],
        builds: Builds,
        events: Iterable[Mapping[str, Any]],
    ) -> None:
        self.never: list[str] = []
        """Actions that never took effect, in words."""
        self._runner, self._journal, self._wants, self._builds = runner, journal, wants, builds
        self._number = 0
        self._waiting: deque[Waiting] = deque()
        self._count = self._longest = 0
        """Number of actions that have waited, and the longest wait [ticks]."""
        self._until: dict[int, float] = {}
        """Number of an action that waited in the recording -> the tick at which it took effect."""
        for event in events:
            if event["kind"] in (WAITS, GOES_ON):
                self._until[event["data"]["action"]] = event["tick"] if event["kind"] == GOES_ON else math.inf

    def has_to_wait(self, action: Action) -> bool:
        """Whether an action must wait; then `due` yields it later."""
        number, self._number = self._number, self._number + 1
        waits = number in self._until
        if self._builds.apart and self._rebuilds(action):  # in the order of the protocol
            waits = bool(self._waiting) or not self._runner.variants.has(self._wants(action))
        if waits:
            self._count += 1
            self._waiting.append(Waiting(number, self._runner.tick, action))
            if self._builds.apart:
                self._builds.join(self)
            self._journal.note(WAITS, f"{_text(action)} waits until its matrices are built", **_data(number))
        return waits

    def due(self) -> Iterator[Action]:
        """Actions that have waited and take effect at this tick."""
        while self._waiting:
            first = self._waiting[0]
            if not (self._ready() if self._builds.apart else self._until[first.number] <= self._runner.tick):
                return
            self._waiting.popleft()
            self._longest = max(self._longest, self._runner.tick - first.tick)
            text = f"{_text(first.action)} has its matrices and takes effect"
            self._journal.note(GOES_ON, text, **_data(first.number))
            yield first.action

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
            self._journal.note(NEVER, text, **_data(number))
        self._waiting.clear()

    def to_json(self) -> dict[str, Any]:
        """Number of actions that have waited, the longest wait [s], and how many never took effect; empty if none."""
        longest = self._longest * self._runner.frame_ns * 1e-9
        return {"waited": self._count, "longest_s": longest, "never": len(self.never)} if self._count else {}

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


def _data(number: int) -> dict[str, Any]:
    return {"by": "protocol", "action": number}


def _text(action: Action) -> str:
    if isinstance(action, Switch):
        return f"{'connect' if action.on else 'disconnect'} {action.controller}"
    if isinstance(action, Change):
        return f"{action.key} = {action.value:g}"
    assert isinstance(action, Apply | Move)  # no other action may need other matrices
    return f"{action.name} = {action.value if isinstance(action, Apply) else action.to:g}"
