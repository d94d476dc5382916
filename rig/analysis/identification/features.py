"""Runs that are no cycles: growth and decay of a vibration, stages of a protocol, transients.

growth      the column vibrates about steady sliding: growth rate and frequency, from a fit of x = exp(s t) (A cos w t +
            B sin w t) + C, beside the eigenvalue of the nearest frequency
stages      mean, or largest deflection, of each hold of the protocol, which the scene runs too
transient   the whole column, as of a run-up, beside a simulation of the protocol, in windows that grow: over the whole
            of it a wrong phase would lead to a wrong answer. Its clusters are twenty parts of the time

Errors of growth and few stages are known from the data; those of ten stages or more and of a transient follow
from clusters: holds, or parts of the time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.analysis.identification.cycles import LEAST, MEASURES, noise_of
from rig.analysis.identification.responses import Response, cycle_response
from rig.analysis.identification.runs import LARGEST, Column, Measured
from rig.analysis.modes import at_rest
from rig.bench.run.simulate import simulate
from rig.errors import Singular, UsageError
from rig.record.run import Reals
from rig.scenes.protocol import Hold, Repeat
from rig.scenes.scene import Scene

PARTS = 20
WINDOWS = (0.07, 0.15, 0.3, 0.6, 1.0)
"""Shares of a transient that are fitted one after the other."""
_FIFTHS, _ROUNDS = 5, 4
_ROUGH = 2.0  # times the noise: largest rms of a transient that fits
_SETTLED = 0.5  # share of a hold after which its mean is taken
_SKIP = 3  # samples that are left out of a vibration: the instrument does not yet read it alone
_NONE = np.full(len(MEASURES), np.nan)


@dataclass(frozen=True)
class FeatureRun:
    """A run with the features [column][feature] of its columns, their errors, and what a model leaves of them."""

    run: Measured
    values: tuple[Reals, ...]
    errors: tuple[Reals, ...]
    known: bool
    """Whether the errors are known; else they follow from clusters."""
    share: float = 1.0
    """Of a transient that is fitted."""
    scatter: float = 0.0
    dropped: int = 0

    @classmethod
    def of(cls, run: Measured, scene: Scene) -> FeatureRun:
        """Read the features of a run. Raises UsageError."""
        if run.kind == "transient":
            values = tuple(column.v for column in run.columns)
            return cls(run, values, tuple(np.full(v.size, noise_of(v)) for v in values), False)
        read = {"growth": _growth, "stages": _stages}[run.kind]
        pairs = [read(run, column, scene) for column in run.columns]
        known = run.kind != "stages" or pairs[0][0].size < LEAST  # holds scatter by more than their noise: drift
        return cls(run, tuple(v for v, _ in pairs), tuple(e for _, e in pairs), known)

    @property
    def begins(self) -> Reals:
        """One entry for each cluster or feature."""
        return np.arange(PARTS if self.run.kind == "transient" else sum(v.size for v in self.values), dtype=float)

    @property
    def samples(self) -> tuple[Reals, ...]:
        """The features as one cluster of each column."""
        return tuple(v[None] for v in self.values)

    @property
    def medians(self) -> Reals:
        """No measures of cycles."""
        return _NONE

    def left(self, model: Response, offsets: Reals) -> Reals:
        """What a model leaves of the features over their errors, [cluster, feature]."""
        rows = []
        for i, (v, error) in enumerate(zip(self.values, self.errors)):
            predicted = self._predicted(i, model)
            if self.run.kind == "transient":
                predicted = self._delayed(i, predicted, float(offsets[i]))
            shift = 0.0 if self.run.kind == "growth" else float(offsets[i])
            apart = np.nan_to_num((v - predicted - shift) / error)
            if self.run.kind == "transient":
                apart[int(self.share * apart.size) :] = 0.0
                apart = np.pad(apart, (0, -apart.size % PARTS)).reshape(PARTS, -1)
            elif not self.known:
                apart = apart[:, None]
            rows.append(apart if apart.ndim == 2 else apart[None])
        return np.concatenate(rows, axis=1)

    def fitted(self, column: int, model: Response, offset: float) -> tuple[Reals, Reals]:
        """The model of the features of a column, one row, and their numbers."""
        return self._predicted(column, model)[None] + offset, np.arange(float(self.values[column].size))[None]

    def _delayed(self, column: int, wave: Reals, offset: float) -> Reals:
        """A simulated column with the delay [samples] that fits best, as of an instrument."""
        v, at, delay = self.values[column], np.arange(float(wave.size)), 0.0
        end = max(int(self.share * v.size), 2)
        for _ in range(_ROUNDS):
            late = np.interp(at - delay, at, wave)
            rate = np.gradient(late)[:end]
            miss = np.nan_to_num(v - offset - late)[:end]
            delay -= float(np.clip(rate @ miss / max(float(rate @ rate), 1e-300), -2.0, 2.0))
        return np.interp(at - delay, at, wave)

    def _predicted(self, column: int, model: Response) -> Reals:
        v, wave = self.values[column], model.waves[column]
        return _nearest(v, wave) if self.run.kind == "growth" else wave[: v.size]

    def misfit(self, left: Reals) -> float:
        """The probability of a larger misfit: of chi-squared with known errors, else of the mean over clusters."""
        from scipy import stats

        if self.known:
            return float(stats.chi2.sf(float((left**2).sum()), left.size))
        if self.run.kind == "transient" and float((left**2).mean()) > _ROUGH**2:
            return 0.0  # one run has no scatter of its own: what exceeds the noise so far is a misfit
        means = left.mean(axis=1)
        return float(stats.ttest_1samp(means, 0.0).pvalue) if np.ptp(means) > 0.0 else math.nan

    def covariance(self, seed: int) -> Reals:
        """No measures of cycles."""
        del seed
        return np.zeros((len(MEASURES), len(MEASURES)))

    def model_measures(self, model: Response) -> None:
        """No measures of cycles."""
        del model

    def bias(self, model: Response) -> Reals:
        """No measures of cycles."""
        del model
        return np.zeros(len(MEASURES))

    def windowed(self, share: float) -> FeatureRun:
        """The run with another share of its transient."""
        return replace(self, share=share)


def _nearest(v: Reals, rates: Reals) -> Reals:
    """Growth and frequency of the eigenvalue whose frequency is nearest to the measured one."""
    growth, omega = rates.reshape(2, -1)
    i = int(np.argmin(np.abs(omega - v[1])))
    return np.array([growth[i], omega[i]])


def vibration(t: Reals, x: Reals) -> tuple[float, float, Reals]:
    """Growth rate s [1/s] and frequency w [rad/s] of x = exp(s t) (A cos w t + B sin w t) + C, and their errors.

    t: evenly spaced [s].
    """
    from scipy.optimize import least_squares

    step, count = float(t[1] - t[0]), 8 * len(x)
    spectrum = np.abs(np.fft.rfft(x - x.mean(), count))
    first = 2.0 * np.pi * float(np.fft.rfftfreq(count, step)[spectrum.argmax()])
    best = None
    for sign in (-1.0, 1.0):
        guess = np.array([sign * 0.05 * first, first])
        ended = least_squares(
            lambda p: _rest(t, x, *p), guess, x_scale=np.abs(guess), ftol=1e-14, xtol=1e-14, gtol=1e-14
        )
        best = ended if best is None or ended.cost < best.cost else best
    assert best is not None
    variance = 2.0 * best.cost / max(x.size - 5, 1)
    errors = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)) * variance)
    return float(best.x[0]), float(best.x[1]), errors


def _rest(t: Reals, x: Reals, s: float, w: float) -> Reals:
    rings = t - t[0]
    size = np.exp(s * (rings - (rings[-1] if s > 0.0 else 0.0)))
    shapes = np.stack((size * np.cos(w * rings), size * np.sin(w * rings), np.ones_like(rings)), axis=1)
    return np.asarray(x - shapes @ np.linalg.lstsq(shapes, x, rcond=None)[0])


def _growth(run: Measured, column: Column, scene: Scene) -> tuple[Reals, Reals]:
    del scene
    known = np.isfinite(column.v)
    t, x = column.t[known][_SKIP:], column.v[known][_SKIP:]
    if x.size < 20:
        raise UsageError(f"{run.name}: {column.name} has {x.size} samples; a growth or decay needs at least 20")
    s, w, errors = vibration(t, x)
    return np.array([s, w]), errors


def holds(protocol: Iterable[Any]) -> list[tuple[float, float]]:
    """Begin and end [s] of each hold of a protocol without waits."""
    made, now = [], 0
    for step in _unrolled(protocol):
        length = getattr(step, "time", 0) or getattr(step, "over", 0)
        if isinstance(step, Hold):
            made.append((now * 1e-9, (now + length) * 1e-9))
        now += length
    return made


def _unrolled(steps: Iterable[Any]) -> Iterator[Any]:
    for step in steps:
        if isinstance(step, Repeat):
            for _ in range(int(step.times)):
                yield from _unrolled(step.steps)
        else:
            yield step


def stages(t: Reals, v: Reals, protocol: Sequence[Any], feature: str) -> tuple[Reals, Reals]:
    """The mean of the second half of each hold, or its largest distance from the first sample; and the errors.

    The error of a mean follows from those of fifths of it, over all holds.
    """
    values, spreads = [], []
    step = float(np.nanmedian(np.abs(np.diff(v))))
    for begin, end in holds(protocol):
        late = v[(t >= begin + _SETTLED * (end - begin)) & (t < end)]
        here = v[(t >= begin) & (t < end)]
        if late.size < 2 * _FIFTHS:
            continue
        if feature == LARGEST:
            values.append(float(np.nanmax(here) - v[0]))
            spreads.append(2.0 * noise_of(v) + step)
        else:
            values.append(float(np.nanmean(late)))
            spreads.append(float(np.std([np.nanmean(part) for part in np.array_split(late, _FIFTHS)], ddof=1)))
    spread = float(np.sqrt(np.mean(np.square(spreads or [0.0])))) / (1.0 if feature == LARGEST else math.sqrt(_FIFTHS))
    steps = np.abs(np.diff(v))
    rounded = float(steps[steps > 0.0].min(initial=0.5 * float(np.ptp(v)))) / math.sqrt(
        12.0
    )  # no mean helps against it
    return np.array(values), np.full(len(values), math.hypot(spread, rounded) + 1e-9 * float(np.ptp(v)))


def _stages(run: Measured, column: Column, scene: Scene) -> tuple[Reals, Reals]:
    values, errors = stages(column.t, column.v, scene.protocol, column.feature)
    if not values.size:
        raise UsageError(f"{run.name}: the protocol of {scene.name} has no hold within the record")
    return values, errors


def respond(scene: Scene, run: Measured) -> Response | str:
    """What the scene does in a run: its limit cycle, or its features, waves [column, feature] padded with zeros."""
    if run.kind == "cycles":
        return cycle_response(scene, run)
    if run.kind == "growth":
        try:
            _, at = at_rest(scene)
        except Singular as fault:
            return fault.why
        rates = at.eigenvalues()
        rates = rates[rates.imag > 0.0]
        if not rates.size:
            return "nothing vibrates about sliding: every eigenvalue is real"
        rows = [np.concatenate([rates.real, rates.imag])] * len(run.columns)
    else:
        rows = [*_simulated(scene, run)]
    waves = np.zeros((len(rows), max(row.size for row in rows)))
    for wave, row in zip(waves, rows):
        wave[: row.size] = row
    return Response(math.nan, 0.0, np.full(len(rows), math.nan), waves)


def _simulated(scene: Scene, run: Measured) -> Iterator[Reals]:
    """The columns, or their stages, of a run of the protocol without noise."""
    parameters = scene.parameters
    if getattr(parameters, "noise", None) is not None:
        parameters = parameters.model_copy(update={"noise": None})
    bare = replace(scene, parameters=parameters, sensors={}, controllers={})
    last = max(float(column.t[-1]) for column in run.columns)
    made = simulate(bare, duration_ns=round((last + 0.01) * 1e9))
    for column in run.columns:
        v = np.interp(column.t, made.time, made.signals[column.output])
        yield stages(column.t, v, scene.protocol, column.feature)[0] if run.kind == "stages" else v
