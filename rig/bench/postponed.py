"""Steps of the protocol that ask for other matrices, in a paced run: each waits for its rig, which no frame builds.

Most of these rigs are built before they are asked for (`rig.bench.upcoming`). One is not where somebody has changed the
rig a moment ago, or where a controller that commands a coefficient is disconnected. Then the step takes effect at the
tick at which its rig is there, and the recording tells both ticks: a run that is simulated again waits as long.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

from rig.bench.journal import Journal
from rig.bench.protocol import Action, Apply, Change, Move, Switch
from rig.bench.stand import Stand
from rig.bench.variant import Build, Variant, Wanted
from rig.errors import RigError

WAITS, GOES_ON = "waits", "goes on"


class Postponed:
    """The actions of a protocol that wait. `wants` tells which rigs an action needs one after the other.

    `events` are those of a recorded run, which has waited already.
    """

    def __init__(
        self,
        stand: Stand,
        journal: Journal,
        wants: Callable[[Action], list[Wanted]],
        events: Iterable[Mapping[str, Any]],
    ) -> None:
        self.apart = False
        """Whether rigs are built in another thread."""
        self._stand, self._journal, self._wants = stand, journal, wants
        self._number = 0
        self._waiting: deque[tuple[int, Action]] = deque()
        self._build: Build[list[Variant]] | None = None
        self._until: dict[int, float] = {}
        """Number of an action that has waited in the recording, and the tick at which it took effect."""
        for event in events:
            if event["kind"] in (WAITS, GOES_ON):
                self._until[event["data"]["action"]] = event["tick"] if event["kind"] == GOES_ON else math.inf

    def has_to_wait(self, action: Action) -> bool:
        """Whether an action does not take effect at this tick; `due` gives it later."""
        number, self._number = self._number, self._number + 1
        waits = number in self._until
        if self.apart and self._rebuilds(action):  # in the order of the protocol
            waits = bool(self._waiting) or not self._stand.has(self._wants(action))
        if waits:
            self._waiting.append((number, action))
            self._note(WAITS, f"{_told(action)} waits until its matrices are built", number)
        return waits

    def due(self) -> Iterator[Action]:
        """What has waited and takes effect at this tick."""
        while self._waiting:
            number, action = self._waiting[0]
            if not (self._built(action) if self.apart else self._until[number] <= self._stand.tick):
                return
            self._waiting.popleft()
            self._note(GOES_ON, f"{_told(action)} has its matrices and takes effect", number)
            yield action

    def until(self) -> int | None:
        """The tick at which the next action takes effect in a run that is simulated again; None if none waits."""
        tick = self._until.get(self._waiting[0][0], math.inf) if self._waiting else math.inf
        return int(tick) if tick < math.inf else None

    def drop(self) -> None:
        """The protocol is over."""
        self._waiting.clear()

    def _rebuilds(self, action: Action) -> bool:
        """Whether an action may ask for other matrices."""
        if isinstance(action, Apply | Move):
            return self._stand.coefficient(action.name)
        return isinstance(action, Switch) or (isinstance(action, Change) and not action.key.startswith("controllers."))

    def _built(self, action: Action) -> bool:
        if self._build is None:
            if self._stand.has(wanted := self._wants(action)):
                return True
            self._build = Build(partial(self._stand.variants, wanted), apart=True)
        if not self._build.done:
            return False
        build, self._build = self._build, None
        try:
            for variant in build.result():
                self._stand.keep(variant)
        except RigError:  # it comes again when the action is carried out, and is told there
            return True
        return self._stand.has(self._wants(action))  # else somebody else has changed the rig

    def _note(self, kind: str, text: str, number: int) -> None:
        self._journal.note(kind, text, by="protocol", action=number)


def _told(action: Action) -> str:
    if isinstance(action, Switch):
        return f"{'connect' if action.on else 'disconnect'} {action.controller}"
    if isinstance(action, Change):
        return f"{action.key} = {action.value:g}"
    assert isinstance(action, Apply | Move)  # nothing else may ask for other matrices
    return f"{action.name} = {action.value if isinstance(action, Apply) else action.to:g}"
