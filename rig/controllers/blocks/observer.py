"""A steady-state Kalman observer as plain arithmetic: from one measured signal to the velocity of the oscillator.

    correct   e = y - C z        z+ = z + L e
    velocity  v(t + ahead) = c_v exp(A ahead) z+
    advance   z = F z+

z [n] is [positions, velocities, unknown forces]; F [n, n], C [n], L [n], A [n, n], c_v [n] are numbers from the design
step. It uses the structure but no friction law: friction is the unknown force, a random walk. The code for three states
(one oscillator) and for four (with the zero of an accelerometer) is unrolled, which is three times as fast.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rig.controllers.blocks.base import Numbers, Values, dot, require

KEYS = ("transition", "output", "gain", "model", "velocity", "rest")


class Observer:
    """The observer with `numbers` of the design step; it predicts the velocity `ahead` [s] after each sample."""

    def __init__(self, numbers: Numbers, ahead: float = 0.0) -> None:
        require(numbers, KEYS, "an observed velocity needs numbers of the design step")
        self.rest: Values = tuple(numbers["rest"])
        n = len(self.rest)
        transition = [tuple(row) for row in numbers["transition"]]
        output: Values = tuple(numbers["output"])
        gain: Values = tuple(numbers["gain"])
        row = propagated(numbers["velocity"], numbers["model"], ahead)
        # one matrix for the whole step: z_next = (F - F L C) z + F L y,  v = (row - row L C) z + row L y
        self._row = tuple(row[j] - dot(row, gain) * output[j] for j in range(n))
        self._feed = dot(row, gain)
        drive = [dot(line, gain) for line in transition]
        self._step = tuple(tuple(line[j] - b * output[j] for j in range(n)) for line, b in zip(transition, drive))
        self._drive = tuple(drive)
        self._free = tuple(transition)
        self.start = self._start
        self.update = {3: self._update3, 4: self._update4}.get(n, self._update)

    def _start(self, y: float) -> Values:
        """The state of a rig at rest at the position of the first sample."""
        return tuple([r * y for r in self.rest])

    def skip(self, z: Values, periods: int) -> Values:
        """The state after `periods` periods without a sample."""
        for _ in range(periods):
            z = tuple([dot(row, z) for row in self._free])
        return z

    def _update(self, z: Values, y: float) -> tuple[Values, float]:
        step = tuple([dot(row, z) + b * y for row, b in zip(self._step, self._drive)])
        return step, dot(self._row, z) + self._feed * y

    def _update3(self, z: Values, y: float) -> tuple[Values, float]:
        x1, x2, x3 = z
        (a, b, c), (d, e, f), (g, h, i) = self._step
        u, v, w = self._drive
        p, q, r = self._row
        step = (
            a * x1 + b * x2 + c * x3 + u * y,
            d * x1 + e * x2 + f * x3 + v * y,
            g * x1 + h * x2 + i * x3 + w * y,
        )
        return step, p * x1 + q * x2 + r * x3 + self._feed * y

    def _update4(self, z: Values, y: float) -> tuple[Values, float]:
        x1, x2, x3, x4 = z
        (a, b, c, d), (e, f, g, h), (i, j, k, l), (m, n, o, p) = self._step
        u, v, w, x = self._drive
        q, r, s, t = self._row
        step = (
            a * x1 + b * x2 + c * x3 + d * x4 + u * y,
            e * x1 + f * x2 + g * x3 + h * x4 + v * y,
            i * x1 + j * x2 + k * x3 + l * x4 + w * y,
            m * x1 + n * x2 + o * x3 + p * x4 + x * y,
        )
        return step, q * x1 + r * x2 + s * x3 + t * x4 + self._feed * y


def propagated(row: ArrayLike, matrix: ArrayLike, time: float) -> Values:
    """The row `row exp(matrix time)`, by scaling and squaring of a Taylor series; time in s."""
    a = np.asarray(matrix, dtype=float) * time
    doublings = max(0, int(np.ceil(np.log2(max(np.abs(a).sum(axis=1).max(), 1e-300)))) + 1)
    a /= 2.0**doublings
    term = out = np.eye(len(a))
    for k in range(1, 17):
        term = term @ a / k
        out = out + term
    for _ in range(doublings):
        out = out @ out
    return tuple(float(x) for x in np.asarray(row, dtype=float) @ out)
