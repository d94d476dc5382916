"""The sample instants of an instrument: sample k at round(k / rate) in whole nanoseconds, without accumulated error.

`Stream` draws the random numbers of an instrument in advance: the division of a run into frames has no influence on
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from hashlib import sha256
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SECOND = 1_000_000_000  # ns
FINEST_STEP = 1000  # ns
_LARGEST = 1 << 31  # products of two such numbers are int64

_PIECE = 1 << 16  # numbers that are drawn and left out at a time: 512 KiB
Integers = NDArray[np.int64]


class Instants(NamedTuple):
    """Sample instants: `samples` per `seconds`, whole numbers without a common divisor.

    Sample k is at k seconds / samples, rounded to the nearest whole nanosecond (a tie to the even one). No error
    accumulates, because every instant is computed from k alone.
    """

    samples: int
    seconds: int

    @classmethod
    def of(cls, rate: float) -> Instants:
        """The instants of a rate [Hz], as a ratio of whole numbers below 2^31 (relative error about 1e-15).

        A rate whose period is within 1e-6 ns of a whole number of nanoseconds has this period.
        """
        period = SECOND / rate
        if abs(period - round(period)) <= 1e-6:
            ratio = Fraction(SECOND, round(period))
        else:
            ratio = Fraction(rate).limit_denominator(max(int(_LARGEST / rate), 1))
        return cls(ratio.numerator, ratio.denominator)

    @property
    def period_ns(self) -> float:
        """Time between two samples [ns]; a whole number where `even`."""
        return SECOND * self.seconds / self.samples

    @property
    def even(self) -> bool:
        """Whether the period is a whole number of nanoseconds."""
        return self.whole[1] == 0

    @property
    def whole(self) -> tuple[int, int]:
        """Whole nanoseconds of a period, and the rest in units of 1 / `samples` nanoseconds."""
        return divmod(SECOND * self.seconds, self.samples)

    def fit(self, period_ns: int) -> bool:
        """Whether a whole number of samples fits into a period [ns]."""
        return period_ns * self.samples % (SECOND * self.seconds) == 0

    def at(self, numbers: int | Integers) -> Integers:
        """The instants [ns] of samples `numbers`, as the kernels compute them (rig.solve.sampling.sample_instant)."""
        period, rest = self.whole
        if not rest:
            return np.asarray(numbers, dtype=np.int64) * period
        cycles, k = np.divmod(np.asarray(numbers, dtype=np.int64), self.samples)
        more, part = np.divmod(k * rest, self.samples)
        down = k * period + more
        up = (2 * part > self.samples) | ((2 * part == self.samples) & (down % 2 == 1))
        return np.asarray(cycles * (SECOND * self.seconds) + down + up, dtype=np.int64)

    def instant(self, number: int) -> int:
        """The instant [ns] of one sample; the same as `at`, 20 times as fast."""
        down, part = divmod(number * SECOND * self.seconds, self.samples)
        return down + (2 * part > self.samples or (2 * part == self.samples and down % 2 == 1))

    def count(self, t_ns: int) -> int:
        """Number of samples from t = 0 up to and including one instant [ns]; the same as `until`, faster."""
        number = max(t_ns * self.samples // (SECOND * self.seconds), 0)  # within one of the last
        while number and self.instant(number) > t_ns:
            number -= 1
        while self.instant(number) <= t_ns:
            number += 1
        return number

    def until(self, t_ns: Integers) -> Integers:
        """Numbers of samples from t = 0 up to and including each instant [ns]; 0 before t = 0."""
        t = np.asarray(t_ns, dtype=np.int64)
        k = np.floor(t / self.period_ns).astype(np.int64)
        k = np.where(self.at(k) > t, k - 1, k)
        k = np.where(self.at(k + 1) <= t, k + 1, k)
        return np.asarray(np.maximum(k + 1, 0), dtype=np.int64)


def common_step(frame_ns: int, instants: Iterable[Instants]) -> int:
    """The integrator's step [ns]: it divides the frame and the period of every sensor with whole samples per frame.

    Other sensors are sampled within steps, and so are those that would need a step shorter than `FINEST_STEP`.
    """
    step = frame_ns
    finest = min(FINEST_STEP, frame_ns)
    for period in sorted({instant.whole[0] for instant in instants if instant.even}, reverse=True):
        if frame_ns % period == 0 and math.gcd(step, period) >= finest:
            step = math.gcd(step, period)
    return step


class Stream:
    """Noise and drop-outs of one instrument; they depend only on the seed of the scene and the instrument's name."""

    def __init__(self, seed: int, name: str) -> None:
        words = np.frombuffer(sha256(name.encode()).digest()[:16], dtype=np.uint32)
        noise, gaps = np.random.SeedSequence([seed, *map(int, words)]).spawn(2)
        self._noise = np.random.Generator(np.random.PCG64(noise))
        self._gaps = np.random.Generator(np.random.PCG64(gaps))
        self._last = 0  # start of the last drawn drop-out [ns]
        self.drawn = [0, 0]
        """How many numbers and how many drop-outs have been drawn."""

    def noise(self, numbers: NDArray[np.float64]) -> None:
        """Fill a row with the next standard normal numbers."""
        self.drawn[0] += len(numbers)
        self._noise.standard_normal(out=numbers)

    def gaps(self, n: int, rate: float, shortest: float, longest: float) -> NDArray[np.int64]:
        """The next n drop-outs [n, 2], start and end [ns]: a Poisson process of `rate` [1/s], uniform lengths [s]."""
        self.drawn[1] += n
        u = self._gaps.random((n, 2))
        start = self._last + np.cumsum(np.rint(-1e9 / rate * np.log1p(-u[:, 0])).astype(np.int64))
        self._last = int(start[-1]) if n else self._last
        end = start + np.rint(1e9 * (shortest + (longest - shortest) * u[:, 1])).astype(np.int64)
        return np.column_stack([start, end])

    def skip(self, numbers: int) -> None:
        """Draw and drop the next `numbers` standard normal numbers."""
        for begin in range(0, numbers, _PIECE):
            self.noise(np.empty(min(_PIECE, numbers - begin)))
