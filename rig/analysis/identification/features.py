"""Runs that are no cycles: growth and decay of a vibration, stages of a protocol, transients.

growth      the column vibrates about steady sliding: growth rate and frequency, from a fit of x = exp(s t) (A cos w t +
            B sin w t) + C, beside the eigenvalue of the nearest frequency
stages      mean, or largest deflection, of each hold of the protocol, which the scene runs too
transient   the whole column, as of a run-up, beside a simulation of the protocol, in windows that grow: over the whole
            of it a wrong phase would lead to a wrong answer. Its clusters are twenty parts of the time
response    the lines of nineteen parts of the column beside those of the rig linearised about steady sliding, which
            the measured input drives. Both pass the same window, so that the same lines leak into their neighbours.
            Each line has the error of what does not follow the input; a part is a cluster

Errors of growth and few stages are known from the data; those of ten stages or more and of a transient follow
from clusters: holds, or parts of the time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.analysis.identification.cycles import LEAST, hotelling
from rig.analysis.identification.responses import Response, cycle_response
from rig.analysis.identification.runs import LARGEST, TRANSIENT, Column, Measured
from rig.analysis.identification.slips import MEASURES, noise_of
from rig.analysis.linear.control_loop import plant
from rig.analysis.linear.modes import at_rest
from rig.bench.run.simulate import simulate
from rig.errors import Singular, UsageError
from rig.printable import counted
from rig.record.run import Reals
from rig.scenes.protocol import Hold, duration_ns
from rig.scenes.scene import Scene
from rig.scenes.sections import unrolled

PARTS = 20
"""Parts of a transient or of a response, which are clusters."""
WINDOWS = (0.07, 0.15, 0.3, 0.6, 1.0)
"""Shares of a transient that are fitted one after the other."""
_FIFTHS = 5  # parts of the late half of a hold, whose means scatter by its error
_ROUNDS = 4  # of the fit of a delay
_HELD = 6.0  # times the noise: bend at a sample that the instrument held
_ROUGH = 2.0  # times the noise: largest rms of a transient that fits
_SETTLED = 0.5  # share of a hold after which its mean is taken
_SKIP = 3  # samples that are left out of a vibration: the instrument does not yet read it alone
_BANDS = 3  # of lines, in which the rest of a response is tested
_STRONG = 1e-3  # of the largest power of an input: lines that are used
_NEIGHBOURS = 11  # lines over which the power of what does not follow the input is averaged
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
        if run.kind == TRANSIENT:
            values = tuple(_without_drop_outs(column.v) for column in run.columns)
            return cls(run, values, tuple(np.full(v.size, noise_of(v)) for v in values), False)
        if run.input is not None:
            of_columns = [lines(run.input, column, column.on(column)) for column in run.columns]
            values = tuple(Z.view(float) for _, _, Z in of_columns)
            return cls(run, values, tuple(_unexplained(U, Z) for _, U, Z in of_columns), False)
        if run.kind == "growth":
            pairs = [_growth(run, column) for column in run.columns]
        else:
            pairs = [_stages(run, column, scene) for column in run.columns]
        known = run.kind != "stages" or pairs[0][0].size < LEAST  # holds scatter by more than their noise: drift
        return cls(run, tuple(v for v, _ in pairs), tuple(e for _, e in pairs), known)

    @property
    def begins(self) -> Reals:
        """One entry for each cluster or feature."""
        if self.run.input is not None:
            count = PARTS - 1
        elif self.run.kind == TRANSIENT:
            count = PARTS
        else:
            count = sum(v.size for v in self.values)
        return np.arange(count, dtype=float)

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
            if self.run.kind == TRANSIENT:
                predicted = self._delayed(i, predicted, float(offsets[i]))
            if self.run.input is not None:
                predicted = self._turned(i, predicted.reshape(v.shape))
            shift = 0.0 if self.run.kind == "growth" else float(offsets[i])
            apart = np.nan_to_num((v - predicted - shift) / error)
            if self.run.kind == TRANSIENT:
                apart[int(self.share * apart.size) :] = 0.0
                apart = np.pad(apart, (0, -apart.size % PARTS)).reshape(PARTS, -1)
            elif not self.known and apart.ndim == 1:
                apart = apart[:, None]
            rows.append(apart if apart.ndim == 2 else apart[None])
        return np.concatenate(rows, axis=1)

    def fitted(self, column: int, model: Response, offset: float) -> tuple[Reals, Reals]:
        """The model of the features of a column, one row, and their numbers."""
        numbers = np.arange(float(self.values[column].size))
        return self._predicted(column, model)[None] + offset, numbers[None]

    def _delayed(self, column: int, wave: Reals, offset: float) -> Reals:
        """A simulated column with the delay [samples] that fits best, as of an instrument."""
        v = self.values[column]
        at = np.arange(float(wave.size))
        delay = 0.0
        end = max(int(self.share * v.size), 2)
        for _ in range(_ROUNDS):
            late = np.interp(at - delay, at, wave)
            rate = np.gradient(late)[:end]
            miss = np.nan_to_num(v - offset - late)[:end]
            by = rate @ miss / max(float(rate @ rate), 1e-300)
            delay -= float(np.clip(by, -2.0, 2.0))
        return np.interp(at - delay, at, wave)

    def _turned(self, column: int, predicted: Reals) -> Reals:
        """Lines of a model with the delay [s] that fits best, as of an instrument."""
        assert self.run.input is not None
        f, _, _ = lines(self.run.input, self.run.columns[column], self.run.columns[column].v)
        Z = np.ascontiguousarray(self.values[column]).view(complex)
        size = self.errors[column][::2]
        Y = np.ascontiguousarray(predicted).view(complex)
        for _ in range(_ROUNDS):
            rate = -2j * math.pi * f * Y / size
            along = (np.conj(rate) * (Z - Y) / size).sum().real
            delay = along / max((np.abs(rate) ** 2).sum(), 1e-300)
            Y = Y * np.exp(-2j * math.pi * f * delay)
        return np.asarray(Y.view(float))

    def _predicted(self, column: int, model: Response) -> Reals:
        v = self.values[column]
        wave = model.waves[column]
        return _nearest(v, wave) if self.run.kind == "growth" else wave[: v.size]

    def misfit(self, left: Reals) -> float:
        """The probability of a larger misfit: of chi-squared with known errors, else of the mean over clusters."""
        from scipy import stats

        if self.known:
            return float(stats.chi2.sf(float((left**2).sum()), left.size))
        if self.run.input is not None:
            _, U, Z = lines(self.run.input, self.run.columns[0], self.run.columns[0].v)
            left_lines = np.ascontiguousarray(left[:, : 2 * Z.shape[1]]).view(complex)
            across = np.conj(U) * left_lines
            sums = np.array([part.sum(axis=1) for part in np.array_split(across, _BANDS, axis=1)])
            return hotelling(np.concatenate([sums.real, sums.imag]).T)
        if self.run.kind == TRANSIENT and float((left**2).mean()) > _ROUGH**2:
            return 0.0  # one run has no scatter of its own: what exceeds the noise so far is a misfit
        means = left.mean(axis=1)
        return float(stats.ttest_1samp(means, 0.0).pvalue) if np.ptp(means) > 0.0 else math.nan

    def covariance(self, *_: Any) -> Reals:
        """No measures of cycles."""
        return np.zeros((len(MEASURES), len(MEASURES)))

    def model_measures(self, *_: Any) -> None:
        """No measures of cycles."""

    def bias(self, *_: Any) -> Reals:
        """No measures of cycles."""
        return np.zeros(len(MEASURES))


def _without_drop_outs(v: Reals) -> Reals:
    """Samples, missing where an instrument has held its last value or none: far from the line between its neighbours.

    As large a bend of another kind is the motion, such as the begin of a stick.
    """
    held = (v[1:-1] == v[:-2]) | (v[1:-1] == 0.0)
    bends = np.abs(v[1:-1] - 0.5 * (v[:-2] + v[2:]))
    known = v.copy()
    known[1:-1][held & (bends > _HELD * noise_of(v))] = math.nan
    return known


def lines(drive: Column, column: Column, v: Reals) -> tuple[Reals, Any, Any]:
    """Frequencies [Hz] where the input `drive` of a response has power, and the lines [part, line] of it and of `v`."""
    U = _lines(drive.on(column))
    Z = _lines(v)
    power = (np.abs(U) ** 2).mean(axis=0)
    strong = power > _STRONG * power.max()
    f = (1.0 + np.flatnonzero(strong)) * column.rate / (v.size // PARTS)
    return f, U[:, strong], np.ascontiguousarray(Z[:, strong])


def _lines(v: Reals) -> Any:
    """The lines of the parts under a window of Hann; the first part depends on what was before it."""
    parts = v[: v.size // PARTS * PARTS].reshape(PARTS, -1)[1:]
    return np.fft.rfft(parts * np.hanning(parts.shape[1]))[:, 1:]


def responses(U: Any, Z: Any) -> Any:
    """The frequency response of lines `Z` [part, line] to those of an input."""
    return (np.conj(U) * Z).sum(axis=0) / (np.abs(U) ** 2).sum(axis=0)


def _unexplained(U: Any, Z: Any) -> Reals:
    """The errors of real and imaginary parts of lines, from what does not follow the input, over neighbours."""
    from scipy.ndimage import uniform_filter1d

    unexplained = Z - responses(U, Z) * U
    power = (np.abs(unexplained) ** 2).sum(axis=0) / (len(Z) - 1)
    errors = np.sqrt(0.5 * uniform_filter1d(power, _NEIGHBOURS))
    return np.asarray(np.repeat(errors, 2))


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

    step = float(t[1] - t[0])
    count = 8 * len(x)
    spectrum = np.abs(np.fft.rfft(x - x.mean(), count))
    first = 2.0 * np.pi * float(np.fft.rfftfreq(count, step)[spectrum.argmax()])
    best = None
    for sign in (-1.0, 1.0):
        guess = np.array([sign * 0.05 * first, first])
        size = np.abs(guess)
        ended = least_squares(lambda p: _rest(t, x, *p), guess, x_scale=size, ftol=1e-14, xtol=1e-14, gtol=1e-14)
        best = ended if best is None or ended.cost < best.cost else best
    assert best is not None
    variance = 2.0 * best.cost / max(x.size - 5, 1)
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    errors = np.sqrt(np.diag(covariance) * variance)
    return float(best.x[0]), float(best.x[1]), errors


def _rest(t: Reals, x: Reals, s: float, w: float) -> Reals:
    rings = t - t[0]
    largest = rings[-1] if s > 0.0 else 0.0
    size = np.exp(s * (rings - largest))
    shapes = np.stack((size * np.cos(w * rings), size * np.sin(w * rings), np.ones_like(rings)), axis=1)
    factors = np.linalg.lstsq(shapes, x, rcond=None)[0]
    return np.asarray(x - shapes @ factors)


def _growth(run: Measured, column: Column) -> tuple[Reals, Reals]:
    known = np.isfinite(column.v)
    t = column.t[known][_SKIP:]
    x = column.v[known][_SKIP:]
    if x.size < 20:
        raise UsageError(
            f"{run.name}: {column.name} has {counted(x.size, 'sample')}; a growth or decay needs at least 20"
        )
    s, w, errors = vibration(t, x)
    return np.array([s, w]), errors


def holds(protocol: Iterable[Any], last: float) -> Iterator[tuple[float, float]]:
    """Begin and end [s] of each hold of a protocol without waits that begins before `last`."""
    now = 0
    for step in unrolled(protocol):
        if now * 1e-9 > last:
            break
        length = duration_ns(step)
        if isinstance(step, Hold):
            yield now * 1e-9, (now + length) * 1e-9
        now += length


def stages(t: Reals, v: Reals, protocol: Sequence[Any], feature: str) -> tuple[Reals, Reals]:
    """The mean of the second half of each hold, or its largest distance from the first sample; and the errors.

    The error of a mean follows from those of fifths of it, over all holds.
    """
    values = []
    spreads = []
    step = float(np.nanmedian(np.abs(np.diff(v))))
    for begin, end in holds(protocol, float(t[-1])):
        late = v[(t >= begin + _SETTLED * (end - begin)) & (t < end)]
        held = v[(t >= begin) & (t < end)]
        if late.size < 2 * _FIFTHS:
            continue
        if feature == LARGEST:
            values.append(float(np.nanmax(held) - v[0]))
            spreads.append(2.0 * noise_of(v) + step)
        else:
            values.append(float(np.nanmean(late)))
            means = [np.nanmean(part) for part in np.array_split(late, _FIFTHS)]
            spreads.append(float(np.std(means, ddof=1)))
    averaged = 1.0 if feature == LARGEST else math.sqrt(_FIFTHS)
    spread = float(np.sqrt(np.mean(np.square(spreads or [0.0])))) / averaged
    steps = np.abs(np.diff(v))
    smallest = float(steps[steps > 0.0].min(initial=0.5 * float(np.ptp(v))))
    rounded = smallest / math.sqrt(12.0)  # no mean helps against it
    error = math.hypot(spread, rounded) + 1e-9 * float(np.ptp(v))
    return np.array(values), np.full(len(values), error)


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
        rows = [*(_simulated if run.input is None else _driven)(scene, run)]
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
    simulated = simulate(bare, duration_ns=round((last + 0.01) * 1e9))
    for column in run.columns:
        v = np.interp(column.t, simulated.time, simulated.signals[column.output])
        yield stages(column.t, v, scene.protocol, column.feature)[0] if run.kind == "stages" else v


def _driven(scene: Scene, run: Measured) -> Iterator[Reals]:
    """The lines of the columns, of the rig linearised about steady sliding and driven by the measured input.

    Each of its vibration modes is a filter of the first order, exact for lines between the samples of the input.
    """
    from scipy.signal import lfilter

    assert run.input is not None
    p = plant(scene)
    rates, shapes = np.linalg.eig(p.A)
    place = p.inputs.index(run.input.output)
    into = np.linalg.solve(shapes, p.B[:, place])
    for column in run.columns:
        row = p.outputs.index(column.output)
        z = rates / column.rate
        drive = run.input.on(column)
        small = np.abs(z) < 1e-4
        safe = np.where(small, 1.0, z)
        late = np.where(small, 0.5 + z / 6.0, (np.expm1(safe) - safe) / safe**2)
        early = np.where(small, 1.0 + 0.5 * z, np.expm1(safe) / safe) - late
        v = p.D[row, place] * drive
        gains = into * (p.C[row] @ shapes) / column.rate
        for gain, a, b, end in zip(gains, late, early, np.exp(z)):
            v = v + (gain * lfilter([a, b], [1.0, -end], drive)).real
        _, _, Z = lines(run.input, column, v)
        yield Z.view(float).ravel()
