"""Frequency response and coherence between two channels of a recording.

    H1(f) = Sxy / Sxx                          x: input, y: output; unbiased with noise in the output
    coherence = |Sxy|^2 / (Sxx Syy)            share of the output's power that follows the input linearly
    H2(f) = H1 / coherence                     unbiased with noise in the input
    random error of |H| = sqrt((1 - coherence) / (2 n coherence)), as a share; n: independent windows

The coherence of channels that are not related is about 1 / n, and below 1 - 0.05^(1 / (n - 1)) in 95 % of the cases. At
a resonance the magnitude is too low by about (window lines' distance / half-power bandwidth)^2 / 3.
Source: J. S. Bendat, A. G. Piersol, Random Data, 4th edition, 2010, chapters 6, 8 and 9.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.averages import Averages, averaged
from rig.analysis.recorded.common_grid import aligned
from rig.analysis.recorded.density import FEWEST
from rig.analysis.recorded.pulses import force_window, pulses
from rig.analysis.recorded.resonances import Complex, Resonance, resonances
from rig.analysis.recorded.series import Series, channels, same, scene_name
from rig.errors import Faults, UsageError
from rig.printable import counted
from rig.record.run import Integers, Reals, Run
from rig.record.run_data import bridge
from rig.results import Column, Result, Table

_WINDOWS = 16  # Hann windows, end to end, in the time span, by default
_FLOOR = 1e-10  # share of the input's largest spectral density: lines below it count as not excited
_ROUNDING = 1e-12  # share of its largest value: an input that changes by less is constant
_NARROW = 4.0  # lines in the bandwidth of a peak that its height needs
_LASTS = 1e-3  # RMS at the end of a window over that of the window: more is reported
_EXCITE = (
    "a response needs an input that moves: noise, a sweep, or a knock with a duration in the protocol of the scene"
)


@dataclass(frozen=True)
class Response(Result):
    """The result of `response`: `h` [n, complex, in `unit`] and `coherence` [n] at `f` [n, Hz].

    `error` [n]: random error of the magnitude as a share, also that of the phase in radians where it is small. `h` is
    NaN at a line that the input does not excite; coherence and error are NaN with a single window. `rate` [Hz] of the
    common samples, `window` [s]; `independent` of the `windows`; `certain`: unrelated channels stay below this
    coherence at 95 % of the lines. `tapered`: Hann windows; otherwise the input is pulses, and the windows begin with
    them. `rest`: RMS of the output at their ends over that of the whole windows.
    """

    FIGURE: ClassVar = "rig.analysis.recorded.channel_figures:response_figure"

    scene: str
    input: str
    input_unit: str
    output: str
    output_unit: str
    rate: float
    start: float
    seconds: float
    window: float
    tapered: bool
    windows: int
    independent: float
    left_out: int
    rest: float
    f: Reals
    h: Complex
    coherence: Reals
    error: Reals
    resonances: tuple[Resonance, ...]
    bridged: int
    gaps: tuple[str, ...]

    @property
    def unit(self) -> str:
        """Unit of the response."""
        return "/".join(f"({u})" if set(u) & set("/*^") else u or "1" for u in (self.output_unit, self.input_unit))

    @property
    def certain(self) -> float:
        """Coherence below which unrelated channels stay at 95 % of the lines; NaN with a single window."""
        return 1.0 - 0.05 ** (1.0 / (self.independent - 1.0)) if self.independent > 1.0 else math.nan

    @property
    def step(self) -> float:
        """Distance between lines [Hz]."""
        return 1.0 / self.window

    @property
    def excited(self) -> dict[str, float]:
        """Lowest and highest line with power of the input [Hz], and the number of lines without."""
        known = np.isfinite(self.h)
        return {
            "lowest": float(self.f[known].min()),
            "highest": float(self.f[known].max()),
            "lines_without": int(np.count_nonzero(~known)),
        }

    @property
    def trusted(self) -> dict[str, float]:
        """Medians of coherence and error, and the share of lines above `certain`; empty with a single window."""
        if self.windows < 2:
            return {}
        known = np.isfinite(self.coherence)
        return {
            "coherence_median": float(np.median(self.coherence[known])),
            "coherence_above": float(np.mean(self.coherence[known] > self.certain)),
            "error_median": float(np.median(self.error[known])),
        }

    def shown(self) -> Iterator[str | Table]:
        """Yield how the response was estimated, what can be trusted, and the resonances."""
        kind = "Hann, half overlapping" if self.tapered else "from pulse to pulse"
        windows = f"{counted(self.windows, 'window')} of {self.window:.4g} s"
        lines = self.excited
        excited = f"  excited: {lines['lowest']:.4g} to {lines['highest']:.4g} Hz"
        if lines["lines_without"]:
            excited += f", without {counted(int(lines['lines_without']), 'line')} in which the input has no power"
        span = f"{self.start:.5g} to {self.start + self.seconds:.5g} s"
        bridged = f"  {counted(self.bridged, 'missing sample')} bridged by straight lines" if self.bridged else ""
        lost = "windows are left out: a longer gap, or they end after the last sample"
        left_out = f"  {self.left_out} {lost}" if self.left_out else ""
        channels = f"response of {self.output} [{self.output_unit}] to {self.input} [{self.input_unit}]"
        yield f"{self.scene}: {channels}, {span} at {self.rate:.6g} Hz"
        yield f"  H1: mean of {windows} ({kind}), {self.independent:.4g} independent; lines {self.step:.4g} Hz apart"
        yield from [] if self.tapered else ["  the input counts as zero between the pulses (force window)"]
        yield from (f"  {gap}" for gap in self.gaps)
        yield from filter(None, (bridged, left_out))
        yield excited
        yield from self._trusted()
        yield from self._doubts()
        if not self.resonances:
            yield "  no resonance: no peak of 6 dB has a random error below 10 % and fits a pole pair"
            return
        yield "  resonances: fit of one pole pair to the lines about each peak\n"
        columns = (
            Column("frequency", "Hz", ".6g"),
            Column("damping", "1", ".4g"),
            Column("magnitude", self.unit, ".4g"),
            Column("at", "Hz", ".5g"),
            Column("coherence", "1", ".4g"),
            Column("error", "1", ".3g", "%", 0.01),
        )
        rows = [(r.frequency, r.damping, r.magnitude, r.at, r.coherence, r.error) for r in self.resonances]
        yield Table("resonances", columns, rows)

    def _trusted(self) -> Iterator[str]:
        trusted = self.trusted
        if not trusted:
            yield "  coherence and random error are unknown: there is a single window"
            return
        yield (
            f"  coherence: median {trusted['coherence_median']:.4g}; {100.0 * trusted['coherence_above']:.3g} % of the "
            f"lines are above {self.certain:.3g}, which unrelated channels stay below with 95 %"
        )
        yield f"  random error of the magnitude: median {_percent(trusted['error_median'])}"

    def _doubts(self) -> Iterator[str]:
        narrow = [r for r in self.resonances if r.bandwidth < _NARROW * self.step]
        if narrow and self.tapered:
            yield (
                "  the resonances at " + ", ".join(f"{r.frequency:.5g}" for r in narrow) + " Hz are narrower than "
                "four lines: magnitude too low, damping too high; take a longer window"
            )
        if self.rest > _LASTS:
            yield (
                f"  at the end of the windows the output has {_percent(self.rest)} of its RMS in them: noise, or a "
                "vibration that has\n  not decayed, whose leakage falsifies the response where it is small; leave "
                "more time between the pulses"
            )

    def facts(self) -> dict[str, Any]:
        """Return settings and resonances; the lines are in `csv`."""
        return {
            "scene": self.scene,
            "input": self.input,
            "input_unit": self.input_unit,
            "output": self.output,
            "output_unit": self.output_unit,
            "unit": self.unit,
            "rate": self.rate,
            "start": self.start,
            "seconds": self.seconds,
            "window": self.window,
            "taper": "hann" if self.tapered else "none",
            "windows": self.windows,
            "windows_independent": self.independent,
            "windows_left_out": self.left_out,
            "excited": self.excited,
            **self.trusted,
            "rest": self.rest,
            "step": self.step,
            "coherence_of_unrelated": self.certain,
            "samples_bridged": self.bridged,
            "gaps": list(self.gaps),
            "resonances": [resonance._asdict() for resonance in self.resonances],
        }

    def listed(self) -> Table:
        """Return the lines: frequency [Hz], magnitude, phase [degrees], coherence, random error of the magnitude."""
        units = {"frequency": "Hz", "magnitude": self.unit, "phase": "degree", "coherence": "", "random error": ""}
        values = (self.f, np.abs(self.h), np.degrees(np.angle(self.h)), self.coherence, self.error)
        return Table("lines", [*map(Column, units, units.values())], [*zip(*(v.tolist() for v in values))])


def response(
    run: Run, source: str, answer: str, window: float | None = None, first: float = 0.0, last: float = math.inf
) -> Response:
    """Estimate the frequency response from channel `source` to channel `answer` of `run`, from `first` to `last` [s].

    A channel is a sensor, a plant output, or an actuator that a controller commands (held from frame to frame). Faster
    channels are filtered and brought to the rate of the slower one; the response then ends at 0.4 of that rate. Hann
    windows, by default a sixteenth of the time span long. For an input of pulses, windows without taper begin with
    each pulse and by default last until the next one, and the input counts as zero between them. `window` [s].

    Raises UsageError with every fault: unknown names, one channel twice, an input that is constant, a window that is
    too short, too long, or has a gap everywhere.
    """
    faults = Faults()
    known = [*channels(run, {"input": source, "output": answer}, first, last, faults).values()]
    faults.raise_found()
    if same(run, source, answer):
        raise UsageError(f"input and output are both {known[0].name}: its response to itself is 1; name two channels")
    gaps = tuple(filter(None, (channel.notes() for channel in known)))
    whole = [bridge(channel.v) for channel in known]
    bridged = [
        Series(channel.name, channel.unit, channel.rate, channel.start, v) for channel, (v, _) in zip(known, whole)
    ]
    (x, y), highest = aligned(bridged)
    for role, channel, remedy in (("input", x, _EXCITE), ("output", y, "choose another channel or range of time")):
        if why := _still(channel):
            faults.found.append(f"{role}: {channel.name} {why}; {remedy}")
    faults.raise_found()
    blows = pulses(x.v)
    begins = np.empty(0, np.int64) if blows is None else blows.begins
    span = "the time span"
    if highest < 0.5 * x.rate:
        span += " without the ends that the filter between the two rates needs"
    count = _count(x, begins, window, span)
    force = x.v if blows is None else force_window(x.v, blows, count)
    spectra = averaged(force, y.v, x.rate, count, begins)
    if not spectra.windows:
        raise UsageError(
            f"{x.name}, {y.name}: every window of {count / x.rate:.4g} s has gaps ({'; '.join(gaps)}). Take a shorter "
            "window or another range of time"
        )
    lowest = (1.5 if spectra.tapered else 0.5) * x.rate / count  # the removal of the means falsifies lines below
    kept = (spectra.f > lowest) & (spectra.f < highest * (1.0 - 1e-9))
    f = spectra.f[kept]
    h, coherence, error = _estimates(spectra, kept)
    return Response(
        scene_name(run),
        x.name,
        x.unit,
        y.name,
        y.unit,
        x.rate,
        x.start,
        x.seconds,
        count / x.rate,
        spectra.tapered,
        spectra.windows,
        spectra.independent,
        spectra.left_out,
        spectra.rest,
        f,
        h,
        coherence,
        error,
        resonances(f, h, coherence, error),
        sum(n for _, n in whole),
        gaps,
    )


def _still(channel: Series) -> str:
    """Why a channel has no spectrum; "" if it has one."""
    v = channel.v[np.isfinite(channel.v)]
    if not v.size:
        return "has no sample in the time span that input and output share"
    if np.ptp(v) <= _ROUNDING * np.abs(v).max():
        return f"is constant ({v.mean():.6g} {channel.unit})"
    return ""


def _count(x: Series, begins: Integers, window: float | None, span: str) -> int:
    """Samples in a window; `span`: what is evaluated, in words."""
    longest = x.v.size
    what = span
    if begins.size:
        ends = begins[1:] if begins.size > 1 else np.array([x.v.size])
        longest = int((ends - begins[: ends.size]).min())
        what = "the time from one pulse to the next"
    if longest < FEWEST:
        raise UsageError(
            f"{x.name}: {what} has {longest / x.rate:.4g} s at {x.rate:.6g} Hz; at least {FEWEST / x.rate:.4g} s "
            f"({FEWEST} samples) are needed"
        )
    if window is None:
        return longest if begins.size else max(longest // _WINDOWS, FEWEST)
    if not FEWEST / x.rate * (1.0 - 1e-9) <= window <= longest / x.rate * (1.0 + 1e-9):
        raise UsageError(
            f"window {window:g} s: must be {FEWEST / x.rate:g} s ({FEWEST} samples at {x.rate:g} Hz) to "
            f"{longest / x.rate:g} s ({what})"
        )
    return min(round(window * x.rate), longest)


def _estimates(spectra: Averages, kept: NDArray[np.bool_]) -> tuple[Complex, Reals, Reals]:
    """H1, coherence and random error at the lines `kept`."""
    sxx = spectra.sxx[kept]
    syy = spectra.syy[kept]
    sxy = spectra.sxy[kept]
    excited = sxx > _FLOOR * sxx.max(initial=0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        h = np.where(excited, sxy / sxx, np.nan)
        coherence = np.where(excited & (spectra.windows > 1), np.abs(sxy) ** 2 / (sxx * syy), np.nan)
        coherence = np.minimum(coherence, 1.0)
        error = np.sqrt((1.0 - coherence) / (2.0 * spectra.independent * coherence))
    return h, coherence, error


def _percent(value: float) -> str:
    return "-" if math.isnan(value) else f"{100.0 * value:.3g} %"
