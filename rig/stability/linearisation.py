"""Steady sliding: the equilibrium of a mode set, its Jacobian and eigenvalues, from the matrices of the run.

    0 = A x + b T(x),   dx' = (A + b dT/dx) dx
    T_p = sigma mu(sigma w_p) N_p,   dT_p = sigma mu dN_p + N_p mu' dw_p,   N = load x + load_t T

Internal states of a law are states like others: their rates are inputs, and the friction force depends on them too.

Driving states without an equilibrium of their own (commands, generators) are held at their values; lags take their
steady values. The eigenvalues are those of the states that structure and network move. States that only drive them (the
exosystem) have a spectrum of their own. Products are differentiated by the product rule (rig.solve.forces).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import PartError, Singular, UsageError
from rig.model.formulation import ModeSet, signal_rows
from rig.model.products import Factor, tangent
from rig.model.singular import JAMS, assembled
from rig.model.system import System
from rig.solve.forces import FRICTION, NORMAL, PRESS, SINE, STATE
from rig.solve.records import CLOSED, SLIP_MINUS, SLIP_PLUS, STICK

Array = NDArray[np.float64]
Contact = Callable[[int, float, float], tuple[float, float, float]]
"""(patch, slip speed w, normal force N) -> friction force T, dT/dw, dT/dN."""
_COUPLED_ROUNDS = 60  # iterations of friction and normal force that depend on each other
_SHORTENED_STEPS = 60  # number of shortened steps
_WIDE = 20  # number of full steps: if they converge at all, they need a few
_FAR = 1e12  # times the previous residual: the full step diverges
_TOLERANCE = 1e-12  # residual over the largest term at which the search ends
_REST = 1e-9  # the same up to which all forces count as balanced
_LEAST = 1e-3  # shortest share of a step
_ROUNDING = 2.0**-52  # of a double, over its size
_LOOSE = 1e-12  # share of the largest stiffness below which nothing is held


@dataclass(frozen=True)
class Steady:
    """Steady sliding in one mode set, and the Jacobian about it.

    `exists`: the equilibrium was found, agrees with the modes and does not jam; if not, `x` is the last point of the
    search. `A`: the Jacobian. `moving`: the states whose eigenvalues count; `settling`: with those that only approach
    a steady value. `speed`, `load`, `friction` [patch]: slip speed, normal force and friction force. `T`: the inputs.
    `inertia`: determinant of the mass matrix with friction included, divided by that without; at zero and below the rig
    jams. `balanced`: all forces balance at `x`. `beyond`: the first output beyond the bound of the scene at an
    equilibrium that would exist otherwise, in words.
    """

    system: System
    modes: ModeSet
    exists: bool
    x: Array
    A: Array
    moving: NDArray[np.int64]
    settling: NDArray[np.int64]
    speed: Array
    load: Array
    friction: Array
    T: Array
    inertia: float
    balanced: bool
    beyond: str = ""

    @property
    def slides(self) -> bool:
        """Whether every contact slips in the direction of its mode, or rests on its bristles."""
        return _slips(self.system, self.modes, self.speed)

    @property
    def counts(self) -> bool:
        """Whether the eigenvalues are meaningful.

        With constant friction coefficients the matrix does not depend on the equilibrium. The eigenvalues then count
        even if the equilibrium would pull the contact open, as it does beyond a divergence, or lies beyond a bound of
        the scene. They never count if the rig jams.
        """
        same = not bool(self.modes.nonlinear.any()) and (self.balanced or not self.system.products)
        return self.exists or (self.inertia > 0.0 and self.slides and same)

    @property
    def unheld(self) -> str:
        """The reason, in words, where no forces balance because no spring resists some displacement; else ""."""
        nq = len(self.system.coordinates)
        if self.balanced or not nq:
            return ""
        _, sizes, shapes = np.linalg.svd(self.A[nq : 2 * nq, :nq])
        if sizes[-1] > _LOOSE * sizes[0]:
            return ""
        free = [name for name, part in zip(self.system.coordinates, np.abs(shapes[-1])) if part > _LOOSE]
        return f"no spring holds {', '.join(free)}, so forces there find no balance; give the structure a stiffness"

    @cached_property
    def _eigenvalues(self) -> NDArray[np.complex128]:
        eigenvalues = np.linalg.eigvals(self.A[np.ix_(self.moving, self.moving)]).astype(np.complex128)
        return eigenvalues[np.lexsort((-eigenvalues.imag, -eigenvalues.real))]

    def eigenvalues(self) -> NDArray[np.complex128]:
        """The eigenvalues [1/s] of the moving states, the least stable first."""
        return self._eigenvalues

    def time_scales(self) -> tuple[float, float]:
        """The shortest and the longest time constant, times 2 pi [s]: periods where the rig vibrates.

        Raises UsageError for a rig none of whose moving states has one, such as a block without a spring.
        """
        if self.unheld and not self.counts:
            raise UsageError(f"there is no cycle: {self.unheld}")
        rates = np.abs(self.eigenvalues())
        fastest = float(rates.max(initial=0.0))
        if fastest == 0.0:
            raise UsageError(
                "nothing vibrates and nothing decays in steady sliding, so there is no cycle; "
                "give the structure a stiffness"
            )
        slowest = float(rates[rates > 1e-6 * fastest].min())
        return 2.0 * np.pi / fastest, 2.0 * np.pi / slowest

    def eigenvectors(self) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """The eigenvalues [i], the least stable first, and the mode shapes [state, i] over all states.

        Motions in which a stuck contact would slip are left out: their eigenvalues are zero, twice each, and rounding
        would make some of them grow.
        """
        A = self.A[np.ix_(self.moving, self.moving)]
        memory = [patch.memory for patch in self.system.patches]
        patch_modes = self.system.modes(self.modes.key)[0]
        stuck = [p for p, mode in enumerate(patch_modes) if mode == STICK and not memory[p]]
        if stuck:
            rows = self.system.slip_rows[stuck][:, self.moving]
            within = np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows) :].T
            values, vectors = np.linalg.eig(within.T @ A @ within)
            vectors = within @ vectors
        else:
            values, vectors = np.linalg.eig(A)
        order = np.lexsort((-values.imag, -values.real))
        shapes = np.zeros((self.system.n, len(values)), dtype=np.complex128)
        shapes[self.moving] = vectors[:, order]
        return values[order].astype(np.complex128), shapes


class _Point(NamedTuple):
    """The last point of the search: x, the matrix, inputs and normal forces there, and whether all forces balance."""

    x: Array
    A: Array
    T: Array
    load: Array
    balanced: bool


def own_law(system: System, modes: ModeSet) -> Contact:
    """The friction of slipping patches by their own law; for w of the other sign the value at rest."""
    laws = [system.law(p, modes.key).tangent() for p in range(len(system.patches))]
    sigmas = modes.sigma.tolist()

    def contact(p: int, w: float, N: float) -> tuple[float, float, float]:
        sigma = sigmas[p]
        mu, slope = laws[p](max(sigma * w, 0.0), N)
        return sigma * mu * N, slope * N, sigma * mu

    return contact


def linearised(system: System, modes: ModeSet, x: Array, contact: Contact) -> tuple[Array, Array, Array]:
    """The Jacobian at x, and the inputs T and the normal forces [patch] there."""
    T, dT = inputs(system, modes, x, contact)
    return modes.A + modes.b @ dT, T, modes.load @ x + modes.load_t @ T


def inputs(system: System, modes: ModeSet, x: Array, contact: Contact) -> tuple[Array, Array]:
    """The inputs T at x and their derivatives over x [input, n]: rig.solve.forces with the chain rule."""
    P = len(system.patches)
    n = system.n
    T = np.zeros(system.inputs)
    dT = np.zeros((system.inputs, n))
    levels = {product.level for product in system.products}

    def multiply(level: int) -> None:
        if level not in levels:
            return
        if level:
            normal_modes = system.modes(modes.key)[1]
            closed = np.array([mode == CLOSED for mode in normal_modes], dtype=bool).reshape(-1, 1)
            normal = modes.normal @ x + modes.normal_t @ T
            normal_slopes = modes.normal + modes.normal_t @ dT
            friction = modes.friction @ x + modes.friction_t @ T
            friction_slopes = modes.friction + modes.friction_t @ dT
            pressed = closed[:, 0] * normal, closed * normal_slopes
            rubbed = friction, friction_slopes
        else:  # no factor is a force
            pressed = rubbed = np.zeros(0), np.zeros((0, n))
        values, slopes = tangent(system.products, level, x, (pressed, rubbed))
        T[P : system.rates_from] += values
        dT[P : system.rates_from] += slopes

    multiply(0)
    multiply(1)
    load = modes.load
    load_t = modes.load_t
    remembering = [p for p, patch in enumerate(system.patches) if patch.memory]
    slipping = [p for p in np.flatnonzero(modes.nonlinear).tolist() if p not in remembering]
    w = system.slip_rows @ x
    by_speed = np.zeros(P)
    by_load = np.zeros(P)
    by_state = np.zeros((P, n))
    coupled = bool(load_t[:, :P].any())  # N depends on T if an absorber's inertia contributes to N
    for _ in range(_COUPLED_ROUNDS if coupled else 1):
        N = load @ x + load_t @ T
        before = T.tolist()
        for p in slipping:
            T[p], by_speed[p], by_load[p] = contact(p, float(w[p]), float(N[p]))
        for p in remembering:
            values, (over_speed, over_load, over_states) = _remembered(system, modes, p, x, float(N[p]))
            T[p] = values[0]
            by_speed[p] = over_speed[0]
            by_load[p] = over_load[0]
            by_state[p] = over_states[0]
        if all(abs(force - last) <= 1e-14 * abs(last) for force, last in zip(T.tolist(), before)):
            break
    load_slopes = load + load_t[:, P:] @ dT[P:]
    change = by_speed[:, None] * system.slip_rows + by_load[:, None] * load_slopes + by_state
    try:
        dT[:P] = np.linalg.solve(np.eye(P) - by_load[:, None] * load_t[:, :P], change) if coupled else change
    except np.linalg.LinAlgError:
        raise Singular(JAMS, system.describe(modes.key), jams=True) from None
    for p in remembering:
        N_p = float(load[p] @ x + load_t[p] @ T)
        values, (over_speed, over_load, over_states) = _remembered(system, modes, p, x, N_p)
        rates = system.rates(p)
        T[rates] = values[1:]
        dT[rates] = over_states[1:] + np.outer(over_speed[1:], system.slip_rows[p])
        dT[rates] += np.outer(over_load[1:], load[p] + load_t[p] @ dT)
    multiply(2)
    return T, dT


def explicit_inputs(system: System, modes: ModeSet, contact: Contact) -> Callable[[Array], Array] | None:
    """The inputs T as a function of x, the values of `inputs` without their derivatives, which cost most of it.

    None where friction acts on its own normal force, and for laws with memory: `inputs` solves these.
    """
    P = len(system.patches)
    if system.remembers or modes.load_t[:, :P].any():
        return None
    closed = np.array([mode == CLOSED for mode in system.modes(modes.key)[1]], dtype=bool)
    slipping = np.flatnonzero(modes.nonlinear).tolist()
    angles: dict[tuple[int, bytes], Array] = {}  # rows, which many products share
    for product in system.products:
        angles |= {(f.kind, f.row.tobytes()): f.row for f in product.factors if f.row is not None}
    normal_from = system.n + len(angles)
    friction_from = normal_from + len(modes.normal)

    def place(factor: Factor) -> int:
        """Of a factor among the states, the angles, the normal forces and the friction forces."""
        if factor.row is not None:
            return system.n + [*angles].index((factor.kind, factor.row.tobytes()))
        return factor.index + {STATE: 0, NORMAL: normal_from, FRICTION: friction_from}[factor.kind]

    of_level: list[list[tuple[int, list[int]]]] = [[], [], []]
    for j, product in enumerate(system.products, P):
        of_level[product.level].append((j, [place(factor) for factor in product.factors]))

    def multiply(level: int, x: Array, values: list[float], T: Array) -> None:
        if level and of_level[level]:
            values[normal_from:friction_from] = (closed * (modes.normal @ x + modes.normal_t @ T)).tolist()
        if level == 2 and of_level[level]:
            values[friction_from:] = (modes.friction @ x + modes.friction_t @ T).tolist()
        for j, places in of_level[level]:
            T[j] = math.prod([values[i] for i in places])

    def explicit(x: Array) -> Array:
        T = np.zeros(system.inputs)
        values = x.tolist()
        values += [_of_angle(kind, float(row @ x)) for (kind, _), row in angles.items()]
        multiply(0, x, values, T)
        multiply(1, x, values, T)
        N = modes.load @ x + modes.load_t @ T
        w = system.slip_rows @ x
        for p in slipping:
            T[p] = contact(p, float(w[p]), float(N[p]))[0]
        multiply(2, x, values, T)
        return T

    return explicit


def _of_angle(kind: int, angle: float) -> float:
    """The value of a factor with an angle [rad], or with a press."""
    if kind == PRESS:
        return max(angle, 0.0)
    return math.sin(angle) if kind == SINE else -2.0 * math.sin(0.5 * angle) ** 2


def _remembered(system: System, modes: ModeSet, p: int, x: Array, N: float) -> tuple[Array, tuple[Array, Array, Array]]:
    """Friction force and rates of patch p, a law with memory, [m + 1]; derivatives over w, N and x [m + 1, n].

    As rig.solve.forces.evaluate_memory; for w of the other sign, and in stick, the value at rest.
    """
    patch = system.patches[p]
    law = system.law(p, modes.key)
    sigma = float(modes.sigma[p])
    assert law.formula is not None
    w = float(system.slip_rows[p] @ x)
    loaded = bool(np.any(modes.load[p]) or N)
    sign = sigma or (-1.0 if w < 0.0 and not loaded else 1.0)
    if system.modes(modes.key)[0][p] == STICK and loaded:
        w = 0.0
    moves = float(sigma != 0.0 or not loaded)
    turned = np.array([sign if state.along else 1.0 for state in law.states])
    memory = list(patch.memory)
    values, slopes = law.formula.evaluate(law.numbers, max(sign * w, 0.0), N, turned * x[memory])
    scale = np.array([sign * N, *turned])
    over_x = np.zeros((len(scale), system.n))
    over_x[:, memory] = scale[:, None] * slopes[:, 2:] * turned
    over_load = scale * slopes[:, 1]
    over_load[0] += sign * values[0]
    over_speed = scale * slopes[:, 0] * sign * moves
    return scale * values[:-1], (over_speed, over_load, over_x)


def moving_states(system: System, A: Array) -> NDArray[np.int64]:
    """The states of structure and network, and every driving state that depends on them."""
    moving = np.zeros(system.n, dtype=bool)
    moving[: system.one] = True
    for _ in range(system.n):
        more = moving | np.any(A[:, moving] != 0.0, axis=1)
        if np.array_equal(more, moving):
            break
        moving = more
    return np.flatnonzero(moving)


def settling(system: System, A: Array, moving: NDArray[np.int64]) -> NDArray[np.int64]:
    """The driving states outside of `moving` that approach a steady value: lags and filters.

    Commands and generators do not.
    """
    rest = np.delete(np.arange(system.n), moving)  # the first ones all move
    own = A[np.ix_(rest, rest)]
    linked = np.eye(len(rest), dtype=bool) | (own != 0.0)
    for _ in range(max(len(rest).bit_length(), 1)):
        steps = linked.astype(np.float64)  # a product of booleans is slow
        linked = steps @ steps > 0.0
    loops = linked & linked.T
    stable = np.zeros(len(rest), dtype=bool)
    for i, loop in enumerate(loops):  # the loop that contains the state
        if loop.sum() == 1:
            growth = own[i, i]
        else:
            growth = np.linalg.eigvals(own[np.ix_(loop, loop)]).real.max()
        stable[i] = growth < 0.0
    return np.asarray(rest[stable], dtype=np.int64)


def sliding_key(system: System, x: Array | None = None) -> int:
    """The mode set in which every contact is closed and slips in the direction of its surface; limiters linear.

    `x`: a state with the driving states in force; the start by default.
    """
    x = system.start if x is None else x
    held = settled(system, x)
    speeds = [float(p.surface @ held) for p in system.patches]
    slip = [SLIP_MINUS if speed < 0.0 else SLIP_PLUS for speed in speeds]
    return system.key(
        slip,
        [CLOSED] * len(system.normals),
        [0] * len(system.limiters),
        switches=[switch.at(x) for switch in system.switches],
    )


def settled(system: System, x: Array) -> Array:
    """`x` at rest, with lags at their steady values and limiters in their range."""
    out = x.copy()
    out[: system.one] = 0.0
    rates = system.signals[:, system.one :] != 0.0
    chained = np.any(rates.any(axis=0) & rates.any(axis=1))
    if not (len(system.network) or len(system.limiters) or chained):
        return out  # no driving state has a rate that depends on one with a rate: nothing settles
    stick = system.key([STICK] * len(system.patches), [1] * len(system.normals), [0] * len(system.limiters))
    A = assembled(system, stick).A
    free = settling(system, A, moving_states(system, A))
    held = np.setdiff1d(np.arange(system.one, system.n), free)
    if len(free):
        out[free] = np.linalg.solve(A[np.ix_(free, free)], -A[np.ix_(free, held)] @ x[held])
    for limiter in system.limiters:  # a lag behind a clamp settles at the clamp's limit
        if limiter.state < system.one:
            continue
        value = float(limiter.row @ out)
        rate = -float(system.signals[limiter.state - system.one, limiter.state])
        if rate > 0.0:
            clamped = min(max(value, limiter.low), limiter.high)
            out[limiter.state] += limiter.gain / rate * (clamped - value)
    return out


def steady(system: System, key: int, contact: Contact | None = None, beside: Steady | None = None) -> Steady:
    """Find steady sliding in mode set `key` by Newton's method, starting from the unloaded structure at rest.

    In a mode set with a stuck patch no equilibrium is searched; only the matrix counts. `contact`: friction force of
    patches with a speed-dependent law, if it is not the law's own (an average over a fast vibration). `beside`:
    steady sliding in this mode set with another start of the same system, near which the search begins. Raises
    rig.errors.Singular.
    """
    if beside is None or beside.modes.key != key:
        modes = assembled(system, key)
        near = None
        moving = moving_states(system, modes.A)
        free = np.sort(np.concatenate([moving, settling(system, modes.A, moving)]))
    else:
        modes = beside.modes
        near = beside.x
        moving = beside.moving
        free = beside.settling
    stuck = STICK in system.modes(key)[0]
    law = contact if contact is not None else own_law(system, modes)
    full_steps = 0 if stuck else _WIDE
    equilibrium = _newton(system, modes, law, free, full_steps, False, near)
    if near is not None and not (equilibrium.balanced and _agrees(system, modes, equilibrium)):
        equilibrium = _newton(system, modes, law, free, full_steps, False)
    slides = equilibrium.balanced and _agrees(system, modes, equilibrium)
    if not (stuck or slides):  # another search may find another equilibrium
        other = _newton(system, modes, law, free, _SHORTENED_STEPS, True)
        slides = other.balanced and _agrees(system, modes, other)
        if slides or not equilibrium.balanced:
            equilibrium = other
    x, A, T, load, balanced = equilibrium
    speed = system.slip_rows @ x
    friction = modes.friction @ x + modes.friction_t @ T
    inertia = _inertia(system, modes, speed, load, law)
    exists = not stuck and slides and inertia > 0.0
    beyond = _beyond(system, modes, x, T) if exists else ""
    return Steady(
        system, modes, exists and not beyond, x, A, moving, free, speed, load, friction, T, inertia, balanced, beyond
    )


def _beyond(system: System, modes: ModeSet, x: Array, T: Array) -> str:
    """The first output beyond its bound at x, in words; "" if there is none."""
    if not system.bounds:
        return ""
    over_x, over_t = signal_rows(system, modes, [dict(bound.row) for bound in system.bounds])
    for bound, value in zip(system.bounds, (over_x @ x + over_t @ T).tolist()):
        if not abs(value) <= bound.limit:
            limit = f"limits.{bound.name} = {bound.limit:g} {bound.unit}"
            return f"where all forces balance, {bound.name} is {value:.4g} {bound.unit}, beyond {limit}"
    return ""


def _agrees(system: System, modes: ModeSet, at: _Point) -> bool:
    """Whether every contact slips in the direction of its mode and is pressed."""
    return _slips(system, modes, system.slip_rows @ at.x) and bool(np.all(at.load[modes.sigma != 0.0] > 0.0))


def _slips(system: System, modes: ModeSet, speed: Array) -> bool:
    """Whether every contact slips in the direction of its mode; one with presliding may rest."""
    rests = np.array([patch.law.presliding for patch in system.patches], dtype=bool) & (speed == 0.0)
    return bool(np.all((modes.sigma * speed > 0.0) | rests))


def _newton(
    system: System,
    modes: ModeSet,
    law: Contact,
    free: NDArray[np.int64],
    rounds: int,
    falling: bool,
    near: Array | None = None,
) -> _Point:
    """Find the point where the rates of the states `free` vanish.

    Full steps need two rounds in most cases and also find equilibria on the way to which the residual grows first.
    `falling`: halve each step until the residual decreases. This is needed near a speed at which the structure becomes
    unstable statically, where full steps diverge.
    """
    nq = len(system.coordinates)
    rows = free[free >= nq]  # q' = v is solved by v = 0
    columns = free[(free < nq) | (free >= 2 * nq)]
    x = system.start.copy()
    x[: system.one] = 0.0 if near is None else near[: system.one]
    A, T, load = linearised(system, modes, x, law)
    if _remember(system, modes, x, load):
        A, T, load = linearised(system, modes, x, law)
    # Every preload is a term of its own: A holds it combined with the contact force that balances it.
    sizes = np.abs(modes.A), np.abs(modes.b)
    sizes[0][nq : 2 * nq] += np.abs(np.linalg.inv(system.mass)) @ np.abs(system.force)
    rate, residual, scale = _rest(modes, sizes, free, x, T)
    for _ in range(rounds):
        if residual <= _TOLERANCE * scale:
            break
        step = np.linalg.lstsq(A[np.ix_(rows, columns)], rate[rows], rcond=1e-14)[0]
        before = residual
        share = 1.0
        while share > (_LEAST if falling else 0.5):
            y = x.copy()
            y[columns] -= share * step
            linearisation = linearised(system, modes, y, law)
            rate, residual, scale = _rest(modes, sizes, free, y, linearisation[1])
            if residual < before:
                break
            share *= 0.5
        if not residual < (before if falling else _FAR * before):
            residual = before
            break
        x = y
        A, T, load = linearisation
    rounding = np.abs(x[columns]) <= _ROUNDING * np.linalg.norm(x[columns])  # below the resolution of lstsq
    x[columns[rounding]] = 0.0
    return _Point(x, A, T, load, residual <= _REST * scale)


def _remember(system: System, modes: ModeSet, x: Array, load: Array) -> bool:
    """Write the internal states of slipping patches in steady slip at x under `load` [patch]; whether there are any.

    From their start Newton's method may not reach them: an age changes over decades.
    """
    remembers = False
    for p, patch in enumerate(system.patches):
        law = system.law(p, modes.key)
        sigma = float(modes.sigma[p])
        if law.formula is not None and patch.memory and sigma != 0.0:
            speed = max(sigma * float(system.slip_rows[p] @ x), 0.0)
            states = law.steady(speed, float(load[p]))
            if fault := law.fault(speed, float(load[p]), states):
                raise PartError(fault)
            x[list(patch.memory)] = [sigma * z if state.along else z for state, z in zip(law.states, states)]
            remembers = True
    return remembers


def _inertia(system: System, modes: ModeSet, speed: Array, load: Array, contact: Contact) -> float:
    """det(M with friction)/det(M), for constant and speed-dependent coefficients together."""
    P = len(system.patches)
    by_force = modes.load_t[:, : len(system.patches)]
    if not np.any(by_force):
        return modes.jam
    by_load = np.zeros(P)
    for p in np.flatnonzero(modes.nonlinear).tolist():
        by_load[p] = contact(p, float(speed[p]), float(load[p]))[2]
    return modes.jam * float(np.linalg.det(np.eye(P) - by_load[:, None] * by_force))


def _rest(
    modes: ModeSet, sizes: tuple[Array, Array], free: NDArray[np.int64], x: Array, T: Array
) -> tuple[Array, float, float]:
    """The rates of all states at x, the largest of the states `free`, and their largest sum of absolute terms.

    `sizes`: absolute values of the terms over x and T.
    """
    rate = modes.A @ x + modes.b @ T
    terms = sizes[0] @ np.abs(x) + sizes[1] @ np.abs(T)
    return rate, float(np.abs(rate[free]).max(initial=0.0)), float(terms[free].max(initial=0.0)) or 1.0
