"""Replay of a recording: publishes its messages again and compares the commands of controllers with the recorded ones.

The recorded bytes are published unchanged, those of the plant and those of controllers that do not take part. After
each step, the replay waits for the commands of the controllers that do: at any pace nothing is lost or overtaken, and
a controller that is slower than the pace makes the replay late. A controller joins at the step at which it joined in
the recording, and is replaced where a successor of its name took its place.

The messages of a run, rebuilt from its arrays as plant and controllers publish them frame by frame.

A recording saved from a Run instead of the bus has no steps, no states and no commands as controllers sent them. In one
of a controller in the plant's process, only the first step of each batch of frames went over the bus.

What a recording contains of one controller: its commands, changes of its parameters, when it took part.

The report of a replay: what was published, how far its commands agree with the recorded ones, how late it was.
"""

from __future__ import annotations

import json
import time
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rig import controllers
from rig.bus import encode, impaired_link, messages, port, run_setup, topics
from rig.controllers.blocks.base import Controller, gets_every_sample
from rig.controllers.runtime.skipped import KIND, SkippedSteps
from rig.errors import BusError, LogError
from rig.machine.scheduling import ANY
from rig.printable import counted
from rig.record import curves, reader, recorded_setup
from rig.record.message_scan import Record, Scan
from rig.record.run import Commands, Integers, Run
from rig.scenes.scene import Scene

_SAVED_ONLY = "contact"
"""Kind of event that a run on the bus does not publish: there may be thousands a second."""


@dataclass(frozen=True)
class RebuiltTraffic:
    """An iterable of the messages of `run`."""

    run: Run
    outputs: Sequence[str]
    """The outputs of the plant, in the order of its states."""
    heard: frozenset[str]
    """Sensors of which a controller needs every sample."""
    links: Callable[[], Mapping[str, impaired_link.ImpairedLink]] = dict
    """Makes the impaired links as they were at the start of the run: sensor -> link over which it was heard."""

    def __iter__(self) -> Iterator[Record]:
        run, frame = self.run, self.run.frame_ns
        series = list(run.measurements.values())
        last = max((int(t_ns[-1]) for t_ns, _ in series if t_ns.size), default=-1) // frame
        edges = np.arange(-1, last + 1) * frame  # frame k has the samples published in (t_{k-1}, t_k]
        cuts = [np.searchsorted(t_ns, edges, "right") for t_ns, _ in series]
        over = {
            name: impaired_link.HeardSensor(link) for name, link in self.links().items() if name in run.measurements
        }
        acts = {name: sent(commands) for name, commands in run.commands.items()}
        applied = {name: deque(zip(*(column.tolist() for column in rows))) for name, rows in run.commands.items()}
        events = deque(event for event in run.events if event["kind"] != _SAVED_ONLY)
        states = iter(self._states())
        state = next(states, None)
        first = (
            round(float(run.time[0]) * 1e9) // frame if run.time.size else 0
        )  # above 0 if it was recorded from there
        for tick in range(first, last + 1):
            now = tick * frame
            yield from self._blocks(tick, last, cuts)
            if state is not None and state.t_ns == now:
                yield state
                state = next(states, None)
            while events and events[0]["t_ns"] <= now:
                yield _event(events.popleft())
            yield Record("step", self._step(tick, cuts, over), now, 0, now)
            for name, known in acts.items():
                if tick in known:
                    yield Record(f"act/{name}", encode.act(tick, now, known[tick]), now, 0, now)
            for name, rows in applied.items():
                while rows and rows[0][0] <= tick:
                    yield Record(f"applied/{name}", encode.applied(rows[0][0], now, *rows.popleft()[1:]), now, 0, now)
        yield from map(_event, events)

    def _blocks(self, tick: int, last: int, cuts: list[Integers]) -> Iterator[Record]:
        """The blocks of measurements that are full at this tick."""
        now, frames = tick * self.run.frame_ns, max(topics.BLOCK_NS // self.run.frame_ns, 1)
        if tick % frames == frames - 1 or tick == last:
            for (name, (t_ns, v)), cut in zip(self.run.measurements.items(), cuts):
                low, high = cut[tick - tick % frames], cut[tick + 1]
                if high > low:
                    yield Record(f"meas/{name}", encode.samples(tick, t_ns[low:high], v[low:high]), now, 0, now)

    def _step(self, tick: int, cuts: list[Integers], over: Mapping[str, impaired_link.HeardSensor]) -> bytes:
        series = list(self.run.measurements.items())
        latest, fresh, new = np.full(len(series), np.nan), np.zeros(len(series), np.int64), {}
        for i, ((name, (_, v)), cut) in enumerate(zip(series, cuts)):
            low, high = cut[tick], cut[tick + 1]
            samples = v[low:high]
            if name in over:
                samples = np.array(over[name].tick(tick, samples.tolist()), np.float64)
                latest[i] = over[name].latest
            elif high:
                latest[i] = v[high - 1]
            fresh[i] = len(samples)
            if name in self.heard:
                new[i] = samples
        return encode.step(tick, tick * self.run.frame_ns, latest, fresh, new)

    def _states(self) -> Iterator[Record]:
        """The states at the rate of a run on the bus; none if an output was lost."""
        run, frame = self.run, self.run.frame_ns
        if not all(name in run.signals for name in self.outputs):
            return
        pack, every = encode.StateEncoder(len(self.outputs)), max(-(-topics.STATE_NS // frame), 1) * frame
        time_ns = np.rint(run.time * 1e9).astype(np.int64)
        for i in np.flatnonzero(time_ns % every == 0).tolist():
            now = int(time_ns[i])
            mode = int(run.mode[i]) if run.mode.size else 0
            values = np.array([run.signals[name][i] for name in self.outputs])
            yield Record("state", pack(now, now // frame, mode, values), now, 0, now)


def sent(commands: Commands) -> dict[int, tuple[float, ...]]:
    """Return tick -> command as sent, where known: a clamped command differs from what the controller sent."""
    columns = zip(commands.answered.tolist(), commands.status.tolist(), commands.values.tolist())
    return {tick: tuple(values) for tick, status, values in columns if status == 0}


def _event(event: dict[str, object]) -> Record:
    t_ns = int(event["t_ns"])  # type: ignore[call-overload]
    return Record(f"event/{event['source']}", messages.event(**event), t_ns, 0, t_ns)  # type: ignore[arg-type]


@dataclass
class RecordedController:
    """The recorded messages of the controller `name`.

    `saved`: of a run in one process, whose controllers work from the begin to the end and publish nothing themselves.
    """

    name: str
    saved: bool
    answers: dict[int, tuple[float, ...]] = field(default_factory=dict)
    """Tick -> command as it was sent."""
    skipped: list[dict[str, Any]] = field(default_factory=list)
    """Data of its events about steps that it did not answer."""
    tuned: dict[int, dict[str, Any]] = field(default_factory=dict)
    """Tick after which parameters were changed -> changes."""
    lives: list[list[int]] = field(default_factory=list)
    """First and last tick of each process of this name that answered: one that was killed may have a successor."""
    _here: bool = False
    _number: int = 0

    def note(self, record: Record, content: Any) -> None:
        """Add a message of the recording, if it is about this controller."""
        kind, _, sender = record.topic.partition("/")
        if kind == "event" and sender == "plant" and content.kind == "begin":
            self._here = self.name in _data(content).get("here", ())
        elif kind == "event" and sender == self.name and content.kind == "parameter":
            data = _data(content)
            self._tune(data.get("after_tick"), data.get("set"))
        elif kind == "event" and sender == self.name and content.kind == KIND:
            self.skipped.append(_data(content))
        elif kind == "event" and sender == "plant" and content.kind == "parameter" and self.saved:
            self._note_protocol(content)
        elif kind == "act" and sender == self.name:
            self.answers[content.tick] = tuple(content.values)
            if not self.saved:
                self._live(content.tick, record.seq)

    def _note_protocol(self, content: Any) -> None:
        """Add a change by the protocol."""
        begin, changes = f"controllers.{self.name}.", _data(content).get("set")
        if isinstance(changes, dict):
            mine = {key.removeprefix(begin): value for key, value in changes.items() if key.startswith(begin)}
            if mine:
                self._tune(content.tick - 1, mine)  # it is made before the step of that tick is answered

    def _tune(self, tick: Any, changes: Any) -> None:
        if isinstance(tick, int) and isinstance(changes, dict):  # otherwise time or content is unknown: skip it
            self.tuned.setdefault(tick, {}).update(changes)

    def _live(self, tick: int, number: int) -> None:
        if not self.lives:
            self.lives.append([0 if self._here else tick, tick])
        elif number < self._number:  # a process counts its messages from 0
            self.lives.append([tick, tick])
        self.lives[-1][1], self._number = tick, number

    @property
    def begins(self) -> list[int]:
        """The ticks at which a process of this controller joined, at least one."""
        return [first for first, _ in self.lives] or [0]

    def silent_at(self, tick: int) -> bool:
        """Whether the recording lacks the command that answers this step, although the controller took part."""
        return tick not in self.answers and any(first <= tick <= last for first, last in self.lives)


def _data(event: Any) -> dict[str, Any]:
    data = json.loads(event.data or "{}")
    return data if isinstance(data, dict) else {}


@dataclass(frozen=True)
class Divergence:
    """The first command that differs from the recorded one."""

    topic: str
    tick: int
    time: float
    """s"""
    recorded: tuple[float, ...]
    answered: tuple[float, ...]

    def __str__(self) -> str:
        recorded, answered = (", ".join(map(repr, v)) or "no command" for v in (self.recorded, self.answered))
        return (
            f"{self.topic} differs at tick {self.tick}, t = {self.time:.9g} s: recorded {recorded}; answered {answered}"
        )


@dataclass(frozen=True)
class TimingError:
    """How much later than the clock demands the steps of a replay were published [s]."""

    mean: float
    p50: float
    p99: float
    worst: float

    @classmethod
    def of(cls, late: Sequence[float]) -> TimingError:
        """Return the timing error of steps that were `late` by these times [s]; at least one."""
        p50, p99, worst = np.quantile(late, (0.5, 0.99, 1.0)).tolist()
        return cls(float(np.mean(late)), p50, p99, worst)

    def __str__(self) -> str:
        return ", ".join(
            f"{name} {value:.3g} s" if value >= 1.0 else f"{name} {1e3 * value:.3g} ms"
            for name, value in vars(self).items()
        )


@dataclass
class Replayed:
    """The result of a replay."""

    messages: int = 0
    """Number of recorded messages that were published."""
    steps: int = 0
    seconds: float = 0.0
    """Simulated time at the end [s]."""
    compared: dict[str, int] = field(default_factory=dict)
    """Number of commands compared with recorded ones, for each controller."""
    unanswered: int = 0
    """Number of recorded commands that no controller sent again."""
    silent: dict[str, int] = field(default_factory=dict)
    """Controller -> number of steps that it answered now, but not in the recording while it took part."""
    unknown_memory: tuple[str, ...] = ()
    """Controllers that worked before the recording began: what they remembered then is unknown."""
    not_finite: tuple[str, ...] = ()
    """First answers of controllers that were not finite, in words: the last command was sent again in their place."""
    divergence: Divergence | None = None
    timing: TimingError | None = None
    """Timing error of the steps; None without a pace."""
    fault: str = ""
    """Why only a part of the recording could be replayed."""

    @property
    def passed(self) -> bool:
        """Whether everything was replayed, and every recorded command was sent again with the same bits."""
        return not (self.divergence or self.unanswered or self.fault)

    def to_json(self) -> dict[str, Any]:
        """The result as plain values for JSON; times in s."""
        return {**asdict(self), "passed": self.passed}

    def text(self) -> str:
        """The result as text."""
        messages, steps = counted(self.messages, "message"), counted(self.steps, "step")
        lines = [f"{messages}, {steps}, {self.seconds:.3f} s of simulated time"]
        if self.timing is not None:
            lines.append(f"timing error of the steps: {self.timing}")
        for name, count in self.compared.items():
            lines.append(
                f"{name}: {counted(count, 'command')} compared"
                if count
                else f"{name}: the recording has no command of {name}, so nothing was compared"
            )
            if name in self.unknown_memory:
                lines.append(f"  {name} ran before the recording began: its state at the beginning is unknown")
            if silent := self.silent.get(name):
                lines.append(
                    f"  {silent} steps have no recorded command of {name}: it did not receive them, or its commands "
                    "were not recorded; a controller with internal state may differ from there on"
                )
        if self.unanswered:
            lines.append(f"{self.unanswered} recorded commands were not answered again")
        lines += self.not_finite
        if self.divergence is not None:
            lines.append(str(self.divergence))
        elif any(self.compared.values()):
            lines.append("no command differs")
        return "\n".join(lines)


PATIENCE_S = 5.0
"""Longest wait for the answer to one step. # chosen"""
_SHOWN_S = 0.1
_SLICE_S = 0.02


class Processes(Protocol):
    """The processes of the controllers that take part."""

    def start(self, name: str) -> None:
        """Start a process of this controller; end the one before it first."""

    def ended(self) -> list[str]:
        """How processes ended that should still run, a sentence each."""


def replay(
    session: port.Session,
    path: Path,
    into: Mapping[str, Controller] | None = None,
    pace: float | None = None,
    wait: float = 10.0,
    progress: Callable[[float], object] = lambda seconds: None,
    *,
    processes: Processes | None = None,
    described: Mapping[str, Any] | None = None,
    initial: Mapping[str, Mapping[str, object]] | None = None,
) -> Replayed:
    """Replay `path` as the hub `session` (`bus.host(scene="replay")`).

    `into`: the controllers that take part, by name: those of the recording, changed ones or others. Each has `wait`
    seconds to join. `pace` is simulated seconds per second of the clock; None is as fast as the controllers answer.
    `described`: descriptions of controllers in place of the recorded ones; `initial`: parameters that a controller is
    asked to change when it has joined. Parameters that were tuned during the run are tuned again at the same tick.

    Raises LogError if the recording has lost the description of its run, BusError if a controller does not join,
    leaves, does not answer a step within 5 s, or refuses a change of its parameters.
    """
    start, into = recorded_setup.head(path), into or {}
    setup = recorded_setup.setup_of(start)
    if not setup.frame_ns:
        raise LogError(f"{path} has lost the description of its run: it can be read, but not replayed")
    saved = start.metadata.get("log", {}).get("made") in ("saved", "measured")
    in_plant = [name for name in into if setup.controllers.get(name, {}).get("section", {}).get("where") == "plant"]
    every, heard = _heard(into.values()), frozenset[str]()
    if saved or in_plant or every:  # needs the code of all controllers
        heard = _heard(map(controllers.restored, filter(None, setup.controllers.values())))
    run = reader.open(path) if saved or in_plant or every - heard else None
    scan, rebuilt = Scan(path), None
    if run is not None:
        links = partial(Scene.from_json(setup.scene).links, "meas") if _impaired(setup.scene) else dict
        rebuilt = RebuiltTraffic(run, list(setup.outputs), heard | every, links)
    recorded = {name: RecordedController(name, saved) for name in into}
    decode = reader.Decoder(setup)
    for record in rebuilt if saved and rebuilt else scan:
        if not curves.derived(record.topic) and (content := decode(record.topic, record.payload)) is not None:
            for recorded_controller in recorded.values():
                recorded_controller.note(record, content)
    if run is not None:
        for name in in_plant:
            recorded[name].answers = sent(run.commands[name]) if name in run.commands else {}
    refused = decode.refused_text()
    traffic = rebuilt or (r for r in scan if not decode.refused or decode(r.topic, r.payload) is not None)
    skipped = {name: controller.skipped for name, controller in recorded.items() if controller.skipped}
    described = {**setup.controllers, **(described or {})}
    shown = replace(setup, run=session.run, core=ANY, controllers=described, skipped=skipped)
    player = _Replay(session, shown, into, recorded, processes, initial or {}, pace, wait, progress)
    result = player.carry_out(traffic)
    result.fault = "; ".join(filter(None, (run.damage,) if run is not None else (scan.fault, refused)))
    return result


def _impaired(scene: str) -> bool:
    """Whether links are made worse on purpose; not known of a scene that is damaged."""
    try:
        return bool(json.loads(scene)["network"])
    except (ValueError, TypeError, KeyError):
        return False


def _heard(known: Iterable[Controller]) -> frozenset[str]:
    """The sensors of which one of these controllers needs every sample."""
    return frozenset(sensor for controller in known if gets_every_sample(controller) for sensor in controller.reads)


class _Replay:
    def __init__(
        self,
        session: port.Session,
        setup: run_setup.Setup,
        into: Mapping[str, Controller],
        recorded: Mapping[str, RecordedController],
        processes: Processes | None,
        initial: Mapping[str, Mapping[str, object]],
        pace: float | None,
        wait: float,
        progress: Callable[[float], object],
    ) -> None:
        self._session, self._into, self._recorded = session, into, recorded
        self._processes, self._initial = processes, initial
        self._pace, self._wait, self._progress = pace, wait, progress
        self._frame_ns = setup.frame_ns
        self._scene = session.serve("scene", lambda body: setup.to_json())
        self._doors = session.serve("cmd/plant", self._admit), session.serve("param/plant", self._fixed)
        self._watch = session.watch("controller/*")
        self._acts: port.Receiver = session.subscribe("act/*")
        self._events = [session.subscribe(f"event/{name}") for name in into]
        self._result = Replayed(compared=dict.fromkeys(into, 0), silent=dict.fromkeys(into, 0))
        self._skipped = {name: SkippedSteps(controller.skipped).unanswered for name, controller in recorded.items()}
        self._begins = {name: list(recorded_controller.begins) for name, recorded_controller in recorded.items()}
        self._changes = {
            name: sorted(recorded_controller.tuned.items()) for name, recorded_controller in recorded.items()
        }
        self._arrivals: Counter[str] = Counter()
        self._starts: Counter[str] = Counter()
        self._open: set[str] = set()
        """Controllers that have not answered the last step yet."""
        self._zero: float | None = None
        """When simulated time 0 is due [s of the monotonic clock]."""
        self._late = array("d")

    def _admit(self, body: dict[str, Any]) -> dict[str, Any]:
        name = body.get("controller")
        if body.get("do") != "admit" or name not in self._into:
            raise BusError(f"a replay does not {body.get('do')} {name or ''}".strip())
        return {}

    def _fixed(self, body: dict[str, Any]) -> dict[str, Any]:
        """The parameters of a plant that is recorded: none."""
        asked = port.param_request(body)
        if keys := [*asked.changes, *asked.keys]:
            taking_part = ", ".join(self._into) or "none: rig live replay LOG --into NAME starts one"
            raise BusError(
                f"{', '.join(dict.fromkeys(keys))}: this run is a replay, and its plant is recorded. Only controllers "
                f"that take part can be tuned: {taking_part}"
            )
        return {"values": {}, "units": {}}

    def carry_out(self, traffic: Iterable[Record]) -> Replayed:
        self._session.announce()
        result, shown, last = self._result, 0.0, -1
        for record in traffic:
            kind, _, name = record.topic.partition("/")
            if curves.derived(record.topic) or kind == "total" or (name in self._into and kind in ("act", "event")):
                continue
            tick = messages.decode("step", record.payload).tick if kind == "step" else -1
            if kind == "step":
                if tick <= last:  # lockstep repeats a step that nobody answered in time
                    continue
                last = tick
                if not result.steps:
                    result.unknown_memory = tuple(name for name in self._into if self._worked_before(name, tick))
                self._prepare(tick)
            timed = topics.of_plant(record.topic)  # others may state any time
            late = self._sleep_until(record.t_ns * 1e-9) if timed else 0.0
            if kind == "step":
                self._late.append(late)
                due = [name for name in self._starts if not record.t_ns % self._into[name].period_ns]
                self._open = {name for name in due if tick not in self._skipped[name]}
            self._session.publisher(record.topic).put(record.payload, record.t_ns)
            result.messages += 1
            if timed:
                result.seconds = max(result.seconds, record.t_ns * 1e-9)
            if kind == "step":
                result.steps += 1
                self._follow(tick)
                if time.monotonic() - shown > _SHOWN_S:
                    shown = time.monotonic()
                    self._progress(result.seconds)
        self._session.publisher("total/plant").put(self._session.totals(), round(result.seconds * 1e9))
        result.not_finite = self._not_finite()
        result.unanswered = sum(
            len(recorded_controller.answers) for recorded_controller in self._recorded.values()
        ) - sum(result.compared.values())
        if self._pace is not None and self._late:
            result.timing = TimingError.of(self._late)
        return result

    def _not_finite(self) -> tuple[str, ...]:
        """What controllers have published about answers that they could not send."""
        lines = list[str]()
        for events in self._events:
            while (message := events.get(0.0)) is not None:
                if message.said.kind == "not finite":
                    lines.append(f"t = {message.said.t_ns * 1e-9:.9g} s: {message.said.text}")
        return tuple(lines)

    def _worked_before(self, name: str, tick: int) -> bool:
        """Whether a controller worked before the first recorded step: it answered the first one that was due."""
        answers = self._recorded[name].answers
        return tick > 0 and bool(answers) and (min(answers) - tick) * self._frame_ns < self._into[name].period_ns

    def _prepare(self, tick: int) -> None:
        """Before a step: start the controllers that joined at it, and change parameters that were changed before it."""
        if joining := [name for name, begins in self._begins.items() if begins and begins[0] <= tick]:
            self._join(joining)
        for name in self._starts:
            changes = self._changes[name]
            while changes and changes[0][0] < tick:
                after, values = changes.pop(0)
                self._tune(name, values, f"that the recording contains after tick {after}")

    def _join(self, names: list[str]) -> None:
        begun = time.monotonic()
        for name in names:
            self._begins[name].pop(0)
            self._starts[name] += 1
            if self._processes is not None:
                self._processes.start(name)
        while missing := [name for name in names if self._arrivals[name] < self._starts[name]]:
            if (self._processes is not None and self._processes.ended()) or time.monotonic() > begun + self._wait:
                raise BusError(
                    f"{', '.join(missing)} did not join the replay {self._session.run} within {self._wait:g} s"
                )
            self._serve(_SLICE_S)
        for name in names:
            if self._initial.get(name):
                self._tune(name, self._initial[name], "of -p")
        if self._zero is not None:
            self._zero += time.monotonic() - begun  # starting a process is no part of the replay

    def _tune(self, name: str, values: Mapping[str, object], which: str) -> None:
        try:
            self._session.ask(f"param/{name}", {"set": dict(values)}, PATIENCE_S)
        except BusError as fault:
            changes = ", ".join(f"{key} = {value}" for key, value in values.items())
            raise BusError(f"{name} did not make the change {which} ({changes}): {fault}") from None

    def _serve(self, timeout: float = 0.0) -> None:
        """Answer queries, and note who joins; wait at most `timeout` [s] for somebody to join or leave."""
        self._scene.poll()
        for door in self._doors:
            door.poll()
        for presence in self._watch.poll(timeout):
            self._arrivals[presence.name] += presence.here

    def _follow(self, tick: int) -> None:
        """After a step: wait until all controllers that it falls due for have answered."""
        self._serve()
        begun = time.monotonic()
        while self._open:
            self._take(tick, _SLICE_S)
            if not self._open:
                return
            self._serve()
            where = f"tick {tick}, t = {tick * self._frame_ns * 1e-9:.9g} s"
            if gone := sorted(name for name in self._open if ("controller", name) not in self._watch.present):
                raise BusError(f"{', '.join(gone)} left at {where}, without an answer to its step")
            if time.monotonic() > begun + PATIENCE_S:
                raise BusError(
                    f"{', '.join(sorted(self._open))} did not answer the step of {where} within {PATIENCE_S:g} s: "
                    "it hangs, or one update takes longer"
                )

    def _sleep_until(self, seconds: float) -> float:
        """Wait until a simulated time [s] is due; return how much later it is then [s]."""
        if self._pace is None:
            return 0.0
        if self._zero is None:
            self._zero = time.monotonic() - seconds / self._pace
        while (left := self._zero + seconds / self._pace - time.monotonic()) > 0.0:
            if left > _SLICE_S:
                self._serve(_SLICE_S / 2)
            else:
                time.sleep(left)
        return -left

    def _take(self, tick: int, timeout: float) -> None:
        while self._open and (message := self._acts.get(timeout)) is not None:
            name = message.topic.partition("/")[2]
            if name in self._open and message.said.tick == tick:
                self._open.remove(name)
                self._compare(name, tick, tuple(message.said.values))

    def _compare(self, name: str, tick: int, answered: tuple[float, ...]) -> None:
        result, recorded_controller = self._result, self._recorded[name]
        if tick not in recorded_controller.answers:
            result.silent[name] += recorded_controller.silent_at(tick)
            return
        recorded = recorded_controller.answers[tick]
        result.compared[name] += 1
        if result.divergence is None and np.array(recorded).tobytes() != np.array(answered).tobytes():
            time_s = tick * self._frame_ns * 1e-9
            result.divergence = Divergence(f"act/{name}", tick, time_s, recorded, answered)
