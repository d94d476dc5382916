"""The stability report: growth in every mode set, jamming, and steps that are too long, before a run starts.

Friction rigs are unstable on purpose: their vibration grows from sliding into stick-slip. The report lists such growth
as information. An error is a growth that no part of the rig limits, because the run would then end at the
largest allowed state. A growing motion is limited by

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

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import Singular
from rig.model import friction_law
from rig.model.formulation import bearing_mass
from rig.model.singular import assembled
from rig.model.system import Finding, Level, Normal, Patch, System
from rig.solve.records import OPEN, STICK
from rig.stability.linearisation import Steady, moving_states, steady
from rig.stability.step_limits import mode_sets, step_findings


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


_ZERO = 1e-6  # share of the largest eigenvalue: zero eigenvalues of a stuck contact come out this large
_NEUTRAL = 1e-10  # share of the largest eigenvalue: growth up to this is rounding
_FAST = 10.0  # times the surface speed: the fastest slip expected
_SPEEDS = 41  # slip speeds at which jamming is examined


def stability_report(
    system: System, method: str, step: float, substeps: int = 1, tolerance: float = 0.0
) -> list[Finding]:
    """The findings about `system` before a run by `method` in sample steps of `step` [s], errors first.

    `substeps`: steps of rk4 or kick in a sample step. `tolerance`: of dopri5.
    """
    broken = list(_matrices(system))
    if broken:
        return broken
    findings = list(_drivers(system))
    for judge in system.judges:
        findings += judge(system, step)
    sets: list[tuple[float, str, Steady]] = []
    for key in mode_sets(system):
        name = system.describe(key)
        jam = list(_jamming(system, key, name))
        findings += jam
        if any(finding.level == "error" for finding in jam):
            continue
        try:
            at = steady(system, key)
        except Singular as error:
            findings.append(_jammed(name, 0.0) if error.jams else _undefined(error, name))
            continue
        sets.append((float(np.abs(np.linalg.eigvals(at.modes.A)).max()), name, at))
    fastest, where, _ = max(sets, key=lambda entry: entry[0], default=(0.0, "", None))
    for _, name, at in sets:
        findings += _growth(at, name, fastest)
    findings += step_findings(system, method, step, substeps, tolerance, (fastest, where))
    return sorted(findings, key=lambda finding: ("error", "warning", "info").index(finding.level))


def _matrices(system: System) -> Iterator[Finding]:
    """Numbers that are not finite, and a mass matrix that is not symmetric and positive definite."""
    names = ("mass", "damping", "stiffness", "force", "coupling", "network", "signals", "start")
    bad = [name for name in names if not np.all(np.isfinite(getattr(system, name)))]
    parts: list[Patch | Normal] = [*system.patches, *system.normals]
    for part in parts:
        if not all(np.all(np.isfinite(v)) for v in vars(part).values() if isinstance(v, np.ndarray)):
            bad.append(part.name)
    if bad:
        yield Finding(
            "error", f"not a finite number in {', '.join(bad)}", math.nan, "look for a division by zero upstream"
        )
        return
    if not len(system.mass):
        return
    lowest = float(np.linalg.eigvalsh(0.5 * (system.mass + system.mass.T)).min())
    if lowest <= 0.0:
        yield Finding(
            "error",
            "the mass matrix is not positive definite: a motion has no inertia",
            lowest,
            "give every coordinate a mass",
        )
    skew = float(np.abs(system.mass - system.mass.T).max())
    if skew > 1e-12 * float(np.abs(system.mass).max()):
        yield Finding("error", "the mass matrix is not symmetric", skew, "write each coupling into both places")


def _drivers(system: System) -> Iterator[Finding]:
    """Driving states that do not depend on the rig and grow by themselves."""
    A = assembled(
        system, system.key([STICK] * len(system.patches), [OPEN] * len(system.normals), [0] * len(system.limiters))
    ).A
    driven = set(moving_states(system, A).tolist())
    rest = np.array([state for state in range(system.one, system.n) if state not in driven], dtype=np.intp)
    values, vectors = np.linalg.eig(A[np.ix_(rest, rest)])
    scale = float(np.abs(values).max())
    for value, shape in zip(values, vectors.T):
        if value.real > _ZERO * scale > 0.0 and value.imag >= 0.0:
            name = system.names[rest[int(np.abs(shape).argmax())]]
            yield Finding("error", f"the state {name} grows by itself{_at(value)}", float(value.real), "check its row")


def _jamming(system: System, key: int, name: str) -> Iterator[Finding]:
    """Jamming: the smallest det(Me)/det(M) for the friction coefficients from rest to fast sliding."""
    sectors, M, worst = system.modes(key)[3], system.mass, 1.0
    if not len(M) or not any(np.any(k.inertia) for k in system.normals):
        return
    speeds = [abs(float(patch.surface @ system.start)) for patch in system.patches]
    for share in np.linspace(0.0, _FAST, _SPEEDS).tolist():
        mu = [float(system.law(p, sectors).mu(share * speed)) for p, speed in enumerate(speeds)]
        Me = bearing_mass(system, key, mu)
        worst = min(worst, float(np.linalg.det(Me) / np.linalg.det(M)))
    if worst <= 0.0:
        yield _jammed(name, worst)
    elif worst < 0.1:
        yield Finding(
            "warning",
            f"close to jamming in {name}: friction takes up {100.0 * (1.0 - worst):.0f} % of the inertia",
            worst,
            "lower the friction coefficient or the tilt of the absorber",
        )


def _jammed(name: str, jam: float) -> Finding:
    return Finding(
        "error",
        f"jams in {name}: friction grows faster with the acceleration than inertia does (Painleve)",
        jam,
        "lower the friction coefficient or the tilt, or give the body that slides more mass",
    )


def _undefined(error: Singular, name: str) -> Finding:
    remedy = "give every body a mass, and every contact a coordinate that moves along it"
    return Finding("error", f"the equations of motion have no unique solution in {name}: {error.why}", 0.0, remedy)


def _growth(at: Steady, name: str, fastest: float) -> Iterator[Finding]:
    """The growing vibration modes of one mode set, each with what limits it. `fastest`: largest |lambda| [1/s]."""
    stuck = STICK in at.system.modes(at.modes.key)[0]
    if at.modes.nonlinear.any() and not (stuck or at.exists):
        return  # a transient mode set without an equilibrium: nothing to linearise about
    values, shapes = at.eigenvectors()
    least = (_ZERO if stuck else _NEUTRAL) * fastest
    for value, shape in zip(values, shapes.T):
        if value.real <= least or value.imag < 0.0:
            continue
        kind = "flutter" if value.imag > 0.0 else "divergence"
        text = f"{kind} in {name}{_at(value)}"
        level, stop, remedy = stopped(at, value, shape, least)
        if level != "info" or stuck or at.exists:
            yield Finding(level, f"{text}: {stop}", float(value.real), remedy)


def _at(value: complex) -> str:
    hertz = f" at {abs(value.imag) / (2.0 * math.pi):.4g} Hz" if value.imag else ""
    return f", growth {value.real:+.4g} 1/s{hertz}"
