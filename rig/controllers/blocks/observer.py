"""A steady-state Kalman observer as plain arithmetic: from one measured signal to the velocity of the oscillator.

    correct   e = y - C z        z+ = z + L e
    velocity  v(t + ahead) = c_v exp(A ahead) z+
    advance   z = F z+

z [n] is [positions, velocities, unknown forces]; F [n, n], C [n], L [n], A [n, n], c_v [n] are numbers from the design
step. It uses the structure but no friction law: friction is the unknown force, a random walk. The code for three states
(one oscillator) and for four (with the zero of an accelerometer) is unrolled, which is three times as fast in Python.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rig.controllers.blocks.base import Numbers, Values, dot, mapped, require

KEYS = ("transition", "output", "gain", "model", "velocity", "rest")


class Observer(NamedTuple):
    """One matrix for the whole step: z_next = step z + drive y,  v = row z + feed y; without a sample z_next = free z.

    A rig at rest at the position of a sample y has the state rest y.
    """

    step: tuple[Values, ...]
    drive: Values
    row: Values
    feed: float
    free: tuple[Values, ...]
    rest: Values


def observer(numbers: Numbers, ahead: float = 0.0) -> Observer:
    """The observer with `numbers` of the design step; it predicts the velocity `ahead` [s] after each sample."""
    require(numbers, KEYS, "an observed velocity needs numbers of the design step")
    n = len(numbers["rest"])
    transition = tuple([tuple(row) for row in numbers["transition"]])
    output = tuple(numbers["output"])
    gain = tuple(numbers["gain"])
    row = propagated(numbers["velocity"], numbers["model"], ahead)
    feed = dot(row, gain)
    drive = tuple([dot(line, gain) for line in transition])
    step = []
    for line, share in zip(transition, drive):
        corrected = [line[j] - share * output[j] for j in range(n)]
        step.append(tuple(corrected))
    observing = tuple([row[j] - feed * output[j] for j in range(n)])
    return Observer(tuple(step), drive, observing, feed, transition, tuple(numbers["rest"]))


def _scaled(share: float, y: float) -> float:
    return share * y


def at_rest(o: Observer, y: float) -> Values:
    """The state of a rig at rest at the position of the first sample."""
    rest: Values = mapped(o.rest, _scaled, (y,), o.rest)
    return rest


def _free(row: Values, z: Values) -> float:
    return dot(row, z)


def skipped(o: Observer, z: Values, periods: int) -> Values:
    """The state after `periods` periods without a sample."""
    for _ in range(periods):
        z = mapped(z, _free, (z,), o.free)
    return z


def _stepped(row: Values, share: float, z: Values, y: float) -> float:
    return dot(row, z) + share * y


def advanced(o: Observer, z: Values, y: float) -> tuple[Values, float]:
    """State after a sample y, and the velocity."""
    return mapped(z, _stepped, (z, y), o.step, o.drive), dot(o.row, z) + o.feed * y


def advanced3(o: Observer, z: Values, y: float) -> tuple[Values, float]:
    """The same for three states."""
    x1, x2, x3 = z
    (a, b, c), (d, e, f), (g, h, i) = o.step
    u, v, w = o.drive
    p, q, r = o.row
    step = (
        a * x1 + b * x2 + c * x3 + u * y,
        d * x1 + e * x2 + f * x3 + v * y,
        g * x1 + h * x2 + i * x3 + w * y,
    )
    return step, p * x1 + q * x2 + r * x3 + o.feed * y


def advanced4(o: Observer, z: Values, y: float) -> tuple[Values, float]:
    """The same for four states."""
    x1, x2, x3, x4 = z
    (a, b, c, d), (e, f, g, h), (i, j, k, l), (m, n, p, q) = o.step
    u, v, w, x = o.drive
    r, s, t, aa = o.row
    step = (
        a * x1 + b * x2 + c * x3 + d * x4 + u * y,
        e * x1 + f * x2 + g * x3 + h * x4 + v * y,
        i * x1 + j * x2 + k * x3 + l * x4 + w * y,
        m * x1 + n * x2 + p * x3 + q * x4 + x * y,
    )
    return step, r * x1 + s * x2 + t * x3 + aa * x4 + o.feed * y


def propagated(row: ArrayLike, matrix: ArrayLike, time: float) -> Values:
    """The row `row exp(matrix time)`, by scaling and squaring of a Taylor series; time in s."""
    a = np.asarray(matrix, dtype=float) * time
    sums = np.abs(a).sum(axis=1)
    norm = max(sums.max(), 1e-300)
    halvings = int(np.ceil(np.log2(norm))) + 1
    doublings = max(0, halvings)
    a /= 2.0**doublings
    term = out = np.eye(len(a))
    for k in range(1, 17):
        term = term @ a / k
        out = out + term
    for _ in range(doublings):
        out = out @ out
    later = np.asarray(row, dtype=float) @ out
    return tuple(float(x) for x in later)
