"""Floquet multipliers of a periodic motion: the growth of a small disturbance over one period.

The motion is restarted from a state in slip, displaced to both sides along each moving state, and simulated for one
period. Central differences (fourth order) of the final states give the monodromy matrix. The events of every run are
located, so that the matrix contains their jumps (saltation). One multiplier equals one: it belongs to the shift along
the motion itself. It is left out, and its deviation from one is the error estimate for the others. A contact that
sticks erases the disturbance: its multiplier is zero. Where a displaced run meets other events, the return map is not
smooth, and smaller displacements are tried.

The forced motion under dither that is not fast, and the growth of a small disturbance of it (Floquet exponents).

    x(t + tau) = x(t) with the period tau of the dither,   dx(t + tau) = P dx(t),   exponents  ln(eigenvalue of P) / tau

While every contact stays closed and slips in its direction, the motion and P follow from the equations of that mode set
and their variational equation. With constant coefficients P = exp(A tau), so that the exponents are the eigenvalues of
sliding without dither; they then count also where a contact would have to pull, as those of an equilibrium do. Where
the slip reverses, the motion is simulated with its events (rig.analysis.floquet). The imaginary part of an exponent is
known up to multiples of the dither's frequency: that nearest to an eigenvalue without dither is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.averaged import averaged, fast_motion
from rig.analysis.orbit import OnePeriod, Orbit
from rig.analysis.return_map import Family, Flow, NotSmooth, ReturnMap
from rig.analysis.return_map import multipliers as floquet_multipliers
from rig.bench.run.rig_variants import with_values
from rig.errors import NumericsError, Singular
from rig.model.assembly import Assembly
from rig.model.method import chosen
from rig.model.singular import assembled
from rig.scenes.scene import Scene
from rig.solve.records import STICK
from rig.stability.linearisation import Steady, inputs, linearised, loads, moving_states, own_law, settling

Array = NDArray[np.float64]
STEPS = (1e-3, 1e-4, 1e-5)  # of the size of each state: of the way of Newton's method, not of its result
_MANY, _SHOWN = 10, 6  # more multipliers than the first number are cut down to the second
RUNS = ((-2.0, 1.0 / 12.0), (-1.0, -8.0 / 12.0), (1.0, 8.0 / 12.0), (2.0, -1.0 / 12.0))
Complex = NDArray[np.complex128]
_SLOWEST = 30.0  # oscillations of the rig in a period of the dither: longer ones take minutes
_ROUNDS = 30  # of Newton's method
_FIRST = 2  # of them may reverse the slip on the way to a motion that does not
_CLOSED = 1e-9  # of the range of each state: a motion that returns so closely is periodic
_ERASED = 1e-6  # a smaller multiplier is zero: a contact sticks, and the rest is the error of the differences
_POINTS = 256  # of a period, at which the contacts are looked at
_TIGHT = 1e-11
_NONE = np.zeros((0, 0), dtype=np.complex128)


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
    modes = assembled(system, orbit.aside(x, orbit.scene.step_ns).key)
    moving = moving_states(system, modes.A)
    moving = moving[np.any(modes.landing[:, moving] != 0.0, axis=0)]  # not the current of an open circuit: it is zero
    size = _sizes(span, len(system.coordinates))
    rows = [p for p, mode in enumerate(system.modes(modes.key)[0]) if mode == STICK]
    basis = _free(system.slip_rows[rows][:, moving] * size[moving])
    rate = modes.A @ x + modes.b @ inputs(system, modes, x, own_law(system, modes))[0]
    whole, met = orbit.carried(x, period)
    none = np.zeros(basis.shape[1])
    return_map = Return(x, np.eye(len(none)), none, none, met, basis, moving, size)
    for step in steps:
        columns = []
        for unit in np.eye(len(none)):
            ends = [orbit.carried(return_map.shifted(share * step * unit), period) for share, _ in RUNS]
            if any(events != met for _, events in ends):
                break
            slope = np.sum([weight * (end - whole) for (end, _), (_, weight) in zip(ends, RUNS)], axis=0) / step
            columns.append(return_map.apart(slope, np.zeros(system.n)))
        if len(columns) == len(none):
            flow = return_map.apart(rate, np.zeros(system.n))
            return replace(return_map, matrix=np.array(columns).T, miss=return_map.apart(whole, x), flow=flow)
    return None


def floquet(orbit: Orbit, around: OnePeriod, period: float) -> Floquet:
    """Compute the multipliers of the cycle `around`, which repeats after `period` [s]."""
    x, span = around.states[middle(orbit, around)], np.ptp(around.states, axis=0)
    flow = Flow(orbit.scene, start=x)
    driven = bool(np.any(np.delete(span, flow.moving) > 0.0))
    size = _sizes(span, len(flow.system.coordinates))[flow.moving]
    returns = ReturnMap(Family.of(flow), size, period, 1.0, period=(lambda _: period) if driven else None)
    returns.key = flow.carried(x, 0.0).first
    try:
        return Floquet(*floquet_multipliers(_quietest(returns, returns.unknowns(x, period, 0.0)), driven))
    except NotSmooth:
        return Floquet(why="the return map is not smooth: displaced runs meet other events")


def _quietest(returns: ReturnMap, u: Array) -> Array:
    """The monodromy matrix by differences over 1e-5 of each state; over 1e-4 where a kink of a law makes runs noisy.

    Noise grows with a smaller step, curvature with a larger one. Raises NotSmooth.
    """
    end = returns.end(u)
    middle = returns.derivative(u, end, over_p=False).P
    try:
        small, large = (returns.derivative(u, end, over_p=False, steps=(step,)).P for step in (1e-6, 1e-4))
    except NotSmooth:
        return middle
    return large if np.abs(small - middle).max() > np.abs(large - middle).max() else middle


def multipliers(matrix: Array, driven: bool) -> Floquet:
    """Return the multipliers of a monodromy matrix; `driven`: it contains no shift along the motion."""
    return Floquet(*floquet_multipliers(matrix, driven))


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


@dataclass(frozen=True)
class Forced:
    """A forced motion. `exponents` [i], the least stable first; `shapes` [state, i] at the phase of the start.

    `exists`, `counts`, `why`: as of `rig.analysis.modes.Sliding`. `means`: over a period, of the states, the
    inputs T, and the friction and normal force of each patch [N]; None where they are not known.
    """

    exponents: Complex
    shapes: Complex
    exists: bool
    counts: bool
    why: str = ""
    means: tuple[Array, Array, Array, Array] | None = None


def forced(scene: Scene, assembly: Assembly, at: Steady, sine: int, cosine: int, amplitude: float) -> Forced:
    """Return the forced motion about sliding `at` under a generator a' = omega b, b' = -omega a of given amplitude."""
    if not at.counts:
        return _unknown("without dither there is no steady sliding about which it could vibrate")
    omega = float(at.system.signals[sine - at.system.one, cosine])
    turns = float(np.abs(at.eigenvalues().imag).max(initial=0.0)) / omega
    if turns > _SLOWEST:
        what = f"in a period of the dither the rig oscillates {turns:.0f} times, and at most {_SLOWEST:g} are computed"
        return _unknown(f"{what}; for so slow a change use the eigenvalues at constant values (rig modes --sweep)")
    closed = _closed(at, sine, cosine, amplitude, omega)
    if closed.exists or closed.counts:
        return closed
    return _with_events(scene, assembly, at, sine, cosine, amplitude, omega, closed.why)


def _unknown(why: str) -> Forced:
    return Forced(_NONE.diagonal(), _NONE, False, False, why)


def _closed(at: Steady, sine: int, cosine: int, amplitude: float, omega: float) -> Forced:
    """The forced motion in the mode set of sliding."""
    from scipy.integrate import solve_ivp

    none = _unknown("no forced motion is found in which every contact slips in its direction")
    system, modes, tau = at.system, at.modes, 2.0 * math.pi / omega
    law = own_law(system, modes)
    moved = np.union1d(at.moving, settling(system, modes.A, at.moving))
    n, m = system.n, len(moved)
    unit = amplitude * np.array([-1j, 1.0])  # as in rig.analysis.averaged.fast_motion
    pushed = at.A[np.ix_(moved, np.array([sine, cosine]))] @ unit
    response = np.linalg.solve(1j * omega * np.eye(m) - at.A[np.ix_(moved, moved)], pushed)
    x = at.x.copy()
    x[[sine, cosine]] = unit.real
    x[moved] += response.real
    size = np.where(np.abs(response) > 0.0, np.abs(response), 1.0)

    def rates(_: float, y: Array) -> Array:
        state, change = y[:n], y[n:].reshape(n, m)
        J, T, _load = linearised(system, modes, state, law)
        return np.concatenate([modes.A @ state + modes.b @ T, (J @ change).ravel()])

    begin = np.zeros((n, m))
    begin[moved, np.arange(m)] = 1.0
    for rounds in range(_ROUNDS):
        scale = np.concatenate([np.maximum(np.abs(x), np.abs(x).max() * 1e-6), np.ones(n * m)])
        run = solve_ivp(rates, (0.0, tau), np.concatenate([x, begin.ravel()]), method="DOP853", rtol=_TIGHT,
                        atol=_TIGHT * scale, t_eval=np.linspace(0.0, tau, _POINTS + 1))  # fmt: skip
        if not run.success or not np.isfinite(run.y).all():
            return none
        P = run.y[n:, -1].reshape(n, m)[moved]
        miss = run.y[:n, -1][moved] - x[moved]
        if np.all(np.abs(miss) <= _CLOSED * size):
            break
        if rounds > _FIRST and (why := _reverses(at, run.y[:n].T @ system.slip_rows.T)):
            return _unknown(why)
        x[moved] += np.linalg.solve(np.eye(m) - P, miss)
    else:
        return none
    states = run.y[:n, :-1].T
    T = np.array([linearised(system, modes, state_at, law)[1] for state_at in states])
    over_x, over_t = loads(system, modes)
    load = states @ over_x.T + T @ over_t.T
    friction = states @ modes.friction.T + T @ modes.friction_t.T
    reverses = _reverses(at, states @ system.slip_rows.T)
    why = reverses or _pulls(at, states @ modes.normal.T + T @ modes.normal_t.T)
    vibrates = np.isin(moved, at.moving)  # lags settle by themselves, whatever vibrates
    values, vectors = np.linalg.eig(P[np.ix_(vibrates, vibrates)])
    shapes = np.zeros((n, len(at.moving)), dtype=np.complex128)
    shapes[moved[vibrates]] = vectors
    counts = not why or not (reverses or modes.nonlinear.any() or system.products)
    means = states.mean(axis=0), T.mean(axis=0), friction.mean(axis=0), load.mean(axis=0)
    return _least_stable_first(values, tau, at, shapes, Forced(_NONE.diagonal(), _NONE, not why, counts, why, means))


def _reverses(at: Steady, speed: Array) -> str:
    """The contact whose slip speed [time, patch] leaves its direction, in words; "" if none does."""
    lowest = (at.modes.sigma * speed).min(axis=0)
    names = [patch.name for patch, w in zip(at.system.patches, lowest) if w <= 0.0]
    return f"in the forced motion the slip of {', '.join(names)} reverses" if names else ""


def _pulls(at: Steady, normal: Array) -> str:
    """The contact whose normal force [time, normal] would have to be negative, in words; "" if none would."""
    lowest = [(contact.name, N) for contact, N in zip(at.system.normals, normal.min(axis=0)) if contact.opens]
    name, N = min(lowest, key=lambda contact_force: contact_force[1], default=("", 1.0))
    return f"in the forced motion {name} would have to pull, with up to {-N:.4g} N" if N <= 0.0 else ""


def _with_events(
    scene: Scene, assembly: Assembly, at: Steady, sine: int, cosine: int, amplitude: float, omega: float, why: str
) -> Forced:
    """The forced motion with its events, found by Newton's method from the averaged motion."""
    tau = 2.0 * math.pi / omega
    try:
        fast = fast_motion(at.system, sine, cosine, amplitude)
        x = averaged(at.system, sine, cosine, amplitude).x + fast.real
        shaking = replace(scene, parameters=with_values(scene.parameters, {"dither.enable": True}), controllers={})
        orbit = Orbit(shaking, assembly, x, chosen(scene.clock.method, at.system), _TIGHT)
        for _ in range(_ROUNDS):
            return_map = returned(
                orbit, x, tau, 2.0 * np.abs(fast), STEPS[1:]
            )  # with the first an erased one may be 1e-4
            if return_map is None:
                return _unknown(f"{why}, and displaced motions meet other events")
            if np.abs(return_map.miss).max(initial=0.0) <= _CLOSED:
                break
            step = np.linalg.lstsq(np.eye(len(return_map.miss)) - return_map.matrix, return_map.miss, rcond=None)[0]
            x = return_map.shifted(np.asarray(step, dtype=np.float64))
        else:
            return _unknown(f"{why}, and Newton's method finds no motion that repeats with the dither")
    except (NumericsError, Singular) as error:
        return _unknown(f"{why}, and its simulation ends: {' '.join(str(error).split())}")
    values, vectors = np.linalg.eig(return_map.matrix)
    left = np.abs(values) > _ERASED
    why = "" if left.any() else "a contact sticks in every period, which ends every disturbance"
    shapes = np.zeros((at.system.n, int(left.sum())), dtype=np.complex128)
    shapes[return_map.moving] = return_map.size[return_map.moving, None] * (return_map.basis @ vectors[:, left])
    return _least_stable_first(values[left], tau, at, shapes, Forced(_NONE.diagonal(), _NONE, True, True, why))


def _least_stable_first(multipliers: Complex, tau: float, at: Steady, shapes: Complex, motion: Forced) -> Forced:
    """The motion with the exponents [1/s] of its multipliers: of their frequencies the one nearest to an eigenvalue of
    sliding without dither.
    """
    still = at.eigenvalues()
    main = np.log(multipliers.astype(np.complex128)) / tau
    turn = 2.0 * math.pi / tau
    most = int(np.abs(still.imag).max(initial=0.0) / turn) + 1
    ways = main[:, None] + 1j * turn * np.arange(-most, most + 1)
    nearest = np.abs(ways[:, :, None] - still).min(axis=2).argmin(axis=1)
    exponents = np.where(
        np.isreal(multipliers), main, ways[np.arange(len(main)), nearest]
    )  # real: no beat, or half of it
    order = np.lexsort((-exponents.imag, -exponents.real))
    return replace(motion, exponents=exponents[order], shapes=shapes[:, order])
