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

Limits of the step and the tolerance: where a method is unstable, coarse or stiff, and which step it needs.

They are examined in all mode sets of a rig with few contacts, in a selection for many (`mode_sets`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import Singular
from rig.model import assembly, friction_law
from rig.model.formulation import bearing_mass
from rig.model.friction_law import Law
from rig.model.method import ADAPTIVE, CROWD, FILM_HELPS, too_many
from rig.model.mode_sets import FAST
from rig.model.singular import assembled
from rig.model.system import Finding, Level, Normal, Patch, Sector, System
from rig.quantities import at_most
from rig.solve.records import CLOSED, LINEAR, OPEN, SLIP_MINUS, SLIP_PLUS, STICK
from rig.stability.linearisation import Steady, moving_states, steady
from rig.stability.memory_steps import fastest_memory, start_loads

_ZERO = 1e-6  # share of the largest eigenvalue: zero eigenvalues of a stuck contact come out this large
_FREE = 2e-8  # share of the largest eigenvalue: the two zeros of a body that moves freely come out this large
_NEUTRAL = 1e-10  # share of the largest eigenvalue: growth up to this is rounding
_FAST = 10.0  # times the surface speed: the fastest slip expected
_SPEEDS = 41  # slip speeds at which jamming is examined
MOST = 27
"""Up to this number every mode set is examined; beyond it only those with all contacts alike or one stuck."""
MOST_STUCK = 8
"""Up to this number of contacts, each stuck alone is examined."""
_KINDS = (SLIP_PLUS, SLIP_MINUS, STICK)
RK4_LIMIT = 2.785
"""|lambda| h on the negative real axis up to which rk4 is stable; 2.828 on the imaginary one."""
EXACT_LIMIT = 1e11
"""|lambda| step up to which the propagators resolve the fastest state (rig.solve.expm.DEEPEST halvings)."""
FILM_LIMIT = 1.6
"""omega h up to which steps of a film are stable. A point that stays closed is stable up to 2, but points that open and
close gain energy beyond 1.6 (1.7 % of the work at 1.87). # derived"""
FILM_COARSE = 1.0
"""Up to this, the growth rate of the film's flutter has an error of at most 4 %, its first opening 1 %. # derived"""
_SHORTEST = 1e-8  # s; of clock.rk4_step
_FINE = 1e-4  # share of the width of a law: slip speed errors up to this keep its events right
_COARSE = 0.5  # |lambda| h: rk4's error in one step is then (1/2)^5/120 = 3e-4


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
        rates, shapes = flat.eigenvectors()
        grow = [(rate, turn) for rate, turn in zip(rates, shapes.T) if rate.real > least and rate.imag >= 0.0]
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


def _returns(at: Steady, value: complex, shape: NDArray[np.complex128], guard: int) -> bool:
    """Whether a monotone growth takes the rig from its start to that guard.

    It does if the start lies on the guard's side of the equilibrium.
    """
    rates, left = np.linalg.eig(at.A[np.ix_(at.moving, at.moving)].T)
    own = left[:, int(np.abs(rates - value).argmin())]
    away = own @ (at.system.start - at.x)[at.moving]
    along = own @ shape[at.moving]
    row = at.modes.guards[guard]
    return bool(row @ at.x > 0.0 and float((away * (row @ shape) * along.conjugate()).real) < 0.0)


def _undriven(at: Steady) -> Steady:
    """Steady sliding in the same mode set with network and driving states held at their values."""
    system = at.system
    signals = np.zeros_like(system.signals)
    network = np.zeros_like(system.network)
    held = replace(system, signals=signals, network=network, limiters=(), switches=(), start=at.x)
    patch_modes, normal_modes, *_ = system.modes(at.modes.key)
    return steady(held, held.key(patch_modes, normal_modes, []))


def _flat(at: Steady) -> Steady:
    """Steady sliding in the same mode set with the present friction coefficients, constant over speed."""
    patch_modes, normal_modes, limiter_modes, sector_modes, thrown = at.system.modes(at.modes.key)
    flat = []
    for p, patch in enumerate(at.system.patches):
        law = at.system.law(p, at.modes.key)
        mu = law.mu(max(float(at.modes.sigma[p] * at.speed[p]), 0.0), float(at.load[p]))
        flat.append(replace(patch, law=replace(friction_law.coulomb(mu, mu), static=law.static), memory=()))
    kept = tuple(sector for sector in at.system.sectors if sector.changes)
    where = [place for sector, place in zip(at.system.sectors, sector_modes) if sector.changes]
    system = replace(at.system, patches=tuple(flat), sectors=kept)
    return steady(system, system.key(patch_modes, normal_modes, limiter_modes, where, thrown))


def _free(rates: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Which eigenvalues are the zeros of a body that moves freely [i].

    Its two zeros have one shape, so that rounding separates them by its square root; a single zero is exact.
    """
    size = np.abs(rates)
    small = size <= _FREE * size.max(initial=0.0)
    return np.asarray(small & (np.count_nonzero(small) > 1))


def _largest(values: NDArray[Any]) -> float:
    return float(values.real[~_free(values)].max(initial=0.0))


def stability_report(
    system: System, method: str, step: float, substeps: int = 1, tolerance: float = 0.0
) -> list[Finding]:
    """The findings about `system` before a run by `method` in sample steps of `step` [s], errors first.

    `substeps`: steps of rk4 or kick in a sample step. `tolerance`: of dopri5 and rosenbrock.
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
            why = f"the equations of motion have no unique solution in {name}: {error.why}"
            remedy = "give every body a mass, and every contact a coordinate that moves along it"
            findings.append(_jammed(name, 0.0) if error.jams else Finding("error", why, 0.0, remedy))
            continue
        sets.append((float(np.abs(np.linalg.eigvals(at.modes.A)).max()), name, at))
    fastest, where, _ = max(sets, key=lambda entry: entry[0], default=(0.0, "", None))
    for _, name, at in sets:
        findings += _growth(at, name, fastest)
    if why := too_many(system):
        remedy = f"eigenvalues hold; for runs {FILM_HELPS}"
        return by_level([*findings, Finding("warning", f"a run is not possible: {why}", 0.0, remedy)])
    if system.film is None and system.keys > CROWD:
        slow = f"there are {system.keys:.1e} mode sets, and each takes time when a run first meets it"
        findings.append(Finding("warning", f"a run in which many contacts open may be slow: {slow}", 0.0, FILM_HELPS))
    findings += step_findings(system, method, step, substeps, tolerance, (fastest, where))
    return by_level(findings)


def by_level(findings: list[Finding]) -> list[Finding]:
    """The findings, errors first."""
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
    M = system.mass
    worst = 1.0
    if not len(M) or not any(np.any(k.inertia) for k in system.normals):
        return
    speeds = [abs(float(patch.surface @ system.start)) for patch in system.patches]
    loads = start_loads(system).tolist()
    for share in np.linspace(0.0, _FAST, _SPEEDS).tolist():
        mu = [system.law(p, key).mu(share * speed, load) for p, (speed, load) in enumerate(zip(speeds, loads))]
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


def _growth(at: Steady, name: str, fastest: float) -> Iterator[Finding]:
    """The growing vibration modes of one mode set, each with what limits it. `fastest`: largest |lambda| [1/s]."""
    stuck = STICK in at.system.modes(at.modes.key)[0]
    if at.modes.nonlinear.any() and not (stuck or at.exists):
        return  # a transient mode set without an equilibrium: nothing to linearise about
    values, shapes = at.eigenvectors()
    least = (_ZERO if stuck else _NEUTRAL) * fastest
    for value, shape, neutral in zip(values, shapes.T, _free(values)):
        if neutral or value.real <= least or value.imag < 0.0:
            continue
        kind = "flutter" if value.imag > 0.0 else "divergence"
        text = f"{kind} in {name}{_at(value)}"
        level, stop, remedy = stopped(at, value, shape, least)
        if level != "info" or stuck or at.exists:
            yield Finding(level, f"{text}: {stop}", float(value.real), remedy)


def _at(value: complex) -> str:
    hertz = f" at {abs(value.imag) / (2.0 * math.pi):.4g} Hz" if value.imag else ""
    return f", growth {value.real:+.4g} 1/s{hertz}"


def mode_sets(system: System) -> Iterator[int]:
    """The mode sets to examine: contacts closed, in slip and stick and in every sector; contacts open; limiters linear.

    Of the positions of a switch: the first two, the last and the one at the start.
    """
    P = len(system.patches)
    K = len(system.normals)
    free = [LINEAR] * len(system.limiters)
    ways = [_ways(system, p) for p in range(P)]
    few = math.prod(map(len, ways)) <= MOST
    patches: list[tuple[int, ...]] = list(product(*ways)) if few else [(k,) * P for k in _KINDS]
    if not few and P <= MOST_STUCK:
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
        yield from _memory(system, step, substeps)
    if method in ADAPTIVE:
        yield from _narrow_law(system, tolerance)


def part(step: float, most: float) -> str:
    """The longest step up to `most` s that divides the sample step of `step` s, with its unit."""
    whole = round(step * 1e9)
    count = max(1, math.ceil(step / most * (1.0 - 1e-12)))
    count = next((n for n in range(count, whole) if whole % n == 0), whole)
    return f"{whole // count * 1e-9:.12g} s"


def blame(system: System, method: str, step: float, substeps: int, x: NDArray[np.float64]) -> str:
    """Whether the step made a run by rk4 or kick diverge, in words, and which step helps. See `stability_report`.

    `x`: the last state, whose driving states count: a drive may be faster than at the start.
    """
    h = step / substeps
    start = np.concatenate([system.start[: system.one], x[system.one :]])
    if np.all(np.isfinite(start)):
        system = replace(system, start=start)
    if system.film is not None:
        fastest = assembly.fastest(system, h)
        limit = FILM_LIMIT
        coarse = FILM_COARSE
    else:
        fastest = max(fastest_state(system), steepest(system))
        limit = RK4_LIMIT
        coarse = _COARSE
    size = fastest * h
    text = f"{method} took steps of {h:g} s: |lambda| h = {size:.3g}"
    if size <= coarse:
        return f"{text}, which is short enough; the motion itself grows"
    why = f"unstable beyond {limit}" if size > limit else f"coarse beyond {coarse}"
    least = 0.1 / fastest if system.film is None else FILM_COARSE / fastest
    finer = [f"clock.rk4_step to {part(step, least)} or less"] if least >= _SHORTEST else []
    other = ["clock.method to auto"] if method == "rk4" else []
    return f"{text}, {why}. " + (
        f"Set {', or '.join([*finer, *other])}" if finer or other else "No step is short enough"
    )


def fastest_eigenvalue(system: System) -> float:
    """The largest |lambda| [1/s] of all mode sets, without speed-dependent friction."""
    return max(float(np.abs(np.linalg.eigvals(assembled(system, key).A)).max()) for key in mode_sets(system))


def fastest_state(system: System) -> float:
    """The largest |lambda| [1/s] of all mode sets, with internal states of friction laws; it limits steps of rk4."""
    return max(fastest_eigenvalue(system), fastest_memory(system, mode_sets(system)).rate)


def steepest(system: System) -> float:
    """The fastest eigenvalue [1/s] where a law over speed is steepest; 0 without such a law.

    The load is that at the start. For laws with memory: rig.stability.memory_steps.
    """
    fastest = 0.0
    speeds = [0.0, *np.geomspace(1e-9, 1.0, _SPEEDS).tolist()]
    for key in mode_sets(system):
        modes = assembled(system, key)
        for p in np.flatnonzero(modes.sigma).tolist():
            law = system.law(p, key)
            if law.constant or law.states:
                continue
            slope = max((law.slope(speed) for speed in speeds), key=abs)
            load = sum(max(float(n.row @ system.start), 0.0) for n in system.normals if n.patch == p)
            bent = modes.A + np.outer(modes.b[:, p], slope * load * system.slip_rows[p])
            fastest = max(fastest, float(np.abs(np.linalg.eigvals(bent)).max()))
    return fastest


def _narrow_law(system: System, tolerance: float) -> Iterator[Finding]:
    """Whether the tolerance of dopri5 or rosenbrock resolves the slip speeds over which friction laws change.

    A released contact starts to slip along the steep part of its law. If the error is not far below the width of that
    part, the contact turns back, sticks and slips again, although the exact motion continues.
    """
    for p, (patch, load) in enumerate(zip(system.patches, start_loads(system).tolist())):
        speed = abs(float(patch.surface @ system.start))
        states = system.start[list(patch.memory)]
        widths = [_width(law, load, states) for law in system.laws(p) if not law.constant and law.sticks]
        error = tolerance * speed
        if widths and error > _FINE * min(widths):
            yield Finding(
                "warning",
                f"tolerance {tolerance:g} is too coarse for the friction law of {patch.name}, which changes within "
                f"{min(widths):.3g} m/s: errors of {error:.2g} m/s may count as events of stick and slip",
                error / min(widths),
                f"clock.tolerance of {at_most(0.5 * _FINE * min(widths) / speed, 1)} or less",
            )


def _width(law: Law, load: float, states: NDArray[np.float64]) -> float:
    """The slip speed [m/s] over which a law changes from its value at rest, taken at its steepest slope.

    With memory: while the internal states are those of the contact at rest, because a released contact passes the
    width before they change. Infinite if the law changes by less than rounding.
    """
    mu, slopes = law.at_once(np.array([0.0, *np.geomspace(1e-9, 1.0, 10 * _SPEEDS).tolist()]), load, states)
    change = float(np.ptp(mu))
    slope = float(np.abs(slopes).max())
    return change / slope if change > 0.0 and slope > 0.0 else math.inf


def _steep_law(system: System, step: float, substeps: int) -> Iterator[Finding]:
    """Whether rk4 can follow a speed-dependent law where it is steepest."""
    fastest = steepest(system)
    h = step / substeps
    if fastest * h > _COARSE:
        yield Finding(
            "warning",
            f"rk4 is coarse at a step of {h:g} s: |lambda| h = {fastest * h:.3g} where the friction law is steepest",
            fastest * h,
            f"rk4_step of {part(step, 0.1 / fastest)} or less, or method dopri5",
        )


def _memory(system: System, step: float, substeps: int) -> Iterator[Finding]:
    """Whether rk4 can follow the internal states of laws with memory."""
    fastest, speed = fastest_memory(system, mode_sets(system))
    h = step / substeps
    size = fastest * h
    moves = f"slips at {speed:.3g} m/s" if speed else "rests or creeps"
    where = f"|lambda| h = {size:.3g} where a contact whose friction law has memory {moves}"
    finer = [f"rk4_step of {part(step, 0.1 / fastest)} or less"] if 0.1 > _SHORTEST * fastest > 0.0 else []
    remedy = ", or ".join([*finer, "method auto"])
    if size > RK4_LIMIT:
        yield Finding("error", f"rk4 is unstable at a step of {h:g} s: {where}, at most {RK4_LIMIT}", size, remedy)
    elif size > _COARSE:
        yield Finding("warning", f"rk4 is coarse at a step of {h:g} s: {where}", size, remedy)


def _film(system: System, step: float, substeps: int) -> Iterator[Finding]:
    """Whether kicks can follow the fastest vibration mode of a film with all points closed and stuck."""
    h = step / substeps
    size = assembly.fastest(system, h) * h
    if size > FILM_LIMIT:
        most = _short_enough(system, h, FILM_LIMIT)
        yield Finding(
            "error",
            f"kick is unstable at a step of {h:g} s: omega h = {size:.3g} with every point closed and stuck, "
            f"at most {FILM_LIMIT}",
            size,
            f"rk4_step of {part(step, most)} or less"
            if most >= _SHORTEST
            else f"less stiffness or damping of the points: no rk4_step of {_SHORTEST:g} s or more is short enough",
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
    h = step / substeps if method == "rk4" else step
    size = fastest * h
    if method == "rk4" and size > RK4_LIMIT:
        yield Finding(
            "error",
            f"rk4 is unstable at a step of {h:g} s: |lambda| h = {size:.3g} in {name}, at most {RK4_LIMIT}",
            size,
            f"rk4_step of {part(step, 0.9 * RK4_LIMIT / fastest)} or less, or method exact or dopri5",
        )
    elif method in ("exact", *ADAPTIVE) and size > EXACT_LIMIT:
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
    elif method == "rk4" and size > _COARSE:
        yield Finding(
            "warning",
            f"rk4 is coarse at a step of {h:g} s: |lambda| h = {size:.3g} in {name}",
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
