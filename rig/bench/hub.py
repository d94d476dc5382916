"""The plant's connection to the bus: publishes what happens on a plant runner, and receives commands of controllers.

Samples are sent in blocks of 20 ms, those of slower sensors one by one. A message for each sample of four sensors at
1 kHz would cost 0.1 ms of every frame (measured: seven times as many late frames), and the step contains the latest
samples anyway. The state is sent at most 200 times per second of simulated time. Both wait for the next batch of the
session (`rig.bus.batch`); only the step is sent at once.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bench.experiment import Experiment
from rig.bench.timing import Spread
from rig.bus import encode, messages
from rig.bus.arrivals import Presence, Refused
from rig.bus.inbound import TIMES_NS
from rig.bus.port import Session
from rig.bus.publisher import Publisher
from rig.bus.run_setup import Setup
from rig.errors import UsageError
from rig.scenes.scene import heard
from rig.sensors.chain.instants import Instants

BLOCK_NS = 20_000_000
STATE_NS = 5_000_000
_REMEMBERED = 1 << 10
_ACTS = 1 << 10
"""Most commands that wait, and most that one frame reads."""
_ANNOUNCED_S = 5.0
"""Time after its admission for which the name of a controller stays reserved until it is present [s]. # chosen"""
_TOO_MANY = 1000
"""Commands between two checks (0.2 s) that count as a flood, beyond four for each step and one for each older step
without an answer. # chosen"""


class Samples:
    """The samples of one sensor, collected until a block is full."""

    def __init__(self, instants: Instants) -> None:
        self._instants = instants
        self._period_ns = round(instants.period_ns)
        self._size = max(BLOCK_NS // self._period_ns, 1)
        self._kept: list[NDArray[np.float64]] = []
        self._count, self._first = 0, 0
        self.next = 0
        """Index of the first sample that is not collected yet."""

    def full_ns(self) -> int:
        """Time at which the last sample of the present block is published [ns]."""
        first = self._first if self._count else self.next
        return self._instants.instant(first + self._size - 1)

    def published(self, t_ns: int) -> int:
        """Number of samples that are published up to `t_ns` but not collected yet."""
        return max(self._instants.count(t_ns) - self.next, 0)

    def add(self, tick: int, samples: NDArray[np.float64]) -> bytes | None:
        """Add the next samples; returns the block if it is full."""
        if not self._count:
            self._first = self.next
        self._kept.append(samples.copy())
        self._count += len(samples)
        self.next += len(samples)
        return self.block(tick) if self._count >= self._size else None

    def block(self, tick: int) -> bytes | None:
        """Encode what has been collected as a Block; None if nothing."""
        if not self._count:
            return None
        gathered = self._kept[0] if len(self._kept) == 1 else np.concatenate(self._kept)
        first, instants = self._first, self._instants
        times = None if instants.even else instants.at(np.arange(first, first + self._count))
        self._kept, self._count = [], 0
        return encode.block(tick, instants.instant(first), self._period_ns, gathered, times)


class Hub:
    """Publishes what happens on the plant runner of `experiment`, and passes commands to its exchange.

    `waits`: the plant waits for commands, so the time of reading a command is its time of arrival. Otherwise the bus
    thread stamps the arrival, and holds the interpreter lock meanwhile; that would cost a waiting plant 50 us.
    """

    def __init__(self, session: Session, experiment: Experiment, setup: Setup, waits: bool = False) -> None:
        self.session, self.experiment = session, experiment
        self.runner = experiment.runner
        runner, bank = self.runner, self.runner.bank
        self._step = session.publisher("step")
        self._heard: list[int] = []
        self.in_plant = experiment.scene.in_plant
        """Controllers that work in the plant process and get no steps over the bus."""
        self.hear(heard({n: s for n, s in experiment.scene.controllers.items() if n not in self.in_plant}))
        self._state = session.publisher("state")
        self._encode_state = encode.StateEncoder(len(runner.outputs))
        self._state_ticks = max(-(-STATE_NS // runner.frame_ns), 1)
        self._events = session.publisher("event/plant")
        self._health = session.publisher("health")
        self._meas = [session.publisher(f"meas/{name}") for name in bank.names]
        self._samples = [Samples(instants) for instants in bank.instants]
        runner.keep_samples = self.collect
        self._full_ns = 0
        """Time at which samples must be collected next [ns]."""
        self._applied: dict[str, Publisher] = {}
        session.before_batches(self._complete)
        self.single = True
        """Whether each piece is one frame."""
        self._told = 0
        self.acts = session.subscribe("act/*", depth=_ACTS, stamped=not waits)
        self._voices: dict[str, str] = {}
        """Admitted controller -> user whose commands count. A controller of the scene is the user of its name."""
        self._admitted: dict[str, float] = {}
        """Admitted controller that is not present yet -> time of its admission [s of the monotonic clock]."""
        self._counted: dict[str, tuple[int, int]] = {}
        """Topic -> number of commands up to the last check, and of steps that were then not answered yet."""
        self._steps, self._ticks = 0, -1
        self.totals = session.subscribe("total/*", polled=True)
        self.watch = session.watch("*/*")
        text = setup.to_text().encode()
        self._scene = session.serve("scene", lambda _: text)
        self.round_trip = Spread()
        """Distribution of the time from sending a step to the arrival of an answer."""
        self._trips: list[int] = []
        self._put_at = [(-1, 0)] * _REMEMBERED
        self.asked = -1
        """Tick of the last step sent."""

    def receive(self) -> None:
        """Pass the commands that have arrived to the exchange."""
        receive = self.experiment.exchange.receive
        for _ in range(_ACTS):
            found = self.command()
            if found is None:
                return
            name, act = found
            receive(name, act.tick, tuple(act.values))

    def command(self, timeout: float = 0.0) -> tuple[str, Any] | None:
        """Sender and content of the oldest command; wait for it at most `timeout` [s]. Records its round trip."""
        message = self.acts.get(timeout)
        while message is not None:
            act, name = message.said, message.topic[4:]
            if self.speaks_for(message.user, name):
                tick, put_at = self._put_at[act.tick % _REMEMBERED]
                if tick == act.tick:
                    self._trips.append((message.arrived_ns or time.monotonic_ns()) - put_at)
                return name, act
            why = "another one commands there" if name in self._voices else "not admitted"
            self.session.door.count(f"{message.user} on {message.topic}", Refused(why))
            message = self.acts.get()
        return None

    def admit(self, name: str, user: str) -> None:
        """From now on accept commands of controller `name` from `user` only."""
        self._voices[name], self._admitted[name] = user, time.monotonic()

    def drives(self, name: str) -> bool:
        """Whether a controller of this name drives an actuator."""
        return name in self.experiment.exchange.lines

    def speaks_for(self, user: str, name: str) -> bool:
        """Whether messages of `user` under `name` count: it has this name, or was admitted under it."""
        return self._voices.get(name, name) == user

    def look(self, timeout: float = 0.0) -> list[Presence]:
        """Processes that joined or left since the last call."""
        changes = self.watch.poll(timeout)
        for who in changes:
            if who.here and who.role == "controller":
                self._admitted.pop(who.name, None)
        return changes

    def awaited(self, name: str, user: str) -> bool:
        """Whether `name` was admitted a moment ago for another user, who may not have announced itself yet."""
        return (
            self._voices.get(name) != user and time.monotonic() - self._admitted.get(name, -_ANNOUNCED_S) < _ANNOUNCED_S
        )

    def floods(self) -> list[str]:
        """Controllers that sent far more commands since the last call than they had steps to answer; a line for each.

        A controller that was delayed answers all waiting steps at once; this backlog is not a flood.
        """
        steps, self._steps = self._step.sent - self._steps, self._step.sent
        ticks, self._ticks = self.asked - self._ticks, self.asked
        found = []
        for topic, count in self.acts.counts.items():
            sent, line = count.received + count.lost, self.experiment.exchange.lines.get(topic[4:])
            before, owed = self._counted.get(topic, (0, 0))
            new = sent - before
            if new > owed + 4 * steps + _TOO_MANY:
                found.append(f"controller {topic[4:]} sent {new} commands for {owed + steps} steps")
            due = ticks // line.period if line is not None else 0
            self._counted[topic] = (sent, max(owed + due - new, 0))
        return found

    def put_step(self) -> None:
        """Send the measurements of this tick to the controllers; a second call at the same tick repeats the step."""
        runner = self.runner
        tick, t_ns, bank = runner.tick, runner.t_ns, runner.bank
        if self.asked != tick:
            self._put_at[tick % _REMEMBERED] = (tick, time.monotonic_ns())
            self.asked = tick
        samples = {i: bank.samples(i) for i in self._heard} if self._heard else None
        self._step.put(encode.step(tick, t_ns, bank.latest, bank.fresh, samples), t_ns)

    def hear(self, sensors: Collection[str]) -> None:
        """From now on include all samples of these sensors in every step. Raises UsageError for an unknown sensor."""
        self._heard = sorted({*self._heard, *self.places(sensors)})

    def places(self, sensors: Collection[str]) -> list[int]:
        """Indices of these sensors in a step. Raises UsageError for an unknown sensor."""
        names = self.runner.bank.names
        if missing := [name for name in sensors if name not in names]:
            raise UsageError(f"there is no sensor {', '.join(missing)}; the sensors are {', '.join(names)}")
        return [names.index(name) for name in sensors]

    def gather(self) -> None:
        """Publish samples and state of this tick, before anything is changed at it."""
        if self.runner.t_ns >= self._full_ns:
            self.collect()
        self.gather_state()

    def collect(self) -> None:
        """Collect the samples that the sensors published since the last call."""
        runner = self.runner
        tick, bank = runner.tick, runner.bank
        for i, samples in enumerate(self._samples):
            new = bank.since(i, samples.next)[: samples.published(runner.t_ns)]
            if len(new) and (block := samples.add(tick, new)) is not None:
                self._meas[i].put(block, runner.t_ns)
        self._full_ns = min((samples.full_ns() for samples in self._samples), default=TIMES_NS)

    def gather_state(self) -> None:
        """Publish the state, if it is due at this tick."""
        runner = self.runner
        if runner.tick % self._state_ticks == 0:
            values = runner.output_values()
            payload = self._encode_state(runner.t_ns, runner.tick, runner.motion.key, values)
            self._state.put(payload, runner.t_ns)

    @property
    def state_due(self) -> int:
        """The first later tick at which the state is published."""
        return (self.runner.tick // self._state_ticks + 1) * self._state_ticks

    def put_applied(self) -> None:
        """Publish the commands that took effect: one message for a piece of several frames, else one for each."""
        frame_ns, now = self.runner.frame_ns, self.runner.t_ns
        for name, line in self.experiment.exchange.all_lines.items():
            if (taken := line.taken()) is None:
                continue
            publisher, (*rows, values), count = self._applied_of(name), taken, len(line.drives)
            if not self.single:
                publisher.put(encode.commands(frame_ns, *taken), now)
                continue
            for i, (tick, answered, status) in enumerate(zip(*rows)):
                one = values[i * count : (i + 1) * count]
                payload = encode.applied(tick, tick * frame_ns, answered, status, one)
                publisher.put(payload, min((tick + 1) * frame_ns, now))

    def carries(self, frames: int) -> None:
        """Set the length of the next piece [frames]."""
        if self.single is not (frames == 1):
            self.put_applied()
            self.single = frames == 1

    def _complete(self) -> None:
        """Add the commands that took effect to a batch that is about to be sent.

        Adding the commands of twenty frames at once takes a fifth of the time of adding them in each frame.
        """
        if self.single:
            self.put_applied()

    def _applied_of(self, name: str) -> Publisher:
        publisher = self._applied.get(name)
        if publisher is None:
            publisher = self._applied[name] = self.session.publisher(f"applied/{name}")
        return publisher

    def put_rest(self) -> None:
        """Send the blocks that are not full, at the end of the run."""
        tick = self.runner.tick
        for publisher, samples in zip(self._meas, self._samples):
            block = samples.block(tick)
            if block is not None:
                publisher.put(block, self.runner.t_ns)

    def put_events(self) -> None:
        """Send the new events of the journal."""
        events = self.experiment.journal.events
        while self._told < len(events):
            event = events[self._told]
            self._told += 1
            self._events.put(messages.event(*event), event.t_ns)

    def put_health(self, **told: Any) -> None:
        """Send a health message with the fields `told`."""
        runner = self.runner
        health = messages.TYPES["Health"](t_ns=runner.t_ns, tick=runner.tick, **told)
        self._health.put(health.SerializeToString(), runner.t_ns)

    def put_totals(self) -> None:
        """Send the numbers of messages sent and received on every topic."""
        self.session.publisher("total/plant").put(self.session.totals(), self.runner.t_ns)

    def serve_scene(self) -> None:
        """Answer queries for the description of the run."""
        self._scene.poll()

    def fold(self) -> None:
        """Add the recorded round trips to their distribution."""
        trips, self._trips = self._trips, []
        self.round_trip.add(np.array(trips, np.int64))

    def unanswered(self, name: str) -> int:
        """Number of steps, since the first one, that a controller has not answered."""
        line, count = self.experiment.exchange.lines[name], self.acts.counts.get(f"act/{name}")
        answers = count.received + count.lost if count is not None else 0
        return self.asked // line.period + 1 - answers

    def lost(self) -> dict[str, int]:
        """Topic -> number of commands that were sent but did not arrive."""
        return {topic: count.lost for topic, count in self.acts.counts.items() if count.lost}


def missing(sent: Mapping[str, int], heard: Any, whole: bool) -> dict[str, int]:
    """Topic -> number of messages that another process did not receive, from its Totals `heard` and from `sent`.

    `whole`: it was subscribed from the first message on, so every message counts; else only gaps are known.
    """
    received = dict(zip(heard.heard_topic, zip(heard.received, heard.lost)))
    found = {}
    for topic, count in sent.items():
        got, gaps = received.get(topic, (0, 0))
        lost = count - got if whole else min(gaps, count)
        if lost > 0:
            found[topic] = lost
    return found
