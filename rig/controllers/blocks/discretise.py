"""A linear system at the period of its controller: discretisation, and the gain of its anti-windup.

Anti-windup: at a limit of its actuator a controller has no effect, and an integrator in it would grow without limit.
So its state is corrected by the part of the command that is cut off:

    v = C x + D y,  u = v within the limits,  x(k+1) = A x + B y + L (u - v)

While u = v this is the controller itself. Beyond the limits it is an observer of the controller's state, which receives
the command in force (observer form; Astrom and Wittenmark, Computer-Controlled Systems, 3rd edition, section 3.5). L is
the gain of the stationary Kalman filter of a system that white noise y drives: cov(B y) = B B', cov(D y) = D D', and
the cross-covariance B D'. For a minimum-phase controller with an invertible D this is L = B D^-1, the conditioning of
Hanus, Kinnaert and Henrotte (Automatica 23, 1987); for a PI controller the tracking time equals the integral time. For
an integrator without a direct term the state follows the command in force. No parameter has to be chosen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.system_file import System

Matrix = NDArray[np.float64]
METHODS = ("zoh", "foh", "tustin", "impulse", "euler", "backward_diff")
"""Methods of discretisation, as python-control names them."""
DEFAULT = "tustin"
"""The method without another one: it preserves stability. # chosen"""
NOISE = 1e-4
"""Variance of a noise of the command, relative to that which y causes: zeros on the unit circle need it. # chosen"""
_SAME = 1e-9  # relative difference of two periods that are the same


class Discrete(NamedTuple):
    """x(k+1) = A x + B y + L (u - v), v = C x + D y, with u the command in force."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    L: Matrix


def discrete(given: System, period: float, method: str | None, prewarp: float | None) -> Discrete:
    """The system at the period of the controller [s]. Raises ValueError ("key: fault").

    `method`: for a continuous system; `prewarp`: frequency [Hz] at which the method tustin is exact.
    """
    if given.dt:
        if method is not None or prewarp is not None:
            key = "method" if method is not None else "prewarp"
            raise ValueError(f"{key}: has no meaning, the system is discrete with dt = {given.dt:g} s; leave it out")
        if abs(given.dt - period) > _SAME * period:
            raise ValueError(f"period: is {period:g} s, but the system is discrete with dt = {given.dt:g} s")
        return Discrete(*given[:4], _anti_windup(*given[:4]))
    method = method or DEFAULT
    step = period
    alpha = None
    if prewarp is not None:
        if method != "tustin":
            raise ValueError(f"prewarp: is possible with the method tustin only, not with {method}")
        if 2.0 * prewarp * period >= 1.0:
            raise ValueError(f"prewarp: is {prewarp:g} Hz; must be below half the sample rate, {0.5 / period:g} Hz")
        turn = 2.0 * math.pi * prewarp
        step = 2.0 * math.tan(0.5 * turn * period) / turn
        alpha = 0.5
    if method == "impulse" and given.D.any():
        raise ValueError("method: is impulse, which needs a system without a direct term (D = 0)")
    made = given[:4]
    if len(given.A):
        from scipy.signal import cont2discrete

        name = "gbt" if alpha is not None else {"tustin": "bilinear"}.get(method, method)
        try:
            made = cont2discrete(given[:4], step, name, alpha)[:4]
        except np.linalg.LinAlgError:
            raise ValueError(f"method: {method} does not exist for this system: it has a pole at 2 / period") from None
    if not all(np.isfinite(matrix).all() for matrix in made):
        raise ValueError(f"method: {method} gives numbers that are not finite; the system is too fast for its period")
    return Discrete(*made, _anti_windup(*made))


def _anti_windup(a: Matrix, b: Matrix, c: Matrix, d: Matrix) -> Matrix:
    """The gain L of the observer form [states, outputs]."""
    states = len(a)
    outputs = len(d)
    if not states or not (c.any() and (b.any() or d.any())):
        return np.zeros((states, outputs))
    from scipy.linalg import solve_discrete_are

    moved = c @ b
    spread = np.diag(d @ d.T + moved @ moved.T)
    noise = np.diag(NOISE * np.where(spread > 0.0, spread, spread.max() or 1.0))
    seen = d @ d.T + noise
    cross = b @ d.T
    walk = b @ b.T
    for more in (0.0, 1e-12, 1e-8):  # what y does not move has to be observed too, if it does not decay
        try:
            extra = more * max(float(np.trace(walk)), 1.0) * np.eye(states)
            p = solve_discrete_are(a.T, c.T, walk + extra, seen, s=cross)
        except (np.linalg.LinAlgError, ValueError):
            continue
        gain: Matrix = np.linalg.solve((c @ p @ c.T + seen).T, (a @ p @ c.T + cross).T).T
        if np.isfinite(gain).all() and np.abs(np.linalg.eigvals(a - gain @ c)).max() < 1.0:
            return gain
    raise ValueError(
        "anti-windup is not possible: a state that does not decay (an integrator) has no effect on the "
        "outputs; state the system without it (a minimal realisation)"
    )
