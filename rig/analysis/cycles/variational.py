"""The derivative of a smooth motion over its start, from its variational equation.

    x' = f(x),   P' = (df/dx) P,   P(0) = 1

Differences of runs have the error of a run over their step, and the step has to be short where the return map bends,
as beside a canard. This derivative has the tolerance of its own integration alone. It needs a motion without an event
and a law without memory; it takes longer, so that it serves the multipliers that are told, not each step of Newton's
method.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rig.bench.free_rig import FreeRig
from rig.stability.linearisation import linearised, own_law

Array = NDArray[np.float64]
_TOLERANCE = 1e-13
_MOST = 40_000  # evaluations: a motion with far faster modes would take minutes
_LEAST = 1e-3  # of the largest state of its kind: the size down to which states are integrated to the tolerance


def derivative(rig: FreeRig, x: Array, key: int, time: float) -> tuple[Array, Array] | None:
    """Return the moving states [i] at the end of the motion from x over `time` [s] in a mode set, and their derivative
    [i, i]; None for a law with memory, and where the integration takes too long.
    """
    from scipy.integrate import DOP853

    if rig.system.remembers:
        return None
    moving = rig.moving
    n = len(x)
    rate = _rate(rig, key)
    start = np.concatenate([x[:, None], np.eye(n)[:, moving]], axis=1)
    least = np.maximum(np.abs(x), _LEAST * np.abs(x).max())[:, None] * np.ones(start.shape[1])
    least[:, 1:] = least[:, :1] / least[moving, 0]
    solver = DOP853(
        lambda _, y: rate(y.reshape(start.shape)).ravel(),
        0.0,
        start.ravel(),
        time,
        rtol=_TOLERANCE,
        atol=_TOLERANCE * _LEAST * least.ravel(),
    )
    while solver.status == "running" and solver.nfev < _MOST:
        solver.step()
    if solver.status != "finished":
        return None
    end = solver.y.reshape(start.shape)[moving]
    return end[:, 0], end[:, 1:]


def _rate(rig: FreeRig, key: int) -> Callable[[Array], Array]:
    """The rate of a state and of its derivative [n, 1 + i] in a mode set."""
    modes = rig.modes(key)
    system = rig.system
    law = own_law(system, modes)
    if system.products or modes.load_t.any():

        def whole(Y: Array) -> Array:
            A, T, _ = linearised(system, modes, Y[:, 0], law)
            out = A @ Y
            out[:, 0] = modes.A @ Y[:, 0] + modes.b @ T
            return np.asarray(out)

        return whole
    slipping = np.flatnonzero(modes.nonlinear).tolist()
    n = system.n
    rows = np.vstack([modes.A, *([system.slip_rows[p], modes.load[p]] for p in slipping)])
    contacts = list(zip(slipping, range(n, len(rows), 2), modes.b.T[slipping, :, None]))

    def rate(Y: Array) -> Array:
        over_rows = rows @ Y
        out = over_rows[:n]
        for p, at, force in contacts:
            w, N = over_rows[at : at + 2]
            T, by_speed, by_load = law(p, float(w[0]), float(N[0]))
            change = by_speed * w + by_load * N
            change[0] = T
            out += force * change
        return out

    return rate
