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

from rig.analysis.recorded.density import FEWEST, PARTS, Averaged, Map, peaks, short_time, welch
from rig.analysis.recorded.series import Series, channels, drive, scene_name, vibration
from rig.errors import Faults, UsageError
from rig.printable import counted
from rig.record.run import Reals, Run
from rig.record.run_data import bridge
from rig.results import Table

DRIVE = "drive"
"""The default of `orders`: the speed of the drive, whatever its output is called."""
_OF_ORDERS = 60  # default windows of the map of orders, end to end
_SLOWEST = 0.1  # of the largest speed
_SHARE = 0.4  # of the sampling rate, at the fastest speed
_FINER = 4  # times the rate of the channel
_SURE = 1.25  # Nyquist order over the highest one
_TURNS_IN_WINDOW = 4.0  # least, if the stretch has twice as many: order one must be separated from zero
_MOST = 1 << 24  # interpolated samples
_EDGE = 40  # samples at either end that the band-limited interpolation falsifies
_TURN = 1.0 / (2.0 * math.pi)  # revolutions in a radian
# By unit: its factor, whether it is a speed, and the unit that an order is counted in
_TURNS = {
    "rad": (_TURN, False, "rev"),
    "rad/s": (_TURN, True, "rev"),
    "m": (1.0, False, "m"),
    "m/s": (1.0, True, "m"),
}


@dataclass(frozen=True)
class Orders(Averaged):
    """The result of `orders`, over the angle or length `over`, counted in `per` ("rev" or "m").

    From `start` to `end` [s], where the speed is `slowest` to `fastest` [per/s]; orders up to `highest`; `window` and
    `map_window` [per]. The windows of `map` are placed at their times [s].
    """

    FIGURE: ClassVar = "rig.analysis.recorded.figures:spectrum_figure"
    AXIS: ClassVar = "order"

    over: str
    counted_in: str
    start: float
    end: float
    slowest: float
    fastest: float
    highest: float

    @property
    def per(self) -> str:
        """What an order is counted in."""
        return self.counted_in

    def shown(self) -> Iterator[str | Table]:
        """Yield the settings and the strongest lines."""
        d = self.density
        per = self.per
        speeds = f"{self.slowest:.4g} to {self.fastest:.4g} {per}/s"
        windows = f"{counted(d.windows, 'Hann window')} of {self.window:.4g} {per}"
        yield f"{self.scene}: orders of {self.name} [{self.unit}] over {self.over}, cycles per {per}"
        yield f"  {self.start:.5g} to {self.end:.5g} s, {speeds}; orders up to {self.highest:.4g} 1/{per}"
        yield "  resampled at even steps: band-limited and cubic interpolation, low-pass filter, decimation"
        yield f"  density: mean of {windows}, half overlapping; lines {d.step:.4g} 1/{per} apart"
        yield f"  map: Hann windows of {self.map_window:.4g} {per}"
        yield from self._report()

    def facts(self) -> dict[str, Any]:
        """Return the settings; the density is in `csv`."""
        kept = ("over", "per", "start", "end", "slowest", "fastest", "highest")
        return super().facts() | {name: getattr(self, name) for name in kept}


def orders(run: Run, name: str = "", over: str = DRIVE, first: float = 0.0, last: float = math.inf) -> Orders:
    """Compute orders of channel `name` over `over`: a speed or an angle of `run`, from `first` to `last` [s].

    Raises UsageError with every fault: unknown names, a unit that is neither angle nor speed, a stretch that is too
    short.
    """
    faults = Faults()
    wanted = {"signal": name or vibration, "orders": drive if over in ("", DRIVE) else over}
    known = channels(run, wanted, first, last, faults)
    turn = known.get("orders")
    if turn is not None and turn.unit not in _TURNS:
        faults.found.append(
            f"orders: {turn.name} reads {turn.unit or 'a number'}; an angle or a speed is needed: {', '.join(_TURNS)}"
        )
    faults.raise_found()
    signal = known["signal"]
    turn = known["orders"]
    v, bridged = bridge(signal.v)
    t, place, speed = _turned(turn)
    begin, end = _stretch(signal, v, t, speed)
    per = _TURNS[turn.unit][2]
    evenly, step, times, top = _resampled(signal, v, begin, end, t, place, speed, per)
    speeds = np.abs(np.interp(times, t, speed))
    turns = round(_TURNS_IN_WINDOW / step) if per == "rev" else 0
    half = max(evenly.size // 2, min(evenly.size, FEWEST))
    count = min(max(evenly.size // PARTS, turns, FEWEST), half)
    short = min(max(evenly.size // _OF_ORDERS, turns, FEWEST), half)
    whole = welch(evenly, 1.0 / step, count)
    course = short_time(evenly, 1.0 / step, short, 0.0)
    kept = whole.f <= top
    shown = course.f <= top
    density = whole._replace(f=whole.f[kept], s=whole.s[kept])
    at = np.interp(course.t / step, np.arange(times.size), times)
    return Orders(
        scene_name(run),
        signal.name,
        signal.unit,
        count * step,
        density,
        peaks(density),
        short * step,
        Map(at, course.f[shown], course.s[shown]),
        bridged,
        signal.notes(),
        turn.name,
        per,
        float(times[0]),
        float(times[-1]),
        float(speeds.min()),
        float(speeds.max()),
        top,
    )


def _turned(turn: Series) -> tuple[Reals, Reals, Reals]:
    """Times [s], the angle since the first of them, and its speed, in revolutions or metres."""
    factor, is_speed, _ = _TURNS[turn.unit]
    known = np.isfinite(turn.v)
    t = turn.t[known]
    v = factor * turn.v[known]
    if is_speed:
        steps = 0.5 * (v[1:] + v[:-1]) * np.diff(t)
        return t, np.concatenate(([0.0], np.cumsum(steps))), v
    return t, v - v[0], np.gradient(v, t)


def _stretch(signal: Series, v: Reals, t: Reals, speed: Reals) -> tuple[int, int]:
    """The first sample of the longest usable stretch, and the one after its last. Raises UsageError."""
    at_samples = np.interp(signal.t, t, speed)
    fast = np.abs(at_samples) >= _SLOWEST * np.abs(speed).max(initial=0.0)
    usable = fast & np.isfinite(v) & (at_samples != 0.0)
    sign = np.where(usable, np.sign(at_samples), 0.0)
    changes = np.flatnonzero(np.diff(sign)) + 1
    cuts = np.concatenate(([0], changes, [sign.size]))
    lengths = np.where(sign[cuts[:-1]] != 0.0, np.diff(cuts), 0)
    best = int(np.argmax(lengths))
    if lengths[best] < FEWEST + 2 * _EDGE:
        raise UsageError(
            f"orders: the longest stretch in which {signal.name} has no gap and the speed is at least a tenth of its "
            f"largest has {counted(lengths[best], 'sample')}; at least {FEWEST + 2 * _EDGE} are needed"
        )
    return int(cuts[best]), int(cuts[best + 1])


def _resampled(
    signal: Series, v: Reals, begin: int, end: int, t: Reals, place: Reals, speed: Reals, per: str
) -> tuple[Reals, float, Reals, float]:
    """The signal at even steps of the angle, the step, the times of the samples, and the highest order."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline
    from scipy.signal import resample_poly

    part = v[begin:end]
    mean = float(part.mean())
    edge = _FINER * _EDGE
    fine = resample_poly(part - mean, _FINER, 1)[edge:-edge]
    at = signal.t[begin] + (edge + np.arange(fine.size)) / (_FINER * signal.rate)
    turn = CubicHermiteSpline(t, place, speed)(np.clip(at, t[0], t[-1]))
    turn = turn if turn[-1] > turn[0] else -turn
    rising = np.concatenate(([True], np.diff(turn) > 0.0))
    fine = fine[rising]
    at = at[rising]
    turn = turn[rising]
    speeds = np.abs(np.interp(at, t, speed))
    step = float(speeds.min()) / signal.rate
    count = int((turn[-1] - turn[0]) / step) if step > 0.0 else _MOST + 1
    if count > _MOST:
        raise UsageError(
            f"orders: from {signal.t[begin]:.5g} to {signal.t[end - 1]:.5g} s the analysis needs {count} steps at the "
            f"slowest speed there, {speeds.min():.3g} {per}/s; at most {_MOST}: take a shorter stretch (--from, --to)"
        )
    top = _SHARE * signal.rate / float(speeds.max())
    every = max(int(1.0 / (2.0 * _SURE * top * step)), 1)
    grid = turn[0] + step * np.arange(count)
    times = np.interp(grid, turn, at)
    evenly = resample_poly(CubicSpline(at, fine)(times), 1, every)
    return np.asarray(evenly, np.float64), every * step, times[::every], top
