"""Friction under dither, averaged over one period of the fast vibration.

    w(theta) = w + Re(W exp(i theta)),  N(theta) = N + Re(L exp(i theta)),  contact closed where N(theta) > 0
    T(w, N) = 1/2pi int mu(|w(theta)|) sgn(w(theta)) max(N(theta), 0) dtheta

W, L: response of the structure without friction to the generator. The integrand jumps where w passes through zero. It
is smooth between these places, and there Gauss-Legendre quadrature with `ORDER` nodes is exact to rounding. Each zero
of w adds 2 mu(0) N / |dw/dtheta| to the slope of T over w: this term is the damping that dither adds.
Coulomb friction gives mu (2/pi) asin(w/a). The slope jumps at a = w: do not evaluate it there.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 4; Thomsen, J. Sound Vib. 228 (1999).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.model import friction_law
from rig.model.friction_law import Law
from rig.model.system import System
from rig.solve.forces import COULOMB
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
ORDER = 64
"""Nodes of the quadrature between two zeros."""
FAR = 4.0
"""Ratio of the dither to a natural frequency from which on it is fast; the response to it is then inertial to 7 %."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(ORDER)


def mean_friction(law: Law, w: float, N: float, fast: complex, load: complex = 0.0) -> tuple[float, float, float]:
    """Return the mean friction force, its slope over w and its slope over N; `fast`, `load`: complex amplitudes of w
    and N.
    """
    reversals = _zeros(w, fast)
    cuts = np.sort(np.concatenate([reversals, _zeros(N, load)]))
    if not len(cuts):
        cuts = np.array([0.0])
    ends = np.append(cuts[1:], cuts[0] + 2.0 * np.pi)
    T = by_speed = by_load = 0.0
    for start, end in zip(cuts, ends):
        theta = 0.5 * (end - start) * (_NODES + 1.0) + start
        weight = 0.5 * (end - start) * _WEIGHTS / (2.0 * np.pi)
        speed = w + (fast * np.exp(1j * theta)).real
        force = N + (load * np.exp(1j * theta)).real
        closed = weight * (force > 0.0)
        mu = np.array([law.mu(abs(v)) for v in speed]) * np.sign(speed)
        slope = np.array([law.slope(abs(v)) for v in speed])
        T += float(closed @ (mu * force))
        by_load += float(closed @ mu)
        by_speed += float(closed @ (slope * force))
    for theta in reversals:
        force = N + (load * np.exp(1j * theta)).real
        steepness = abs((1j * fast * np.exp(1j * theta)).real)
        if steepness > 0.0:
            by_speed += law.mu(0.0) * max(force, 0.0) / (np.pi * steepness)
    return T, by_speed, by_load


def _zeros(mean: float, amplitude: complex) -> Array:
    """Angles in [0, 2 pi) at which mean + Re(amplitude exp(i theta)) passes through zero."""
    size = abs(amplitude)
    if not abs(mean) < size:
        return np.zeros(0)
    middle = np.pi - np.angle(amplitude)
    half = np.arccos(mean / size)
    return np.sort(np.mod([middle - half, middle + half], 2.0 * np.pi))


def fast_motion(
    system: System, sine: int, cosine: int, amplitude: float, leading: bool = False
) -> NDArray[np.complex128]:
    """Return the complex amplitude of every state under a generator a' = omega b, b' = -omega a, without friction.

    The states are Re(. exp(i omega t)); those of the generator, `sine` and `cosine`, are a sin and a cos. `leading`:
    keep only the inertia in the response.
    """
    omega = float(system.signals[sine - system.one, cosine])
    nq = len(system.coordinates)
    unit = amplitude * np.array([-1j, 1.0])  # a sin = Re(-i a exp(i omega t)), a cos = Re(a exp(i omega t))
    generator = np.array([sine, cosine])

    def driven(row: Array) -> complex:
        return complex(row[generator] @ unit)

    push = np.array([driven(row) for row in system.force]) if nq else np.zeros(0)
    for k in system.normals:
        push = push + k.direction * driven(k.row)
    dynamic = _dynamic_stiffness(system, omega, leading)
    answer = np.zeros(system.n, dtype=np.complex128)
    q = np.linalg.solve(dynamic, push.astype(complex)) if nq else push
    answer[:nq] = q
    answer[nq : 2 * nq] = 1j * omega * q
    answer[generator] = unit
    return answer


def _dynamic_stiffness(system: System, omega: float, leading: bool) -> NDArray[np.complex128]:
    """Forces on the coordinates per amplitude at omega [rad/s], without friction; `leading`: those of inertia alone."""
    nq = len(system.coordinates)
    dynamic: NDArray[np.complex128] = -(omega**2) * system.mass.astype(np.complex128)
    if not leading:
        dynamic += system.stiffness + 1j * omega * system.damping
    for k in system.normals:
        dynamic += omega**2 * np.outer(k.direction, k.inertia)
        if not leading:
            dynamic -= np.outer(k.direction, k.row[:nq] + 1j * omega * k.row[nq : 2 * nq])
    return dynamic


def not_fast(system: System, sine: int, cosine: int) -> str:
    """Return the reason why friction cannot be averaged over a generator a' = omega b, b' = -omega a; "" if it can.

    It can where the generator is far above the natural frequencies that the contacts feel: the slip speed then responds
    to a friction force as inertia alone does, to 1 / (FAR^2 - 1), as at FAR times the natural frequency of one mass.
    """
    omega = float(system.signals[sine - system.one, cosine])
    nq = len(system.coordinates)
    most = 1.0 / (FAR**2 - 1.0)
    if system.remembers:
        names = ", ".join(patch.name for patch in system.patches if patch.memory)
        return f"the friction law of {names} has memory, and its force is not averaged over the dither"
    directed = []
    for i, patch in enumerate(system.patches):
        if any(law.backward for law in system.laws(i)):
            directed.append(patch.name)
    if directed:
        return f"the friction law of {', '.join(directed)} depends on the direction, and its mean is not computed"
    of_inertia = _dynamic_stiffness(system, omega, leading=True)
    of_all = _dynamic_stiffness(system, omega, leading=False)
    for row, patch in zip(system.slip_rows[:, nq : 2 * nq], system.patches):
        force = patch.direction.astype(complex)
        inertial = complex(row @ np.linalg.solve(of_inertia, force))
        actual = complex(row @ np.linalg.solve(of_all, force))
        if not abs(actual - inertial) <= most * abs(inertial):
            hertz = omega / (2.0 * np.pi)
            return (
                f"{hertz:g} Hz is not far above the natural frequencies: {patch.name} responds to it by "
                f"{abs(actual / inertial - 1.0):.0%} differently from inertia alone, and averaging allows {most:.0%}"
            )
    return ""


def averaged(system: System, sine: int, cosine: int, amplitude: float, leading: bool = False) -> Steady:
    """Return steady sliding under a generator a' = omega b, b' = -omega a (states `sine`, `cosine`) of given amplitude.

    Fast and slow motion are separated: this holds where the generator is much faster than the vibration modes of the
    structure. `leading`: the fast motion contains inertia alone, the leading order of the theories of direct partition
    of motion: a force A on a mass m gives it the amplitude A / (m omega) of velocity. Springs and dampers change it by
    terms of order 1 / omega^2.
    """
    answer = fast_motion(system, sine, cosine, amplitude, leading)
    omega = float(system.signals[sine - system.one, cosine])
    q = answer[: len(system.coordinates)]
    fast = [complex(system.slip_rows[p] @ answer) for p in range(len(system.patches))]
    pressed = [(k.patch, k.row @ answer - omega**2 * k.inertia @ q) for k in system.normals]

    def load_of(p: int) -> complex:
        return complex(sum(N for patch, N in pressed if patch == p))

    load = [load_of(p) for p in range(len(system.patches))]
    start = system.start.copy()
    start[[sine, cosine]] = 0.0
    patches = []
    for patch in system.patches:
        if patch.law.code == COULOMB:  # in the form that stays outside of the matrices
            law = friction_law.falling(patch.law.numbers[0], 0.0, 0.0)
            patch = replace(patch, law=replace(law, static=patch.law.static))
        patches.append(patch)
    slow = replace(system, patches=tuple(patches), start=start)

    def contact(p: int, w: float, N: float) -> tuple[float, float, float]:
        return mean_friction(system.patches[p].law, w, N, fast[p], load[p])

    return steady(slow, sliding_key(slow), contact)
