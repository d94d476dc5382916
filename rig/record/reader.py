"""Reader of recordings, whole or damaged: returns a Run with everything that checksums prove, and reports the rest."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError

from rig.bus import messages, run_setup
from rig.bus.columns import Columns, alike, single
from rig.errors import BusError
from rig.record import curves, recorded_setup, run
from rig.record.message_scan import Scan
from rig.structure import model_store

_KEPT = ("truth/", "meas/", "applied/", "event/", "state", "checkpoint")
"""Topics that a Run contains."""
_LEAST_NS = 100_000_000
"""Simulated time after which each channel of outputs must have been sent."""


class Decoder:
    """A decoder of the messages of a recording. Messages that cannot be decoded are counted in `refused`."""

    def __init__(self, setup: run_setup.Setup) -> None:
        self.refused: Counter[str] = Counter()
        self._outputs = list(setup.outputs)
        self._decode = messages.decoder(self._outputs)

    def __call__(self, topic: str, payload: bytes) -> Any:
        """Return the decoded message, or None. Channels derived by the recorder are not messages of the bus."""
        if curves.derived(topic):
            return payload
        try:
            content = self._decode(topic, payload)
            if content.DESCRIPTOR.name == "Event" and content.data:
                json.loads(content.data)
            elif content.DESCRIPTOR.name == "Applied" and content.ticks:
                messages.commands(content)
            return content
        except (BusError, DecodeError, ValueError):
            self.refused[topic] += 1
            return None

    def columns(self, topic: str, payloads: Iterable[bytes]) -> Iterator[Columns]:
        """Yield the columns of messages without text, in order; messages in a row with the same layout together."""
        for _, row in groupby(payloads, len):
            together = list(row)
            decoded = alike(messages.kind(topic, self._outputs), together) if len(together) > 1 else None
            if decoded is not None and _consistent(decoded):
                yield decoded
            else:
                yield from (single(content) for payload in together if (content := self(topic, payload)) is not None)

    def refused_text(self) -> str:
        """Return the number of undecodable messages by topic, in words; "" if there are none."""
        counts = ", ".join(f"{count} on {topic}" for topic, count in sorted(self.refused.items()))
        return f"messages that cannot be decoded: {counts}" if counts else ""


def _consistent(columns: Columns) -> bool:
    """Whether the commands in each Applied have one entry in every column, as `rig.bus.messages.commands` demands."""
    if "ticks" not in columns:
        return True
    count = columns["ticks"].shape[1]
    if not count:
        return True
    if any(columns[name].shape[1] != count for name in ("answers", "statuses")):
        return False
    return bool(columns["values"].shape[1] % count == 0)


def open(path: Path | str) -> run.Run:
    """Read a recording as a Run; `Run.damage` states what is missing if the file is cut off or damaged.

    Raises rig.errors.LogError for a file that cannot be read or is not a recording of a run.
    """
    scan = Scan(Path(path))
    gathered = scan.payloads(_KEPT)
    setup = recorded_setup.setup_of(scan)
    lacking = absent(scan, gathered.keys(), setup)
    for model in setup.models:  # offered to whoever assembles the rig of this run
        model_store.offer(model)
    decode = Decoder(setup)

    def read(topic: str) -> list[Columns]:
        return list(decode.columns(topic, gathered.pop(topic, ())))  # the bytes go: two copies of a long run are large

    made = scan.metadata.get("log", {}).get("made")
    time_ns, signals, mode = _truth([topic for topic in gathered if topic.startswith("truth/")], read, setup)
    events = list[dict[str, Any]]()
    for topic, payloads in gathered.items():
        if topic.startswith("event/"):
            decoded = (decode(topic, payload) for payload in payloads)
            events += _events(topic[6:], decoded)
    events.sort(key=itemgetter("t_ns"))
    measurements = {name: _samples(read(f"meas/{name}")) for name in setup.sensors}
    checkpoints = (decode("checkpoint", payload) for payload in gathered.get("checkpoint", ()))
    applied = {topic[8:]: read(topic) for topic in list(gathered) if topic.startswith("applied/")}
    summary = _summary(scan.metadata.get("summary", {}), events)
    stopped = summary.pop("fault", "")
    recovery = scan.metadata.get("recovered", {})
    lost = recovery.get("lost") or recovery["fault"] if "fault" in recovery else ""
    damage = "; ".join(filter(None, (scan.fault, decode.refused_text(), lacking)))
    return run.Run(
        scene=setup.scene,
        step_ns=setup.step_ns,
        frame_ns=setup.frame_ns or _frame(applied),
        time=np.multiply(time_ns, 1e-9, dtype=np.float64),
        signals=signals,
        units={**setup.outputs, **{f"meas/{name}": unit for name, (unit, _) in setup.sensors.items()}},
        measurements=measurements,
        commands={name: _commands(content) for name, content in applied.items()},
        events=events,
        energy=summary.pop("energy", {}),
        summary=summary,
        mode=mode,
        controllers=setup.controllers,
        provenance=setup.provenance,
        name=setup.run,
        models=setup.models,
        fault=stopped or damage,
        damage=damage,
        recovered=f"recovered from a damaged recording; {lost}" if lost else "",
        began_ns=scan.began_ns,
        untold=_untold(scan),
        on_bus=made == "recorded",
        measured=made == "measured",
        **_window(scan),
        checkpoints={checkpoint.tick: checkpoint.state for checkpoint in checkpoints if checkpoint is not None},
        sealed=scan.sealed,
    )


def absent(scan: Scan, topics: Collection[str], setup: run_setup.Setup) -> str:
    """The channels that the run had and of which no message is in the file, in words; "" if there are none."""
    outputs = [f"truth/{name}" for name in setup.outputs]
    if scan.metadata.get("log", {}).get("made") != "saved" and not any(topic.startswith("truth/") for topic in topics):
        outputs = ["state"] if setup.outputs else []  # a live run sends all outputs in one message
    long_ns = scan.last_ns - _window(scan).get("begin_ns", 0)
    expected = outputs if long_ns > max(setup.frame_ns, _LEAST_NS) else []
    expected += [f"meas/{name}" for name, (_, period_ns) in setup.sensors.items() if 0 < 2 * period_ns < long_ns]
    missing = [topic for topic in expected if topic not in topics]
    return f"no message of {', '.join(missing)} is in it; the other channels can be read" if missing else ""


def _summary(entries: dict[str, str], events: list[dict[str, Any]]) -> dict[str, Any]:
    """The summary of the run; the plant's last events if the recorder was killed or the summary is damaged."""
    try:
        if entries:
            return {key: json.loads(text) for key, text in entries.items()}
    except ValueError:
        pass
    spoken = (event for event in reversed(events) if (event["source"], event["kind"]) == ("plant", "verdict"))
    return next((dict(event["data"]) for event in spoken), {})


def _untold(scan: Scan) -> str:
    try:
        names = json.loads(scan.metadata.get("recording", {}).get("untold", "[]"))
    except ValueError:
        names = []
    return f"unknown how many messages of {', '.join(names)} are missing from before a restart" if names else ""


def _window(scan: Scan) -> dict[str, Any]:
    """The window that a trigger recorded, as fields of a Run."""
    if not (about := scan.metadata.get("trigger")):
        return {}
    return {"window": about.get("text", ""), "begin_ns": round(float(about.get("begin", "0")) * 1e9)}


def _frame(applied: dict[str, list[Columns]]) -> int:
    """The length of a frame [ns], for a recording without its description."""
    for block in (block for blocks in applied.values() for block in blocks):
        for t_ns, tick in zip(block["t_ns"].tolist(), block["tick"].tolist()):
            if tick > 0:
                return int(t_ns // tick)
    return 0


def _samples(blocks: list[Columns]) -> run.Samples:
    times = [np.empty(0, np.int64)]
    values = [np.empty(0)]
    for block in blocks:
        values.append(block["v"].ravel())
        times.append(_times(block).ravel())
    samples = run.Samples(np.concatenate(times), np.concatenate(values))
    rows = _in_order(samples.t_ns)
    return samples if rows is None else run.Samples(samples.t_ns[rows], samples.v[rows])


def _in_order(t_ns: run.Integers) -> run.Integers | None:
    """Rows of `t_ns` in order of time; None if they are. Another program may have sorted the file.

    What is recorded twice stays so: `rig verify` finds it.
    """
    if np.all(np.diff(t_ns) >= 0):
        return None
    return np.argsort(t_ns, kind="stable")


def _times(block: Columns) -> run.Integers:
    """Times [ns] at which the samples of Blocks were published, as `rig.bus.messages.times` says of one."""
    if block["t_ns"].size:
        return block["t_ns"]
    spacing = np.arange(block["v"].shape[1], dtype=np.int64)
    return np.asarray(block["t0_ns"][:, None] + block["dt_ns"][:, None] * spacing)


def _truth(
    topics: list[str], read: Callable[[str], list[Columns]], setup: run_setup.Setup
) -> tuple[run.Integers, dict[str, run.Reals], run.Integers]:
    """Plant outputs at the rate of the steps if recorded so, else at each State message."""
    samples_of = {topic[6:]: _samples(read(topic)) for topic in topics}
    if samples_of:
        time_ns = _common([samples.t_ns for samples in samples_of.values()])
        signals = {name: _placed(samples, time_ns) for name, samples in samples_of.items()}
        mode = signals.pop("mode", np.empty(0))
        return time_ns, signals, np.nan_to_num(mode, nan=-1.0).astype(np.int64)
    states = read("state")
    rows: run.Integers | None = None

    def column(field: str, number: type[np.generic]) -> Any:
        numbers = np.concatenate([np.empty(0, number), *(state[field] for state in states)])
        return numbers if rows is None else numbers[rows]

    rows = _in_order(time_ns := column("t_ns", np.int64))
    signals = {name: column(messages.field_name(name), np.float64) for name in setup.outputs}
    return time_ns if rows is None else time_ns[rows], signals, column("mode", np.int64)


def _common(times: list[run.Integers]) -> run.Integers:
    """All times in order, each once: of outputs without losses the times of any of them."""
    first = times[0]
    if np.all(np.diff(first) > 0) and all(np.array_equal(first, other) for other in times[1:]):
        return first
    return np.unique(np.concatenate(times))


def _placed(samples: run.Samples, time_ns: run.Integers) -> run.Reals:
    """The samples at all times; NaN for lost blocks."""
    if samples.v.size == time_ns.size and np.array_equal(samples.t_ns, time_ns):
        return samples.v
    placed = np.full(time_ns.size, np.nan)
    placed[np.searchsorted(time_ns, samples.t_ns)] = samples.v
    return placed


def _commands(blocks: list[Columns]) -> run.Commands:
    rows = list[run.Commands]()
    widths = Counter[int]()
    for applied in blocks:
        names = ("ticks", "answers", "statuses") if applied["ticks"].size else ("tick", "answered", "status")
        tick, answered, status = (applied[name].ravel() for name in names)
        rows.append(run.Commands(tick, answered, status, applied["values"].reshape(tick.size, -1)))
        widths[rows[-1].values.shape[1]] += len(applied["tick"])
    width = max(widths, key=widths.__getitem__, default=0)
    fitting = [row for row in rows if row.values.shape[1] == width]  # an unknown sender may send other numbers
    none = np.empty(0, np.int64)
    whole = run.Commands(*map(np.concatenate, zip(run.Commands(none, none, none, np.empty((0, width))), *fitting)))
    if np.all(np.diff(whole.tick) >= 0):
        return whole
    order = np.argsort(whole.tick, kind="stable")
    return run.Commands(whole.tick[order], whole.answered[order], whole.status[order], whole.values[order])


def _events(source: str, events: Iterable[Any]) -> Iterator[dict[str, Any]]:
    """Events of one process: the source is the owner of the topic, whom nobody else can impersonate, whatever a message
    says.
    """
    for event in events:
        if event is not None:
            fields = {name: getattr(event, name) for name in ("t_ns", "tick", "kind", "text")}
            data = json.loads(event.data) if event.data else {}
            yield {**fields, "source": source, "data": data if isinstance(data, dict) else {"data": data}}
