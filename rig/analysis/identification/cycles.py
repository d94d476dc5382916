"""Measured cycles: those that can be used, and what a model leaves of each.

The detector (rig.analysis.identification.slips) reads a measurement and the periods of a model. The bias by instrument
noise is measured on the periods of a model.

    r_ij = (y_i - o - w(t_i - s_j)) / sigma       cycle j, w a period of the model, s_j its shift, o an offset

A shift for each cycle takes up delay, drift of the phase and jitter. In stick the state is known, so that each stick
forgets the past and cycles are nearly independent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from rig.analysis.identification.responses import Response
from rig.analysis.identification.runs import MOTIONS, Measured
from rig.analysis.identification.slips import MEASURES, noise_of, slips, window
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
SCREEN = (1, 2, 3, 4, 5)
"""Measures that are fitted where cycles repeat. A period is stick and motion."""
LASTING = (0, 2, 3, 4)
"""Measures that are fitted where cycles do not repeat. A short stick scatters most."""
EXACT = 1e-4
"""Error of a measure that the detector adds."""
_DOUBLE = 1.8  # medians: a longer period is two
_BEFORE = 0.35  # of a period before the begin of a slip: what is fitted of a cycle
_AFTER = 0.6  # of a period after it
_FAR = 6.0  # times the usual deviation
_CUT = 2  # cycles of which the ends of a run may cut off a part
_ROUNDS = 4  # of the fit of the shifts
_JUMP = 0.1  # of the range of a column, between two points of a period
_MODEL = 3e-6  # of the range of a column: error of the mean of a response in a phase, most of it between its points
_SPIKE = 3.0  # times what bends as often as not there: more is a spike. chosen
_SPIKE_NOISE = 6.0  # times the noise that it exceeds beside
_ASIDE = 3  # samples about a phase, besides the scatter of the cycles
_DRIFTS = 0.02  # of the drop: a smaller change counts as none
_PASSES = 3  # a sample between two spikes shows when these are bridged
BINS = 5
"""Phases of a cycle in which the mean residual is tested."""


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
    spikes: tuple[int, ...] = ()
    """Of each column: samples that stood alone, as drop-outs of a laser, and are bridged."""
    floors: Reals = field(default_factory=lambda: np.zeros(1))
    """Of each column: the error of a model; what it misses by as little is no misfit."""

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
        begins = detected.begins
        count = len(begins)
        kept = _usable(detected.measures)
        for a, b in zip(*_gaps(lost)):
            before = column.start + a / column.rate
            after = column.start + b / column.rate
            kept &= ~((begins > before) & (begins - np.exp(detected.measures[:, 0]) < after))
        T = float(np.exp(np.median(detected.measures[kept, 0]))) if kept.any() else 0.0
        places = []
        within = []
        for each in run.columns:
            first = np.rint((begins - _BEFORE * T - each.start) * each.rate).astype(np.int64)
            place = first[:, None] + np.arange(int((_BEFORE + _AFTER) * T * each.rate))
            places.append(place)
            within.append((place[:, :1] >= 0) & (place[:, -1:] < each.v.size))
        whole = kept & np.all(within, axis=(0, 2))
        samples = []
        times = []
        for each, place in zip(run.columns, places):
            samples.append(bridge(each.v)[0][place[whole]])
            times.append(each.start + place[whole] / each.rate - begins[whole, None])
        fine = np.all([np.isfinite(s).all(axis=1) for s in samples], axis=0)
        used = min(int(kept.sum()), int(fine.sum()) + _CUT)
        if used < LEAST:
            raise UsageError(
                f"{run.name}: {used} of {count} cycles in {run.seconds:.4g} s of {column.name} can be used; "
                f"at least {LEAST} are needed: record longer, or check its speed, load and scale, or leave the run out"
            )
        floors = np.array([_MODEL * float(np.ptp(s[fine].mean(axis=0))) for s in samples])
        sigmas = np.maximum([noise_of(each.v) for each in run.columns], floors)
        measures = detected.measures[whole][fine]
        scatter = _spread(measures[:, 0])
        despiked = [_despiked(s[fine], float(sigma), scatter) for s, sigma in zip(samples, sigmas)]
        return cls(
            run,
            slope,
            n,
            sigmas,
            begins[whole][fine],
            measures,
            count - int(fine.sum()),
            tuple(s for s, _ in despiked),
            tuple(t[fine] for t in times),
            spikes=tuple(spikes for _, spikes in despiked),
            floors=floors,
        )

    @cached_property
    def drift(self) -> float:
        """Change of the logarithm of the drop from the first third of the cycles to the last; 0 if it may be scatter.

        A limit cycle has none: a vibration that still grows, or a rig that changes, is fitted by no law.
        """
        drops = self.measures[:, 3]
        third = len(drops) // 3
        first = drops[:third]
        last = drops[-third:]
        change = float(np.median(last) - np.median(first))
        error = 1.25 * math.hypot(_spread(first), _spread(last)) / math.sqrt(third)  # of two medians
        return change if abs(change) > max(_DRIFTS, _FAR * error) else 0.0

    def words(self) -> Iterator[str]:
        """What was replaced, a line for each column, and whether the cycles change."""
        if self.drift:
            way = "grows" if self.drift > 0.0 else "decays"
            yield (
                f"{self.run.name}: the vibration {way}: the drop changes by {100.0 * math.expm1(self.drift):+.2g} % "
                "from the first third of the cycles to the last. Those of a law do not: leave out what comes before it "
                'has settled, skip = "..."'
            )
        for column, count in zip(self.run.columns, self.spikes):
            if count:
                yield f"{self.run.name}: {counted(count, 'sample')} of {column.name} stand out alone: bridged by a line"

    @property
    def period(self) -> float:
        """Median period [s]."""
        return float(np.exp(np.median(self.measures[:, 0])))

    @cached_property
    def scatter(self) -> float:
        """Standard deviation of the logarithm of the period, of a robust fit."""
        return _spread(self.measures[:, 0])

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
        medians = np.median(self.measures[drawn], axis=1)
        return np.atleast_2d(np.cov(medians.T))

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
        measures = np.asarray(np.median(detected.measures, axis=0))
        return measures if np.isfinite(measures).all() else None

    def bias(self, model: Response, seed: int = 7) -> Reals:
        """What the noise of the instrument adds to the measures: with noise minus without."""
        plain = self.model_measures(model)
        noisy = self.model_measures(model, float(self.sigma[0]), seed, 60)
        return np.zeros(len(MEASURES)) if plain is None or noisy is None else noisy - plain

    def left(self, model: Response, offsets: Reals) -> Reals:
        """What a model leaves of the cycles over the noise, [cycle, samples of all columns], at the best shifts."""
        rows = []
        for i, offset in enumerate(offsets):
            fitted, _ = self.fitted(i, model, float(offset))
            rows.append((self.samples[i] - fitted) / self.sigma[i])
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
        return hotelling(np.array(means).T, self.share, np.repeat(self.floors / self.sigma, BINS))


def hotelling(rows: Reals, share: float = 0.0, known: Reals | float = 0.0) -> float:
    """The probability of a mean of `rows` [cluster, value] farther from zero.

    `share`: see `CycleRun.share`. `known`: standard deviation of each value of the mean beside that by the scatter.
    """
    from scipy import stats

    n, p = rows.shape
    if n <= p + 2:
        return math.nan
    mean = rows.mean(axis=0)
    S = np.cov(rows.T) + n * np.diag(np.broadcast_to(known, p) ** 2)
    weights = np.linalg.pinv(S, rcond=1e-12, hermitian=True)
    T2 = n * float(mean @ weights @ mean) / (1.0 + share)
    return float(stats.f.sf((n - p) / (p * (n - 1)) * T2, p, n - p))


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
    root = np.linalg.cholesky(covariance[index] + np.diag(least**2)[index])
    return np.asarray(np.linalg.inv(root))


def shifted(each: Any, response: Response, offsets: Reals) -> Reals:
    """The measures of a model with its offset; far off, if the detector reads no slips in it."""
    if not isinstance(each, CycleRun):
        return np.zeros(len(MEASURES))
    measures = each.model_measures(response)
    if measures is None:
        return np.full(len(MEASURES), 1e3)
    falls = each.slope < 0.0 and not each.run.columns[0].unit.endswith("/s")
    measures[4] += offsets[0] * (-1.0 if falls else 1.0)
    return measures


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


def _usable(measures: Reals) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which cycles are one cycle, and no outlier."""
    kept = np.isfinite(measures).all(axis=1)
    kept &= measures[:, 0] < np.median(measures[kept, 0]) + math.log(_DOUBLE)
    middle = np.median(measures[kept], axis=0)
    spread = 1.4826 * np.median(np.abs(measures[kept] - middle), axis=0)
    if float(spread[0]) > REPEATS:
        return kept  # their medians are fitted, which outliers hardly move
    usual = spread + 1e-6 * np.abs(middle) + 1e-12
    far = np.abs(measures - middle) > np.maximum(_FAR * usual, 0.02)
    kept &= ~far[:, [0, 1, 2, 3]].any(axis=1)
    return kept


def _spread(values: Reals) -> float:
    """Standard deviation of values, of a robust fit."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _despiked(samples: Reals, sigma: float, scatter: float) -> tuple[Reals, int]:
    """Samples [cycle, sample] with spikes bridged by lines, and the number of spikes.

    A spike, as a drop-out of a laser, is far from the line between its neighbours: farther than by the noise `sigma`
    and than what half of the cycles are near this phase (they scatter by the share `scatter`), which is the motion.
    """
    from scipy.ndimage import maximum_filter1d

    aside = _ASIDE + math.ceil(3.0 * min(scatter, REPEATS) * samples.shape[1])
    spiky = np.zeros(samples.shape, bool)
    smooth = samples
    for _ in range(_PASSES):
        bends = np.zeros(samples.shape)
        bends[:, 1:-1] = np.abs(smooth[:, 1:-1] - 0.5 * (smooth[:, :-2] + smooth[:, 2:]))
        usual = np.median(maximum_filter1d(bends, 2 * aside + 1, axis=1), axis=0)
        tall = bends > _SPIKE * usual + _SPIKE_NOISE * sigma
        found = tall & (bends == maximum_filter1d(bends, 3, axis=1)) & ~spiky
        if not found.any():
            break
        spiky |= found
        smooth = np.array([bridge(row)[0] for row in np.where(spiky, math.nan, samples)])
    lost = ~np.isfinite(smooth)  # more in a row than a line bridges: no spikes
    return np.where(lost, samples, smooth), int((spiky & ~lost).sum())


def _gaps(lost: Any) -> tuple[Any, Any]:
    """Begins and ends of the gaps [sample]."""
    edges = np.diff(np.concatenate(([0], lost.astype(np.int8), [0])))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
