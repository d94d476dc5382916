"""Puts the sensor traffic of a recording on the bus again, and holds a controller's answers against the recorded ones.

The recorded bytes are published as they are. Without a pace, each step waits for the answers that were recorded to
it: the replay goes as fast as the controllers acknowledge. A recording that was saved from a Run, not taken off the
bus, has no steps; they are made again from its measurements.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rig.bus import encode, messages, topics
from rig.bus.port import Receiver, Session
from rig.bus.setup import Setup
from rig.errors import BusError
from rig.record.reader import Record, Scan, head
from rig.record.reader import open as read
from rig.record.run import Run

_PATIENCE_S = 5.0


@dataclass(frozen=True)
class Divergence:
    """The first answer that is not the recorded one."""

    topic: str
    tick: int
    time: float
    """s"""
    recorded: tuple[float, ...]
    answered: tuple[float, ...]

    def __str__(self) -> str:
        recorded, answered = (", ".join(map(repr, values)) for values in (self.recorded, self.answered))
        return (
            f"{self.topic} parts at tick {self.tick}, t = {self.time:.9g} s: recorded {recorded}; answered {answered}"
        )


@dataclass
class Replayed:
    """What a replay did."""

    messages: int = 0
    steps: int = 0
    seconds: float = 0.0
    """Simulated time."""
    compared: dict[str, int] = field(default_factory=dict)
    """Answers held against recorded ones, for each controller."""
    unanswered: int = 0
    """Recorded answers that did not come again."""
    divergence: Divergence | None = None
    fault: str = ""
    """Why the recording could be replayed only in part."""


def replay(
    session: Session,
    path: Path,
    into: Sequence[str] = (),
    pace: float | None = None,
    wait: float = 10.0,
    progress: Callable[[float], None] = lambda seconds: None,
) -> Replayed:
    """Replay `path` as the hub `session` (`bus.host(scene="replay")`).

    Waits until the controllers `into` have joined. `pace` is simulated seconds for each second of the clock; None goes
    as fast as the controllers answer.
    """
    start = head(path)
    described = replace(start.setup(), run=session.run)
    unknown = [name for name in into if name not in described.controllers]
    if unknown:
        known = ", ".join(described.controllers) or "none"
        raise BusError(f"the recording has no controller {', '.join(unknown)}; it has: {known}")
    traffic: Scan | _Remade = (
        _Remade(read(path)) if start.metadata.get("log", {}).get("made") == "saved" else Scan(path)
    )
    result = _Replay(session, described, _answers(traffic, into), pace, progress).run(traffic, wait)
    result.fault = traffic.fault if isinstance(traffic, Scan) else ""
    return result


Answers = dict[str, dict[int, tuple[float, ...]]]
"""Controller -> tick -> what it commanded."""


def _answers(traffic: Iterable[Record], into: Sequence[str]) -> Answers:
    """The recorded answers of the controllers `into`."""
    found: Answers = {name: {} for name in into}
    for record in traffic:
        first, _, name = record.topic.partition("/")
        if first == "act" and name in found:
            said = messages.decode(record.topic, record.payload)
            found[name][said.tick] = tuple(said.values)
    return found


class _Replay:
    def __init__(
        self,
        session: Session,
        described: Setup,
        recorded: Answers,
        pace: float | None,
        progress: Callable[[float], None],
    ) -> None:
        self._session, self._recorded, self._pace, self._progress = session, recorded, pace, progress
        self._frame_ns = described.frame_ns
        self._scene = session.serve("scene", lambda body: described.to_json())
        self._watch = session.watch("controller/*")
        self._acts: Receiver = session.subscribe("act/*")
        self._result = Replayed(compared=dict.fromkeys(recorded, 0))
        self._open: set[tuple[str, int]] = set()
        """Answers that are due: (controller, tick)."""

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
                self._open |= {(name, tick) for name, answers in self._recorded.items() if tick in answers}
            self._session.publisher(record.topic).put(record.payload, record.t_ns)
            result.messages += 1
            result.seconds = max(result.seconds, record.t_ns * 1e-9)
            if record.topic == "step":
                result.steps += 1
                self._follow(tick)
                if time.monotonic() - told > 0.1:
                    told = time.monotonic()
                    self._progress(result.seconds)
        if self._pace is not None:
            self._sleep_until(time.monotonic() + 0.1)  # the last answers are on their way
        self._session.publisher("total/plant").put(self._session.totals(), round(result.seconds * 1e9))
        result.unanswered = len(self._open)
        return result

    def _gather(self, wait: float) -> None:
        deadline = time.monotonic() + wait
        while missing := [name for name in self._recorded if ("controller", name) not in self._watch.present]:
            if time.monotonic() > deadline:
                raise BusError(f"{', '.join(missing)} did not join the replay {self._session.run} within {wait:g} s")
            self._watch.poll(0.02)
            self._scene.poll()

    def _follow(self, tick: int) -> None:
        """After a step: take the answers; without a pace wait until none is due."""
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

    def _sleep_until(self, instant: float) -> None:
        while (left := instant - time.monotonic()) > 0.0:
            self._scene.poll()
            self._take(min(left, 0.02))

    def _take(self, timeout: float) -> None:
        while (message := self._acts.get(timeout)) is not None:
            timeout = 0.0
            said, name = messages.decode(message.topic, message.payload), message.topic.partition("/")[2]
            if (name, said.tick) in self._open:
                self._open.remove((name, said.tick))
                self._compare(name, said.tick, tuple(said.values))

    def _compare(self, name: str, tick: int, answered: tuple[float, ...]) -> None:
        self._result.compared[name] += 1
        recorded, before = self._recorded[name][tick], self._result.divergence
        if np.array(recorded).tobytes() != np.array(answered).tobytes() and (before is None or tick < before.tick):
            self._result.divergence = Divergence(f"act/{name}", tick, tick * self._frame_ns * 1e-9, recorded, answered)


@dataclass(frozen=True)
class _Remade:
    """Measurements, steps and answers of a saved Run, as plant and controllers published them frame by frame."""

    run: Run

    def __iter__(self) -> Iterator[Record]:
        frame, series = self.run.frame_ns, list(self.run.measurements.items())
        last = max((int(t_ns[-1]) for _, (t_ns, _) in series if t_ns.size), default=-1) // frame
        edges = np.arange(-1, last + 1) * frame  # frame k holds the samples published in (t_{k-1}, t_k]
        cuts = [np.searchsorted(t_ns, edges, "right") for _, (t_ns, _) in series]
        answers = {c.controller: dict(zip(c.answered.tolist(), c.values)) for c in self.run.commands}
        for tick in range(last + 1):
            now = tick * frame
            latest, fresh = np.full(len(series), np.nan), np.zeros(len(series), np.int64)
            for i, ((name, (t_ns, v)), cut) in enumerate(zip(series, cuts)):
                low, high = cut[tick], cut[tick + 1]
                fresh[i] = high - low
                if high:
                    latest[i] = v[high - 1]
                if high > low:
                    dt_ns = int(t_ns[low + 1] - t_ns[low]) if high - low > 1 else 0
                    yield Record(f"meas/{name}", encode.block(tick, int(t_ns[low]), dt_ns, v[low:high]), now, 0, now)
            yield Record("step", encode.step(tick, now, latest, fresh), now, 0, now)
            for name, known in answers.items():
                if tick in known:
                    yield Record(f"act/{name}", encode.act(tick, now, known[tick]), now, 0, now)
