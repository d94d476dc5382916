"""A plant without a pace waits for its recorders: what they have not written yet must fit into their memory.

It computes faster than a recorder writes. What the recorder has received waits in a ring buffer (rig.record.recorder),
which drops the oldest batches when it is full. Therefore the plant waits when a recorder is half of the ring behind. A
recorder states several times per second up to which simulated time it has written.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable

from rig.bench.hub import Hub
from rig.bus.arrivals import Message
from rig.bus.batch import WAITING

MOST = WAITING // 2
"""Most batches that a recorder may be behind."""
PATIENCE_S = 30.0
"""Longest wait for a recorder that does not get on [s]; from then on it loses messages, which are counted."""
_LOOK_S, _EVERY_NS = 0.1, 20_000_000


class RecorderLag:
    """Tells how far the recorders are behind, and waits for them.

    `names()`: the recorders that are waited for. `serve()` is called ten times per second while the plant waits, and
    `stopped()` ends a wait. `say` gets a line for the first wait, and for a recorder that does not get on.
    """

    def __init__(
        self,
        hub: Hub,
        names: Callable[[], Iterable[str]],
        serve: Callable[[], object],
        stopped: Callable[[], bool],
        say: Callable[[str], object],
    ) -> None:
        self._hub, self._names, self._serve, self._stopped, self._say = hub, names, serve, stopped, say
        self._sent: deque[tuple[int, int]] = deque()
        """Simulated times [ns], and the number of batches sent before each; from the last written one on."""
        self._reached: dict[str, int] = {}
        """Recorder -> simulated time up to which it has written [ns]."""
        self._given_up: dict[str, int] = {}
        """Recorder that did not get on -> the time that it had reached."""
        self._said, self._due = False, 0

    def look(self, now: int) -> None:
        """At most 50 times per second: note what was sent, and wait while a recorder is too far behind."""
        if now < self._due:
            return
        self._due = now + _EVERY_NS
        self._sent.append((self._hub.runner.t_ns, self._hub.session.batches))
        for message in self._hub.totals.drain():
            self._hear(message)
        if self._behind() > MOST:
            self._wait()

    def _hear(self, message: Message) -> None:
        name = message.topic.partition("/")[2]
        if self._hub.commands.speaks_for(message.user, name):
            self._reached[name] = max(message.t_ns, self._reached.get(name, 0))

    def _behind(self) -> int:
        """Number of batches that the slowest recorder has not written."""
        reached = {name: self._reached.get(name, 0) for name in self._names()}
        self._given_up = {name: t_ns for name, t_ns in self._given_up.items() if reached.get(name) == t_ns}
        waited = [t_ns for name, t_ns in reached.items() if name not in self._given_up]
        if not waited:
            self._sent.clear()
            return 0
        while len(self._sent) > 1 and self._sent[1][0] <= min(waited):
            self._sent.popleft()
        return self._hub.session.batches - self._sent[0][1] if self._sent else 0

    def _wait(self) -> None:
        slow, moved = dict(self._reached), time.monotonic()
        if not self._said:
            self._said = True
            self._say("the recorder is slower than the plant, which waits for it from time to time")
        while self._behind() > MOST and not self._stopped():
            self._serve()
            if (message := self._hub.totals.get(_LOOK_S)) is not None:
                self._hear(message)
            if self._reached != slow:
                slow, moved = dict(self._reached), time.monotonic()
            elif time.monotonic() > moved + PATIENCE_S:
                self._give_up()

    def _give_up(self) -> None:
        """Wait no more for the slowest recorders until they get on."""
        reached = {name: self._reached.get(name, 0) for name in self._names() if name not in self._given_up}
        for name in sorted(reached):
            if reached[name] == min(reached.values()):
                self._given_up[name] = reached[name]
                self._say(f"recorder {name} has written nothing for {PATIENCE_S:g} s; the plant continues without it")
