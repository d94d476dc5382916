"""The messages of a run, rebuilt from its arrays as plant and controllers publish them frame by frame.

A recording saved from a Run instead of the bus has no steps, no states and no commands as controllers sent them. In one
of a controller in the plant's process, only the first step of each batch of frames went over the bus.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.bus import encode, impaired_link, messages, topics
from rig.record.message_scan import Record
from rig.record.run import Commands, Integers, Run

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
        run = self.run
        frame = self.run.frame_ns
        series = list(run.measurements.values())
        last = max((int(t_ns[-1]) for t_ns, _ in series if t_ns.size), default=-1) // frame
        edges = np.arange(-1, last + 1) * frame  # frame k has the samples published in (t_{k-1}, t_k]
        cuts = [np.searchsorted(t_ns, edges, "right") for t_ns, _ in series]
        over = {
            name: impaired_link.HeardSensor(link) for name, link in self.links().items() if name in run.measurements
        }
        acts = {name: sent(commands) for name, commands in run.commands.items()}
        applied = {name: deque(_rows(commands)) for name, commands in run.commands.items()}
        events = deque(event for event in run.events if event["kind"] != _SAVED_ONLY)
        states = iter(self._states())
        state = next(states, None)
        first = 0
        if run.time.size:  # above 0 if it was recorded from there
            first = round(float(run.time[0]) * 1e9) // frame
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
        now = tick * self.run.frame_ns
        frames = max(topics.BLOCK_NS // self.run.frame_ns, 1)
        if tick % frames == frames - 1 or tick == last:
            for (name, (t_ns, v)), cut in zip(self.run.measurements.items(), cuts):
                low, high = cut[tick - tick % frames], cut[tick + 1]
                if high > low:
                    yield Record(f"meas/{name}", encode.samples(tick, t_ns[low:high], v[low:high]), now, 0, now)

    def _step(self, tick: int, cuts: list[Integers], over: Mapping[str, impaired_link.HeardSensor]) -> bytes:
        series = list(self.run.measurements.items())
        latest = np.full(len(series), np.nan)
        fresh = np.zeros(len(series), np.int64)
        new = {}
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
        run = self.run
        frame = self.run.frame_ns
        if not all(name in run.signals for name in self.outputs):
            return
        pack = encode.StateEncoder(len(self.outputs))
        every = max(-(-topics.STATE_NS // frame), 1) * frame
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


def _rows(commands: Commands) -> Iterator[tuple[Any, ...]]:
    """The commands one by one: tick, answered step, status and values."""
    return zip(*(column.tolist() for column in commands))


def _event(event: dict[str, object]) -> Record:
    t_ns = int(event["t_ns"])  # type: ignore[call-overload]
    return Record(f"event/{event['source']}", messages.event(**event), t_ns, 0, t_ns)  # type: ignore[arg-type]
