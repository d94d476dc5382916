"""What limits a growing motion.

    a limiter          that the motion reaches and that makes it decay once it clamps
    the friction law   if its fall with speed causes the growth: the growth ends where the law is flat
    the contact        if the growing mode shape reaches a guard. An oscillation always does. A monotone growth does if
                       there are guards on both sides, or if the start lies on the side of the guard; this is a warning,
                       because a larger disturbance lets it run away. That the growth ends at the guard is likely but
                       not proved: without damping it may continue

The contact does not limit a drive or a network that runs away by itself: a belt that follows the body it carries (gain
K above one, stuck: growth (K-1)/lag), a negative capacitance below -1/(1+kappa/k), or one whose charge leaks away.

Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, equations 4.7 to 4.20. The criteria are derived
here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.model import friction_law
from rig.model.build_checks import Level
from rig.stability.linearisation import Steady, steady


def stopped(at: Steady, value: complex, shape: NDArray[np.complex128], least: float) -> tuple[Level, str, str]:
    """The severity of a growing motion, what limits it, and the remedy.

    `value`, `shape`: its eigenvalue [1/s] and eigenvector; growth rates up to `least` [1/s] count as zero.
    """
    system = at.system
    patch_modes, normal_modes, _, sector_modes, thrown = system.modes(at.modes.key)
    for x, limiter in enumerate(system.limiters):
        if abs(limiter.row @ shape) <= 1e-9 * np.abs(limiter.row) @ np.abs(shape):
            continue
        clamped = [int(i == x) for i in range(len(system.limiters))]
        held = steady(system, system.key(patch_modes, normal_modes, clamped, sector_modes, thrown))
        if _largest(held.eigenvalues()) <= least:
            remedy = "none needed; a lower gain keeps the drive within its limits"
            return "info", f"the limits of {limiter.name} stop it", remedy
    q = 2 * len(system.coordinates)
    if value.imag == 0.0 and q < system.n - 1 and _largest(_undriven(at).eigenvalues()) <= least:
        driver = system.names[q + int(np.abs(shape[q:]).argmax())]
        remedy = "give the drive limits (speed_min, speed_max, force_max), or lower the gain of its feedback"
        if driver in system.names[q : system.one]:
            remedy = "less negative capacitance, or a bleed resistor with less resistance than the leak of the stack"
        return "error", f"{driver} grows without limit", remedy
    if at.modes.nonlinear.any():
        flat = _flat(at)
        grow = [(rate, turn) for rate, turn in zip(*_turned(flat)) if rate.real > least and rate.imag >= 0.0]
        stops = [stopped(flat, rate, turn, least) for rate, turn in grow]
        if all(stop[0] == "info" for stop in stops):
            ends = stops[0][1] if stops else "it ends where friction falls less, or in stick (rig cycle)"
            remedy = "to stabilise sliding: more speed, more damping, less load, or a control loop"
            return "info", f"friction falls with speed; {ends}", remedy
    rows = at.modes.guards @ shape
    size = 1e-9 * np.abs(at.modes.guards) @ np.abs(shape)
    seen = np.abs(rows) > size
    both_sides = bool(np.any(rows[seen].real > 0.0) and np.any(rows[seen].real < 0.0))
    if seen.any():
        which = np.flatnonzero(seen)
        first = int(which[0])
        if at.exists and value.imag > 0.0:  # an oscillation grows in both directions: the nearest guard comes first
            room = at.modes.guards @ at.x + at.modes.guards_t @ at.T
            first = int(which[(room[which] / np.abs(rows[which])).argmin()])
        guard = system.event_text(int(at.modes.kinds[first]), int(at.modes.owners[first]))
        if value.imag > 0.0 or both_sides:
            remedy = "run the scene to see the vibration; to suppress it: more damping, or less friction"
            return "info", f"it grows until {guard}", remedy
        if _returns(at, value, shape, first):
            farthest = int(np.abs(shape[: q // 2]).argmax())
            far = f"{system.names[farthest]} = {at.x[farthest]:.3g}"
            return (
                "warning",
                f"{guard}, unless a disturbance carries it beyond {far}",
                "more stiffness against this motion",
            )
    remedy = "more damping" if value.imag > 0.0 else "more stiffness against this motion"
    moved = system.names[int(np.abs(shape[: q // 2]).argmax())] if q else "the network"
    return "error", f"{moved} grows and no contact, law or limiter stops it", remedy


def _turned(at: Steady) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Eigenvalues [i] and mode shapes [i, state], the least stable first."""
    values, shapes = at.eigenvectors()
    return values, shapes.T


def _returns(at: Steady, value: complex, shape: NDArray[np.complex128], guard: int) -> bool:
    """Whether a monotone growth takes the rig from its start to that guard.

    It does if the start lies on the guard's side of the equilibrium.
    """
    rates, left = np.linalg.eig(at.A[np.ix_(at.moving, at.moving)].T)
    own = left[:, int(np.abs(rates - value).argmin())]
    away = own @ (at.system.start - at.x)[at.moving] / (own @ shape[at.moving])
    row = at.modes.guards[guard]
    return bool(row @ at.x > 0.0 and float((away * (row @ shape)).real) < 0.0)


def _undriven(at: Steady) -> Steady:
    """Steady sliding in the same mode set with network and driving states held at their values."""
    system = at.system
    signals, network = np.zeros_like(system.signals), np.zeros_like(system.network)
    held = replace(system, signals=signals, network=network, limiters=(), switches=(), start=at.x)
    patch_modes, normal_modes, *_ = system.modes(at.modes.key)
    return steady(held, held.key(patch_modes, normal_modes, []))


def _flat(at: Steady) -> Steady:
    """Steady sliding in the same mode set with the present friction coefficients, constant over speed."""
    patch_modes, normal_modes, limiter_modes, sector_modes, thrown = at.system.modes(at.modes.key)
    flat = []
    for p, patch in enumerate(at.system.patches):
        law = at.system.law(p, sector_modes)
        mu = law.mu(max(float(at.modes.sigma[p] * at.speed[p]), 0.0))
        flat.append(replace(patch, law=replace(friction_law.coulomb(mu, mu), static=law.static)))
    kept = tuple(sector for sector in at.system.sectors if sector.changes)
    where = [place for sector, place in zip(at.system.sectors, sector_modes) if sector.changes]
    system = replace(at.system, patches=tuple(flat), sectors=kept)
    return steady(system, system.key(patch_modes, normal_modes, limiter_modes, where, thrown))


def _largest(values: NDArray[Any]) -> float:
    return float(values.real.max()) if len(values) else 0.0
