"""Signals at a lower rate: every n-th sample behind a low-pass filter against aliasing.

The filter is a Kaiser-windowed FIR of odd length, symmetric about its middle, so that its delay is a whole number of
samples and is taken back: a row is at the instant of a recorded sample.

    pass band   0 to 0.4 of the new rate      amplitude within 0.002 %, no phase
    stop band   from 0.5 of the new rate      at least 100 dB below

A lower rate is a whole fraction of the recorded one, so that no instant is interpolated. At both ends, and on both
sides of a gap of more than four samples, the signal is continued by its point reflection about its last sample; the 33
rows next to such an end rest on the continuation in part. Shorter gaps are bridged by a straight line. Rows in longer
gaps, and in a stretch between two of them that is shorter than a new period, are NaN.

Source: J. F. Kaiser, Nonrecursive digital filter design using the I0-sinh window function, IEEE ISCAS (1974) 20-23.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from rig.errors import UsageError
from rig.record.film_points import listed
from rig.record.run_data import (
    BRIDGED,
    MEASURED,
    TRUE,
    Grid,
    Reals,
    Samples,
    bridge,
    grid,
)

if TYPE_CHECKING:
    pass

ATTENUATION = 100.0  # dB
PASSED = 0.4  # of the new rate
STOPPED = 0.5
_FEWEST = 10
"""Rows that must remain: the filter reaches over 66 of them, so that fewer are made of its continuation alone."""
_WHOLE = 1e-6  # of a factor: rates come from times in whole nanoseconds


@dataclass(frozen=True)
class Lowered:
    """Signals by name after decimation; `notes`: what was done to them, in words."""

    signals: Mapping[str, Samples]
    notes: tuple[str, ...] = ()


def lowered(signals: Mapping[str, Samples], rate: float) -> Lowered:
    """Decimate to `rate` [Hz] the signals that were recorded at a higher rate; slower ones stay as they are.

    Raises UsageError with every rate of signals that is no multiple of `rate`, for signals of which fewer than 10 rows
    would remain, and if all signals are slower.
    """
    grids = {name: grid(_plain(name), samples) for name, samples in signals.items() if samples.t_ns.size > 1}
    fastest = max((even.rate for even in grids.values()), default=rate)
    if rate > fastest * (1.0 + _WHOLE):
        raise UsageError(
            f"--rate {rate:.6g} Hz: the highest recorded rate is {fastest:.6g} Hz; take a lower one or leave out --rate"
        )
    exported = dict(signals)
    notes = list[str]()
    faults = list[str]()
    bridged = 0
    for recorded, names in _by_rate(grids).items():
        factor = recorded / rate
        size = min(grids[name].v.size for name in names)
        text = f"{', '.join(listed(dict.fromkeys(map(_plain, names), '')))}: recorded at {recorded:.6g} Hz"
        if factor < 1.0 - _WHOLE:
            notes.append(f"{text}, below --rate; exported as recorded")
        elif abs(factor - round(factor)) > _WHOLE * factor:
            near = " or ".join(f"{recorded / n:.6g} Hz" for n in (math.ceil(factor), math.floor(factor)))
            faults.append(f"--rate {rate:.6g} Hz: {text}; a lower rate is this over a whole number: {near}")
        elif round(factor) > 1 and size < _FEWEST * factor:
            faults.append(
                f"--rate {rate:.6g} Hz: {text} for {size / recorded:.4g} s; at least {_FEWEST} rows must "
                f"remain: take {_FEWEST * recorded / size:.4g} Hz or more"
            )
        elif round(factor) > 1:
            notes.append(
                f"{text}, now at {rate:.6g} Hz behind a low-pass filter: pass band to {PASSED * rate:.6g} Hz, "
                f"{ATTENUATION:g} dB below from {STOPPED * rate:.6g} Hz"
            )
            for name in names:
                v, filled = decimated(grids[name].v, round(factor))
                exported[name] = Samples(grids[name].t_ns[:: round(factor)], v)
                bridged += filled
    if faults:
        raise UsageError("\n".join([*faults, "take another rate, or choose outputs and sensors with --only"]))
    if bridged:
        notes.append(f"{bridged} missing samples in gaps of up to {BRIDGED} were bridged by straight lines beforehand")
    return Lowered(exported, tuple(notes))


def _by_rate(grids: Mapping[str, Grid]) -> dict[float, list[str]]:
    """Names of signals by rate [Hz]; rates that differ by rounding are one."""
    names_by_rate: dict[float, list[str]] = {}
    for name, even in grids.items():
        rate = next((rate for rate in names_by_rate if abs(rate - even.rate) <= _WHOLE * rate), even.rate)
        names_by_rate.setdefault(rate, []).append(name)
    return names_by_rate


def _plain(name: str) -> str:
    return name.removeprefix(MEASURED).removeprefix(TRUE)


@lru_cache(16)
def low_pass(factor: int) -> Reals:
    """Return the impulse response of the filter in front of a decimation by `factor`; its sum is 1."""
    from scipy import signal

    width = 2.0 * (STOPPED - PASSED) / factor  # in units of half of the recorded rate, as scipy counts
    taps, beta = signal.kaiserord(ATTENUATION, width)
    rows = -(-taps // (2 * factor))  # to each side, so that the delay is a whole number of new periods too
    edge = (STOPPED + PASSED) / factor
    return np.asarray(signal.firwin(2 * rows * factor + 1, edge, window=("kaiser", beta)), np.float64)


def decimated(v: Reals, factor: int) -> tuple[Reals, int]:
    """Filter `v` (missing samples are NaN), keep every `factor`-th sample from the first one on.

    Returns the samples, and the number of missing ones that were bridged.
    """
    v, bridged = bridge(v)
    filtered = np.full(-(-v.size // factor), np.nan)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], np.isfinite(v), [False])))).reshape(-1, 2)
    for begin, end in edges.tolist():
        first = -(-begin // factor)
        last = -(-end // factor)
        if end - begin >= factor and last > first:
            filtered[first:last] = _filtered(v[begin:end], factor, first * factor - begin)[: last - first]
    return filtered, bridged


def _filtered(v: Reals, factor: int, first: int) -> Reals:
    """A stretch without gaps, filtered, at its samples `first`, `first + factor`, and so on."""
    from scipy import signal

    taps = low_pass(factor)
    delay = taps.size // 2
    longer = np.pad(v, delay, mode="reflect", reflect_type="odd")
    return np.asarray(signal.upfirdn(taps, longer[first:], 1, factor)[2 * delay // factor :], np.float64)
