"""Limits of the step and the tolerance: where a method is unstable, coarse or stiff, and which step it needs.

They are examined in all mode sets of a rig with few contacts, in a selection for many (`mode_sets`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from rig.model import assembly
from rig.model.friction_law import Law
from rig.model.mode_sets import FAST
from rig.model.singular import assembled
from rig.model.system import Finding, Sector, System
from rig.quantities import at_most
from rig.solve.records import CLOSED, LINEAR, OPEN, SLIP_MINUS, SLIP_PLUS, STICK

MOST = 27
"""Up to this number every mode set is examined; beyond it only those with all contacts alike or one contact stuck."""
_KINDS = (SLIP_PLUS, SLIP_MINUS, STICK)


def mode_sets(system: System) -> Iterator[int]:
    """The mode sets to examine: contacts closed, in slip and stick and in every sector; contacts open; limiters linear.

    Of the positions of a switch: the first two, the last and the one at the start.
    """
    P, K, free = len(system.patches), len(system.normals), [LINEAR] * len(system.limiters)
    ways = [_ways(system, p) for p in range(P)]
    few = math.prod(map(len, ways)) <= MOST
    patches: list[tuple[int, ...]] = list(product(*ways)) if few else [(k,) * P for k in _KINDS]
    if not few:
        patches += [(SLIP_PLUS,) * p + (STICK,) + (SLIP_PLUS,) * (P - p - 1) for p in range(P)]
    places = list(product(*(_places(sector) for sector in system.sectors)))
    ends = [{0, 1, len(s.positions) - 1, s.at(system.start)} for s in system.switches]
    for thrown in product(*(sorted(positions) for positions in ends)):
        for modes, where in product(patches, places):
            yield system.key(modes, [CLOSED] * K, free, where, thrown)
        if any(k.opens for k in system.normals):
            lifted = [OPEN if k.opens else CLOSED for k in system.normals]
            yield system.key([SLIP_PLUS] * P, lifted, free, switches=thrown)


def _ways(system: System, p: int) -> tuple[int, ...]:
    """The modes of patch p to examine: all; or, if no coordinate moves along it, only slip as it is driven."""
    nq = len(system.coordinates)
    row = system.slip_rows[p]
    if np.any(row[nq : 2 * nq]):
        return _KINDS
    return (SLIP_PLUS if row @ system.start >= 0.0 else SLIP_MINUS,)


def _places(sector: Sector) -> Sequence[int]:
    """The sectors to examine: all sectors of a friction law; of a structure the first and the one at half a turn."""
    return (0, len(sector.edges) // 2) if sector.changes else range(len(sector.edges))


RK4_LIMIT = 2.785
"""|lambda| h on the negative real axis up to which rk4 is stable; 2.828 on the imaginary one."""
KICK_LIMIT = 2.0
"""|lambda| h up to which a contact that stays closed is stable under kicks."""
EXACT_LIMIT = 1e11
"""|lambda| step up to which the propagators resolve the fastest state (rig.solve.expm.DEEPEST halvings)."""
FILM_LIMIT = 1.6
"""The same for a film. Beyond, points that open and close gain energy (1.7 % of the work at 1.87). # derived"""
FILM_COARSE = 1.0
"""Up to this, the growth rate of the film's flutter has an error of at most 4 %, its first opening 1 %. # derived"""
_FINE = 1e-4  # share of the width of a law: slip speed errors up to this keep its events right
_COARSE = 0.5  # |lambda| h: rk4's error in one step is then (1/2)^5/120 = 3e-4, kick's (1/2)^3/24 = 5e-3
_SPEEDS = 41  # slip speeds at which the steepest slope of a law is searched


def step_findings(
    system: System, method: str, step: float, substeps: int, tolerance: float, fastest: tuple[float, str]
) -> Iterator[Finding]:
    """Whether `method` can follow `system` in sample steps of `step` [s]. Arguments: see `stability_report`.

    `fastest`: largest |lambda| [1/s] of all mode sets, and its mode set in words.
    """
    if system.film is not None:
        yield from _film(system, step, substeps)
    else:
        yield from _eigenvalues(*fastest, method, step, substeps)
    if method == "rk4":
        yield from _steep_law(system, step, substeps)
    if method == "dopri5":
        yield from _narrow_law(system, tolerance)


def part(step: float, most: float) -> str:
    """The longest step up to `most` s that divides the sample step of `step` s, with its unit."""
    whole = round(step * 1e9)
    count = max(1, math.ceil(step / most * (1.0 - 1e-12)))
    count = next((n for n in range(count, whole) if whole % n == 0), whole)
    return f"{whole // count * 1e-9:.12g} s"


def blame(system: System, method: str, step: float, substeps: int) -> str:
    """Whether the step made a run by rk4 or kick diverge, in words, and which step helps. See `stability_report`."""
    h = step / substeps
    if system.film is not None:
        fastest, limit, coarse = assembly.fastest(system, h), FILM_LIMIT, FILM_COARSE
    else:
        fastest = fastest_eigenvalue(system)
        fastest, limit = max(fastest, steepest(system)), RK4_LIMIT if method == "rk4" else KICK_LIMIT
        coarse = _COARSE
    size = fastest * h
    text = f"{method} took steps of {h:g} s: |lambda| h = {size:.3g}"
    if size <= coarse:
        return f"{text}, which is short enough; the motion itself grows"
    why = f"unstable beyond {limit}" if size > limit else f"coarse beyond {coarse}"
    least = 0.1 / fastest if system.film is None else FILM_COARSE / fastest
    return f"{text}, {why}. Set clock.rk4_step to {part(step, least)} or less" + (
        ", or clock.method to dopri5" if method == "rk4" else ""
    )


def fastest_eigenvalue(system: System) -> float:
    """The largest |lambda| [1/s] of all mode sets, without speed-dependent friction."""
    return max(float(np.abs(np.linalg.eigvals(assembled(system, key).A)).max()) for key in mode_sets(system))


def steepest(system: System) -> float:
    """The fastest eigenvalue [1/s] where a speed-dependent law is steepest; 0 without such a law.

    The load is that at the start.
    """
    fastest = 0.0
    speeds = [0.0, *np.geomspace(1e-9, 1.0, _SPEEDS).tolist()]
    for key in mode_sets(system):
        modes, sectors = assembled(system, key), system.modes(key)[3]
        for p in np.flatnonzero(modes.sigma).tolist():
            law = system.law(p, sectors)
            if law.constant:
                continue
            slope = max((law.slope(speed) for speed in speeds), key=abs)
            load = sum(max(float(n.row @ system.start), 0.0) for n in system.normals if n.patch == p)
            bent = modes.A + np.outer(modes.b[:, p], slope * load * system.slip_rows[p])
            fastest = max(fastest, float(np.abs(np.linalg.eigvals(bent)).max()))
    return fastest


def _narrow_law(system: System, tolerance: float) -> Iterator[Finding]:
    """Whether the tolerance of dopri5 resolves the slip speeds over which friction laws change.

    A released contact starts to slip along the steep part of its law. If the error is not far below the width of that
    part, the contact turns back, sticks and slips again, although the exact motion continues.
    """
    for p, patch in enumerate(system.patches):
        speed = abs(float(patch.surface @ system.start))
        widths = [_width(law) for law in system.laws(p) if not law.constant and law.sticks]
        error = tolerance * speed
        if widths and error > _FINE * min(widths):
            yield Finding(
                "warning",
                f"tolerance {tolerance:g} is too coarse for the friction law of {patch.name}, which changes within "
                f"{min(widths):.3g} m/s: errors of {error:.2g} m/s may count as events of stick and slip",
                error / min(widths),
                f"clock.tolerance of {at_most(0.5 * _FINE * min(widths) / speed, 1)} or less",
            )


def _width(law: Law) -> float:
    """The slip speed [m/s] over which a law changes from its value at rest, taken at its steepest slope.

    Infinite if the law changes by less than rounding.
    """
    speeds = np.array([0.0, *np.geomspace(1e-9, 1.0, 10 * _SPEEDS).tolist()])
    change = float(np.ptp(law.over(speeds)))
    slope = max(abs(law.slope(speed)) for speed in speeds.tolist())
    return change / slope if change > 0.0 else math.inf


def _steep_law(system: System, step: float, substeps: int) -> Iterator[Finding]:
    """Whether rk4 can follow a speed-dependent law where it is steepest."""
    fastest, h = steepest(system), step / substeps
    if fastest * h > _COARSE:
        yield Finding(
            "warning",
            f"rk4 is coarse at a step of {h:g} s: |lambda| h = {fastest * h:.3g} where the friction law is steepest",
            fastest * h,
            f"rk4_step of {part(step, 0.1 / fastest)} or less, or method dopri5",
        )


def _film(system: System, step: float, substeps: int) -> Iterator[Finding]:
    """Whether kicks can follow the fastest vibration mode of a film with all points closed and stuck."""
    h = step / substeps
    size = assembly.fastest(system, h) * h
    if size > FILM_LIMIT:
        yield Finding(
            "error",
            f"kick is unstable at a step of {h:g} s: omega h = {size:.3g} with every point closed and stuck, "
            f"at most {FILM_LIMIT}",
            size,
            f"rk4_step of {part(step, _short_enough(system, h, FILM_LIMIT))} or less",
        )
    elif size > FILM_COARSE:
        yield Finding(
            "warning",
            f"kick is coarse at a step of {h:g} s: omega h = {size:.3g} with every point closed and stuck; flutter of "
            "the film grows more slowly than it should",
            size,
            f"rk4_step of {part(step, _short_enough(system, h, FILM_COARSE))} or less",
        )


def _short_enough(system: System, h: float, most: float) -> float:
    """A step [s] of at most `most` radians of the film's fastest motion. A damped film is stiffer at a shorter step."""
    while (size := assembly.fastest(system, h) * h) > most:
        h *= max(0.999 * most / size, 0.1)
    return h


def _eigenvalues(fastest: float, name: str, method: str, step: float, substeps: int) -> Iterator[Finding]:
    """Whether `method` can follow the fastest eigenvalue of all mode sets [1/s], that of the mode set `name`."""
    h = step / substeps if method in ("rk4", "kick") else step
    size = fastest * h
    if method == "rk4" and size > RK4_LIMIT:
        yield Finding(
            "error",
            f"rk4 is unstable at a step of {h:g} s: |lambda| h = {size:.3g} in {name}, at most {RK4_LIMIT}",
            size,
            f"rk4_step of {part(step, 0.9 * RK4_LIMIT / fastest)} or less, or method exact or dopri5",
        )
    elif method == "kick" and size > KICK_LIMIT:
        yield Finding(
            "error",
            f"kick is unstable at a step of {h:g} s: |lambda| h = {size:.3g} in {name}, at most {KICK_LIMIT}",
            size,
            f"rk4_step of {part(step, 0.9 * KICK_LIMIT / fastest)} or less",
        )
    elif method in ("exact", "dopri5") and size > EXACT_LIMIT:
        yield Finding(
            "error",
            f"too fast for the step in {name}: a state decays within {1.0 / fastest:.3g} s; a step of {step:g} s "
            f"resolves {step / EXACT_LIMIT:.3g} s",
            size,
            "leave out what is so fast: a lag, a resistance or an inductance next to zero or to infinity",
        )
    elif method == "smooth":
        yield Finding(
            "warning",
            "friction is smoothed: a stuck contact creeps, and static friction above kinetic is lost",
            size,
            "use method auto; smooth serves for comparison only",
        )
    elif method in ("rk4", "kick") and size > _COARSE:
        yield Finding(
            "warning",
            f"{method} is coarse at a step of {h:g} s: |lambda| h = {size:.3g} in {name}",
            size,
            f"rk4_step of {part(step, 0.1 / fastest)} or less",
        )
    elif method == "dopri5" and size > FAST:
        yield Finding(
            "info",
            f"stiff in {name}: |lambda| step = {size:.3g}; dopri5 takes its steps there with exact propagators",
            size,
            "results keep the tolerance",
        )
    elif method == "exact" and size > 1.0:
        yield Finding(
            "info",
            f"the step is long for {name}: |lambda| step = {size:.3g} for its fastest mode; most ticks are subdivided",
            size,
            "results stay exact",
        )
