"""Frequency response and coherence between two channels of a recording.

    H1(f) = Sxy / Sxx                          x: input, y: output; unbiased with noise in the output
    coherence = |Sxy|^2 / (Sxx Syy)            share of the output's power that follows the input linearly
    H2(f) = H1 / coherence                     unbiased with noise in the input
    random error of |H| = sqrt((1 - coherence) / (2 n coherence)), as a share; n: independent windows

The coherence of channels that are not related is about 1 / n, and below 1 - 0.05^(1 / (n - 1)) in 95 % of the cases. At
a resonance the magnitude is too low by about (window lines' distance / half-power bandwidth)^2 / 3.
Source: J. S. Bendat, A. G. Piersol, Random Data, 4th edition, 2010, chapters 6, 8 and 9.

Averaged spectra of two channels over windows: power, cross spectrum, and how many averages are independent.

noise and vibration   Hann windows, half overlapping, each without its mean (Welch)
pulses                windows that begin shortly before each pulse and are not tapered: a taper would change the decay

Pulses of an input, such as blows of a hammer: where their windows begin, and the force window.

A line is subtracted first, because force transducers drift. An input is a sequence of pulses if it then exceeds a level
in at most a twentieth of its samples. The level is a tenth of the largest value, or six standard deviations of the
noise (from the median of the magnitudes) if these are more; it must be below half of the largest value.

Between its pulses the input is zero: the force window replaces what the transducer reads there, noise and drift.
Source: D. J. Ewins, Modal Testing, 2nd edition, 2000, chapter 3.

Resonances of a frequency response: natural frequency and damping from a fit about each peak.

    H(s) = (c0 + c1 s + c2 s^2 + c3 s^3) / (s^2 + a1 s + a0),  s = 2 pi i f

One pole pair, real coefficients; the cubic stands for the mode's own residue, which differs between displacement,
velocity and acceleration, and for the tails of the other modes. Least squares over the lines about the peak that are
above half of its height, at least four on either side, iterated with the last denominator as weight (Sanathanan and
Koerner, IEEE Trans. Autom. Control 8, 1963), so that the error of H itself becomes least. A fit uses every line, where
the half-power method uses two.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.density import FEWEST
from rig.analysis.recorded.series import Series, aligned, channels, same, scene_name
from rig.errors import Faults, UsageError
from rig.printable import columns, counted
from rig.record.run import Integers, Reals, Run
from rig.record.run_data import bridge
from rig.results import Result, csv_text

_CHUNK = 1 << 22  # samples that are transformed at once
_LOUD, _NOISE, _CLEAR, _RARE = 0.1, 6.0, 0.5, 0.05
_NORMAL = 1.4826  # standard deviation over median magnitude, of normal noise
_SAMPLES_BESIDE = 4  # samples before and after a pulse, at least; and at least twice its length
Complex = NDArray[np.complex128]
_STANDS_OUT = 6.0  # dB above the minima beside it
_SURE = 0.1  # random error of a peak
_TRIED, _MOST = 200, 12  # peaks, and resonances among them
_LINES_BESIDE = 4  # lines on either side of a peak, at least
_DEEP = 0.5  # share of the height of a peak down to which its lines are fitted
_ROUNDS = 20
_FITS = 0.2  # RMS of the error of a fit over that of the response
_NARROWEST = 0.5  # lines in the bandwidth
_WINDOWS = 16  # Hann windows, end to end, in the time span, by default
_FLOOR = 1e-10  # share of the input's largest spectral density: lines below it count as not excited
_ROUNDING = 1e-12  # share of its largest value: an input that changes by less is constant
_NARROW = 4.0  # lines in the bandwidth of a peak that its height needs
_LASTS = 1e-3  # RMS at the end of a window over that of the window: more is reported
_EXCITE = (
    "a response needs an input that moves: noise, a sweep, or a knock with a duration in the protocol of the scene"
)


class Averages(NamedTuple):
    """One-sided spectra at `f` [Hz]: `sxx`, `syy` (real) and `sxy` = mean of conj(X) Y, of `windows` windows.

    `independent`: number of independent windows that have the same variance. `left_out`: windows with gaps, or that end
    after the last sample. `rest`: RMS of the output about its mean in the last tenth of the windows over that in the
    whole windows; NaN for Hann windows.
    """

    f: Reals
    sxx: Reals
    syy: Reals
    sxy: NDArray[np.complex128]
    windows: int
    independent: float
    left_out: int
    tapered: bool
    rest: float


def averaged(x: Reals, y: Reals, rate: float, count: int, begins: Integers) -> Averages:
    """Average over windows of `count` samples that begin at `begins`; without any, over half overlapping Hann windows.

    Windows with a missing sample (NaN) are left out.
    """
    from scipy.signal import get_window

    tapered = not begins.size
    weights = np.asarray(get_window("hann", count), np.float64) if tapered else np.ones(count)
    hop = count - count // 2
    places = np.arange(0, x.size - count + 1, hop) if tapered else begins[begins + count <= x.size]
    gaps = np.concatenate(([0], np.cumsum(np.isnan(x) | np.isnan(y))))
    used = places[gaps[places + count] == gaps[places]]
    lines = count // 2 + 1
    sxx = np.zeros(lines)
    syy = np.zeros(lines)
    sxy = np.zeros(lines, np.complex128)
    late = whole = 0.0
    rows = max(_CHUNK // count, 1)
    for part in (used[a : a + rows] for a in range(0, used.size, rows)):
        index = part[:, None] + np.arange(count)
        taken = [v[index] - v[index].mean(axis=1, keepdims=True) for v in (x, y)]
        inputs, other = (np.fft.rfft(v * weights, axis=1) for v in taken)
        sxx += (np.abs(inputs) ** 2).sum(axis=0)
        syy += (np.abs(other) ** 2).sum(axis=0)
        sxy += (inputs.conj() * other).sum(axis=0)
        late += float(taken[1][:, -max(count // 10, 1) :].var(axis=1).sum())
        whole += float((taken[1] ** 2).mean(axis=1).sum())
    scale = 2.0 / (rate * float(weights @ weights) * max(used.size, 1))
    shared = float(weights[hop:] @ weights[: count - hop]) / float(weights @ weights) if tapered else 0.0
    return Averages(
        np.asarray(np.fft.rfftfreq(count, 1.0 / rate), np.float64),
        scale * sxx,
        scale * syy,
        scale * sxy,
        used.size,
        used.size / (1.0 + 2.0 * shared**2 * (1.0 - 1.0 / max(used.size, 1))),
        (places if tapered else begins).size - used.size,
        tapered,
        np.nan if tapered or not whole else float(np.sqrt(late / whole)),
    )


class Pulses(NamedTuple):
    """Pulses in order of time: [n] sample at which the window of each begins, and the sample after the pulse."""

    begins: Integers
    ends: Integers


def pulses(x: Reals) -> Pulses | None:
    """Return the pulses of `x` (NaN: missing); None if it is not a sequence of pulses."""
    at = np.flatnonzero(np.isfinite(x))
    away = np.zeros(x.size)
    away[at] = x[at] - np.polyval(np.polyfit(at, x[at], 1), at)
    away[at] = np.abs(away[at] - np.median(away[at]))
    top = float(away.max())
    level = max(_LOUD * top, _NOISE * _NORMAL * float(np.median(away[at])))
    loud = away > level
    if not loud.any() or level > _CLEAR * top or loud.mean() > _RARE:
        return None
    first, last = np.flatnonzero(np.diff(np.concatenate(([False], loud, [False])))).reshape(-1, 2).T
    beside = max(2 * int((last - first).max()), _SAMPLES_BESIDE)
    apart = first[1:] - last[:-1] > 2 * beside  # not the bounce of one pulse
    begins = first[np.concatenate(([True], apart))] - beside
    ends = last[np.concatenate((apart, [True]))] + beside
    return Pulses(np.maximum(begins, 0), np.minimum(ends, x.size))


def force_window(x: Reals, blows: Pulses, count: int) -> Reals:
    """Return `x` without its baseline in the pulses and zero between them, in the windows of `count` samples.

    The baseline is the line through the samples of the window that follow the pulse.
    """
    made = np.zeros(x.size)
    for begin, end in zip(blows.begins.tolist(), blows.ends.tolist()):
        at = np.arange(end, min(begin + count, x.size))
        at = at[np.isfinite(x[at])]
        line = np.polyfit(at - begin, x[at], 1) if at.size > 1 else np.zeros(2)
        made[begin:end] = x[begin:end] - np.polyval(line, np.arange(end - begin))
    return made


class Resonance(NamedTuple):
    """A peak of a frequency response: `frequency` [Hz] of the damped vibration and damping ratio, as in `rig modes`.

    `at` [Hz]: the line with the largest magnitude, `magnitude` there, its `coherence` and random error. `bandwidth`
    [Hz]: between the half-power points, by the fit.
    """

    frequency: float
    damping: float
    bandwidth: float
    at: float
    magnitude: float
    coherence: float
    error: float


def resonances(f: Reals, h: Complex, coherence: Reals, error: Reals) -> tuple[Resonance, ...]:
    """Return the resonances of the response `h` at `f` [Hz], the largest peaks, in order of frequency.

    `h` is NaN at a line without excitation. A resonance is a peak 6 dB above its surroundings with a random error of at
    most 10 %, to whose lines a stable pole pair fits within 20 %, with a bandwidth of at least half a line.
    """
    from scipy.signal import find_peaks

    known = np.isfinite(h)
    lines = np.flatnonzero(known)
    size = np.where(known, np.abs(h), 0.0)
    if not size.any():
        return ()
    level = 20.0 * np.log10(np.maximum(size[lines], 1e-15 * size.max()))
    tops, _ = find_peaks(level, prominence=_STANDS_OUT)
    sure = []
    for top in lines[tops].tolist():
        beside = error[max(top - _LINES_BESIDE, 0) : top + _LINES_BESIDE + 1]  # all nan with a single window
        if not (np.isfinite(beside).any() and max(float(error[top]), float(np.nanmedian(beside))) > _SURE):
            sure.append(top)
    made: list[Resonance] = []
    for top in sorted(sure, key=lambda top: -size[top])[:_TRIED]:
        low, high = _about(size, known, top)
        pole = _fitted(f[low:high], h[low:high]) if high - low > 2 * _LINES_BESIDE else None
        if pole is None or not f[low] <= (hertz := pole.imag / (2.0 * math.pi)) <= f[high - 1]:
            continue
        bandwidth = -pole.real / math.pi
        if bandwidth >= _NARROWEST * (f[1] - f[0]):
            at_top = (float(v[top]) for v in (f, size, coherence, error))
            made.append(Resonance(hertz, -pole.real / abs(pole), bandwidth, *at_top))
    return tuple(sorted(made[:_MOST]))


def _about(size: Reals, known: NDArray[np.bool_], top: int) -> tuple[int, int]:
    """The first line of a peak and the one after its last."""
    ends = []
    for step in (-1, 1):
        at = top
        while (
            0 <= at + step < size.size
            and known[at + step]
            and (
                abs(at - top) < _LINES_BESIDE or (size[at + step] >= _DEEP * size[top] and size[at + step] <= size[at])
            )
        ):
            at += step
        ends.append(at)
    return ends[0], ends[1] + 1


def _fitted(f: Reals, h: Complex) -> complex | None:
    """The stable pole [1/s] with positive frequency; None without one, or if the fit is bad."""
    scale = 2.0 * math.pi * float(f.mean())
    s = 2j * math.pi * f / scale
    rows = np.stack([-h * s, -h, np.ones_like(s), s, s * s, s**3], axis=1)
    weight = np.ones(f.size)
    a1 = a0 = 0.0
    for _ in range(_ROUNDS):
        weighed = rows * weight[:, None]
        right = h * s * s * weight
        solved = np.linalg.lstsq(
            np.concatenate([weighed.real, weighed.imag]), np.concatenate([right.real, right.imag]), rcond=None
        )[0]
        before = (a1, a0)
        a1, a0 = (float(solved[0]), float(solved[1]))
        if abs(a1 - before[0]) + abs(a0 - before[1]) < 1e-12:
            break
        weight = 1.0 / np.maximum(np.abs(s * s + a1 * s + a0), 1e-9)
    inside = a0 - 0.25 * a1 * a1
    off = h - rows[:, 2:] @ solved[2:] / (s * s + a1 * s + a0)
    if a1 <= 0.0 or inside <= 0.0 or np.linalg.norm(off) > _FITS * np.linalg.norm(h):
        return None
    return scale * complex(-0.5 * a1, math.sqrt(inside))


@dataclass(frozen=True)
class Response(Result):
    """The result of `response`: `h` [n, complex, in `unit`] and `coherence` [n] at `f` [n, Hz].

    `error` [n]: random error of the magnitude as a share, also that of the phase in radians where it is small. `h` is
    NaN at a line that the input does not excite; coherence and error are NaN with a single window. `rate` [Hz] of the
    common samples, `window` [s]; `independent` of the `windows`; `certain`: unrelated channels stay below this
    coherence at 95 % of the lines. `tapered`: Hann windows; otherwise the input is pulses, and the windows begin with
    them. `rest`: RMS of the output at their ends over that of the whole windows.
    """

    FIGURE: ClassVar = "rig.analysis.recorded.figures:response_figure"

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

    def text(self) -> str:
        """Return the report as text."""
        kind = "Hann, half overlapping" if self.tapered else "from pulse to pulse"
        windows = f"{counted(self.windows, 'window')} of {self.window:.4g} s"
        known = np.isfinite(self.h)
        band = f"{self.f[known].min():.4g} to {self.f[known].max():.4g} Hz"
        without = int(np.count_nonzero(~known)) and f"{np.count_nonzero(~known)} lines in which the input has no power"
        bridged = f"  {self.bridged} missing samples are bridged by straight lines" if self.bridged else ""
        lost = "windows are left out: a longer gap, or they end after the last sample"
        left_out = f"  {self.left_out} {lost}" if self.left_out else ""
        lines = [
            f"{self.scene}: response of {self.output} [{self.output_unit}] to {self.input} [{self.input_unit}], "
            f"{self.start:.5g} to {self.start + self.seconds:.5g} s at {self.rate:.6g} Hz",
            f"  H1: mean of {windows} ({kind}), {self.independent:.4g} independent; lines {self.step:.4g} Hz apart",
            *([] if self.tapered else ["  the input counts as zero between the pulses (force window)"]),
            *(f"  {gap}" for gap in self.gaps),
            *filter(None, (bridged, left_out)),
            f"  excited: {band}{f', without {without}' if without else ''}",
            *self._trusted(),
            *self._doubts(),
        ]
        if not self.resonances:
            none = "  no resonance: no peak of 6 dB has a random error below 10 % and fits a pole pair"
            return "\n".join([*lines, none])
        head = ("frequency Hz", "damping ratio", f"magnitude {self.unit}", "at Hz", "coherence", "random error")
        rows = [
            (
                f"{r.frequency:.6g}",
                f"{r.damping:.4g}",
                f"{r.magnitude:.4g}",
                f"{r.at:.5g}",
                "-" if math.isnan(r.coherence) else f"{r.coherence:.4g}",
                _percent(r.error),
            )
            for r in self.resonances
        ]
        how = "  resonances: fit of one pole pair to the lines about each peak"
        return "\n".join([*lines, how, "", *columns([head, *rows], ">>>>>>")])

    def _trusted(self) -> Iterator[str]:
        if self.windows < 2:
            yield "  coherence and random error are unknown: there is a single window"
            return
        known = np.isfinite(self.coherence)
        share = np.mean(self.coherence[known] > self.certain)
        yield (
            f"  coherence: median {np.median(self.coherence[known]):.4g}; {100.0 * share:.3g} % of the lines are "
            f"above {self.certain:.3g}, which unrelated channels stay below with 95 %"
        )
        yield f"  random error of the magnitude: median {_percent(float(np.median(self.error[known])))}"

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

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; the lines are in `csv`."""
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
            "rest": self.rest,
            "step": self.step,
            "coherence_of_unrelated": self.certain,
            "samples_bridged": self.bridged,
            "gaps": list(self.gaps),
            "resonances": [resonance._asdict() for resonance in self.resonances],
        }

    def csv(self) -> str:
        """Return the lines: frequency [Hz], magnitude, phase [degrees], coherence, random error of the magnitude."""
        head = ("frequency [Hz]", f"magnitude [{self.unit}]", "phase [degree]", "coherence", "random error")
        lines = (self.f, np.abs(self.h), np.degrees(np.angle(self.h)), self.coherence, self.error)
        return csv_text(head, zip(*(v.tolist() for v in lines)))


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
    (x, y), highest = aligned(
        [Series(channel.name, channel.unit, channel.rate, channel.start, v) for channel, (v, _) in zip(known, whole)]
    )
    faults.found += [
        f"{what}: {channel.name} {why}; {remedy}"
        for what, channel, remedy in (("input", x, _EXCITE), ("output", y, "choose another channel or range of time"))
        if (why := _still(channel))
    ]
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
    return f"is constant ({v.mean():.6g} {channel.unit})" if np.ptp(v) <= _ROUNDING * np.abs(v).max() else ""


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
