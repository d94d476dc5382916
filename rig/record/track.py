"""Channels of a recording at the frames of a run, for the protocol step `follow` (rig.scenes.protocol).

A value at a frame lies on the straight line between the samples before and after it. Missing samples are bridged by
the same line and named. A channel with more samples than the run has frames is not filtered.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import RigError, UsageError
from rig.printable import counted
from rig.record.reader import open as read
from rig.record.run import Run
from rig.record.run_data import MEASURED, TRUE, Samples, increasing, period, signals, unknown
from rig.units import same_unit

LARGEST = 1 << 21
"""Most values that a step follows. # chosen: every recording of a run contains them"""
_GAP = 1.5  # periods: a longer distance of two samples is a gap


def track(
    path: str,
    channels: Mapping[str, str],
    units: Mapping[str, str],
    begin_ns: int | None,
    end_ns: int | None,
    frame_ns: int,
) -> tuple[bytes, dict[str, Any]]:
    """Return `followed` of the recording in a file. Raises ValueError with all faults."""
    if not Path(path).exists():
        raise ValueError("there is no such file")
    try:
        run = read(Path(path))
    except RigError as fault:
        if Path(path).suffix.lower() == ".mcap":
            raise ValueError(str(fault)) from None
        raise ValueError(f"is no recording; make one of a measurement: rig import {Path(path).name}") from None
    return followed(run, channels, units, begin_ns, end_ns, frame_ns)


def followed(
    run: Run,
    channels: Mapping[str, str],
    units: Mapping[str, str],
    begin_ns: int | None,
    end_ns: int | None,
    frame_ns: int,
) -> tuple[bytes, dict[str, Any]]:
    """Return `content` and `about` of a `rig.scenes.protocol.Track`: actuators follow `channels` (actuator -> channel).

    `units` of the actuators; from `begin_ns` to `end_ns`, by default where all channels have samples. Raises ValueError
    with all faults.
    """
    rows = dict[str, Samples]()
    faults = list[str]()
    for actuator, name in channels.items():
        try:
            rows[actuator] = samples(run, name, units[actuator])
        except UsageError as fault:
            faults.append(str(fault))
    if not faults:
        begin = int(max(row.t_ns[0] for row in rows.values())) if begin_ns is None else begin_ns
        end = int(min(row.t_ns[-1] for row in rows.values())) if end_ns is None else end_ns
        span = f"from {begin * 1e-9:.9g} s to {end * 1e-9:.9g} s"
        for actuator, name in channels.items():
            first, last = rows[actuator].t_ns[[0, -1]] * 1e-9
            if begin < first * 1e9 - 0.5 or end > last * 1e9 + 0.5:
                faults.append(f"{name} has samples from {first:.9g} s to {last:.9g} s, and is to be followed {span}")
        frames = (end - begin) // frame_ns
        if not faults and frames < 1:
            faults.append(f"{span} is less than a frame")
        elif (frames + 1) * len(rows) > LARGEST:
            longest = (LARGEST // len(rows) - 1) * frame_ns * 1e-9
            faults.append(f"{frames * frame_ns * 1e-9:g} s are too long; at most {longest:g} s: state begin and end")
    if faults:
        raise ValueError("; ".join(faults))
    t_ns = begin + np.arange(frames + 1) * frame_ns
    values = np.array([np.interp(t_ns - begin, row.t_ns - begin, row.v) for row in rows.values()])
    about: dict[str, Any] = {"frame_ns": frame_ns, "begin": begin * 1e-9}
    notes = [_bridged(name, rows[actuator], begin, int(t_ns[-1])) for actuator, name in channels.items()]
    if note := "; ".join(filter(None, notes)):
        about["note"] = note
    return np.ascontiguousarray(values, "<f8").tobytes(), about


def samples(run: Run, name: str, unit: str) -> Samples:
    """Return the samples of channel `name` that are there; `truth/NAME` selects an output of a simulated run.

    Raises UsageError for an unknown name, another unit, times that do not increase and less than two samples.
    """
    known = signals(run)
    if name not in known:
        raise unknown(name, known)
    if not same_unit(known[name], unit):
        raise UsageError(f"{name} is in {known[name] or 'an unknown unit'}, not in {unit}")
    plain = name.removeprefix(TRUE).removeprefix(MEASURED)
    whole = run.measurements[plain] if plain == name and name in run.measurements else run.recorded(plain)
    finite = np.isfinite(whole.v)
    present = Samples(whole.t_ns[finite], whole.v[finite])
    if present.t_ns.size < 2:
        raise UsageError(f"{name} has {counted(present.t_ns.size, 'sample')}")
    if not increasing(present.t_ns):
        raise UsageError(f"{name}: its times do not increase")
    return present


def _bridged(name: str, row: Samples, begin: int, end: int) -> str:
    """The gaps of a channel from `begin` to `end` [ns], in words; "" without any."""
    here = row.t_ns[(row.t_ns >= begin) & (row.t_ns <= end)]
    steps = np.diff(here)
    usual = period(here)
    far = np.flatnonzero(steps > _GAP * usual) if usual else np.empty(0, np.int64)
    if not far.size:
        return ""
    longest = int(far[np.argmax(steps[far])])
    return (
        f"{counted(far.size, 'gap')} of {name} bridged by a straight line, the longest takes "
        f"{steps[longest] * 1e-9:.4g} s from {here[longest] * 1e-9:.9g} s on"
    )
