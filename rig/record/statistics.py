"""Numbers of a stretch of a run that do not hang on single samples, and when its contact opened for the first time.

After a contact of many points has opened the motion is chaotic: two runs that differ by a rounding are soon different
sample by sample, and agree in these. Sources: the mean square is that about the mean; bands are octaves below half the
rate, by Parseval's sum over the lines of the discrete Fourier transform.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rig.record.run import Reals, Run, Samples

FRACTION, OPENINGS, CENTRE = "contact_fraction", "openings", "pressure_centre_"
"""Outputs of a contact of many points: share that is closed, openings so far, where the pressure acts."""
ACCELERATION = "m/s^2"
_BANDS = 5
_LINES = 16  # of the transform, at least, in a band
_CELL = re.compile(r".*_\d+_\d+")


class Statistic(NamedTuple):
    """A number: `kind` is rms, mean, least, range or band, `of` what; `value` in `unit`."""

    kind: str
    of: str
    value: float
    unit: str

    @property
    def name(self) -> str:
        """For a reader."""
        return f"{self.kind} {self.of}"


def first_opening(run: Run) -> float | None:
    """Time [s] at which a point opens after all were closed; None where none does, or the rig has no such points.

    A slider is set down on an open contact, and its points bounce while the load comes on. Where they never are all
    closed, it is the first time that a point opens at all.
    """
    if OPENINGS not in run.signals or FRACTION not in run.signals or not run.time.size:
        return None
    count, closed = run.signals[OPENINGS], run.signals[FRACTION]
    here = np.isfinite(count) & np.isfinite(closed)
    time, count, closed = run.time[here], count[here], closed[here]
    whole = np.flatnonzero(closed == 1.0)
    begin = int(whole[0]) if whole.size else 0
    more = np.flatnonzero(np.diff(count[begin:]) > 0.0)
    return float(time[begin + 1 + int(more[0])]) if more.size else None


def whole_signals(run: Run) -> list[str]:
    """Outputs of the plant without those of one contact point among many (`NAME_I_J`)."""
    return [name for name in run.signals if not _CELL.fullmatch(name)]


def statistics(run: Run, first: float = 0.0, last: float = float("inf")) -> Iterator[Statistic]:
    """The numbers of `run` from `first` to `last` [s]; of samples that were lost nothing is told."""
    names = [name for name in whole_signals(run) if name != OPENINGS]
    for name in names:
        _, v = _stretch(run.recorded(name), first, last)
        unit = run.units.get(name, "")
        if v.size < 2:
            continue
        if name == FRACTION:
            yield Statistic("mean", name, float(v.mean()), unit)
            yield Statistic("least", name, float(v.min()), unit)
        elif name.startswith(CENTRE):
            yield Statistic("range", name, float(np.ptp(v)), unit)
        else:
            yield Statistic("rms", name, float(v.std()), unit)
    for name, samples in run.measurements.items():
        t, v = _stretch(samples, first, last)
        if v.size > 1:
            unit = run.units.get(f"meas/{name}", "")
            yield Statistic("rms", f"meas/{name}", float(v.std()), unit)
            yield from _bands(f"meas/{name}", t, v, unit)


def _stretch(samples: Samples, first: float, last: float) -> tuple[Reals, Reals]:
    """Times [s] and values of what there is between two times."""
    t = np.multiply(samples.t_ns, 1e-9, dtype=np.float64)
    here = (t >= first) & (t <= last) & np.isfinite(samples.v)
    return t[here], samples.v[here]


def _bands(name: str, t: Reals, v: Reals, unit: str) -> Iterator[Statistic]:
    """RMS in octaves, the highest first; none of samples with a gap between them."""
    step = float(t[-1] - t[0]) / (t.size - 1)
    if np.ptp(np.diff(t)) > 0.5 * step:
        return
    power = 2.0 * np.abs(np.fft.rfft(v - v.mean()) / v.size) ** 2
    f = np.arange(power.size) / (v.size * step)
    high = 0.5 / step
    for _ in range(_BANDS):
        here = (f > 0.5 * high) & (f <= high)
        if np.count_nonzero(here) < _LINES:
            return
        yield Statistic("band", f"{name} {0.5 * high:.0f}..{high:.0f} Hz", float(np.sqrt(power[here].sum())), unit)
        high *= 0.5
