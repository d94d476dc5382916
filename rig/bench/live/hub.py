"""The plant's connection to the bus: publishes what happens on a plant runner, and receives commands of controllers.

Samples are sent in blocks (`rig.bench.live.hub`), the state at most 200 times per second of simulated time. Both
wait for the next batch of the session (`rig.bus.messages`), which another thread sends; only the step is sent at once.

The samples of a sensor in blocks, as they are sent on the bus.

A block covers 20 ms; samples of slower sensors are sent one by one. A message for each sample of four sensors at 1 kHz
would cost 0.1 ms of every frame (measured: seven times as many late frames), and the step contains the latest samples
anyway.

Commands of controllers from the bus: whose commands count, how long answers take, and which are missing.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Collection, Mapping
from heapq import heapify, heapreplace
from typing import Any

import numpy as np

from rig.bench.live.timing import Spread
from rig.bench.run.checkpoint import interval
from rig.bench.run.exchange import Exchange
from rig.bench.run.experiment import Experiment
from rig.bench.run.plant_truth import Bands
from rig.bus import encode, messages
from rig.bus.inbound import TIMES_NS
from rig.bus.port import Publisher, Session
from rig.bus.run_setup import Setup
from rig.bus.topics import BLOCK_NS, STATE_NS, Count, Presence, Refused
from rig.errors import UsageError
from rig.printable import counted
from rig.scenes.sections import sensors_in_full
from rig.sensors.chain.bank import Bank
from rig.sensors.chain.instants import Instants

_REMEMBERED = 1 << 10  # steps whose time of sending is known, for the time from step to command. chosen: 1 s
_ACTS = 1 << 10  # most commands that wait, and most that one frame reads
# Time after its admission for which the name of a controller stays reserved until it is present [s]. # chosen
ANNOUNCED_S = 5.0
# Commands between two checks (0.2 s) that count as a flood, beyond four for each step and one for each older step
# without an answer. # chosen
_TOO_MANY = 1000


class AllSamples:
    """The samples of all `instruments`, published in blocks on `session`."""

    def __init__(self, session: Session, instruments: Bank) -> None:
        count = len(instruments.names)
        self._blocks = [
            SampleBlocks(instruments, i, session.publisher(f"meas/{name}"), (i + 1) / count)
            for i, name in enumerate(instruments.names)
        ]
        # Heap of the times at which blocks are full [ns], with their instruments.
        self._full = [(blocks.full_ns(), i) for i, blocks in enumerate(self._blocks)] or [(TIMES_NS, -1)]
        heapify(self._full)

    @property
    def full_ns(self) -> int:
        """Time at which the next block is full [ns]."""
        return self._full[0][0]

    def gather(self, tick: int, t_ns: int) -> None:
        """Publish the blocks that are full at `tick`, which is at `t_ns`."""
        full = self._full
        while full[0][0] <= t_ns:
            i = full[0][1]
            blocks = self._blocks[i]
            blocks.collect(tick, t_ns)
            heapreplace(full, (blocks.full_ns(), i))

    def collect(self, tick: int, t_ns: int) -> None:
        """Collect the samples up to `t_ns`: the instruments are about to drop them."""
        for blocks in self._blocks:
            blocks.collect(tick, t_ns)

    def put_rest(self, tick: int, t_ns: int) -> None:
        """Publish the blocks that are not full, at the end of a run."""
        for blocks in self._blocks:
            blocks.put(tick, t_ns)


class SampleBlocks:
    """The samples of instrument `i`, collected until a block is full, which `publisher` then sends.

    `share`: the length of the first block as a share of the others. With different shares the blocks of many
    instruments are not full in the same frame.
    """

    def __init__(self, instruments: Bank, i: int, publisher: Publisher, share: float = 1.0) -> None:
        self._i = i
        self._memory = instruments.memory
        self._publisher = publisher
        self._instants = instants = instruments.instants[i]
        self._even = instants.even
        self._period_ns = round(instants.period_ns)
        self._whole = max(BLOCK_NS // self._period_ns, 1)
        self._size = max(round(share * self._whole), 1)
        self._kept: list[bytes] = []
        # Numbers of the first sample of the present block, and of the first that is not collected yet.
        self._first = self._next = 0

    def full_ns(self) -> int:
        """Time at which the last sample of the present block is published [ns]."""
        last = self._first + self._size - 1
        return last * self._period_ns if self._even else self._instants.instant(last)

    def collect(self, tick: int, t_ns: int) -> None:
        """Collect the samples that were published up to `t_ns` since the last call; publishes the block if it is full.

        The instruments may have published more: those of later frames.
        """
        end = t_ns // self._period_ns + 1 if self._even else self._instants.count(t_ns)
        if end <= self._next:
            return
        samples = self._memory(self._i, self._next, end - self._next)
        if len(samples):
            self._kept.append(samples.tobytes())
            self._next += len(samples)
            if self._next - self._first >= self._size:
                self.put(tick, t_ns)

    def put(self, tick: int, t_ns: int) -> None:
        """Publish at `t_ns` what has been collected, if anything; another thread encodes it later."""
        if kept := self._kept:
            self._publisher.put_later(t_ns, _encoded, tick, self._instants, self._period_ns, self._first, kept)
            self._kept = []
            self._first = self._next
            self._size = self._whole


def _encoded(tick: int, instants: Instants, period_ns: int, first: int, kept: list[bytes]) -> bytes:
    raw = b"".join(kept)
    times = None if instants.even else instants.at(np.arange(first, first + len(raw) // 8))
    return encode.block(tick, instants.instant(first), period_ns, raw, times)


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
                    self._trips.append((message.arrived_ns or time.monotonic_ns()) - put_at)
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
        trips = self._trips
        self._trips = []
        self.round_trip.add(np.array(trips, np.int64))

    def unanswered(self, name: str) -> int:
        """Number of steps, since the first one, that a controller has not answered."""
        queue = self._exchange.queues[name]
        count = self._accepted.get(f"act/{name}")
        answers = count.received + count.lost if count is not None else 0
        return self.last_step // queue.period + 1 - answers

    def lost(self) -> dict[str, int]:
        """Topic -> number of commands of admitted controllers that were sent but did not arrive."""
        return {topic: count.lost for topic, count in self._accepted.items() if count.lost}


class Hub:
    """Publishes what happens on the plant runner of `experiment`; `commands` receives the commands of controllers.

    `waits`: the plant waits for commands.
    """

    def __init__(self, session: Session, experiment: Experiment, setup: Setup, waits: bool = False) -> None:
        self.session = session
        self.experiment = experiment
        self.runner = experiment.runner
        runner = self.runner
        bank = self.runner.bank
        self._step = session.publisher("step")
        self._heard: list[int] = []
        self.in_plant = experiment.scene.in_plant
        """Controllers that work in the plant process and get no steps over the bus."""
        self.hear(sensors_in_full({n: s for n, s in experiment.scene.controllers.items() if n not in self.in_plant}))
        self._state = session.publisher("state")
        self._encode_state = encode.StateEncoder(len(runner.outputs))
        self._band = session.publisher("band")
        self._state_ticks = max(-(-STATE_NS // runner.frame_ns), 1)
        self._checkpoint = session.publisher("checkpoint")
        self._checkpoint_ticks = interval(runner.frame_ns, runner.step_ns)
        self._events = session.publisher("event/plant")
        self._health = session.publisher("health")
        self._samples = AllSamples(session, bank)
        runner.keep_samples = self.collect
        self.due = 0
        """The first tick at which `gather` has something to publish."""
        # Last tick of `gather`: within a piece of the compiled loop the plant is at it, and the runner not yet.
        self._reached = 0
        session.before_batches(self._complete)
        self.single = True
        """Whether each piece is one frame."""
        self.commands = CommandInbox(session, experiment.exchange, self._step, stamped=not waits)
        self.totals = session.subscribe("total/*", polled=True)
        self.watch = session.watch("*/*")
        text = setup.to_text().encode()
        self._scene = session.serve("scene", lambda _: text)

    def look(self, timeout: float = 0.0) -> list[Presence]:
        """Processes that joined or left since the last call."""
        changes = self.watch.poll(timeout)
        if changes:
            self._show()
        for who in changes:
            if who.here and who.role == "controller":
                self.commands.arrived(who.name)
        return changes

    def _show(self) -> None:
        """Send the extremes of all steps while a viewer is present."""
        watched = any(role == "viewer" for role, _ in self.watch.present)
        runner = self.runner
        if watched is (runner.bands is None):
            later = self._band.put_later
            made = Bands(len(runner.outputs), runner.step_ns, runner.pair, later, runner.frame_ns)
            runner.bands = made if watched else None

    def put_step(self, tick: int) -> None:
        """Send the measurements of `tick`, at which the instruments are, to the controllers.

        A second call at the same tick repeats the step.
        """
        runner = self.runner
        hearing = runner.hearing_at(tick) if runner.meas_links else runner.bank
        t_ns = tick * runner.frame_ns
        samples = {i: hearing.samples(i) for i in self._heard} if self._heard else None
        payload = encode.step(tick, t_ns, hearing.latest, hearing.fresh, samples)
        self.commands.step_sent(tick)  # a round trip begins with the put, as a bare one does
        self._step.put(payload, t_ns)

    def hear(self, sensors: Collection[str]) -> None:
        """From now on include all samples of these sensors in every step. Raises UsageError for an unknown sensor."""
        self._heard = sorted({*self._heard, *self.places(sensors)})

    def places(self, sensors: Collection[str]) -> list[int]:
        """Indices of these sensors in a step. Raises UsageError for an unknown sensor."""
        names = self.runner.bank.names
        if missing := [name for name in sensors if name not in names]:
            raise UsageError(f"there is no sensor {', '.join(missing)}; the sensors are {', '.join(names)}")
        return [names.index(name) for name in sensors]

    def gather(self, tick: int) -> None:
        """Publish the samples and the state that are due at `tick`, at which the plant is, before it is changed."""
        self._reached = tick
        if tick >= self.due:
            frame_ns = self.runner.frame_ns
            self._samples.gather(tick, tick * frame_ns)
            self.gather_state(tick)
            self.due = min(_next(tick, self._state_ticks), -(-self._samples.full_ns // frame_ns))

    def collect(self) -> None:
        """Collect the samples that the sensors published since they were last collected."""
        self._samples.collect(self.runner.tick, self.runner.t_ns)

    def gather_state(self, tick: int) -> None:
        """Publish the state, if it is due at `tick`."""
        runner = self.runner
        if tick % self._state_ticks == 0:
            t_ns = tick * runner.frame_ns
            values = runner.output_values().tobytes()
            if runner.bands is not None:
                runner.bands.put()
            self._state.put_later(t_ns, self._encode_state, t_ns, tick, runner.motion.key, values)
            if tick % self._checkpoint_ticks == 0 and tick and not self.experiment.aborted:
                runner.motion.terms()  # collected sums need no room in the message
                if kept := runner.checkpoint():
                    self._checkpoint.put(messages.checkpoint(runner.frame_ns, tick, kept), t_ns)

    @property
    def state_due(self) -> int:
        """The first later tick at which the state is published."""
        return _next(self.runner.tick, self._state_ticks)

    @property
    def checkpoint_due(self) -> int:
        """The first later tick at which a checkpoint is published."""
        return _next(self.runner.tick, self._checkpoint_ticks)

    def put_applied(self) -> None:
        """Publish the commands that took effect: one message for a piece of several frames, else one for each."""
        frame_ns = self.runner.frame_ns
        now = max(self.runner.tick, self._reached) * frame_ns
        for name, queue in self.experiment.exchange.all_queues.items():
            if (taken := queue.taken()) is None:
                continue
            publisher = self.session.publisher(f"applied/{name}")
            if not self.single:
                publisher.put(encode.commands(frame_ns, *taken), now)
                continue
            times = [min((tick + 1) * frame_ns, now) for tick in taken[0]]
            publisher.put_each(times, encode.each_applied(frame_ns, *taken))

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

    def put_rest(self) -> None:
        """Send the blocks that are not full and the last extremes, at the end of the run."""
        self._samples.put_rest(self.runner.tick, self.runner.t_ns)
        if self.runner.bands is not None:
            self.runner.bands.put()

    def put_events(self) -> None:
        """Send the new events of the journal."""
        if self.experiment.journal.events:
            for event in self.experiment.journal.take():
                self._events.put(messages.event(*event), event.t_ns)

    def put_health(self, **values: Any) -> None:
        """Send a health message with the fields `values`."""
        runner = self.runner
        health = messages.TYPES["Health"](t_ns=runner.t_ns, tick=runner.tick, **values)
        self._health.put(health.SerializeToString(), runner.t_ns)

    def put_totals(self) -> None:
        """Send the numbers of messages sent and received on every topic."""
        self.session.publisher("total/plant").put(self.session.totals(), self.runner.t_ns)

    def serve_scene(self) -> None:
        """Answer queries for the description of the run."""
        self._scene.poll()


def _next(tick: int, ticks: int) -> int:
    """The first multiple of `ticks` after `tick`."""
    return (tick // ticks + 1) * ticks


def missing(sent: Mapping[str, int], heard: Any, whole: bool) -> dict[str, int]:
    """Topic -> number of messages that another process did not receive, from its Totals `heard` and from `sent`.

    `whole`: it was subscribed from the first message on, so every message counts; else only gaps are known.
    """
    received = dict(zip(heard.heard_topic, zip(heard.received, heard.lost)))
    lost_of_topic = {}
    for topic, count in sent.items():
        got, gaps = received.get(topic, (0, 0))
        lost = count - got if whole else min(gaps, count)
        if lost > 0:
            lost_of_topic[topic] = lost
    return lost_of_topic
