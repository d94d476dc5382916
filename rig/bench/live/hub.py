"""The plant's connection to the bus: publishes what happens on a plant runner, and receives commands of controllers.

Samples are sent in blocks (`rig.bench.live.sample_blocks`), the state at most 200 times per second of simulated time.
Both wait for the next batch of the session (`rig.bus.batch`), which another thread sends; only the step is sent at
once.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from rig.bench.live.command_inbox import CommandInbox
from rig.bench.live.sample_blocks import AllSamples
from rig.bench.run.checkpoint import interval
from rig.bench.run.experiment import Experiment
from rig.bench.run.plant_truth import Bands
from rig.bus import encode, messages
from rig.bus.port import Session
from rig.bus.run_setup import Setup
from rig.bus.topics import STATE_NS, Presence
from rig.errors import UsageError
from rig.scenes.sections import sensors_in_full


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
        self._text = setup.to_text().encode()
        self._scene = session.serve("scene", self._described)

    def _described(self, asked: Mapping[str, Any]) -> bytes:
        """The description of the run; who asks from another host takes the seat of its ticket."""
        self.session.seat(self._scene.asker, str(asked.get("holds", "")))
        return self._text

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
