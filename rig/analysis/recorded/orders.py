"""Order tracking: the spectrum of a channel over the angle of a disc, or over the travel of a belt.

    order   cycles in a revolution (of a speed in rad/s or an angle), in a metre (of a speed in m/s or a length)

An excitation that is tied to the angle, such as an uneven disc, keeps its order while the speed changes. Method: the
channel is interpolated (band-limited to four times its rate, then by a cubic spline) at even steps of the angle, fine
enough to avoid aliasing at the slowest speed. Then it passes a low-pass filter (Kaiser FIR) and is decimated. The
highest order is the one that stays below 0.4 of the sampling rate at the fastest speed. The analysis uses the longest
stretch of time in which the channel has no gap and the speed keeps its sign and is at least a tenth of its largest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rig.analysis.recorded.series import Series, drive, scene_name, series, squared, vibration
from rig.analysis.recorded.spectrum import (
    FEWEST,
    Density,
    Line,
    Map,
    gaps_told,
    peaks,
    short_time,
    table,
    welch,
)
from rig.errors import UsageError
from rig.printable import counted
from rig.record.run import Reals, Run
from rig.record.run_data import bridge
from rig.results import Result

DRIVE = "drive"
"""The default: the speed of the drive, whatever its output is called."""
_SLOWEST = 0.1  # of the largest speed
_SHARE = 0.4  # of the sampling rate, at the fastest speed
_FINER = 4  # times the rate of the channel
_SURE = 1.25  # Nyquist order over the highest one
_OF_DENSITY, _OF_MAP = 8, 60  # windows in the stretch
_LEAST = 4.0  # revolutions in a window, if the stretch has twice as many: order one must be separated from zero
_MOST = 1 << 24  # interpolated samples
_EDGE = 40  # samples at either end that the band-limited interpolation falsifies
_TURNS = {"rad": (1.0 / (2.0 * math.pi), False, "rev"), "rad/s": (1.0 / (2.0 * math.pi), True, "rev"),
          "m": (1.0, False, "m"), "m/s": (1.0, True, "m")}  # fmt: skip
"""By unit: its factor, whether it is a speed, and the unit that an order is counted in."""


@dataclass(frozen=True)
class Orders(Result):
    """The result of `orders`, over the angle or length `over`, counted in `per` ("rev" or "m").

    From `start` to `end` [s], where the speed is `slowest` to `fastest` [per/s]; orders up to `highest`; `window` and
    `map_window` [per]. The windows of `map` are placed at their times [s].
    """

    FIGURE: ClassVar = "rig.analysis.recorded.figures:orders_figure"

    scene: str
    name: str
    unit: str
    over: str
    per: str
    start: float
    end: float
    slowest: float
    fastest: float
    highest: float
    window: float
    density: Density
    lines: tuple[Line, ...]
    map_window: float
    map: Map
    bridged: int
    gaps: str

    def text(self) -> str:
        """Return the report as text."""
        d, per = self.density, self.per
        lines = [
            f"{self.scene}: orders of {self.name} [{self.unit}] over {self.over}, cycles per {per}",
            f"  {self.start:.5g} to {self.end:.5g} s, {self.slowest:.4g} to {self.fastest:.4g} {per}/s; orders up to "
            f"{self.highest:.4g} 1/{per}",
            "  resampled at even steps: band-limited and cubic interpolation, low-pass filter, decimation",
            f"  density: mean of {counted(d.windows, 'Hann window')} of {self.window:.4g} {per}, half overlapping; "
            f"lines {d.step:.4g} 1/{per} apart",
            f"  map: Hann windows of {self.map_window:.4g} {per}",
            *gaps_told(self.gaps, self.bridged, d.left_out),
            f"  RMS about the mean, over these windows: {d.rms:.5g} {self.unit}",
        ]
        return "\n".join(
            [*lines, "", *table(self.lines, d, f"order 1/{per}", self.unit, f"{squared(self.unit)}*{per}")]
        )

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; the density is in `csv`."""
        return {
            "scene": self.scene,
            "signal": self.name,
            "unit": self.unit,
            "over": self.over,
            "per": self.per,
            "start": self.start,
            "end": self.end,
            "slowest": self.slowest,
            "fastest": self.fastest,
            "highest": self.highest,
            "window": self.window,
            "windows": self.density.windows,
            "step": self.density.step,
            "rms": self.density.rms,
            "samples_bridged": self.bridged,
            "gaps": self.gaps,
            "lines": [line._asdict() for line in self.lines],
        }

    def csv(self) -> Iterator[tuple[str, float, str, float, str]]:
        """Yield rows: axis, place on it, its unit, density there, its unit."""
        for f, s in zip(self.density.f.tolist(), self.density.s.tolist()):
            yield "order", f, f"1/{self.per}", s, f"{squared(self.unit)}*{self.per}"


def orders(run: Run, name: str = "", over: str = DRIVE, first: float = 0.0, last: float = math.inf) -> Orders:
    """Compute orders of channel `name` over `over`: a speed or an angle of `run`, from `first` to `last` [s].

    Raises UsageError with every fault: unknown names, a unit that is neither angle nor speed, a stretch that is too
    short.
    """
    faults: list[str] = []
    found: dict[str, Series] = {}
    for what, given, usual in (("signal", name, vibration), ("orders", "" if over == DRIVE else over, drive)):
        try:
            found[what] = series(run, given or usual(run), first, last)
        except UsageError as error:
            faults.append(f"{what}: {error}")
    turn = found.get("orders")
    if turn is not None and turn.unit not in _TURNS:
        faults.append(f"orders: {turn.name} reads {turn.unit or 'a number'}; an angle or a speed is needed: "
                      f"{', '.join(_TURNS)}")  # fmt: skip
    if faults:
        raise UsageError("\n".join(faults))
    signal = found["signal"]
    v, bridged = bridge(signal.v)
    t, place, speed = _turned(found["orders"])
    begin, end = _stretch(signal, v, t, speed)
    per = _TURNS[found["orders"].unit][2]
    evenly, step, times, top = _resampled(signal, v, begin, end, t, place, speed, per)
    slowest, fastest = (float(pick(np.abs(np.interp(times, t, speed)))) for pick in (np.min, np.max))
    turns = round(_LEAST / step) if per == "rev" else 0
    half = max(evenly.size // 2, min(evenly.size, FEWEST))
    count, short = (min(max(evenly.size // parts, turns, FEWEST), half) for parts in (_OF_DENSITY, _OF_MAP))
    density = _up_to(welch(evenly, 1.0 / step, count), top)
    made = short_time(evenly, 1.0 / step, short, 0.0)
    kept = made.f <= top
    at = np.interp(made.t / step, np.arange(times.size), times)
    return Orders(
        scene_name(run), signal.name, signal.unit, found["orders"].name, per, float(times[0]), float(times[-1]),
        slowest, fastest, top, count * step, density, peaks(density), short * step,
        Map(at, made.f[kept], made.s[kept]), bridged, signal.notes(),
    )  # fmt: skip


def _turned(turn: Series) -> tuple[Reals, Reals, Reals]:
    """Times [s], the angle since the first of them, and its speed, in revolutions or metres."""
    factor, is_speed, _ = _TURNS[turn.unit]
    known = np.isfinite(turn.v)
    t, v = turn.t[known], factor * turn.v[known]
    if is_speed:
        return t, np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)))), v
    return t, v - v[0], np.gradient(v, t)


def _stretch(signal: Series, v: Reals, t: Reals, speed: Reals) -> tuple[int, int]:
    """The first sample of the longest usable stretch, and the one after its last. Raises UsageError."""
    there = np.interp(signal.t, t, speed)
    fast = np.abs(there) >= _SLOWEST * np.abs(speed).max(initial=0.0)
    sign = np.where(fast & np.isfinite(v) & (there != 0.0), np.sign(there), 0.0)
    cuts = np.concatenate(([0], np.flatnonzero(np.diff(sign)) + 1, [sign.size]))
    lengths = np.where(sign[cuts[:-1]] != 0.0, np.diff(cuts), 0)
    best = int(np.argmax(lengths))
    if lengths[best] < FEWEST + 2 * _EDGE:
        raise UsageError(
            f"orders: the longest stretch in which {signal.name} has no gap and the speed is at least a tenth of its "
            f"largest has {lengths[best]} samples; at least {FEWEST + 2 * _EDGE} are needed"
        )
    return int(cuts[best]), int(cuts[best + 1])


def _resampled(
    signal: Series, v: Reals, begin: int, end: int, t: Reals, place: Reals, speed: Reals, per: str
) -> tuple[Reals, float, Reals, float]:
    """The signal at even steps of the angle, the step, the times of the samples, and the highest order."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline
    from scipy.signal import resample_poly

    part, mean = v[begin:end], float(v[begin:end].mean())
    fine = resample_poly(part - mean, _FINER, 1)[_FINER * _EDGE : -_FINER * _EDGE]
    at = signal.t[begin] + (_FINER * _EDGE + np.arange(fine.size)) / (_FINER * signal.rate)
    turn = CubicHermiteSpline(t, place, speed)(np.clip(at, t[0], t[-1]))
    turn = turn if turn[-1] > turn[0] else -turn
    rising = np.concatenate(([True], np.diff(turn) > 0.0))
    fine, at, turn = fine[rising], at[rising], turn[rising]
    there = np.abs(np.interp(at, t, speed))
    step = float(there.min()) / signal.rate
    count = int((turn[-1] - turn[0]) / step) if step > 0.0 else _MOST + 1
    if count > _MOST:
        raise UsageError(
            f"orders: from {signal.t[begin]:.5g} to {signal.t[end - 1]:.5g} s the analysis needs {count} steps at the "
            f"slowest speed there, {there.min():.3g} {per}/s; at most {_MOST}: take a shorter stretch (--from, --to)"
        )
    top = _SHARE * signal.rate / float(there.max())
    every = max(int(1.0 / (2.0 * _SURE * top * step)), 1)
    grid = turn[0] + step * np.arange(count)
    times = np.interp(grid, turn, at)
    evenly = resample_poly(CubicSpline(at, fine)(times), 1, every)
    return np.asarray(evenly, np.float64), every * step, times[::every], top


def _up_to(density: Density, top: float) -> Density:
    kept = density.f <= top
    return Density(density.f[kept], density.s[kept], density.windows, density.left_out)
