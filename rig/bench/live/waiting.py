"""What a live plant waits for: the answers of its controllers in lockstep, and its recorders without a pace.

Lockstep: the plant integrates a frame after every controller that has joined and is due has answered its step.

A controller in another process is asked like one in the plant process, by the compiled loop or by the exchange. Its
answer comes over the bus: the first controller that is asked at a tick sends the step and waits for all answers.

A step without an answer is sent again, first after 10 ms, then at growing intervals; a controller answers a repeated
step with the same command. A controller that has not answered for `EVICTED` seconds is evicted and treated like one
that died. Controllers join between two pieces of the run. It does not depend on the order in which answers arrive.

A plant without a pace waits for its recorders: what they have not written yet must fit into their memory.

It computes faster than a recorder writes. What the recorder has received waits in a ring buffer (rig.record.recorder),
which drops the oldest batches when it is full. Therefore the plant waits when a recorder is half of the ring behind. A
recorder states several times per second up to which simulated time it has written.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from math import isfinite

from rig.bench.live.housekeeping import Housekeeper
from rig.bench.live.hub import Hub
from rig.bench.run.local_controllers import ControllerInProcess
from rig.bus.messages import WAITING
from rig.bus.topics import Message
from rig.controllers.blocks.base import Values

AGAIN = 0.01
EVICTED = 5.0
_LOOK_NS = 100_000_000
MOST = 1 << 10
"""Most commands that are read in a frame in which no controller is due."""


class Stopped(Exception):
    """Raised in place of an answer when the run shall end."""


class Lockstep:
    """Sends steps and waits for the answers, until `stopped()`."""

    def __init__(self, hub: Hub, housekeeper: Housekeeper, stopped: Callable[[], bool]) -> None:
        self._hub, self._housekeeper, self._stopped = hub, housekeeper, stopped
        self._commands, self._exchange = hub.commands, hub.experiment.exchange
        self._evicted: set[str] = set()
        self._partners: dict[str, Partner] = {}
        self._tick = -1
        """Tick of the last step."""
        self._due: set[str] = set()
        """Controllers that have not answered it."""
        self._found: dict[str, Values] = {}
        """The answers to it."""
        self._again, self._looked = AGAIN, 0
        self.again = 0
        """Number of repeated steps."""

    def look(self) -> Sequence[ControllerInProcess]:
        """The controllers that have joined and are not evicted; to be called between two pieces of the run."""
        hub, queues = self._hub, self._exchange.queues
        here = [
            name for name in sorted(queues) if ("controller", name) in hub.watch.present and name not in hub.in_plant
        ]
        self._evicted.intersection_update(here)
        known = {name: partner for name, partner in self._partners.items() if queues.get(name) is partner.queue}
        self._partners = {
            name: known.get(name) or Partner(name, self, hub) for name in here if name not in self._evicted
        }
        return [*self._partners.values()]

    @property
    def asks_each_tick(self) -> bool:
        """Whether a controller is due at each tick, and the compiled loop can ask all of them."""
        queues, runner = [partner.queue for partner in self._partners.values()], self._hub.runner
        return (
            any(queue.period == 1 for queue in queues)
            and len(queues) <= len(runner.controllers.controllers)
            and all(queue.connected and queue.link is None for queue in queues)
            and None not in [runner.plain(drive) for queue in queues for drive in queue.drives]
        )

    def exchange(self, tick: int) -> None:
        """Send the step of `tick` and wait for the answers of the controllers that are due. Raises Stopped.

        At a tick that the plant runner has not reached yet, because the compiled loop asks, this waits for a moment
        only: the loop then ends, and another call continues to wait.
        """
        hub, due = self._hub, self._due
        if tick != self._tick:
            self._tick, self._found, self._again = tick, {}, AGAIN
            hub.gather(tick)
            for name, partner in self._partners.items():
                if not tick % partner.queue.period:
                    due.add(name)
            hub.put_step(tick)
            self._looked = self._commands.put_ns
            if not due:
                self._pass_over()
        while due:
            command = self._commands.next(self._again)
            if command is not None:
                name, answered, values = command
                if answered == tick:
                    self._found[name] = values
                    due.discard(name)
                elif name not in self._exchange.queues:
                    self._exchange.receive(name, answered, ())
            elif not self._goes_on_waiting(tick):
                return

    def answer(self, name: str, tick: int) -> Values | None:
        """The answer of a controller to the step of `tick`; None without one, see `exchange`."""
        if tick != self._tick or self._due:
            self.exchange(tick)
        return self._found.get(name)

    def _goes_on_waiting(self, tick: int) -> bool:
        """Repeat the step; whether the plant runner is at this tick. Raises Stopped."""
        hub, now = self._hub, time.monotonic_ns()
        if self._stopped():
            raise Stopped
        here = hub.runner.tick == tick
        if here and (now - self._looked > _LOOK_NS or self._again > AGAIN):
            self._looked = now
            self._overdue(now - self._commands.put_ns)
        if self._due:
            hub.put_step(tick)
            self.again += 1
            self._again = min(self._again * 2.0, 0.5) if here else AGAIN
        return here

    def _pass_over(self) -> None:
        """Read commands when no controller is due: answers to repeated steps, or from controllers without admission."""
        for _ in range(MOST):
            command = self._commands.next()
            if command is None:
                return
            if command[0] not in self._exchange.queues:
                self._exchange.receive(*command)

    def _overdue(self, waited_ns: int) -> None:
        """Stop waiting for controllers that have left, or that hang (these are evicted)."""
        self._hub.serve_scene()
        self._hub.session.flush()
        self._housekeeper.notice()
        present = self._hub.watch.present
        for name in sorted(self._due):
            if ("controller", name) in present:
                if waited_ns < EVICTED * 1e9:
                    continue
                self._evicted.add(name)
                tick = self._hub.runner.tick
                text = f"controller {name} did not answer for {EVICTED:g} s and is evicted at tick {tick}"
                self._housekeeper.faults.append(text)
                self._hub.experiment.journal.note("evicted", text, controller=name)
            self._due.discard(name)
            del self._partners[name]


class Partner(ControllerInProcess):
    """A controller in another process, which the plant asks like one in its own: the answer comes from `lockstep`."""

    def __init__(self, name: str, lockstep: Lockstep, hub: Hub) -> None:
        self._take_place(name, hub.experiment)
        self._lockstep, self.columns = lockstep, []
        self.due = -(-hub.runner.tick // self.queue.period) * self.queue.period

    def ask(self, tick: int) -> Values:
        """See `ControllerInProcess.ask`. An answer that the compiled loop cannot put into force is kept in `given`."""
        values = self._lockstep.answer(self.name, tick)
        if values is None:
            if self._runner.tick < tick:
                return ()  # it is asked again when the loop has ended
            values = ()  # it has left, or is evicted
        self.due, self.given = tick + self.queue.period, values
        return values if isfinite(sum(values)) else ()

    def native(self) -> None:
        """See `ControllerInProcess.native`."""
        return

    def catch_up(self, tick: int, send: bool = False) -> None:
        """See `ControllerInProcess.catch_up`: a controller in another process is asked at each of its ticks."""


MOST_WAITING = WAITING // 2
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
        if self._behind() > MOST_WAITING:
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
        while self._behind() > MOST_WAITING and not self._stopped():
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
