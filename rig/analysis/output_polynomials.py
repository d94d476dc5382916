"""The outputs of a rig between samples: the polynomials that the plant writes for its sensors, collected."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.motion.motion import Motion

Array = NDArray[np.float64]


class Dense:
    """Outputs over a range of time, smooth inside each segment, with jumps only between segments."""

    def __init__(self) -> None:
        self._start: list[float] = []
        self._length: list[float] = []
        self._coef: list[Array] = []

    def add(self, offset: float, motion: Motion) -> None:
        """Append the segments of the last call of `advance`, which began at `offset` s."""
        segments = motion.segments
        n = int(segments.count[0])
        self._start += (offset + segments.start[:n]).tolist()
        self._length += segments.length[:n].tolist()
        self._coef += [one.copy() for one in segments.coef[:n]]

    def at(self, t: float, after: bool) -> Array:
        """Return every output at t [s], just after or just before it."""
        ends = np.array(self._start) + np.array(self._length)
        slack = 1e-9 * min(self._length[0], float(ends[-1]))
        i = int(np.searchsorted(ends, t + slack if after else t - slack))
        i = min(i, len(ends) - 1)
        u = min(max((t - self._start[i]) / self._length[i], 0.0), 1.0)
        return np.asarray(np.polynomial.polynomial.polyval(u, self._coef[i].T), dtype=np.float64)

    def segments(self, output: int) -> tuple[Array, Array, Array]:
        """Return starts [s] and lengths [s] of all segments, and the polynomials [segment, power] of an output
        in them.
        """
        return np.array(self._start), np.array(self._length), np.array([one[output] for one in self._coef])

    def sampled(self, points: int) -> tuple[Array, Array]:
        """Return times [n] and values [output, n]: `points` of each segment, its ends among them."""
        u = np.linspace(0.0, 1.0, points)
        t = np.array(self._start)[:, None] + np.array(self._length)[:, None] * u
        values = [np.polynomial.polynomial.polyval(u, one.T) for one in self._coef]
        return t.ravel(), np.concatenate(values, axis=1)

    def extremes(self, output: int) -> tuple[float, float]:
        """Return the lowest and highest value of an output: at ends of segments, or where its polynomial has slope
        zero.
        """
        coef = np.array([one[output] for one in self._coef])
        values = np.polynomial.polynomial.polyval(np.linspace(0.0, 1.0, 9), coef.T)
        low, high = float(values.min()), float(values.max())
        near = {int(v.argmin()) // 9 for v in (values, -values)}
        for i in {j for n in near for j in (n - 1, n, n + 1) if 0 <= j < len(coef)}:
            slope = np.trim_zeros(np.polynomial.polynomial.polyder(coef[i]), "b")
            if len(slope) > 1:
                level = np.polynomial.polynomial.polyroots(slope)
                level = level[(np.abs(level.imag) < 1e-9) & (level.real >= 0.0) & (level.real <= 1.0)].real
                found = np.polynomial.polynomial.polyval(level, coef[i])
                low, high = min([low, *found.tolist()]), max([high, *found.tolist()])
        return low, high
