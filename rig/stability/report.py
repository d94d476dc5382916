"""The stability report: growth in every mode set, jamming, and steps that are too long, before a run starts.

Friction rigs are unstable on purpose: their vibration grows from sliding into stick-slip. The report lists such growth
as information. An error is a growth that no part of the rig limits, because the run would then end at the
largest allowed state (rig.stability.growth).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rig.errors import Singular
from rig.model.build_checks import Finding
from rig.model.singular import assembled, bearing_mass
from rig.model.system import System
from rig.model.system_parts import Normal, Patch
from rig.solve.state_codes import OPEN, STICK
from rig.stability.examined_mode_sets import mode_sets
from rig.stability.growth import stopped
from rig.stability.jacobian import moving_states
from rig.stability.linearisation import Steady, steady
from rig.stability.step_limits import step_findings

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
    found = list(_drivers(system))
    for judge in system.judges:
        found += judge(system, step)
    sets: list[tuple[float, str, Steady]] = []
    for key in mode_sets(system):
        name = system.describe(key)
        jam = list(_jamming(system, key, name))
        found += jam
        if any(one.level == "error" for one in jam):
            continue
        try:
            at = steady(system, key)
        except Singular as error:
            found.append(_jammed(name, 0.0) if error.jams else _undefined(error, name))
            continue
        sets.append((float(np.abs(np.linalg.eigvals(at.modes.A)).max()), name, at))
    fastest, where, _ = max(sets, key=lambda one: one[0], default=(0.0, "", None))
    for _, name, at in sets:
        found += _growth(at, name, fastest)
    found += step_findings(system, method, step, substeps, tolerance, (fastest, where))
    return sorted(found, key=lambda one: ("error", "warning", "info").index(one.level))


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
        Me = bearing_mass(system, key, mu.__getitem__)
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
