"""Protocol steps of a paced run that need other matrices: each waits until its rig is built, which takes many frames.

Most of these rigs are built in advance (`rig.bench.prepared_rigs`), but not if the rig was changed a moment ago, or if
a controller that commands a coefficient is disconnected. Then the step takes effect at the tick at which its rig is
ready. The recording contains both ticks, and a re-simulation waits as long. A step that still waits when the run ends
never takes effect; an event says so.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple

from rig.bench.actions import Action, Apply, Change, Move, Switch
from rig.bench.background_builds import Builds
from rig.bench.journal import Journal
from rig.bench.rig_variant import Wanted
from rig.bench.runner import PlantRunner
from rig.errors import RigError

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
