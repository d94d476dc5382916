"""Reader of recordings, whole or damaged: returns a Run with everything that checksums prove, and reports the rest."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError

from rig.bus import messages
from rig.bus.run_setup import Setup
from rig.errors import BusError
from rig.plants.structures import model_store
from rig.record.message_scan import Record, Scan, head
from rig.record.run import Commands, Integers, Reals, Run, Samples

__all__ = ["Decoder", "Record", "Scan", "head", "open"]

_KEPT = ("truth/", "meas/", "applied/", "event/", "state")
"""Topics that a Run contains."""


class Decoder:
    """A decoder of the messages of a recording. Messages that cannot be decoded are counted in `refused`."""

    def __init__(self, setup: Setup) -> None:
        self.refused: Counter[str] = Counter()
        self._decode = messages.decoder(list(setup.outputs))

    def __call__(self, topic: str, payload: bytes) -> Any:
        """Return the decoded message, or None. Channels derived by the recorder are not messages of the bus."""
        if topic == "plot":
            return payload
        try:
            said = self._decode(topic, payload)
            if said.DESCRIPTOR.name == "Event" and said.data:
                json.loads(said.data)
            elif said.DESCRIPTOR.name == "Applied" and said.ticks:
                messages.commands(said)
            return said
        except (BusError, DecodeError, ValueError):
            self.refused[topic] += 1
            return None

    def told(self) -> str:
        """Return the number of undecodable messages by topic, in words; "" if there are none."""
        counts = ", ".join(f"{count} on {topic}" for topic, count in sorted(self.refused.items()))
        return f"messages that cannot be decoded: {counts}" if counts else ""


def open(path: Path | str) -> Run:
    """Read a recording as a Run; `Run.damage` states what is missing if the file is cut off or damaged.

    Raises rig.errors.LogError for a file that cannot be read or is not a recording of a run.
    """
    scan = Scan(Path(path))
    gathered: dict[str, list[bytes]] = defaultdict(list)
    for record in scan:
        if record.topic.startswith(_KEPT):
            gathered[record.topic].append(record.payload)
    setup = scan.setup()
    for model in setup.models:  # offered to whoever assembles the rig of this run
        model_store.offer(model)
    decode = Decoder(setup)

    def read(topic: str) -> list[Any]:
        return [said for payload in gathered.get(topic, ()) if (said := decode(topic, payload)) is not None]

    time_ns, signals, mode = _truth([topic for topic in gathered if topic.startswith("truth/")], read, setup)
    events = [event for topic in gathered if topic.startswith("event/") for event in _events(topic[6:], read(topic))]
    events.sort(key=_when)
    measurements = {name: _samples(read(f"meas/{name}")) for name in setup.sensors}
    applied = {topic[8:]: read(topic) for topic in gathered if topic.startswith("applied/")}
    summary = _summary(scan.metadata.get("summary", {}), events)
    stopped = summary.pop("fault", "")
    damage = "; ".join(filter(None, (scan.fault, decode.told())))
    return Run(
        scene=setup.scene,
        step_ns=setup.step_ns,
        frame_ns=setup.frame_ns or _frame(applied),
        time=np.multiply(time_ns, 1e-9, dtype=np.float64),
        signals=signals,
        units={**setup.outputs, **{f"meas/{name}": unit for name, (unit, _) in setup.sensors.items()}},
        measurements=measurements,
        commands={name: _commands(said) for name, said in applied.items()},
        events=events,
        energy=summary.pop("energy", {}),
        summary=summary,
        mode=mode,
        controllers=setup.controllers,
        provenance=setup.provenance,
        models=setup.models,
        fault=stopped or damage,
        damage=damage,
        recovered=_recovered(scan),
        untold=_untold(scan),
        sealed=scan.sealed,
    )


def _summary(told: dict[str, str], events: list[dict[str, Any]]) -> dict[str, Any]:
    """The summary of the run; the plant's last events if the recorder was killed or the summary is damaged."""
    try:
        if told:
            return {key: json.loads(text) for key, text in told.items()}
    except ValueError:
        pass
    spoken = (event for event in reversed(events) if (event["source"], event["kind"]) == ("plant", "verdict"))
    return next((dict(event["data"]) for event in spoken), {})


def _recovered(scan: Scan) -> str:
    told = scan.metadata.get("recovered", {})
    return f"recovered from a damaged recording; {told.get('lost') or told['fault']}" if "fault" in told else ""


def _untold(scan: Scan) -> str:
    try:
        names = json.loads(scan.metadata.get("recording", {}).get("untold", "[]"))
    except ValueError:
        names = []
    return f"unknown how many messages of {', '.join(names)} are missing from before a restart" if names else ""


def _frame(applied: dict[str, list[Any]]) -> int:
    """The length of a frame [ns], for a recording without its description."""
    return next((said.t_ns // said.tick for found in applied.values() for said in found if said.tick > 0), 0)


def _when(event: dict[str, Any]) -> int:
    return int(event["t_ns"])


def _samples(blocks: list[Any]) -> Samples:
    times, values = [np.empty(0, np.int64)], [np.empty(0)]
    for block in blocks:
        values.append(np.array(block.v, dtype=np.float64))
        times.append(messages.times(block))
    return Samples(np.concatenate(times), np.concatenate(values))


def _truth(
    topics: list[str], read: Callable[[str], list[Any]], setup: Setup
) -> tuple[Integers, dict[str, Reals], Integers]:
    """Plant outputs at the rate of the steps if recorded so, else at each State message."""
    found = {topic[6:]: _samples(read(topic)) for topic in topics}
    if found:
        time_ns = np.unique(np.concatenate([samples.t_ns for samples in found.values()]))
        signals = {name: np.full(time_ns.size, np.nan) for name in found}  # NaN for lost blocks
        for name, (t_ns, v) in found.items():
            signals[name][np.searchsorted(time_ns, t_ns)] = v
        mode = signals.pop("mode", np.empty(0))
        return time_ns, signals, np.nan_to_num(mode, nan=-1.0).astype(np.int64)
    states = read("state")
    fields = [messages.field_name(name) for name in setup.outputs]
    table = np.array([[getattr(state, f) for f in fields] for state in states], float).reshape(len(states), len(fields))
    time_ns = np.array([state.t_ns for state in states], np.int64)
    mode = np.array([state.mode for state in states], np.int64)
    return time_ns, {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(setup.outputs)}, mode


def _commands(found: list[Any]) -> Commands:
    drives = Counter(len(a.values) // (len(a.ticks) or 1) for a in found).most_common(1)
    width = drives[0][0] if drives else 0
    tick, answered, status, values = list[int](), list[int](), list[int](), list[float]()
    for applied in found:
        rows = messages.commands(applied)
        if len(rows.values) == width * len(rows.tick):  # an unknown sender may send another number of values
            tick += rows.tick
            answered += rows.answered
            status += rows.status
            values += rows.values
    tick_of, answered_of, status_of = np.array([tick, answered, status], np.int64)
    return Commands(tick_of, answered_of, status_of, np.array(values, float).reshape(len(tick), width))


def _events(source: str, found: Iterable[Any]) -> Iterator[dict[str, Any]]:
    """Events of one process: the source is the owner of the topic, whom nobody else can impersonate, whatever a message
    says.
    """
    for event in found:
        told = {name: getattr(event, name) for name in ("t_ns", "tick", "kind", "text")}
        yield {**told, "source": source, "data": json.loads(event.data) if event.data else {}}
