"""Spectrum of one signal of a recording: over frequency, and over orders, with a map of its course.

    S(f): mean over Hann windows, half overlapping, each without its mean (Welch); one-sided, [unit^2/Hz]
    RMS^2 = sum S df        about the mean; of a line: the sum over its main lobe, two lines to each side

A gap of up to four samples is bridged by a straight line. Windows with a longer gap are left out, and counted.

Order tracking: the spectrum over the angle of a disc, or over the travel of a belt.

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
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.hysteresis import slowest
from rig.analysis.recorded.series import Series, channels, drive, scene_name, series, squared, vibration
from rig.errors import Faults, UsageError
from rig.printable import columns, counted
from rig.record.run import Reals, Run
from rig.record.run_data import BRIDGED, bridge
from rig.results import Result, csv_text

FEWEST = 32
"""Samples in a window."""
_OF_DENSITY, _OF_MAP, _OF_ORDERS = 8, 80, 60  # default number of windows: of a density, and of the two maps
_PERIODS = 5.0  # smallest number of periods of the slowest strong vibration in a default window of the spectrogram
_COLUMNS = 1200  # of a spectrogram, at most
_LOBE = 2  # lines to each side of the middle of a Hann window's main lobe
_STANDS_OUT = 10.0  # dB above the minima beside it
_SHOWN, _LEAST = 8, 1e-3  # lines in the report: how many, and RMS of the weakest over that of the signal

DRIVE = "drive"
"""The default of `orders`: the speed of the drive, whatever its output is called."""
_SLOWEST = 0.1  # of the largest speed
_SHARE = 0.4  # of the sampling rate, at the fastest speed
_FINER = 4  # times the rate of the channel
_SURE = 1.25  # Nyquist order over the highest one
_TURNS_IN_WINDOW = 4.0  # least, if the stretch has twice as many: order one must be separated from zero
_MOST = 1 << 24  # interpolated samples
_EDGE = 40  # samples at either end that the band-limited interpolation falsifies
# By unit: its factor, whether it is a speed, and the unit that an order is counted in
_TURNS = {"rad": (1.0 / (2.0 * math.pi), False, "rev"), "rad/s": (1.0 / (2.0 * math.pi), True, "rev"),
          "m": (1.0, False, "m"), "m/s": (1.0, True, "m")}  # fmt: skip


class Line(NamedTuple):
    """A line of a spectrum: `at` [Hz or orders], `rms` in the unit of the channel, `density` at its top."""

    at: float
    rms: float
    density: float


class Density(NamedTuple):
    """Power spectral density `s` at `f`, averaged over `windows`; `left_out` others had gaps."""

    f: Reals
    s: Reals
    windows: int
    left_out: int

    @property
    def step(self) -> float:
        """Distance between lines."""
        return float(self.f[1])

    @property
    def rms(self) -> float:
        """RMS of all lines together, in the unit of the channel."""
        return math.sqrt(float(self.s.sum()) * self.step)


class Map(NamedTuple):
    """Short-time density `s` [f, window] at `f`, of windows about `t` [s]; NaN where a window has a gap."""

    t: Reals
    f: Reals
    s: Reals


@dataclass(frozen=True)
class _Averaged(Result):
    """What a spectrum over frequency and one over orders share: `window` of the density, `map_window` of the map."""

    scene: str
    name: str
    unit: str
    window: float
    density: Density
    lines: tuple[Line, ...]
    map_window: float
    map: Map
    bridged: int
    gaps: str

    AXIS: ClassVar[str]

    @property
    def per(self) -> str:
        """Unit of the windows: "s", or what an order is counted in."""
        return "s"

    @property
    def axis_unit(self) -> str:
        """Unit of the axis."""
        return "Hz" if self.per == "s" else f"1/{self.per}"

    @property
    def density_unit(self) -> str:
        """Unit of the density."""
        return f"{squared(self.unit)}/Hz" if self.per == "s" else f"{squared(self.unit)}*{self.per}"

    def _report(self, head: list[str]) -> str:
        """The report: its `head`, what was lost, and the strongest lines."""
        d, whole = self.density, max(self.density.rms**2, 1e-300)
        lost = [f"  {self.gaps}"] if self.gaps else []
        if self.bridged or d.left_out:
            lost.append(f"  {self.bridged} of them are bridged by lines over gaps of up to {BRIDGED} samples; "
                        f"{d.left_out} windows with longer gaps are left out")  # fmt: skip
        rows = [(f"{line.at:.6g}", f"{line.rms:.4g}", f"{100.0 * line.rms**2 / whole:.3g} %", f"{line.density:.3g}")
                for line in self.lines]  # fmt: skip
        titles = (f"{self.AXIS} {self.axis_unit}", f"RMS {self.unit}", "of the mean square",
                  f"density {self.density_unit}")  # fmt: skip
        none = [f"  no line is {_STANDS_OUT:g} dB above its surroundings and has a millionth of the mean square"]
        table = columns([titles, *rows], ">>>>") if rows else none
        whole_rms = f"  RMS about the mean, over these windows: {d.rms:.5g} {self.unit}"
        return "\n".join([*head, *lost, whole_rms, "", *table])

    def _values(self) -> dict[str, Any]:
        """The fields as JSON values; the density is in `csv`."""
        return {
            "scene": self.scene,
            "signal": self.name,
            "unit": self.unit,
            "window": self.window,
            "windows": self.density.windows,
            "step": self.density.step,
            "rms": self.density.rms,
            "samples_bridged": self.bridged,
            "gaps": self.gaps,
            "lines": [line._asdict() for line in self.lines],
        }

    def rows(self) -> Iterator[tuple[str | float, ...]]:
        """Yield the density: axis, place on it, its unit, density there, its unit."""
        for f, s in zip(self.density.f.tolist(), self.density.s.tolist()):
            yield self.AXIS, f, self.axis_unit, s, self.density_unit

    def csv(self) -> str:
        """Return `rows` as CSV."""
        return csv_text(["axis", "at", "unit", "density", "unit of density"], self.rows())


@dataclass(frozen=True)
class Orders(_Averaged):
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

    def text(self) -> str:
        """Return the report as text."""
        d, per = self.density, self.per
        return self._report([
            f"{self.scene}: orders of {self.name} [{self.unit}] over {self.over}, cycles per {per}",
            f"  {self.start:.5g} to {self.end:.5g} s, {self.slowest:.4g} to {self.fastest:.4g} {per}/s; orders up to "
            f"{self.highest:.4g} 1/{per}",
            "  resampled at even steps: band-limited and cubic interpolation, low-pass filter, decimation",
            f"  density: mean of {counted(d.windows, 'Hann window')} of {self.window:.4g} {per}, half overlapping; "
            f"lines {d.step:.4g} 1/{per} apart",
            f"  map: Hann windows of {self.map_window:.4g} {per}",
        ])  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; the density is in `csv`."""
        kept = ("over", "per", "start", "end", "slowest", "fastest", "highest")
        return self._values() | {name: getattr(self, name) for name in kept}


@dataclass(frozen=True)
class Spectrum(_Averaged):
    """The result of `spectrum`: `window` [s] of the density, `map_window` [s] of the spectrogram; `bridged` samples.

    `orders`: the same over a speed or an angle, if it was asked for.
    """

    FIGURE: ClassVar = "rig.analysis.recorded.figures:spectrum_figure"
    AXIS: ClassVar = "frequency"

    rate: float
    start: float
    seconds: float
    orders: Orders | None = None

    def text(self) -> str:
        """Return the report as text."""
        d = self.density
        report = self._report([
            f"{self.scene}: spectrum of {self.name} [{self.unit}], {self.start:.5g} to "
            f"{self.start + self.seconds:.5g} s at {self.rate:.6g} Hz",
            f"  power spectral density: mean of {counted(d.windows, 'Hann window')} of {self.window:.4g} s, "
            f"half overlapping; lines {d.step:.4g} Hz apart",
            f"  spectrogram: Hann windows of {self.map_window:.4g} s, lines {self.map.f[1]:.4g} Hz apart",
        ])  # fmt: skip
        return f"{report}\n\n{self.orders.text()}" if self.orders else report

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; the density is in `csv`."""
        return self._values() | {
            "rate": self.rate,
            "start": self.start,
            "seconds": self.seconds,
            "windows_left_out": self.density.left_out,
            "orders": self.orders and self.orders.to_json(),
        }

    def rows(self) -> Iterator[tuple[str | float, ...]]:
        """Yield the density, and that over orders."""
        yield from super().rows()
        if self.orders:
            yield from self.orders.rows()


def spectrum(
    run: Run,
    name: str = "",
    window: float | None = None,
    first: float = 0.0,
    last: float = math.inf,
    over: str = "",
) -> Spectrum:
    """Compute the spectrum of signal `name` of `run`, by default a vibration sensor, from `first` to `last` [s].

    `window` [s]: by default an eighth of the recording for the density; for the spectrogram an eightieth, or five
    periods of the slowest strong vibration. `over`: compute the orders over this too, as `orders` does. Raises
    UsageError for an unknown name, and for a window that is too short, too long, or has a gap everywhere.
    """
    faults = Faults()
    signal = faults(lambda: series(run, name or vibration(run), first, last), None)
    count = faults(lambda: length(signal, window), None) if signal else None
    turned = faults(lambda: orders(run, name if signal else "", over, first, last), None) if over else None
    faults.raise_found()
    assert signal is not None
    assert count is not None
    short = count
    if window is None:
        hertz = slowest(signal)
        periods = math.ceil(_PERIODS * signal.rate / hertz) if hertz else 0
        short = min(max(signal.v.size // _OF_MAP, periods, FEWEST), count)
    v, bridged = bridge(signal.v)
    density = welch(v, signal.rate, count)
    if not density.windows:
        raise UsageError(
            f"{signal.name}: every window of {count / signal.rate:.4g} s has gaps; {signal.notes()}. Take a shorter "
            "window or another range of time"
        )
    return Spectrum(
        scene_name(run), signal.name, signal.unit, count / signal.rate, density, peaks(density), short / signal.rate,
        short_time(v, signal.rate, short, signal.start), bridged, signal.notes(), signal.rate, signal.start,
        signal.seconds, turned,
    )  # fmt: skip


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
        faults.found.append(f"orders: {turn.name} reads {turn.unit or 'a number'}; an angle or a speed is needed: "
                      f"{', '.join(_TURNS)}")  # fmt: skip
    faults.raise_found()
    signal, turn = known["signal"], known["orders"]
    v, bridged = bridge(signal.v)
    t, place, speed = _turned(turn)
    begin, end = _stretch(signal, v, t, speed)
    per = _TURNS[turn.unit][2]
    evenly, step, times, top = _resampled(signal, v, begin, end, t, place, speed, per)
    fast = np.abs(np.interp(times, t, speed))
    turns = round(_TURNS_IN_WINDOW / step) if per == "rev" else 0
    half = max(evenly.size // 2, min(evenly.size, FEWEST))
    count, short = (min(max(evenly.size // parts, turns, FEWEST), half) for parts in (_OF_DENSITY, _OF_ORDERS))
    whole, made = welch(evenly, 1.0 / step, count), short_time(evenly, 1.0 / step, short, 0.0)
    kept, shown = whole.f <= top, made.f <= top
    density = whole._replace(f=whole.f[kept], s=whole.s[kept])
    at = np.interp(made.t / step, np.arange(times.size), times)
    return Orders(
        scene_name(run), signal.name, signal.unit, count * step, density, peaks(density), short * step,
        Map(at, made.f[shown], made.s[shown]), bridged, signal.notes(), turn.name, per, float(times[0]),
        float(times[-1]), float(fast.min()), float(fast.max()), top,
    )  # fmt: skip


def length(signal: Series, window: float | None) -> int:
    """Return the samples of a window of `window` [s], or of the default window. Raises UsageError."""
    if signal.v.size < FEWEST:
        raise UsageError(
            f"{signal.name}: {counted(signal.v.size, 'sample')} at {signal.rate:g} Hz; a spectrum needs at least "
            f"{FEWEST}. Take a longer range of time or a faster channel"
        )
    if window is None:
        return max(signal.v.size // _OF_DENSITY, FEWEST)
    if not FEWEST / signal.rate * (1.0 - 1e-9) <= window <= signal.seconds * (1.0 + 1e-9):
        raise UsageError(
            f"window {window:g} s: must be {FEWEST / signal.rate:g} s ({FEWEST} samples of {signal.name} at "
            f"{signal.rate:g} Hz) to {signal.seconds:g} s (the recording)"
        )
    return min(round(window * signal.rate), signal.v.size)


def welch(v: Reals, rate: float, count: int) -> Density:
    """Return the density of `v` (missing samples are NaN) from windows of `count` samples; of no windows where none
    fits.
    """
    from scipy.signal import welch as by_scipy

    hop = count - count // 2
    ok = np.isfinite(v)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ok, [False])))).reshape(-1, 2)
    total, used = np.zeros(count // 2 + 1), 0
    for a, b in edges.tolist():
        if b - a >= count:
            _, s = by_scipy(v[a:b], rate, "hann", count, count // 2, detrend="constant")
            fits = 1 + (b - a - count) // hop
            total, used = total + fits * s, used + fits
    whole = max(1 + (v.size - count) // hop, 0)
    return Density(
        np.asarray(np.fft.rfftfreq(count, 1.0 / rate), np.float64), total / max(used, 1), used, max(whole - used, 0)
    )


def short_time(v: Reals, rate: float, count: int, start: float) -> Map:
    """Return the short-time density of `v` (missing: NaN) from windows of `count` samples; the first sample is at
    `start`.
    """
    from scipy.signal import ShortTimeFFT
    from scipy.signal.windows import hann

    hop = max(count // 4, -(-v.size // _COLUMNS), 1)
    made = ShortTimeFFT(hann(count, sym=False), hop, rate, fft_mode="onesided2X", scale_to="psd")
    p0, p1 = made.lower_border_end[1], max(made.upper_border_begin(v.size)[1], made.lower_border_end[1] + 1)
    s = made.spectrogram(np.nan_to_num(v), detr="constant", p0=p0, p1=p1).astype(np.float32)
    gaps = np.concatenate(([0], np.cumsum(np.isnan(v))))
    begins = np.arange(p0, p1) * hop - made.m_num_mid
    s[:, gaps[np.minimum(begins + count, v.size)] > gaps[begins]] = np.nan
    return Map(start + made.t(v.size, p0, p1), made.f, s)


def peaks(density: Density) -> tuple[Line, ...]:
    """Return the strongest lines of a density, each placed between two lines of the transform by the higher
    neighbour.
    """
    from scipy.signal import find_peaks

    s = density.s
    if s.size < 2 * _LOBE + 2 or not s.any():
        return ()
    level = 10.0 * np.log10(np.maximum(s, 1e-30 * s.max()))
    tops, _ = find_peaks(level, prominence=_STANDS_OUT, distance=2 * _LOBE)
    lines = []
    for top in tops.tolist():
        lobe = slice(max(top - _LOBE, 0), top + _LOBE + 1)
        side = 1 if s[top + 1] > s[top - 1] else -1
        near = math.sqrt(float(s[top + side] / s[top]))
        aside = side * max((2.0 * near - 1.0) / (near + 1.0), 0.0)  # exact for a sine under a Hann window
        rms = math.sqrt(float(s[lobe].sum()) * density.step)
        lines.append(Line(float(density.f[top]) + aside * density.step, rms, float(s[top])))
    strong = [line for line in lines if line.rms > _LEAST * density.rms]
    return tuple(sorted(strong, key=lambda line: -line.rms)[:_SHOWN])


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
            f"largest has {counted(lengths[best], 'sample')}; at least {FEWEST + 2 * _EDGE} are needed"
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
