"""Floquet multipliers of a periodic motion: what one round leaves of a small disturbance.

The motion is started again from a state in slip, displaced to both sides along each moving state, and carried through
one period; central differences (of fourth order) of where it arrives make the monodromy matrix. The events of every
run are located, so what a landing or a release does to the disturbance, its saltation, is in it. One multiplier is one,
the shift along the motion itself: it is left out, and how well it comes out tells how good the others are. A contact
that sticks forgets: its multiplier is zero. Where a displaced run meets other events, the return is not smooth, and
smaller displacements are tried.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.solve.formulation import assemble
from rig.solve.linear import moving_states
from rig.solve.system import STICK
from rig.study.orbit import BLOCK, Orbit, Round

Array = NDArray[np.float64]
STEPS = (1e-3, 1e-4, 1e-5)  # of the size of each state
_MANY, _SHOWN = 10, 6  # multipliers: more than these are cut down to so many
RUNS = ((-2.0, 1.0 / 12.0), (-1.0, -8.0 / 12.0), (1.0, 8.0 / 12.0), (2.0, -1.0 / 12.0))


@dataclass(frozen=True)
class Floquet:
    """Multipliers, the largest first; `error`: how far the one of the motion itself is from one (NaN: it is driven).

    `why`: what keeps them from being told, "" where they are.
    """

    multipliers: tuple[complex, ...] = ()
    error: float = math.nan
    why: str = ""

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {"multipliers": [[v.real, v.imag] for v in self.multipliers], "error": self.error, "why": self.why}

    def text(self) -> str:
        """For a reader; what is less than the error is zero."""
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


def floquet(orbit: Orbit, around: Round, period: float) -> Floquet:
    """The multipliers of the cycle `around`, which repeats after `period` [s]."""
    system = orbit.system
    at = _start(orbit, around)
    x = around.states[at]
    probe = orbit.moving(x, orbit.scene.step_ns, 1)
    modes = assemble(system, probe.key)
    moving = moving_states(system, modes.A)
    moving = moving[np.any(modes.landing[:, moving] != 0.0, axis=0)]  # not the current of an open circuit: it is zero
    size = around.states.max(axis=0) - around.states.min(axis=0)
    driven = bool(np.any(np.delete(size, moving) > 0.0))
    size = _sizes(size, len(system.coordinates))
    rows = [p for p, mode in enumerate(system.modes(probe.key)[0]) if mode == STICK]
    basis = _free(system.slip_rows[rows][:, moving] * size[moving])
    whole, names = _carried(orbit, x, period)
    for step in STEPS:
        columns = []
        for direction in basis.T:
            shift = np.zeros(system.n)
            shift[moving] = size[moving] * direction
            ends = [_carried(orbit, x + share * step * shift, period) for share, _ in RUNS]
            if any(met != names for _, met in ends):
                break
            slope = np.sum([weight * (end - whole) for (end, _), (_, weight) in zip(ends, RUNS)], axis=0) / step
            columns.append(basis.T @ (slope[moving] / size[moving]))
        if len(columns) == basis.shape[1]:
            return _told(np.linalg.eigvals(np.array(columns).T), driven)
    return Floquet(why="the return is not smooth: runs beside the motion meet other events")


def _told(values: NDArray[np.complex128], driven: bool) -> Floquet:
    order = sorted((complex(v) for v in values), key=lambda v: (-abs(v), -v.imag))
    if driven:
        return Floquet(tuple(order))
    own = min(order, key=lambda v: abs(v - 1.0))
    order.remove(own)
    return Floquet(tuple(order), abs(own - 1.0))


def _start(orbit: Orbit, around: Round) -> int:
    """The tick in the middle of the longest stretch between events, with as few contacts stuck as there are."""
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
    """What each state is displaced by, before the step: its span, or a little of the largest of its kind."""
    out = span.copy()
    for kind in (slice(nq), slice(nq, 2 * nq), slice(2 * nq, None)):  # metres, metres per second, volts and the like
        if span[kind].size:
            out[kind] = np.maximum(span[kind], 1e-3 * span[kind].max())
    return np.where(out > 0.0, out, 1.0)


def _free(rows: Array) -> Array:
    """Orthonormal directions [state, i] that leave the slip speed of stuck contacts alone."""
    if not len(rows):
        return np.eye(rows.shape[1])
    _, values, directions = np.linalg.svd(rows)
    rank = int(np.count_nonzero(values > 1e-12 * values.max()))
    return np.asarray(directions[rank:].T)


def _carried(orbit: Orbit, x: Array, period: float) -> tuple[Array, list[str]]:
    """The state after `period` [s], to the nanosecond, and what was met."""
    whole, rest = divmod(round(period * 1e9), orbit.scene.step_ns)
    met: list[str] = []
    for step_ns, ticks in ((orbit.scene.step_ns, whole), (rest, 1)):
        if step_ns and ticks:
            motion = orbit.moving(x, step_ns, min(ticks, BLOCK), read=False)
            for done in range(0, ticks, BLOCK):
                motion.advance(min(BLOCK, ticks - done))
                met += [event.what for event in motion.events()]
            x = motion.x.copy()
    return x, met
