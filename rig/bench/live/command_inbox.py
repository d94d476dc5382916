"""Commands of controllers from the bus: whose commands count, how long answers take, and which are missing."""

from __future__ import annotations

import time
from collections import defaultdict

import numpy as np

from rig.bench.live.timing import Spread
from rig.bench.run.exchange import Exchange
from rig.bus.port import Session
from rig.bus.publishers import Publisher
from rig.bus.topics import Count, Refused
from rig.printable import counted

_REMEMBERED = 1 << 10  # steps whose time of sending is known, for the time from step to command. chosen: 1 s
_ACTS = 1 << 10  # most commands that wait, and most that one frame reads
# Time after its admission for which the name of a controller stays reserved until it is present [s]. # chosen
ANNOUNCED_S = 5.0
# Commands between two checks (0.2 s) that count as a flood, beyond four for each step and one for each older step
# without an answer. # chosen
_TOO_MANY = 1000


class CommandInbox:
    """Receives commands and passes them to `exchange`. `steps`: the publisher of the steps that they answer.

    `stamped`: the bus thread notes the time of arrival. It holds the interpreter lock meanwhile, which would cost a
    plant that waits for commands 50 us; for such a plant the time of reading is the time of arrival.
    """

    def __init__(self, session: Session, exchange: Exchange, steps: Publisher, stamped: bool) -> None:
        self._inbound = session.inbound
        self._exchange = exchange
        self.steps = steps
        self.acts = session.subscribe("act/*", depth=_ACTS, stamped=stamped)
        # Admitted controller -> user whose commands count. A controller of the scene is the user of its name.
        self._voices: dict[str, str] = {}
        # Admitted controller that is not present yet -> time of its admission [s of the monotonic clock].
        self._admitted: dict[str, float] = {}
        # Topic -> counts of the accepted commands: what a refused sender claims to have sent says nothing.
        self._accepted: defaultdict[str, Count] = defaultdict(Count)
        # Topic -> number of commands up to the last check, and of steps that were then not answered yet.
        self._counted: dict[str, tuple[int, int]] = {}
        self._steps = 0
        self._ticks = -1
        self.round_trip = Spread()
        """Distribution of the time from sending a step to the arrival of an answer."""
        self._trips: list[int] = []
        self.links = {name: Spread() for name in session.tickets}
        """The same for each controller of another host."""
        self._far: dict[str, list[int]] = {name: [] for name in self.links}
        self._put_at = [(-1, 0)] * _REMEMBERED  # tick and time [ns] of the steps sent last
        self.last_step = -1
        self.put_ns = 0
        """Tick of the last step sent, and time at which it was sent for the first time [ns, monotonic clock]."""

    def receive(self) -> None:
        """Pass the commands that have arrived to the exchange."""
        receive = self._exchange.receive
        for _ in range(_ACTS):
            command = self.next()
            if command is None:
                return
            receive(*command)

    def next(self, timeout: float = 0.0) -> tuple[str, int, tuple[float, ...]] | None:
        """The oldest command: sender, tick that it answers, values. Waits for it at most `timeout` [s].

        Records its round trip.
        """
        message = self.acts.get(timeout)
        while message is not None:
            act = message.said
            name = message.topic[4:]
            if self.speaks_for(message.user, name):
                if name in self._exchange.queues:
                    self._count(message.topic, message.seq)
                answered = act.tick
                tick, put_at = self._put_at[answered % _REMEMBERED]
                if tick == answered:
                    trips = self._far.get(name, self._trips)
                    trips.append((message.arrived_ns or time.monotonic_ns()) - put_at)
                return name, answered, tuple(act.values[:])  # a slice is read at once, not number by number
            why = "another one commands there" if name in self._voices else "not admitted"
            self._inbound.count(f"{message.user} on {message.topic}", Refused(why))
            message = self.acts.get()
        return None

    def _count(self, topic: str, seq: int) -> None:
        count = self._accepted[topic]
        if seq == count.last + 1:
            count.next(seq)
        else:
            count.see(seq, 0.0)

    def admit(self, name: str, user: str) -> None:
        """From now on accept commands of controller `name` from `user` only."""
        self._voices[name] = user
        self._admitted[name] = time.monotonic()

    def speaks_for(self, user: str, name: str) -> bool:
        """Whether messages of `user` under `name` count: it has this name, or was admitted under it."""
        return self._voices.get(name, name) == user

    def arrived(self, name: str) -> None:
        """An admitted controller is present now."""
        self._admitted.pop(name, None)

    def step_sent(self, tick: int) -> None:
        """Note the time at which the step of `tick` is sent for the first time."""
        if self.last_step != tick:
            self.put_ns = time.monotonic_ns()
            self._put_at[tick % _REMEMBERED] = (tick, self.put_ns)
            self.last_step = tick

    def awaited(self, name: str, user: str) -> bool:
        """Whether `name` was admitted a moment ago for another user, who may not have announced itself yet."""
        return (
            self._voices.get(name) != user and time.monotonic() - self._admitted.get(name, -ANNOUNCED_S) < ANNOUNCED_S
        )

    def floods(self) -> list[str]:
        """Controllers that sent far more commands since the last call than they had steps to answer; a line for each.

        A controller that was delayed answers all waiting steps at once; this backlog is not a flood.
        """
        steps = self.steps.sent - self._steps
        self._steps = self.steps.sent
        ticks = self.last_step - self._ticks
        self._ticks = self.last_step
        lines = []
        for topic, count in self.acts.counts.items():
            lost = self._accepted[topic].lost if topic in self._accepted else 0
            sent = count.received + lost
            queue = self._exchange.queues.get(topic[4:])
            before, owed = self._counted.get(topic, (0, 0))
            new = sent - before
            if new > owed + 4 * steps + _TOO_MANY:
                lines.append(
                    f"controller {topic[4:]} sent {counted(new, 'command')} for {counted(owed + steps, 'step')}"
                )
            due = ticks // queue.period if queue is not None else 0
            self._counted[topic] = (sent, max(owed + due - new, 0))
        return lines

    def fold(self) -> None:
        """Add the recorded round trips to their distribution."""
        waiting = {"": self._trips, **self._far}
        self._trips = []
        self._far = {name: [] for name in self.links}
        for name, trips in waiting.items():
            durations = np.array(trips, np.int64)
            self.round_trip.add(durations)
            if name:
                self.links[name].add(durations)

    def by_link(self) -> dict[str, dict[str, float]]:
        """Controller of another host -> its round trips [us], for the summary."""
        return {name: spread.to_json() for name, spread in self.links.items() if spread.count}

    def unanswered(self, name: str) -> int:
        """Number of steps, since the first one, that a controller has not answered."""
        queue = self._exchange.queues[name]
        count = self._accepted.get(f"act/{name}")
        answers = count.received + count.lost if count is not None else 0
        return self.last_step // queue.period + 1 - answers

    def lost(self) -> dict[str, int]:
        """Topic -> number of commands of admitted controllers that were sent but did not arrive."""
        return {topic: count.lost for topic, count in self._accepted.items() if count.lost}
