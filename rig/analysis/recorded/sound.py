"""Level, short-time spectrum and squeals of the sound at a microphone, or of another sensor that samples fast.

    level = 20 dB lg(rms / reference)      20 uPa for sound pressure, ISO 1683 for motion

A window of 40 ms (Hann) is taken every 10 ms. A squeal lasts while the loudest tone above 1 kHz exceeds a threshold.
The threshold is 60 dB for sound pressure. For motion no threshold of hearing is known, so that it is 20 dB below the
loudest window. Growth and decay are slopes of the tone's level up to 6 dB below its maximum; a window blurs rates above
about 50 1/s.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 3c (60 dB, 1 kHz), figure 29.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.series import scene_name
from rig.errors import UsageError
from rig.printable import counted
from rig.record.run import Run
from rig.record.run_data import Integers, increasing, places, stretches
from rig.results import Result

Reals = NDArray[np.float64]

REFERENCE = {"Pa": 20e-6, "m/s": 1e-9, "m/s^2": 1e-6, "m": 1e-12}
"""By unit: the reference value of 0 dB."""
_SHOWN = {"Pa": "20 uPa", "m/s": "1 nm/s", "m/s^2": "1 um/s^2", "m": "1 pm"}
WINDOW = 0.040  # s: tones 50 Hz apart are told from each other
HOP = 0.010  # s from window to window: a quarter of its length
LOWEST = 1000.0  # Hz
LOUD = 60.0  # dB, of sound pressure
BELOW = 20.0  # dB
_SETTLED = 3.0  # dB by which a tone falls below the threshold before its squeal is over
_TOP = 6.0  # dB below the maximum, where growth ends and decay begins
_FEWEST = 3  # windows
_NEPER = 20.0 / math.log(10.0)  # dB
_SILENCE = 1e-12  # of the reference: the level of zero


@dataclass(frozen=True)
class Squeal:
    """From `begin` to `end` [s]: mean, lowest and highest `frequency` [Hz], loudest tone `level` [dB].

    `growth`, `decay` [1/s] of the amplitude at its begin and end; NaN if the recording does not contain them.
    """

    begin: float
    end: float
    frequency: float
    lowest: float
    highest: float
    level: float
    growth: float
    decay: float

    def __str__(self) -> str:
        parts = [
            f"{self.begin:.2f} to {self.end:.2f} s: {self.frequency:.1f} Hz ({self.lowest:.1f} to "
            f"{self.highest:.1f}), {self.level:.1f} dB"
        ]
        parts += [f"grows with {self.growth:.3g} 1/s"] if math.isfinite(self.growth) else []
        parts += [f"decays with {self.decay:.3g} 1/s"] if math.isfinite(self.decay) else []
        return ", ".join(parts)


@dataclass(frozen=True)
class Sound(Result):
    """The sound at sensor `channel`: samples `v` [n] in `unit` at `rate` [Hz].

    Of each window [k]: `times` [s] of its middle, `level` and level of its loudest tone above 1 kHz `tone` [dB],
    `frequency` [Hz] of that tone. `spectrum` [k, f] in dB at `frequencies` [f]. `threshold` [dB] of a squeal; `missing`
    samples count as silence. `starts`: index and time [s] of the first sample of each stretch; stretches that lie far
    apart follow each other in `v` without their gap.
    """

    FIGURE: ClassVar = "rig.analysis.recorded.figures:sound_figure"

    scene: str
    channel: str
    unit: str
    rate: float
    starts: tuple[tuple[int, float], ...]
    v: Reals
    missing: int
    times: Reals
    level: Reals
    tone: Reals
    frequency: Reals
    frequencies: Reals
    spectrum: NDArray[np.float32]
    threshold: float
    squeals: tuple[Squeal, ...]
    run: Run = field(compare=False)
    """The run that it was heard in."""

    @property
    def reference(self) -> str:
        """The reference of 0 dB, in words."""
        return f"dB re {_SHOWN[self.unit]}"

    def t(self, index: Integers) -> Reals:
        """The times [s] of samples of `v`."""
        firsts, times = (np.array(column) for column in zip(*self.starts, strict=True))
        part = np.searchsorted(firsts, index, side="right") - 1
        return np.asarray(times[part] + (index - firsts[part]) / self.rate)

    @property
    def overall(self) -> float:
        """The level of the whole signal [dB]."""
        return float(_decibel(float(np.sqrt(np.mean(self.v**2))), self.unit))

    @property
    def peak(self) -> float:
        """The largest absolute sample, in `unit`."""
        return float(np.abs(self.v).max())

    def shown(self) -> Iterator[str]:
        """Yield the level and the squeals."""
        windows = f"in {1e3 * WINDOW:g} ms from {self.level.min():.1f} to {self.level.max():.1f} dB"
        yield f"{self.scene}: {self.channel}, {len(self.v) / self.rate:.2f} s at {self.rate:g} Hz"
        yield f"  level {self.overall:.1f} {self.reference}, {windows}; peak {self.peak:.3g} {self.unit}"
        yield from [f"  missing, counted as silence: {counted(self.missing, 'sample')}"] if self.missing else []
        yield from (f"  squeal {squeal}" for squeal in self.squeals)
        if not self.squeals:
            yield f"  no squeal: no tone above {LOWEST / 1e3:g} kHz exceeds {self.threshold:.1f} dB"

    def facts(self) -> dict[str, Any]:
        """Return the fields as JSON values; samples and spectrum are left out."""
        return {
            "scene": self.scene,
            "channel": self.channel,
            "unit": self.unit,
            "rate": self.rate,
            "seconds": len(self.v) / self.rate,
            "reference": REFERENCE[self.unit],
            "level": self.overall,
            "peak": self.peak,
            "missing": self.missing,
            "threshold": self.threshold,
            "squeals": [vars(squeal) for squeal in self.squeals],
            "windows": {
                "times": self.times.tolist(),
                "level": self.level.tolist(),
                "tone": self.tone.tolist(),
                "frequency": self.frequency.tolist(),
            },
        }


def hear(run: Run, channel: str = "") -> Sound:
    """Analyse the sound at sensor `channel` of `run`, by default the first one that reads sound pressure.

    Raises UsageError if there is no such sensor, or none that samples fast and long enough.
    """
    channel = channel or _microphone(run)
    unit = _unit(run, channel)
    t_ns, raw = run.measurements[channel]
    if not increasing(t_ns):
        raise UsageError(f"{channel}: its times do not increase")
    rate = _rate(t_ns)
    length = round(WINDOW * rate)
    if rate < 4.0 * LOWEST:
        raise UsageError(f"{channel} samples at {rate:g} Hz; a squeal needs {4.0 * LOWEST:g} Hz or more")
    parts = _parts(t_ns, raw)
    longest = max(part.v.size for part in parts)
    if longest < length:
        raise UsageError(f"{channel} recorded {longest / rate:.3g} s; at least {WINDOW:g} s are needed")
    parts = [part for part in parts if part.v.size >= length]
    begins = [np.arange(0, part.v.size - length + 1, round(HOP * rate)) for part in parts]
    heard = [_windows(part.v, at, length, rate) for part, at in zip(parts, begins, strict=True)]
    frequencies = heard[0][0]
    sizes = np.concatenate([part for _, part, _ in heard])
    rms = np.concatenate([part for *_, part in heard])
    frequency, tone = _loudest(frequencies, sizes)
    tone = _decibel(tone / math.sqrt(2.0), unit)
    level = _decibel(rms, unit)
    threshold = LOUD if unit == "Pa" else float(tone.max()) - BELOW
    middles = [part.start + (at + 0.5 * length) / rate for part, at in zip(parts, begins, strict=True)]
    times = np.concatenate(middles)
    ends = np.cumsum([at.size for at in middles])
    squeals = list[Squeal]()
    for end, at in zip(ends.tolist(), middles, strict=True):
        of_part = slice(end - at.size, end)
        squeals += _squeals(times[of_part], tone[of_part], frequency[of_part], threshold)
    firsts = np.cumsum([0, *(part.v.size for part in parts[:-1])])
    return Sound(
        scene=scene_name(run),
        channel=channel,
        unit=unit,
        rate=rate,
        starts=tuple(zip(firsts.tolist(), (part.start for part in parts), strict=True)),
        v=np.concatenate([part.v for part in parts]),
        missing=sum(part.missing for part in parts),
        times=times,
        level=level,
        tone=tone,
        frequency=frequency,
        frequencies=frequencies,
        spectrum=_decibel(sizes / math.sqrt(2.0), unit),
        run=run,
        threshold=threshold,
        squeals=tuple(squeals),
    )


def _rate(t_ns: Integers) -> float:
    """Samples per second [Hz], from the longest stretch."""
    longest = max((t_ns[part] for part in stretches(t_ns)), key=lambda part: part.size)
    return 1e9 * int(places(longest)[-1]) / int(longest[-1] - longest[0]) if longest.size > 1 else 0.0


class _Part(NamedTuple):
    """A stretch that lies far from the others: its begin [s], samples, and how many of these are missing (silence)."""

    start: float
    v: Reals
    missing: int


def _parts(t_ns: Integers, raw: Reals) -> list[_Part]:
    parts = []
    for part in stretches(t_ns):
        at = places(t_ns[part])
        v = np.zeros(int(at[-1]) + 1)
        v[at] = np.nan_to_num(raw[part])
        missing = int(v.size - np.count_nonzero(np.isfinite(raw[part])))
        parts.append(_Part(float(t_ns[part][0] * 1e-9), v, missing))
    return parts


def _microphone(run: Run) -> str:
    microphones = [name for name in run.measurements if run.units.get(f"meas/{name}") == "Pa"]
    if microphones:
        return microphones[0]
    others = {name: run.units.get(f"meas/{name}", "") for name in run.measurements}
    sensors = ", ".join(f"{name} [{unit}]" for name, unit in others.items()) or "none"
    near = next((name for name, unit in others.items() if unit in REFERENCE), "")
    instead = f", or analyse another sensor: --signal {near}" if near else ""
    raise UsageError(
        f"no sensor of this recording reads sound pressure [Pa]; its sensors: {sensors}. "
        f"Give the scene a microphone ([sensors.microphone]){instead}"
    )


def _unit(run: Run, channel: str) -> str:
    if channel not in run.measurements:
        raise UsageError(f"no sensor {channel!r} in this recording; known: {', '.join(run.measurements) or 'none'}")
    unit = run.units.get(f"meas/{channel}", "")
    if unit not in REFERENCE:
        raise UsageError(
            f"{channel} reads {unit or 'a number'}: neither sound pressure nor a vibration ({', '.join(REFERENCE)})"
        )
    return unit


def _decibel(size: Any, unit: str) -> Any:
    return 20.0 * np.log10(np.maximum(size / REFERENCE[unit], _SILENCE))


def _windows(v: Reals, begins: NDArray[np.int64], length: int, rate: float) -> tuple[Reals, NDArray[np.float32], Reals]:
    """Frequencies [f], amplitudes [k, f], root mean squares [k] of the windows that begin at samples `begins` [k]."""
    from scipy.fft import next_fast_len, rfft, rfftfreq
    from scipy.signal.windows import hann

    window = hann(length, sym=False)
    fine = next_fast_len(2 * length, real=True)
    frequencies = rfftfreq(fine, 1.0 / rate)
    sizes = np.empty((begins.size, frequencies.size), np.float32)
    rms = np.empty(begins.size)
    for k, begin in enumerate(begins):
        part = v[begin : begin + length] * window
        sizes[k] = np.abs(rfft(part, fine)) * (2.0 / window.sum())
        rms[k] = math.sqrt(float(part @ part) / float(window @ window))
    return frequencies, sizes, rms


def _loudest(frequencies: Reals, sizes: NDArray[np.float32]) -> tuple[Reals, Reals]:
    """Frequency [k] and amplitude [k] of the loudest tone above LOWEST, by a parabola through the logarithms."""
    first = int(np.searchsorted(frequencies, LOWEST))
    top = np.clip(first + sizes[:, first:-1].argmax(axis=1), 1, frequencies.size - 2)
    rows = np.arange(len(sizes))
    before, middle, after = (np.log(np.maximum(sizes[rows, top + d].astype(float), 1e-300)) for d in (-1, 0, 1))
    bend = before - 2.0 * middle + after
    peaked = bend < 0.0
    aside = np.where(peaked, 0.5 * (before - after) / np.where(peaked, bend, -1.0), 0.0)
    return frequencies[top] + aside * frequencies[1], np.exp(middle - 0.25 * (before - after) * aside)


def _squeals(times: Reals, tone: Reals, frequency: Reals, threshold: float) -> Iterator[Squeal]:
    begin = None
    for k, loud in enumerate([*tone, -math.inf]):
        if begin is None and loud >= threshold:
            begin = k
        elif begin is not None and loud < threshold - _SETTLED:
            if k - begin >= _FEWEST:
                yield _squeal(times[begin:k], tone[begin:k], frequency[begin:k], k == tone.size)
            begin = None


def _squeal(times: Reals, tone: Reals, frequency: Reals, goes_on: bool) -> Squeal:
    high = np.flatnonzero(tone >= tone.max() - _TOP)
    first = int(high[0])
    last = int(high[-1])
    return Squeal(
        begin=float(times[0]),
        end=float(times[-1]),
        frequency=float(frequency[high].mean()),
        lowest=float(frequency[high].min()),
        highest=float(frequency[high].max()),
        level=float(tone.max()),
        growth=_slope(times[: first + 1], tone[: first + 1]),
        decay=math.nan if goes_on else -_slope(times[last:], tone[last:]),
    )


def _slope(times: Reals, tone: Reals) -> float:
    """Slope of the amplitude's logarithm [1/s]; NaN over too few windows."""
    return float(np.polyfit(times, tone, 1)[0]) / _NEPER if times.size >= _FEWEST else math.nan
