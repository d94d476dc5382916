"""The forced motion under dither that is not fast, and the growth of a small disturbance of it (Floquet exponents).

    x(t + tau) = x(t) with the period tau of the dither,   dx(t + tau) = P dx(t),   exponents  ln(eigenvalue of P) / tau

With constant coefficients, and while every contact slips in its direction, P = exp(A tau): the exponents are the
eigenvalues of sliding without dither. They count also where a contact would have to pull, as those of an equilibrium
do. Any other motion is the fixed point of the return map (rig.analysis.cycles.return_map), with its events. The
imaginary part of an exponent is known up to multiples of the frequency of the dither: the one nearest to an eigenvalue
without dither is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.averaged import averaged, fast_motion
from rig.analysis.cycles.return_map import Family, NoCycle, NotSmooth, ReturnMap, parameter, sizes
from rig.bench.free_rig import TIGHT, Carried, FreeRig
from rig.errors import NumericsError, Singular
from rig.model.assembly import Assembly
from rig.scenes.scene import Scene
from rig.scenes.sections import with_values
from rig.stability.linearisation import Steady, linearised, own_law, settling

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
_SLOWEST = 30.0  # oscillations of the rig in a period of the dither: longer ones take minutes
_ERASED = 1e-6  # a smaller multiplier is zero: a contact sticks, and the rest is the error of the differences
_HALVINGS = 6  # of a step of Newton's method
_POINTS = 256  # of a period, at which the contacts are looked at
_NONE = np.zeros((0, 0), dtype=np.complex128)


@dataclass(frozen=True)
class Forced:
    """A forced motion. `exponents` [i], the least stable first; `shapes` [state, i] at the phase of the start.

    `exists`, `counts`, `why`: as of `rig.analysis.linear.modes_report.Sliding`. `means`: over a period, of the states,
    the inputs T, and the friction and normal force of each patch [N]; None where they are not known.
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
    unit = amplitude * np.array([-1j, 1.0])  # as in rig.analysis.cycles.averaged.fast_motion
    moved = np.union1d(at.moving, settling(at.system, at.modes.A, at.moving))
    pushed = at.A[np.ix_(moved, np.array([sine, cosine]))] @ unit
    response = np.zeros(at.system.n, dtype=np.complex128)
    response[[sine, cosine]] = unit
    dynamic = 1j * omega * np.eye(len(moved)) - at.A[np.ix_(moved, moved)]
    response[moved] = np.linalg.solve(dynamic, pushed)
    turn = np.exp(2j * np.pi * np.arange(_POINTS) / _POINTS)
    states = at.x + np.outer(turn, response).real
    reverses = _reverses(at, states @ at.system.slip_rows.T)
    if not (reverses or at.modes.nonlinear.any() or at.system.products or at.system.remembers):
        why = _pulls(at, states @ at.modes.normal.T + at.modes.normal_t @ at.T)
        rates, shapes = at.eigenvectors()
        means = (at.x, at.T, at.friction, at.load)
        motion = Forced(_NONE.diagonal(), _NONE, not why, True, why, means)
        return _least_stable_first(rates, at, shapes, motion)
    slow = [at.x + response.real]
    with suppress(NumericsError, Singular):
        mean = averaged(at.system, sine, cosine, amplitude).x
        slow.append(mean + fast_motion(at.system, sine, cosine, amplitude).real)
    why = reverses or "no forced motion is found in which every contact slips in its direction"
    return _returning(scene, assembly, at, slow, 2.0 * np.abs(response), 2.0 * math.pi / omega, why)


def _unknown(why: str) -> Forced:
    return Forced(_NONE.diagonal(), _NONE, False, False, why)


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


def _returning(
    scene: Scene, assembly: Assembly, at: Steady, starts: Sequence[Array], span: Array, tau: float, why: str
) -> Forced:
    """The forced motion by Newton's method on the return map, from the first start from which it has no event."""
    shaking = replace(scene, parameters=with_values(scene.parameters, {"dither.enable": True}), controllers={})
    last: tuple[ReturnMap, Array, Carried] | None = None
    for x in starts:
        rig = FreeRig(shaking, assembly, start=x, tolerance=TIGHT)
        returns = ReturnMap(Family.of(rig), sizes(span, rig), tau, 1.0, period=lambda _: tau)
        u = returns.unknowns(x, tau, 0.0)
        try:
            u, end = returns.newton(u, parameter(0.0, len(u)), u, over_p=False, halvings=_HALVINGS)
            last = returns, u, end
        except (NoCycle, NumericsError) as error:
            ends = f"{why}, and {' '.join(str(error).split())}"
            continue
        if not end.events:
            break
    if last is None:
        return _unknown(ends)
    returns, u, end = last
    try:
        values, vectors = np.linalg.eig(returns.derivative(u, end, over_p=False).P)
    except NotSmooth as error:
        return _unknown(f"{why}, and {error}")
    rig = returns.rig(u)
    x = returns.state(u)
    left = (np.abs(values) > _ERASED) | (not end.events)
    why = "" if left.any() else "a contact sticks in every period, which ends every disturbance"
    shapes = np.zeros((at.system.n, int(left.sum())), dtype=np.complex128)
    shapes[rig.moving] = returns.size[:, None] * vectors[:, left]
    means = None if end.events else _means(rig, x, end.first, tau)
    motion = Forced(_NONE.diagonal(), _NONE, True, True, why, means)
    exponents = np.log(values[left].astype(np.complex128)) / tau
    return _least_stable_first(exponents, at, shapes, motion, tau)


def _means(rig: FreeRig, x: Array, key: int, tau: float) -> tuple[Array, Array, Array, Array]:
    """The means of `Forced` of a motion from x on that stays in one mode set."""
    modes = rig.modes(key)
    system = rig.system
    states = [x]
    for _ in range(_POINTS - 1):
        states.append(rig.within(states[-1], key, tau / _POINTS))
    law = own_law(system, modes)
    X = np.array(states)
    T = np.array([linearised(system, modes, state, law)[1] for state in states])
    friction = X @ modes.friction.T + T @ modes.friction_t.T
    load = X @ modes.load.T + T @ modes.load_t.T
    return X.mean(axis=0), T.mean(axis=0), friction.mean(axis=0), load.mean(axis=0)


def _least_stable_first(main: Complex, at: Steady, shapes: Complex, motion: Forced, tau: float = 0.0) -> Forced:
    """The motion with its exponents [1/s], `main`.

    Those of a return after `tau` [s] are known up to multiples of its frequency: of them the one nearest to an
    eigenvalue of sliding without dither counts.
    """
    if tau:
        still = at.eigenvalues()
        turn = 2.0 * math.pi / tau
        most = int(np.abs(still.imag).max(initial=0.0) / turn) + 1
        ways = main[:, None] + 1j * turn * np.arange(-most, most + 1)
        nearest = np.abs(ways[:, :, None] - still).min(axis=2).argmin(axis=1)
        beat = np.abs(np.sin(main.imag * tau)) > 1e-14  # a real multiplier has none, or half of one
        main = np.where(beat, ways[np.arange(len(main)), nearest], main)
    order = np.lexsort((-main.imag, -main.real))
    return replace(motion, exponents=main[order], shapes=shapes[:, order])
