"""Statistics of a part of a run, which do not depend on single samples, and characteristic instants of a film.

After the first opening of a contact of many points the motion is chaotic: two runs that differ by rounding soon differ
sample by sample, and agree in these statistics. Sources: the mean square is that about the mean; bands are octaves
below half the rate, by Parseval's sum over the lines of the discrete Fourier transform.

`characteristic` names instants of the pressure of a film in a run; `first_opening` is the time of the first opening.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rig.record.film_points import Points, grouped
from rig.record.run import Reals, Run, Samples

FRACTION = "contact_fraction"
"""Output of a contact of many points: share of closed points."""
OPENINGS = "openings"
"""Output of a contact of many points: openings so far."""
CENTRE = "pressure_centre_"
"""Begin of the outputs of a contact of many points that are the centre of pressure."""
ACCELERATION = "m/s^2"
SETTLED = 5e-3
"""Time [s] for which all points must be closed before an opening counts as the first. # chosen"""
_BANDS = 5
_STILL = 1e-12  # of its size: below this an output does not move
_LINES = 16  # fewest lines of the transform in a band

_BEFORE = 0.02
"""The map before the first opening precedes it by this share of the time up to it."""


class Statistic(NamedTuple):
    """A number: `kind` is rms, mean, least, range or band, `of` what; `value` in `unit`."""

    kind: str
    of: str
    value: float
    unit: str

    @property
    def name(self) -> str:
        """The name as text."""
        return f"{self.kind} {self.of}"


def first_opening(run: Run) -> float | None:
    """Return the time [s] at which a point opens after all were closed for `SETTLED`; None if none does.

    A slider is set down on an open contact, and its points bounce while the load increases. If the points are never all
    closed for so long, the result is the first time that a point opens. None as well for a rig without such points.
    """
    if OPENINGS not in run.signals or FRACTION not in run.signals:
        return None
    return _first(run.time, run.signals[OPENINGS], run.signals[FRACTION])


def _first(time: Reals, count: Reals, closed: Reals) -> float | None:
    """The first opening; `count`: openings so far, `closed`: share of the points."""
    here = np.isfinite(count) & np.isfinite(closed)
    time = time[here]
    count = count[here]
    closed = closed[here]
    if time.size < 2:
        return None
    opens = np.diff(count) > 0.0
    disturbed = time[1:][opens | (closed[1:] < 1.0)]
    ends = disturbed[np.diff(disturbed, prepend=time[0]) >= SETTLED - 1e-9]
    first = ends if ends.size else time[1:][opens]
    return float(first[0]) if first.size else None


def contact(run: Run) -> str:
    """Return in words what a contact of many points did; "" for a rig without such points."""
    if OPENINGS not in run.signals or FRACTION not in run.signals:
        return ""
    opened = first_opening(run)
    if opened is None:
        return "no point opens" if np.nanmax(run.signals[FRACTION], initial=0.0) > 0.0 else "no point closes"
    closed = run.signals[FRACTION][run.time >= opened]
    closed = closed[np.isfinite(closed)]
    return (
        f"a point opens first at t = {opened:.6g} s; from there on {closed.mean():.1%} of the points are closed on "
        f"average and {closed.min():.1%} at least; the motion is chaotic there: its numbers are statistics"
    )


def whole_signals(run: Run) -> list[str]:
    """Return the plant outputs except those of one contact point among many."""
    return [members[0] for members in grouped(run.signals).values() if len(members) == 1]


def statistics(run: Run, first: float = 0.0, last: float = float("inf")) -> Iterator[Statistic]:
    """Yield the statistics of `run` from `first` to `last` [s]; lost samples are left out."""
    names = [name for name in whole_signals(run) if name != OPENINGS]
    for name in names:
        _, v = _stretch(run.recorded(name), first, last)
        unit = run.units.get(name, "")
        if v.size < 2 or np.ptp(v) <= _STILL * float(np.abs(v).max()):
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
    """Times [s] and values of the samples between two times."""
    t = np.multiply(samples.t_ns, 1e-9, dtype=np.float64)
    here = (t >= first) & (t <= last) & np.isfinite(samples.v)
    return t[here], samples.v[here]


def _bands(name: str, t: Reals, v: Reals, unit: str) -> Iterator[Statistic]:
    """RMS in octaves, the highest first; nothing for samples with a gap between them."""
    step = float(t[-1] - t[0]) / (t.size - 1)
    if np.ptp(np.diff(t)) > 0.5 * step:
        return
    power = 2.0 * np.abs(np.fft.rfft(v - v.mean()) / v.size) ** 2
    f = np.arange(power.size) / (v.size * step)
    high = float(f"{0.5 / step:.6g}")  # times are rounded to nanoseconds
    for _ in range(_BANDS):
        here = (f > 0.5 * high) & (f <= high)
        if np.count_nonzero(here) < _LINES:
            return
        yield Statistic("band", f"{name} {0.5 * high:g}..{high:g} Hz", float(np.sqrt(power[here].sum())), unit)
        high *= 0.5


class Instant(NamedTuple):
    """A sample of a run, and why it was chosen."""

    sample: int
    why: str


def first_open(run: Run) -> int | None:
    """Return the first sample with an open point from the first opening on; None without an opening."""
    return None if FRACTION not in run.signals else _opened(run, first_opening(run), run.signals[FRACTION])


def _opened(run: Run, opened: float | None, closed: Reals) -> int | None:
    begin = int(np.searchsorted(run.time, opened)) if opened is not None else 0
    return None if opened is None else begin + int(np.argmax(closed[begin:] < 1.0))


def characteristic(run: Run, points: Points | None = None) -> list[Instant]:
    """Return the characteristic instants in order of time: around the first opening, at extremes, at the end.

    They are: before the first opening, at it, with the pressure most at either edge of a slider or, without one, with
    the largest pressure at a point, with the fewest points in contact, at the end. Without any opening: four instants
    at equal distances. The moment of the pressure about the slider's middle decides where the pressure is most at an
    edge, so that a single last point with little load does not count. `points`: those of a rig with few contacts, which
    has no output for the share of closed points.
    """
    count = run.time.size
    pressed = {name: run.output(name) for name in points.names} if points is not None else {}
    if FRACTION in run.signals or not pressed:
        opening = first_open(run)
        closed = run.signals.get(FRACTION)
    else:
        open_now = np.stack([force <= 0.0 for force in pressed.values()], axis=1)
        closed = np.where(np.isnan(np.sum(list(pressed.values()), axis=0)), np.nan, 1.0 - open_now.mean(axis=1))
        opens = np.cumsum(np.diff(open_now.astype(int), axis=0, prepend=open_now[:1]) > 0, axis=0).sum(axis=1)
        opening = _opened(run, _first(run.time, opens.astype(np.float64), closed), closed)
    if opening is None or closed is None:
        why = "all in contact" if closed is not None else ""
        return [Instant(i, why) for i in np.linspace(count / 4, count - 1, 4).astype(int).tolist()]
    fraction = np.nan_to_num(closed[opening:], nan=1.0)
    instants = [
        Instant(math.floor((1.0 - _BEFORE) * opening), "before the first opening"),
        Instant(opening, "first opening"),
        Instant(opening + int(fraction.argmin()), "fewest in contact"),
        Instant(count - 1, "at the end"),
    ]
    if f"{CENTRE}x" in run.signals:
        moment = np.nan_to_num((run.output("normal_force") * run.output(f"{CENTRE}x"))[opening:])
        instants.append(Instant(opening + int(moment.argmin()), "most at the rear edge"))
        instants.append(Instant(opening + int(moment.argmax()), "most at the front edge"))
    elif points is not None:
        largest = np.max([surface.maps(pressed).max(axis=1) for surface in points.surfaces], axis=0)
        instants.append(Instant(opening + int(np.nan_to_num(largest[opening:]).argmax()), "largest pressure"))
    return sorted(instants)
