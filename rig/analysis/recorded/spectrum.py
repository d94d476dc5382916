"""Spectrum of one signal of a recording over frequency, with a map of its course.

Density, map and lines are those of rig.analysis.recorded.density. A gap of up to four samples is bridged by a straight
line. Windows with a longer gap are left out, and counted. Stretches that lie far apart, such as two days, are averaged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

from rig.analysis.recorded.density import (
    FEWEST,
    PARTS,
    Averaged,
    joined_densities,
    peaks,
    short_time,
    welch,
)
from rig.analysis.recorded.moving_windows import slowest
from rig.analysis.recorded.orders import Orders, orders
from rig.analysis.recorded.series import Series, of_spans, scene_name, spans, vibration
from rig.errors import Faults, UsageError
from rig.printable import counted
from rig.record.run import Run
from rig.record.run_data import bridge
from rig.results import Result, Table

_OF_MAP = 80  # the same of a spectrogram, whose windows are shorter to show the course
_ONE_RATE = 1e-3  # of the rate: stretches whose rates differ by less are averaged
_PERIODS = 5.0  # smallest number of periods of the slowest strong vibration in a default window of the spectrogram


@dataclass(frozen=True)
class Spectrum(Averaged):
    """The result of `spectrum`: `window` [s] of the density, `map_window` [s] of the spectrogram; `bridged` samples.

    `orders`: the same over a speed or an angle, if it was asked for.
    """

    FIGURE: ClassVar = "rig.analysis.recorded.figures:spectrum_figure"
    AXIS: ClassVar = "frequency"

    rate: float
    start: float
    seconds: float
    orders: Orders | None = None

    def shown(self) -> Iterator[str | Table | Result]:
        """Yield the settings and the strongest lines, and the orders."""
        d = self.density
        span = f"{self.start:.5g} to {self.start + self.seconds:.5g} s"
        windows = f"{counted(d.windows, 'Hann window')} of {self.window:.4g} s"
        yield f"{self.scene}: spectrum of {self.name} [{self.unit}], {span} at {self.rate:.6g} Hz"
        yield f"  power spectral density: mean of {windows}, half overlapping; lines {d.step:.4g} Hz apart"
        yield f"  spectrogram: Hann windows of {self.map_window:.4g} s, lines {self.map.f[1]:.4g} Hz apart"
        yield from self._report()
        if self.orders:
            yield ""
            yield self.orders

    def facts(self) -> dict[str, Any]:
        """Return the settings; the density is in `csv`."""
        return super().facts() | {
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
    none: list[Series] = []
    parts = faults(lambda: _parts(run, name or vibration(run), first, last), none)
    signal = max(parts, key=lambda part: part.v.size, default=None)
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
    samples = [bridge(part.v) for part in parts]
    density = joined_densities([welch(v, signal.rate, count) for v, _ in samples])
    if not density.windows:
        raise UsageError(
            f"{signal.name}: every window of {count / signal.rate:.4g} s has gaps; {signal.notes()}. Take a shorter "
            "window or another range of time"
        )
    return Spectrum(
        scene_name(run),
        signal.name,
        signal.unit,
        count / signal.rate,
        density,
        peaks(density),
        short / signal.rate,
        short_time(samples[parts.index(signal)][0], signal.rate, short, signal.start),
        sum(bridged for _, bridged in samples),
        _notes(parts, signal, count),
        signal.rate,
        parts[0].start,
        parts[-1].start + parts[-1].seconds - parts[0].start,
        turned,
    )


def _parts(run: Run, name: str, first: float, last: float) -> list[Series]:
    """The stretches of a channel that lie far apart. Raises UsageError where their rates differ."""
    parts = of_spans(run, name, spans(run, name, first, last))
    rates = [part.rate for part in parts]
    if max(rates) > (1.0 + _ONE_RATE) * min(rates):
        raise UsageError(
            f"{parts[0].name}: its stretches are sampled at {min(rates):.6g} to {max(rates):.6g} Hz; take one of them "
            "(--from, --to)"
        )
    return parts


def _notes(parts: list[Series], longest: Series, count: int) -> str:
    """The missing samples of a channel, and its stretches, in words."""
    notes = [part.notes() for part in parts]
    if len(parts) > 1:
        told = [f"{part.start:.9g} to {part.start + part.seconds:.9g} s" for part in parts]
        short = [span for span, part in zip(told, parts, strict=True) if part.v.size < count]
        notes.append(f"each window lies in one of {len(parts)} stretches: {', '.join(told)}")
        notes.append(f"the spectrogram is that of the longest, from {longest.start:.9g} s")
        notes += [f"shorter than a window: {', '.join(short)}"] if short else []
    return "; ".join(dict.fromkeys(filter(None, notes)))


def length(signal: Series, window: float | None) -> int:
    """Return the samples of a window of `window` [s], or of the default window. Raises UsageError."""
    if signal.v.size < FEWEST:
        raise UsageError(
            f"{signal.name}: {counted(signal.v.size, 'sample')} at {signal.rate:g} Hz; a spectrum needs at least "
            f"{FEWEST}. Take a longer range of time or a faster channel"
        )
    if window is None:
        return max(signal.v.size // PARTS, FEWEST)
    if not FEWEST / signal.rate * (1.0 - 1e-9) <= window <= signal.seconds * (1.0 + 1e-9):
        raise UsageError(
            f"window {window:g} s: must be {FEWEST / signal.rate:g} s ({FEWEST} samples of {signal.name} at "
            f"{signal.rate:g} Hz) to {signal.seconds:g} s (the recording)"
        )
    return min(round(window * signal.rate), signal.v.size)
