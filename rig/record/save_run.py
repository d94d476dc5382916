"""A Run of this process written as a recording: the same file that the recorder would write, with longer blocks."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from rig.bus import encode, messages, run_setup
from rig.record import run_data
from rig.record.writer import Writer

_SLICE_NS = 250_000_000

Stamped = tuple[int, str, bytes]
"""Simulated time, topic, payload."""


def save(run: run_data.RunData, path: Path, name: str = "simulate", replace: bool = True) -> None:
    """Write `run` to `path`. The wall clock is that of a run in real time that began at `run.began_ns`.

    An existing file is overwritten only with `replace`, else OutputError is raised.
    """
    setup = run_setup.Setup(
        run=name,
        scene=run.scene,
        frame_ns=run.frame_ns,
        step_ns=run.step_ns,
        outputs={signal: run.units.get(signal, "") for signal in run.signals},
        sensors={
            sensor: (
                run.units.get(f"meas/{sensor}", ""),
                round(float(np.median(np.diff(t_ns)))) if t_ns.size > 1 else 0,
            )
            for sensor, (t_ns, _) in run.measurements.items()
        },
        controllers=run.controllers or {name: {} for name in run.commands},
        provenance=run.provenance,
        models=run.models,
    )
    writer = Writer(path, setup, "saved", replace)
    try:
        sequence: dict[str, int] = {}
        for stop_ns, stamped in _slices(run):
            for t_ns, topic, payload in stamped:
                seq = sequence[topic] = sequence.get(topic, -1) + 1
                writer.write(topic, payload, t_ns, seq, run.began_ns + t_ns)
            writer.settle(stop_ns)
        writer.close(
            {"messages": writer.messages, "seconds": _end_ns(run) * 1e-9},
            {**run.summary, "energy": run.energy, "fault": run.fault},
        )
    finally:
        writer.abandon()


def _end_ns(run: run_data.RunData) -> int:
    """Simulated time of the last sample or command."""
    ends = [round(float(run.time[-1]) * 1e9)] if run.time.size else []
    ends += [int(t_ns[-1]) for t_ns, _ in run.measurements.values() if t_ns.size]
    ends += [int(commands.tick[-1]) * run.frame_ns for commands in run.commands.values() if commands.tick.size]
    return max(ends, default=0)


def _slices(run: run_data.RunData) -> Iterator[tuple[int, list[Stamped]]]:
    """End of a slice of the run [ns], and all messages in it in order of time."""
    time_ns = np.rint(run.time * 1e9).astype(np.int64)
    series = {f"truth/{name}": (time_ns, v) for name, v in run.signals.items()}
    if run.mode.size:
        series["truth/mode"] = (time_ns, run.mode.astype(np.float64))
    series |= {f"meas/{name}": (t_ns, v) for name, (t_ns, v) in run.measurements.items()}
    end = _end_ns(run)
    events = sorted(run.events, key=lambda event: event["t_ns"])
    done = 0
    for begin in range(0, end + 1, _SLICE_NS):
        stop = begin + _SLICE_NS
        stamped: list[Stamped] = []
        for topic, (t_ns, v) in series.items():
            stamped += _blocks(topic, t_ns, v, run.frame_ns, begin, stop)
        for name, commands in run.commands.items():
            first, last = np.searchsorted(commands.tick * run.frame_ns, (begin, stop))
            for i in range(first, last):
                tick = int(commands.tick[i])
                packed = encode.applied(
                    tick, tick * run.frame_ns, int(commands.answered[i]), int(commands.status[i]), commands.values[i]
                )
                stamped.append((tick * run.frame_ns, f"applied/{name}", packed))
        for tick, state in run.checkpoints.items():
            if begin <= tick * run.frame_ns < stop:
                stamped.append((tick * run.frame_ns, "checkpoint", messages.checkpoint(run.frame_ns, tick, state)))
        while done < len(events) and (events[done]["t_ns"] < stop or stop > end):
            event = events[done]
            stamped.append((int(event["t_ns"]), f"event/{event['source']}", messages.event(**event)))
            done += 1
        yield stop, sorted(stamped, key=lambda message: message[0])


def _blocks(
    topic: str, t_ns: run_data.Integers, v: run_data.Reals, frame_ns: int, begin: int, stop: int
) -> Iterator[Stamped]:
    first, last = np.searchsorted(t_ns, (begin, stop))
    if first == last:
        return
    times, values = t_ns[first:last], np.ascontiguousarray(v[first:last], np.float64)
    gaps = np.diff(times)
    changes = np.abs(np.diff(gaps)) > 1  # more than rounding to whole nanoseconds: a new block begins
    for low, high in pairwise([0, *(np.flatnonzero(changes) + 2), times.size]):
        tick = -(-int(times[high - 1]) // frame_ns)
        yield int(times[low]), topic, encode.samples(tick, times[low:high], values[low:high])
