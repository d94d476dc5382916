"""A Run of this process written as a recording: the same file that the recorder would write, with longer blocks."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from rig.bus import encode, messages, run_setup
from rig.record import run_data
from rig.record.writer import Writer

_SLICE_NS = 250_000_000  # of the run, whose messages are sorted at once. chosen

Stamped = tuple[int, str, bytes]
"""Simulated time, topic, payload."""


def save(run: run_data.RunData, path: Path, name: str = "simulate", replace: bool = True) -> None:
    """Write `run` to `path`. The wall clock is that of a run in real time that began at `run.began_ns`.

    An existing file is overwritten only with `replace`, else OutputError is raised.
    """
    sensors = {}
    for sensor, (times_ns, _) in run.measurements.items():
        period_ns = round(float(np.median(np.diff(times_ns)))) if times_ns.size > 1 else 0
        sensors[sensor] = (run.units.get(f"meas/{sensor}", ""), period_ns)
    setup = run_setup.Setup(
        run=name,
        scene=run.scene,
        frame_ns=run.frame_ns,
        step_ns=run.step_ns,
        outputs={signal: run.units.get(signal, "") for signal in run.signals},
        sensors=sensors,
        controllers=run.controllers or {controller: {} for controller in run.commands},
        provenance=run.provenance,
        models=run.models,
    )
    writer = Writer(path, setup, "saved", replace)
    try:
        sequence: dict[str, int] = {}
        for stop_ns, stamped in _slices(run):
            for t_ns, topic, payload in stamped:
                sequence[topic] = sequence.get(topic, -1) + 1
                writer.write(topic, payload, t_ns, sequence[topic], run.began_ns + t_ns)
            writer.settle(stop_ns)
        account = {"messages": writer.messages, "seconds": _end_ns(run) * 1e-9}
        writer.close(account, {**run.summary, "energy": run.energy, "fault": run.fault})
    finally:
        writer.abandon()


def _end_ns(run: run_data.RunData) -> int:
    """Simulated time of the last sample or command."""
    ends = list[int]()
    if run.time.size:
        ends.append(round(float(run.time[-1]) * 1e9))
    for t_ns, _ in run.measurements.values():
        if t_ns.size:
            ends.append(int(t_ns[-1]))
    for commands in run.commands.values():
        if commands.tick.size:
            ends.append(int(commands.tick[-1]) * run.frame_ns)
    return max(ends, default=0)


def _slices(run: run_data.RunData) -> Iterator[tuple[int, list[Stamped]]]:
    """End of a slice of the run [ns], and all messages in it in order of time."""
    series = dict(_series(run))
    end = _end_ns(run)
    events = sorted(run.events, key=lambda event: event["t_ns"])
    done = 0
    for begin in range(0, end + 1, _SLICE_NS):
        stop = begin + _SLICE_NS
        stamped: list[Stamped] = []
        for topic, (t_ns, v) in series.items():
            stamped += _blocks(topic, t_ns, v, run.frame_ns, begin, stop)
        for name, commands in run.commands.items():
            stamped += _applied(name, commands, run.frame_ns, begin, stop)
        for tick, state in run.checkpoints.items():
            now = tick * run.frame_ns
            if begin <= now < stop:
                stamped.append((now, "checkpoint", messages.checkpoint(run.frame_ns, tick, state)))
        while done < len(events) and (events[done]["t_ns"] < stop or stop > end):
            event = events[done]
            stamped.append((int(event["t_ns"]), f"event/{event['source']}", messages.event(**event)))
            done += 1
        yield stop, sorted(stamped, key=lambda message: message[0])


def _series(run: run_data.RunData) -> Iterator[tuple[str, tuple[run_data.Integers, run_data.Reals]]]:
    """Topic, times and values of each output and sensor."""
    time_ns = np.rint(run.time * 1e9).astype(np.int64)
    for name, v in run.signals.items():
        yield f"truth/{name}", (time_ns, v)
    if run.mode.size:
        yield "truth/mode", (time_ns, run.mode.astype(np.float64))
    for name, (t_ns, v) in run.measurements.items():
        yield f"meas/{name}", (t_ns, v)


def _applied(name: str, commands: run_data.Commands, frame_ns: int, begin: int, stop: int) -> Iterator[Stamped]:
    """The messages of the commands that took effect from `begin` on and before `stop` [ns]."""
    first, last = np.searchsorted(commands.tick * frame_ns, (begin, stop))
    for i in range(first, last):
        tick = int(commands.tick[i])
        now = tick * frame_ns
        answered = int(commands.answered[i])
        status = int(commands.status[i])
        yield now, f"applied/{name}", encode.applied(tick, now, answered, status, commands.values[i])


def _blocks(
    topic: str, t_ns: run_data.Integers, v: run_data.Reals, frame_ns: int, begin: int, stop: int
) -> Iterator[Stamped]:
    first, last = np.searchsorted(t_ns, (begin, stop))
    if first == last:
        return
    times = t_ns[first:last]
    values = np.ascontiguousarray(v[first:last], np.float64)
    gaps = np.diff(times)
    changes = np.abs(np.diff(gaps)) > 1  # more than rounding to whole nanoseconds: a new block begins
    for low, high in pairwise([0, *(np.flatnonzero(changes) + 2), times.size]):
        tick = -(-int(times[high - 1]) // frame_ns)
        yield int(times[low]), topic, encode.samples(tick, times[low:high], values[low:high])
