"""Measured cycles: where they begin, their measures, and what a model leaves of each.

The slip signal u = 1 - r / s of a column, r its rate (of a velocity its value), s that in stick, is 0 in stick. A slip
counts where u exceeds .8; it begins and ends where u passes .3, as in rig.analysis.recorded.stick_slip. Without stick,
u is how far the column lies below its middle. The same code reads a measurement and the periods of a model, so that its
filter is a part of both. The bias by instrument noise is measured on the periods of a model.

    r_ij = (y_i - o - w(t_i - s_j)) / sigma       cycle j, w a period of the model, s_j its shift, o an offset

A shift for each cycle takes up delay, drift of the phase and jitter. In stick the state is known, so that each stick
forgets the past and cycles are nearly independent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rig.analysis.identification.responses import Response
from rig.analysis.identification.runs import MOTIONS, Measured
from rig.errors import UsageError
from rig.printable import counted
from rig.record.run import Reals
from rig.record.run_data import bridge

LEAST = 10
"""Fewest cycles of a run."""
SAMPLED = 20
"""Fewest samples of a motion between two sticks."""
REPEATS = 0.05
"""Largest scatter (standard deviation of the logarithm) of the periods of cycles that repeat."""
MEASURES = ("period", "stick", "motion", "drop", "level", "peak")
SCREEN, LASTING = (1, 2, 3, 4, 5), (0, 2, 3, 4)
"""Measures that are fitted: where cycles repeat, and where they do not. A period is stick and motion, and a short stick
scatters most."""
EXACT = 1e-4
"""Error of a measure that the detector adds."""
_LOW, _HIGH = 0.3, 0.8
_DOUBLE = 1.8  # medians: a longer period is two
_BEFORE, _AFTER = 0.35, 0.6  # of a period about the begin of a slip: what is fitted of a cycle
_FAR = 6.0  # times the usual deviation
_CUT = 2  # cycles of which the ends of a run may cut off a part
_ROUNDS = 4
_JUMP = 0.1  # of the range of a column, between two points of a period
BINS = 5


class Slips(NamedTuple):
    """Slips of a column: their begins [s] and the measures of the cycle that each ends, [cycle, MEASURES]."""

    begins: Reals
    measures: Reals


def noise_of(v: Reals) -> float:
    """Standard deviation of the noise of samples of a smooth signal, at least that of its rounding."""
    known = v[np.isfinite(v)]
    third = np.diff(known, 3)
    spread = 1.4826 * float(np.median(np.abs(third - np.median(third)))) / math.sqrt(20.0) if third.size else 0.0
    steps = np.abs(np.diff(known))
    step = float(steps[steps > 0.0].min()) if (steps > 0.0).any() else 0.0
    rounded = step / math.sqrt(12.0) if np.count_nonzero(steps == 0.0) > 0.02 * steps.size else 0.0
    return max(spread, rounded, 1e-9 * float(np.ptp(known)), 1e-300)


def window(noise: float, rate: float, slope: float, motion: float) -> int:
    """Samples (odd) over which a derivative is taken: its noise stays below a tenth of the slope, if that fits."""
    wanted = (12.0 * (noise * rate / (0.1 * abs(slope))) ** 2) ** (1.0 / 3.0) if slope else 5.0
    return int(np.clip(wanted, 5.0, max(0.33 * motion * rate, 5.0))) | 1


def slips(v: Reals, rate: float, start: float, slope: float, velocity: bool, n: int) -> Slips | None:
    """The slips of samples at `rate` from `start` on; None with less than three.

    `slope`: rate in stick; NaN: the middle of the column. `n`: window of the filter.
    """
    from scipy.ndimage import median_filter
    from scipy.signal import savgol_filter

    calm = median_filter(v, 5, mode="nearest")
    smooth = savgol_filter(calm, n, 2)
    if math.isnan(slope):
        low, high = np.percentile(smooth, (2.0, 98.0))
        u = (0.5 * (low + high) - smooth) / max(0.5 * (high - low), 1e-300)
        lower, upper = 0.0, 0.5
    else:
        u = 1.0 - (smooth if velocity else savgol_filter(calm, n, 2, deriv=1, delta=1.0 / rate)) / slope
        lower, upper = _LOW, _HIGH
    above = u > lower
    edges = np.diff(above.astype(np.int8))
    begins = np.flatnonzero(edges == 1)
    ends = np.flatnonzero(edges == -1)
    if begins.size < 3 or not ends.size:
        return None
    ends = ends[ends > begins[0]]
    begins = begins[: ends.size]
    tall = np.array([u[a : b + 2].max() > upper for a, b in zip(begins, ends)], bool)
    begins = begins[tall]
    ends = ends[tall]
    if begins.size < 4:
        return None
    t0 = start + (begins + (lower - u[begins]) / (u[begins + 1] - u[begins])) / rate
    t1 = start + (ends + (lower - u[ends]) / (u[ends + 1] - u[ends])) / rate
    up = math.copysign(1.0, slope) if not math.isnan(slope) and not velocity else 1.0
    rows = []
    for j in range(1, begins.size):
        a = begins[j]
        b = ends[j]
        before = ends[j - 1]
        first = before if math.isnan(slope) else max(a - 2, 0)  # the slip alone: what wanders in stick is no drop
        high = _peak(up * smooth[first : b + 2])
        low = -_peak(-up * smooth[a : min(b + n, smooth.size)])
        rows.append(
            (
                t0[j] - t0[j - 1],
                t0[j] - t1[j - 1],
                t1[j] - t0[j],
                high - low,
                up * 0.5 * (high + low),
                _peak(u[max(a - 1, 0) : b + 3]),
            )
        )
    made = np.array(rows)
    with np.errstate(invalid="ignore", divide="ignore"):
        made[:, [0, 1, 2, 3, 5]] = np.log(made[:, [0, 1, 2, 3, 5]])
    return Slips(t0[1:], made)


def _peak(v: Reals) -> float:
    """The largest value, by a parabola through three samples."""
    i = int(np.argmax(v))
    if 0 < i < v.size - 1:
        before, here, after = v[i - 1 : i + 2]
        if (bend := before - 2.0 * here + after) < 0.0:
            return float(here - (after - before) ** 2 / (8.0 * bend))
    return float(v[i])


@dataclass(frozen=True)
class CycleRun:
    """The cycles of a run, and what a model leaves of them. `slope`: rate of the first column in stick."""

    run: Measured
    slope: float
    n: int
    sigma: Reals
    begins: Reals
    measures: Reals
    """[cycle, MEASURES] of the cycles that are kept."""
    dropped: int
    samples: tuple[Reals, ...]
    """Of each column [cycle, sample]."""
    times: tuple[Reals, ...]
    """Times of the samples from the begin of the cycle [s]."""
    expected: Reals | float = 0.0
    """What the right law leaves of the mean cycle, over the noise of the columns: process noise moves it."""
    share: float = 0.0
    """Variance of the error of `expected` over that of the mean cycle."""

    @classmethod
    def of(cls, run: Measured, model: Response) -> CycleRun:
        """Find the cycles of a run, for the stick and motion of a model. Raises UsageError for what cannot be used."""
        column = run.columns[0]
        slope = float(model.slopes[0])
        motion = model.period - model.stick
        if motion * column.rate < SAMPLED:
            raise UsageError(
                f"{run.name}: {column.name} has {motion * column.rate:.3g} samples in a motion of {motion:.3g} s "
                f"between two sticks; at least {SAMPLED} are needed: sample at {SAMPLED / motion:.3g} Hz or more"
            )
        for each, wave in zip(run.columns, model.waves):
            if each.unit not in MOTIONS and np.abs(np.diff(wave)).max() > _JUMP * np.ptp(wave):
                raise UsageError(
                    f"{run.name}: {each.name} reads {each.output}, which jumps where a motion ends: cycles are fitted "
                    "to displacements and velocities; leave this column out"
                )
        v, _ = bridge(column.v)
        lost = ~np.isfinite(v)
        v = np.interp(np.arange(v.size), np.flatnonzero(~lost), v[~lost]) if lost.any() else v
        sigma = noise_of(v)
        n = window(sigma, column.rate, 0.0 if math.isnan(slope) else slope, motion)
        if n >= v.size:
            raise UsageError(
                f"{run.name}: {column.name} has {counted(v.size, 'sample')}; record at least {LEAST} cycles"
            )
        detected = slips(v, column.rate, column.start, slope, column.unit.endswith("/s"), n)
        if detected is None:
            raise UsageError(
                f"{run.name}: {column.name} shows no cycles of stick and slip in {run.seconds:.4g} s: it slides "
                f"steadily, stays at rest, or ends too early; at least {LEAST} are needed: record longer, choose a "
                "speed at which the rig vibrates, or leave the run out"
            )
        kept = _usable(detected.measures)
        count = len(detected.begins)
        for a, b in zip(*_gaps(lost)):
            times = detected.begins
            before = column.start + a / column.rate
            after = column.start + b / column.rate
            kept &= ~((times > before) & (times - np.exp(detected.measures[:, 0]) < after))
        begins = detected.begins
        T = float(np.exp(np.median(detected.measures[kept, 0]))) if kept.any() else 0.0
        places = [
            np.rint((begins - _BEFORE * T - each.start) * each.rate).astype(np.int64)[:, None]
            + np.arange(int((_BEFORE + _AFTER) * T * each.rate))
            for each in run.columns
        ]
        within = [(at[:, :1] >= 0) & (at[:, -1:] < each.v.size) for at, each in zip(places, run.columns)]
        whole = kept & np.all(within, axis=(0, 2))
        samples = [bridge(each.v)[0][at[whole]] for at, each in zip(places, run.columns)]
        times_ = [each.start + at[whole] / each.rate - begins[whole, None] for at, each in zip(places, run.columns)]
        fine = np.all([np.isfinite(s).all(axis=1) for s in samples], axis=0)
        if (used := min(int(kept.sum()), int(fine.sum()) + _CUT)) < LEAST:
            raise UsageError(
                f"{run.name}: {used} of {count} cycles in {run.seconds:.4g} s of {column.name} can be used; "
                f"at least {LEAST} are needed: record longer, or check its speed, load and scale, or leave the run out"
            )
        sigmas = np.array([noise_of(each.v) for each in run.columns])
        return cls(
            run,
            slope,
            n,
            sigmas,
            begins[whole][fine],
            detected.measures[whole][fine],
            count - int(fine.sum()),
            tuple(s[fine] for s in samples),
            tuple(t[fine] for t in times_),
        )

    @property
    def period(self) -> float:
        """Median period [s]."""
        return float(np.exp(np.median(self.measures[:, 0])))

    @cached_property
    def scatter(self) -> float:
        """Standard deviation of the logarithm of the period, of a robust fit."""
        logs = self.measures[:, 0]
        return 1.4826 * float(np.median(np.abs(logs - np.median(logs))))

    @cached_property
    def medians(self) -> Reals:
        """The median of each measure."""
        return np.asarray(np.median(self.measures, axis=0))

    def covariance(self, seed: int, block: int = 20, draws: int = 400) -> Reals:
        """Covariance of the medians, by a bootstrap over blocks of consecutive cycles."""
        chance = np.random.default_rng(seed)
        count = len(self.measures)
        block = max(1, min(block, count // 5))
        first = chance.integers(0, count - block + 1, (draws, -(-count // block)))
        drawn = (first[..., None] + np.arange(block)).reshape(draws, -1)[:, :count]
        return np.atleast_2d(np.cov(np.median(self.measures[drawn], axis=1).T))

    def model_measures(self, model: Response, noise: float = 0.0, seed: int = 0, cycles: int = 12) -> Reals | None:
        """The medians of the measures that the detector reads in the periods of a model with instrument noise."""
        column = self.run.columns[0]
        count = int(cycles * model.period * column.rate) + 1
        if count <= 2 * self.n:
            return None
        v = model.at(0, np.arange(count) / (column.rate * model.period))
        if noise:
            v = v + noise * np.random.default_rng(seed).standard_normal(count)
        detected = slips(v, column.rate, 0.0, self.slope, column.unit.endswith("/s"), self.n)
        if detected is None:
            return None
        made = np.asarray(np.median(detected.measures, axis=0))
        return made if np.isfinite(made).all() else None

    def bias(self, model: Response, seed: int = 7) -> Reals:
        """What the noise of the instrument adds to the measures: with noise minus without."""
        plain = self.model_measures(model)
        noisy = self.model_measures(model, float(self.sigma[0]), seed, 60)
        return np.zeros(len(MEASURES)) if plain is None or noisy is None else noisy - plain

    def left(self, model: Response, offsets: Reals) -> Reals:
        """What a model leaves of the cycles over the noise, [cycle, samples of all columns], at the best shifts."""
        rows = [
            (self.samples[i] - self.fitted(i, model, float(offset))[0]) / self.sigma[i]
            for i, offset in enumerate(offsets)
        ]
        return np.asarray(np.concatenate(rows, axis=1) - self.expected)

    def fitted(self, column: int, model: Response, offset: float) -> tuple[Reals, Reals]:
        """The model at the samples of a column [cycle, sample], and the phases in periods of the model."""
        y = self.samples[column]
        t = self.times[column]
        T = model.period
        goal = y.mean(axis=0) - offset
        at = t.mean(axis=0)
        trial = np.arange(96) / 96.0
        apart = model.at(column, at[None, :] / T - trial[:, None]) - goal
        shift = np.full(len(y), float(trial[np.argmin((apart**2).sum(axis=1))]))
        for _ in range(_ROUNDS):
            w, rate = model.with_rate(column, t / T - shift[:, None])
            miss = y - offset - w
            by = -(rate * miss).sum(axis=1) / np.maximum((rate**2).sum(axis=1), 1e-300)
            shift += np.clip(by, -0.1, 0.1)
        phase = t / T - shift[:, None]
        return model.at(column, phase) + offset, phase

    def misfit(self, left: Reals) -> float:
        """Hotelling's test of the mean residual in phases: the probability of a larger one, if the model is right."""
        means = []
        begin = 0
        for samples in self.samples:
            part = left[:, begin : begin + samples.shape[1]]
            begin += samples.shape[1]
            means += [piece.mean(axis=1) for piece in np.array_split(part, BINS, axis=1)]
        return hotelling(np.array(means).T, self.share)


def hotelling(rows: Reals, share: float = 0.0) -> float:
    """The probability of a mean of `rows` [cluster, value] farther from zero. `share`: see `CycleRun.share`."""
    from scipy import stats

    n, p = rows.shape
    if n <= p + 2:
        return math.nan
    mean = rows.mean(axis=0)
    S = np.cov(rows.T)
    T2 = n * float(mean @ np.linalg.pinv(S, rcond=1e-12, hermitian=True) @ mean) / (1.0 + share)
    return float(stats.f.sf((n - p) / (p * (n - 1)) * T2, p, n - p))


def _usable(measures: Reals) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which cycles are one cycle, and no outlier."""
    kept = np.isfinite(measures).all(axis=1)
    kept &= measures[:, 0] < np.median(measures[kept, 0]) + math.log(_DOUBLE)
    middle = np.median(measures[kept], axis=0)
    if 1.4826 * float(np.median(np.abs(measures[kept, 0] - middle[0]))) > REPEATS:
        return kept  # their medians are fitted, which outliers hardly move
    usual = 1.4826 * np.median(np.abs(measures[kept] - middle), axis=0) + 1e-6 * np.abs(middle) + 1e-12
    far = np.abs(measures - middle) > np.maximum(_FAR * usual, 0.02)
    kept &= ~far[:, [0, 1, 2, 3]].any(axis=1)
    return kept


def _gaps(lost: Any) -> tuple[Any, Any]:
    """Begins and ends of the gaps [sample]."""
    edges = np.diff(np.concatenate(([0], lost.astype(np.int8), [0])))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def combined(p: list[float]) -> float:
    """One probability of several independent tests (Fisher)."""
    from scipy import stats

    known = [max(value, 1e-300) for value in p if math.isfinite(value)]
    return float(stats.chi2.sf(-2.0 * float(np.sum(np.log(known))), 2 * len(known))) if known else math.nan


def measure_weights(each: CycleRun, covariance: Reals, chosen: Sequence[int], floor: float) -> Reals:
    """The inverse of a root of a covariance of chosen measures; `floor`: of a logarithm, of a level in drops."""
    least = np.full(len(MEASURES), floor)
    least[4] = floor * float(np.exp(each.medians[3]))
    index = np.ix_(chosen, chosen)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance[index] + np.diag(least**2)[index])))


def shifted(each: Any, response: Response, offsets: Reals) -> Reals:
    """The measures of a model with its offset; far off, if the detector reads no slips in it."""
    if not isinstance(each, CycleRun):
        return np.zeros(len(MEASURES))
    made = each.model_measures(response)
    if made is None:
        return np.full(len(MEASURES), 1e3)
    column = each.run.columns[0]
    made[4] += offsets[0] * (-1.0 if each.slope < 0.0 and not column.unit.endswith("/s") else 1.0)
    return made


def measure_blocks(
    evidence: Sequence[Any],
    weights: Sequence[Reals],
    biases: Sequence[Reals],
    chosen: Sequence[int],
    i: int,
    response: Response,
    offsets: Reals,
) -> Reals:
    """The residual of the measures of a run, one cluster."""
    if not isinstance(evidence[i], CycleRun):
        return np.asarray(evidence[i].left(response, offsets))
    apart = evidence[i].medians - biases[i] - shifted(evidence[i], response, offsets)
    return np.asarray(weights[i] @ apart[list(chosen)])[None]
