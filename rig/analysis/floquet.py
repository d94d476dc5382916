"""Floquet multipliers of a periodic motion: the growth of a small disturbance over one period.

The motion is restarted from a state in slip, displaced to both sides along each moving state, and simulated for one
period. Central differences (fourth order) of the final states give the monodromy matrix. The events of every run are
located, so that the matrix contains their jumps (saltation). One multiplier equals one: it belongs to the shift along
the motion itself. It is left out, and its deviation from one is the error estimate for the others. A contact that
sticks erases the disturbance: its multiplier is zero. Where a displaced run meets other events, the return map is not
smooth, and smaller displacements are tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.orbit import OnePeriod, Orbit
from rig.model.singular import assembled
from rig.solve.state_codes import STICK
from rig.stability.jacobian import inputs, moving_states, own_law

Array = NDArray[np.float64]
STEPS = (1e-3, 1e-4, 1e-5)  # of the size of each state
_MANY, _SHOWN = 10, 6  # more multipliers than the first number are cut down to the second
RUNS = ((-2.0, 1.0 / 12.0), (-1.0, -8.0 / 12.0), (1.0, 8.0 / 12.0), (2.0, -1.0 / 12.0))


@dataclass(frozen=True)
class Floquet:
    """Multipliers, the largest first; `error`: deviation of the trivial multiplier from one (NaN: the motion is
    driven).

    `why`: why the multipliers are not known, "" if they are.
    """

    multipliers: tuple[complex, ...] = ()
    error: float = math.nan
    why: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {"multipliers": [[v.real, v.imag] for v in self.multipliers], "error": self.error, "why": self.why}

    def text(self) -> str:
        """Return the multipliers as text; values below the error are shown as zero."""
        if self.why:
            return self.why
        small = 10.0 * (self.error if math.isfinite(self.error) else 0.0)
        most = len(self.multipliers) if len(self.multipliers) <= _MANY else _SHOWN
        shown = [
            "0" if abs(v) <= small else f"{v.real:.6g}" if v.imag == 0.0 else f"{v.real:.6g} {v.imag:+.6g}i"
            for v in self.multipliers[:most]
        ]
        if left := self.multipliers[most:]:
            shown.append(f"{len(left)} more of size {abs(left[0]):.6g} and less")
        return f"{', '.join(shown)} (to {self.error:.1e})" if math.isfinite(self.error) else ", ".join(shown)


@dataclass(frozen=True)
class Return:
    """The return map of one period near `x`, in small steps along `basis` [moving state, i], each over its `size`.

    `matrix` [i, i]: the monodromy matrix. `miss` [i]: distance of the end of `x` from its start. `flow` [i]: its rate
    [1/s]. `met`: events on the way.
    """

    x: Array
    matrix: Array
    miss: Array
    flow: Array
    met: list[str]
    basis: Array
    moving: NDArray[np.int64]
    size: Array

    def shifted(self, by: Array) -> Array:
        """Return the state x displaced by `by` [i]."""
        x = self.x.copy()
        x[self.moving] += self.size[self.moving] * (self.basis @ by)
        return x

    def apart(self, end: Array, start: Array) -> Array:
        """Return the difference of two states [i]."""
        return np.asarray(self.basis.T @ ((end - start)[self.moving] / self.size[self.moving]))


def returned(orbit: Orbit, x: Array, period: float, span: Array, steps: Sequence[float] = STEPS) -> Return | None:
    """Compute the return map of `x` over `period` [s]; `span`: range of each state in it. None if it is not smooth.

    `steps`: of the differences, of the size of each state; the first with which the map is smooth counts.
    """
    system = orbit.system
    modes = assembled(system, orbit.key_at(x))
    moving = moving_states(system, modes.A)
    moving = moving[np.any(modes.landing[:, moving] != 0.0, axis=0)]  # not the current of an open circuit: it is zero
    size = _sizes(span, len(system.coordinates))
    rows = [p for p, mode in enumerate(system.modes(modes.key)[0]) if mode == STICK]
    basis = _free(system.slip_rows[rows][:, moving] * size[moving])
    rate = modes.A @ x + modes.b @ inputs(system, modes, x, own_law(system, modes))[0]
    whole, met = orbit.carried(x, period)
    none = np.zeros(basis.shape[1])
    found = Return(x, np.eye(len(none)), none, none, met, basis, moving, size)
    for step in steps:
        columns = []
        for unit in np.eye(len(none)):
            ends = [orbit.carried(found.shifted(share * step * unit), period) for share, _ in RUNS]
            if any(events != met for _, events in ends):
                break
            slope = np.sum([weight * (end - whole) for (end, _), (_, weight) in zip(ends, RUNS)], axis=0) / step
            columns.append(found.apart(slope, np.zeros(system.n)))
        if len(columns) == len(none):
            flow = found.apart(rate, np.zeros(system.n))
            return replace(found, matrix=np.array(columns).T, miss=found.apart(whole, x), flow=flow)
    return None


def floquet(orbit: Orbit, around: OnePeriod, period: float) -> Floquet:
    """Compute the multipliers of the cycle `around`, which repeats after `period` [s]."""
    x, span = around.states[middle(orbit, around)], np.ptp(around.states, axis=0)
    found = returned(orbit, x, period, span)
    if found is None:
        return Floquet(why="the return map is not smooth: displaced runs meet other events")
    return multipliers(found.matrix, driven=bool(np.any(np.delete(span, found.moving) > 0.0)))


def multipliers(matrix: Array, driven: bool) -> Floquet:
    """Return the multipliers of a monodromy matrix; `driven`: it contains no shift along the motion."""
    values = np.linalg.eigvals(matrix)
    order = sorted((complex(v) for v in values), key=lambda v: (-abs(v), -v.imag))
    if driven:
        return Floquet(tuple(order))
    own = min(order, key=lambda v: abs(v - 1.0))
    order.remove(own)
    return Floquet(tuple(order), abs(own - 1.0))


def middle(orbit: Orbit, around: OnePeriod) -> int:
    """Return the tick in the middle of the longest time between events with the fewest stuck contacts."""
    step, ticks = orbit.scene.step_ns * 1e-9, len(around.states) - 1
    if not around.events:
        return 0
    times = [0.0, *(t for t, _ in around.events)]
    stretches = [
        (sum(orbit.stuck(event.before, p) for p in range(len(orbit.system.patches))), a - b, 0.5 * (a + b))
        for a, b, (_, event) in zip(times, times[1:], around.events)
    ]
    *_, middle = min(stretches)
    return min(round(middle / step), ticks)


def _sizes(span: Array, nq: int) -> Array:
    """The unit displacement of each state: its range, or a small part of the largest range of its kind."""
    out = span.copy()
    for kind in (slice(nq), slice(nq, 2 * nq), slice(2 * nq, None)):  # metres, metres per second, volts and the like
        if span[kind].size:
            out[kind] = np.maximum(span[kind], 1e-3 * span[kind].max())
    return np.where(out > 0.0, out, 1.0)


def _free(rows: Array) -> Array:
    """Orthonormal directions [state, i] that do not change the slip speed of stuck contacts."""
    if not len(rows):
        return np.eye(rows.shape[1])
    _, values, directions = np.linalg.svd(rows)
    rank = int(np.count_nonzero(values > 1e-12 * values.max()))
    return np.asarray(directions[rank:].T)
