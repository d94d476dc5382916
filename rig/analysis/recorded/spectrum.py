"""Power spectral density and spectrogram of one signal of a recording.

    S(f): mean over Hann windows, half overlapping, each without its mean (Welch); one-sided, [unit^2/Hz]
    RMS^2 = sum S df        about the mean; of a line: the sum over its main lobe, two lines to each side

A gap of up to four samples is bridged by a straight line. Windows with a longer gap are left out, and counted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.hysteresis import slowest
from rig.analysis.recorded.series import Series, scene_name, series, squared, vibration
from rig.errors import UsageError
from rig.printable import columns, counted
from rig.record.run import Reals, Run
from rig.record.run_data import BRIDGED, bridge
from rig.results import Result

FEWEST = 32
"""Samples in a window."""
_OF_DENSITY, _OF_MAP = 8, 80  # default number of windows in the recording
_PERIODS = 5.0
"""Smallest number of periods of the slowest strong vibration in a default window of the spectrogram."""
_COLUMNS = 1200  # of a spectrogram, at most
_LOBE = 2  # lines to each side of the middle of a Hann window's main lobe
_STANDS_OUT = 10.0  # dB above the minima beside it
_MOST, _LEAST = 8, 1e-3  # lines in the report: how many, and RMS of the weakest over that of the signal


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
class Spectrum(Result):
    """The result of `spectrum`: `window` [s] of the density, `map_window` [s] of the spectrogram; `bridged` samples."""

    FIGURE: ClassVar = "rig.analysis.recorded.figures:spectrum_figure"

    scene: str
    name: str
    unit: str
    rate: float
    start: float
    seconds: float
    window: float
    density: Density
    lines: tuple[Line, ...]
    map_window: float
    map: Map
    bridged: int
    gaps: str

    def text(self) -> str:
        """Return the report as text."""
        d = self.density
        lines = [
            f"{self.scene}: spectrum of {self.name} [{self.unit}], {self.start:.5g} to "
            f"{self.start + self.seconds:.5g} s at {self.rate:.6g} Hz",
            f"  power spectral density: mean of {counted(d.windows, 'Hann window')} of {self.window:.4g} s, "
            f"half overlapping; lines {d.step:.4g} Hz apart",
            f"  spectrogram: Hann windows of {self.map_window:.4g} s, lines {self.map.f[1]:.4g} Hz apart",
            *gaps_told(self.gaps, self.bridged, d.left_out),
            f"  RMS about the mean, over these windows: {d.rms:.5g} {self.unit}",
        ]
        return "\n".join([*lines, "", *table(self.lines, d, "frequency Hz", self.unit, f"{squared(self.unit)}/Hz")])

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; the density is in `csv`."""
        return {
            "scene": self.scene,
            "signal": self.name,
            "unit": self.unit,
            "rate": self.rate,
            "start": self.start,
            "seconds": self.seconds,
            "window": self.window,
            "windows": self.density.windows,
            "windows_left_out": self.density.left_out,
            "step": self.density.step,
            "rms": self.density.rms,
            "samples_bridged": self.bridged,
            "gaps": self.gaps,
            "lines": [line._asdict() for line in self.lines],
        }

    def csv(self) -> Iterator[tuple[str, float, str, float, str]]:
        """Yield rows: axis, place on it, its unit, density there, its unit."""
        for f, s in zip(self.density.f.tolist(), self.density.s.tolist()):
            yield "frequency", f, "Hz", s, f"{squared(self.unit)}/Hz"


def spectrum(
    run: Run, name: str = "", window: float | None = None, first: float = 0.0, last: float = math.inf
) -> Spectrum:
    """Compute the spectrum of signal `name` of `run`, by default a vibration sensor, from `first` to `last` [s].

    `window` [s]: by default an eighth of the recording for the density; for the spectrogram an eightieth, or five
    periods of the slowest strong vibration. Raises UsageError for an unknown name, and for a window that is too short,
    too long, or has a gap everywhere.
    """
    found = series(run, name or vibration(run), first, last)
    count = short = length(found, window)
    if window is None:
        hertz = slowest(found)
        periods = math.ceil(_PERIODS * found.rate / hertz) if hertz else 0
        short = min(max(found.v.size // _OF_MAP, periods, FEWEST), count)
    v, bridged = bridge(found.v)
    density = welch(v, found.rate, count)
    if not density.windows:
        raise UsageError(
            f"{found.name}: every window of {count / found.rate:.4g} s has gaps; {found.notes()}. Take a shorter "
            "window or another range of time"
        )
    return Spectrum(
        scene_name(run), found.name, found.unit, found.rate, found.start, found.seconds, count / found.rate, density,
        peaks(density), short / found.rate, short_time(v, found.rate, short, found.start), bridged, found.notes(),
    )  # fmt: skip


def length(found: Series, window: float | None) -> int:
    """Return the samples of a window of `window` [s], or of the default window. Raises UsageError."""
    if found.v.size < FEWEST:
        raise UsageError(
            f"{found.name}: {found.v.size} samples at {found.rate:g} Hz; a spectrum needs at least {FEWEST}. Take a "
            "longer range of time or a faster channel"
        )
    if window is None:
        return max(found.v.size // _OF_DENSITY, FEWEST)
    if not FEWEST / found.rate * (1.0 - 1e-9) <= window <= found.seconds * (1.0 + 1e-9):
        raise UsageError(
            f"window {window:g} s: must be {FEWEST / found.rate:g} s ({FEWEST} samples of {found.name} at "
            f"{found.rate:g} Hz) to {found.seconds:g} s (the recording)"
        )
    return min(round(window * found.rate), found.v.size)


def welch(v: Reals, rate: float, count: int) -> Density:
    """Return the density of `v` (missing samples are NaN) from windows of `count` samples; of no windows where none
    fits.
    """
    from scipy import signal

    hop = count - count // 2
    ok = np.isfinite(v)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ok, [False])))).reshape(-1, 2)
    total, used = np.zeros(count // 2 + 1), 0
    for a, b in edges.tolist():
        if b - a >= count:
            _, s = signal.welch(v[a:b], rate, "hann", count, count // 2, detrend="constant")
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
    found = []
    for top in tops.tolist():
        lobe = slice(max(top - _LOBE, 0), top + _LOBE + 1)
        side = 1 if s[top + 1] > s[top - 1] else -1
        near = math.sqrt(float(s[top + side] / s[top]))
        aside = side * max((2.0 * near - 1.0) / (near + 1.0), 0.0)  # exact for a sine under a Hann window
        rms = math.sqrt(float(s[lobe].sum()) * density.step)
        found.append(Line(float(density.f[top]) + aside * density.step, rms, float(s[top])))
    strong = [line for line in found if line.rms > _LEAST * density.rms]
    return tuple(sorted(strong, key=lambda line: -line.rms)[:_MOST])


def table(lines: tuple[Line, ...], density: Density, head: str, unit: str, of: str) -> Iterator[str]:
    """Yield the strongest lines as a table."""
    if not lines:
        yield f"  no line is {_STANDS_OUT:g} dB above its surroundings and has a millionth of the mean square"
        return
    whole = max(density.rms**2, 1e-300)
    rows = [(f"{line.at:.6g}", f"{line.rms:.4g}", f"{100.0 * line.rms**2 / whole:.3g} %", f"{line.density:.3g}")
            for line in lines]  # fmt: skip
    titles = (head, f"RMS {unit}", "of the mean square", f"density {of}")
    yield from columns([titles, *rows], ">>>>")


def gaps_told(gaps: str, bridged: int, left_out: int) -> Iterator[str]:
    """Yield lines on missing samples and their treatment."""
    if gaps:
        yield f"  {gaps}"
    if bridged or left_out:
        yield (f"  {bridged} of them are bridged by lines over gaps of up to {BRIDGED} samples; "
               f"{left_out} windows with longer gaps are left out")  # fmt: skip
