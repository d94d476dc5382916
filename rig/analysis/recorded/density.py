"""Power spectral density of samples: averaged over windows, over time, and its lines.

    S(f): mean over Hann windows, half overlapping, each without its mean (Welch); one-sided, [unit^2/Hz]
    RMS^2 = sum S df        about the mean; of a line: the sum over its main lobe, two lines to each side

Windows with a missing sample are left out, and counted. The samples may be even in time or in angle: a spectrum over
frequency and one over orders share density, map, lines and report.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.series import squared
from rig.record.run import Reals
from rig.record.run_data import BRIDGED
from rig.results import Column, Result, Table

FEWEST = 32
"""Samples in a window."""
PARTS = 8  # default windows of a density, end to end
_COLUMNS = 1200  # of a spectrogram, at most
_LOBE = 2  # lines to each side of the middle of a Hann window's main lobe
_STANDS_OUT = 10.0  # dB above the minima beside it
_SHOWN = 8  # lines in the report, at most
_LEAST = 1e-3  # RMS of the weakest line in the report over that of the signal


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
class Averaged(Result):
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

    def _report(self) -> Iterator[str | Table]:
        """What was lost, and the strongest lines."""
        d = self.density
        mean_square = max(d.rms**2, 1e-300)
        yield from [f"  {self.gaps}"] if self.gaps else []
        if self.bridged or d.left_out:
            yield (
                f"  {self.bridged} of them are bridged by lines over gaps of up to {BRIDGED} samples; "
                f"{d.left_out} windows with longer gaps are left out"
            )
        yield f"  RMS about the mean, over these windows: {d.rms:.5g} {self.unit}\n"
        columns = (
            Column("at", self.axis_unit, ".6g"),
            Column("rms", self.unit, ".4g"),
            Column("of the mean square", "1", ".3g", "%", 0.01),
            Column("density", self.density_unit, ".3g"),
        )
        rows = [(line.at, line.rms, line.rms**2 / mean_square, line.density) for line in self.lines]
        if rows:
            yield Table("lines", columns, rows)
        else:
            yield f"  no line is {_STANDS_OUT:g} dB above its surroundings and has a millionth of the mean square"

    def facts(self) -> dict[str, Any]:
        """Return the settings; the density is in `csv`."""
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
            "lines": [],
        }

    def rows(self) -> Iterator[tuple[str | float, ...]]:
        """Yield the density: axis, place on it, its unit, density there, its unit."""
        for f, s in zip(self.density.f.tolist(), self.density.s.tolist()):
            yield self.AXIS, f, self.axis_unit, s, self.density_unit

    def listed(self) -> Table:
        """Return `rows` as a table."""
        return Table("density", [*map(Column, ("axis", "at", "unit", "density", "unit of density"))], [*self.rows()])


def welch(v: Reals, rate: float, count: int) -> Density:
    """Return the density of `v` (missing samples are NaN) from windows of `count` samples; of no windows where none
    fits.
    """
    from scipy.signal import welch as by_scipy

    hop = count - count // 2
    ok = np.isfinite(v)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ok, [False])))).reshape(-1, 2)
    total = np.zeros(count // 2 + 1)
    used = 0
    for a, b in edges.tolist():
        if b - a >= count:
            _, s = by_scipy(v[a:b], rate, "hann", count, count // 2, detrend="constant")
            fits = 1 + (b - a - count) // hop
            total = total + fits * s
            used = used + fits
    whole = max(1 + (v.size - count) // hop, 0)
    f = np.asarray(np.fft.rfftfreq(count, 1.0 / rate), np.float64)
    return Density(f, total / max(used, 1), used, max(whole - used, 0))


def short_time(v: Reals, rate: float, count: int, start: float) -> Map:
    """Return the short-time density of `v` (missing: NaN) from windows of `count` samples; the first sample is at
    `start`.
    """
    from scipy.signal import ShortTimeFFT
    from scipy.signal.windows import hann

    hop = max(count // 4, -(-v.size // _COLUMNS), 1)
    transform = ShortTimeFFT(hann(count, sym=False), hop, rate, fft_mode="onesided2X", scale_to="psd")
    p0 = transform.lower_border_end[1]
    p1 = max(transform.upper_border_begin(v.size)[1], p0 + 1)
    s = transform.spectrogram(np.nan_to_num(v), detr="constant", p0=p0, p1=p1).astype(np.float32)
    gaps = np.concatenate(([0], np.cumsum(np.isnan(v))))
    begins = np.arange(p0, p1) * hop - transform.m_num_mid
    s[:, gaps[np.minimum(begins + count, v.size)] > gaps[begins]] = np.nan
    return Map(start + transform.t(v.size, p0, p1), transform.f, s)


def joined_densities(densities: Sequence[Density]) -> Density:
    """Return the mean over the windows of all stretches of a channel."""
    if len(densities) == 1:
        return densities[0]
    windows = sum(density.windows for density in densities)
    total = np.sum([density.windows * density.s for density in densities], axis=0)
    return Density(densities[0].f, total / max(windows, 1), windows, sum(density.left_out for density in densities))


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
