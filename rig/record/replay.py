"""Replay of a recording: publishes its measurements again and compares the controllers' commands with the recorded
ones.

The recorded bytes are published unchanged. Without a pace, each step waits for the commands that were recorded for it,
so that the replay is as fast as the controllers. A recording saved from a Run instead of the bus has no step messages;
they are rebuilt from its measurements. The same holds for a controller in the plant's process, for which only the first
message of each batch of frames went over the bus.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rig import controllers
from rig.bus import encode, messages, topics
from rig.bus.port import Receiver, Session
from rig.bus.run_setup import Setup
from rig.controllers.blocks.base import hears
from rig.errors import BusError, LogError
from rig.placement import ANY
from rig.record.reader import Decoder, Record, Scan, head
from rig.record.reader import open as read
from rig.record.run import Commands, Run

_PATIENCE_S = 5.0


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
        recorded, answered = (", ".join(map(repr, values)) for values in (self.recorded, self.answered))
        return (
            f"{self.topic} differs at tick {self.tick}, t = {self.time:.9g} s: recorded {recorded}; answered {answered}"
        )


@dataclass
class Replayed:
    """The result of a replay."""

    messages: int = 0
    steps: int = 0
    seconds: float = 0.0
    """Simulated time."""
    compared: dict[str, int] = field(default_factory=dict)
    """Number of commands compared with recorded ones, for each controller."""
    unanswered: int = 0
    """Number of recorded commands that the controller did not send again."""
    divergence: Divergence | None = None
    fault: str = ""
    """Why only a part of the recording could be replayed."""


def replay(
    session: Session,
    path: Path,
    into: Sequence[str] = (),
    pace: float | None = None,
    wait: float = 10.0,
    progress: Callable[[float], None] = lambda seconds: None,
) -> Replayed:
    """Replay `path` as the hub `session` (`bus.host(scene="replay")`).

    Waits until the controllers `into` have joined; they may be those of the recording or others. `pace` is simulated
    seconds per second of the clock; None is as fast as the controllers answer. Parameters that were tuned during the
    run are tuned again at the same tick.
    """
    start = head(path)
    described = replace(start.setup(), run=session.run, core=ANY)
    if not described.frame_ns:
        raise LogError(f"{path} has lost the description of its run: it can be read, but not replayed")
    lacking = start.metadata.get("log", {}).get("made") == "saved" or (into and _in_plant(described))
    traffic: Scan | _Remade = _Remade(read(path), _heard(described)) if lacking else Scan(path)
    consumers, decode = {name: _Consumer() for name in into}, Decoder(described)
    for record in traffic:
        first, _, name = record.topic.partition("/")
        if (
            (said := decode(record.topic, record.payload)) is not None
            and name in consumers
            and first in ("act", "event")
        ):
            consumers[name].note(said)
    sound = (record for record in traffic if not decode.refused or decode(record.topic, record.payload) is not None)
    refused = decode.told()
    result = _Replay(session, described, consumers, pace, progress).run(sound, wait)
    result.fault = "; ".join(
        filter(None, (traffic.fault if isinstance(traffic, Scan) else traffic.run.damage, refused))
    )
    return result


def _in_plant(described: Setup) -> bool:
    """Whether a controller of the run worked in the plant's process."""
    return any(told.get("section", {}).get("where") == "plant" for told in described.controllers.values())


def _heard(described: Setup) -> frozenset[str]:
    known = [controllers.restored(told) for told in described.controllers.values() if told]
    return frozenset(sensor for one in known if hears(one) for sensor in one.reads)


@dataclass
class _Consumer:
    """The recorded messages of one controller."""

    answers: dict[int, tuple[float, ...]] = field(default_factory=dict)
    """Tick -> command; () if it is unknown."""
    tuned: dict[int, dict[str, Any]] = field(default_factory=dict)
    """Tick after which parameters were changed -> changes."""
    period_ns: int = 0
    """Description of a controller that the recording does not contain, once it asked to join."""

    def note(self, said: Any) -> None:
        """Add an Act or an Event of this controller."""
        if said.DESCRIPTOR.name == "Act":
            self.answers[said.tick] = tuple(said.values)
        elif said.kind == "parameter":
            told = json.loads(said.data or "{}")
            tick, changes = (told.get(key) for key in ("after_tick", "set")) if isinstance(told, dict) else (None, None)
            if isinstance(tick, int) and isinstance(changes, dict):  # otherwise time or content is unknown: skip it
                self.tuned.setdefault(tick, {}).update(changes)

    def answers_to(self, tick: int, t_ns: int) -> bool:
        """Return whether an answer to this step is expected."""
        return t_ns % self.period_ns == 0 if self.period_ns else tick in self.answers


class _Replay:
    def __init__(
        self,
        session: Session,
        described: Setup,
        consumers: dict[str, _Consumer],
        pace: float | None,
        progress: Callable[[float], None],
    ) -> None:
        self._session, self._controllers, self._pace, self._progress = session, consumers, pace, progress
        self._frame_ns = described.frame_ns
        self._scene = session.serve("scene", lambda body: described.to_json())
        self._door = session.serve("cmd/plant", self._admit)
        self._watch = session.watch("controller/*")
        self._acts: Receiver = session.subscribe("act/*")
        self._result = Replayed(compared=dict.fromkeys(consumers, 0))
        self._open: set[tuple[str, int]] = set()
        """Expected answers: (controller, tick)."""
        self._last: dict[str, int] = {}
        """Tick of the last step that each controller must answer."""

    def _admit(self, body: dict[str, Any]) -> dict[str, Any]:
        name = body.get("controller")
        if body.get("do") != "admit" or name not in self._controllers:
            raise BusError(f"a replay does not {body.get('do')} {name or ''}".strip())
        self._controllers[name].period_ns = int(body["period_ns"])
        return {}

    def run(self, traffic: Iterable[Record], wait: float) -> Replayed:
        self._session.announce()
        self._gather(wait)
        result, begun, told = self._result, time.monotonic(), 0.0
        for record in traffic:
            if record.topic.startswith(("plot", "total/")) or topics.of(record.topic).sender != "plant":
                continue
            if self._pace is not None:
                self._sleep_until(begun + record.t_ns * 1e-9 / self._pace)
            if record.topic == "step":
                tick = messages.decode("step", record.payload).tick
                due = [name for name, one in self._controllers.items() if one.answers_to(tick, record.t_ns)]
                self._open |= {(name, tick) for name in due}
                self._last |= dict.fromkeys(due, tick)
            self._session.publisher(record.topic).put(record.payload, record.t_ns)
            result.messages += 1
            result.seconds = max(result.seconds, record.t_ns * 1e-9)
            if record.topic == "step":
                result.steps += 1
                self._follow(tick)
                if time.monotonic() - told > 0.1:
                    told = time.monotonic()
                    self._progress(result.seconds)
        for name in self._controllers:  # the last answers are still on the way
            self._settle(name)
        self._session.publisher("total/plant").put(self._session.totals(), round(result.seconds * 1e9))
        result.unanswered = len(self._open)
        return result

    def _gather(self, wait: float) -> None:
        deadline = time.monotonic() + wait
        while missing := [name for name in self._controllers if ("controller", name) not in self._watch.present]:
            if time.monotonic() > deadline:
                raise BusError(f"{', '.join(missing)} did not join the replay {self._session.run} within {wait:g} s")
            self._watch.poll(0.02)
            self._scene.poll()
            self._door.poll()

    def _follow(self, tick: int) -> None:
        """After a step: receive the answers; without a pace wait until none is outstanding."""
        self._scene.poll()
        self._take(0.0)
        deadline = time.monotonic() + _PATIENCE_S
        while self._pace is None and self._open:
            self._take(0.02)
            self._watch.poll()
            late = sorted({name for name, _ in self._open})
            gone = [name for name in late if ("controller", name) not in self._watch.present]
            if gone or time.monotonic() > deadline:
                raise BusError(f"{', '.join(gone or late)} {'left' if gone else 'did not answer'} at tick {tick}")
        for name, one in self._controllers.items():
            if tick in one.tuned:
                self._settle(name)
                self._session.ask(f"param/{name}", {"set": one.tuned[tick]}, _PATIENCE_S)

    def _settle(self, name: str) -> None:
        """Wait until a controller has received its last step: a change of parameters would overtake waiting steps."""
        deadline = time.monotonic() + _PATIENCE_S
        while (name, self._last.get(name, -1)) in self._open and time.monotonic() < deadline:
            self._take(0.02)
            self._watch.poll()
            if ("controller", name) not in self._watch.present:
                return

    def _sleep_until(self, instant: float) -> None:
        while (left := instant - time.monotonic()) > 0.0:
            self._scene.poll()
            self._take(min(left, 0.02))

    def _take(self, timeout: float) -> None:
        while (message := self._acts.get(timeout)) is not None:
            timeout = 0.0
            said, name = message.said, message.topic.partition("/")[2]
            if (name, said.tick) in self._open:
                self._open.remove((name, said.tick))
                self._compare(name, said.tick, tuple(said.values))

    def _compare(self, name: str, tick: int, answered: tuple[float, ...]) -> None:
        recorded, before = self._controllers[name].answers.get(tick, ()), self._result.divergence
        if not recorded:
            return
        self._result.compared[name] += 1
        if np.array(recorded).tobytes() != np.array(answered).tobytes() and (before is None or tick < before.tick):
            self._result.divergence = Divergence(f"act/{name}", tick, tick * self._frame_ns * 1e-9, recorded, answered)


@dataclass(frozen=True)
class _Remade:
    """Measurements, steps and commands of a saved Run, as plant and controllers published them frame by frame."""

    run: Run
    heard: frozenset[str]
    """Sensors of which a controller needs every sample."""

    def __iter__(self) -> Iterator[Record]:
        frame, series = self.run.frame_ns, list(self.run.measurements.items())
        last = max((int(t_ns[-1]) for _, (t_ns, _) in series if t_ns.size), default=-1) // frame
        places = [i for i, (name, _) in enumerate(series) if name in self.heard]
        edges = np.arange(-1, last + 1) * frame  # frame k has the samples published in (t_{k-1}, t_k]
        cuts = [np.searchsorted(t_ns, edges, "right") for _, (t_ns, _) in series]
        answers = {name: self._answers(commands) for name, commands in self.run.commands.items()}
        for event in self.run.events:
            yield Record(f"event/{event['source']}", messages.event(**event), event["t_ns"], 0, event["t_ns"])
        for tick in range(last + 1):
            now = tick * frame
            latest, fresh = np.full(len(series), np.nan), np.zeros(len(series), np.int64)
            for i, ((name, (t_ns, v)), cut) in enumerate(zip(series, cuts)):
                low, high = cut[tick], cut[tick + 1]
                fresh[i] = high - low
                if high:
                    latest[i] = v[high - 1]
                if high > low:
                    yield Record(f"meas/{name}", encode.samples(tick, t_ns[low:high], v[low:high]), now, 0, now)
            new = {i: series[i][1].v[cuts[i][tick] : cuts[i][tick + 1]] for i in places}
            yield Record("step", encode.step(tick, now, latest, fresh, new), now, 0, now)
            for name, known in answers.items():
                if tick in known:
                    yield Record(f"act/{name}", encode.act(tick, now, known[tick]), now, 0, now)

    @staticmethod
    def _answers(commands: Commands) -> dict[int, tuple[float, ...]]:
        """The commands as sent, where known: a clamped command differs from what the controller sent."""
        columns = zip(commands.answered.tolist(), commands.status.tolist(), commands.values.tolist())
        return {tick: tuple(values) if status == 0 else () for tick, status, values in columns if status != 2}
