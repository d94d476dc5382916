"""One formulation for every rig: the matrices of one mode set.

Each friction patch is in slip+ (w > 0), slip- or stick, each normal force closed or open, each limiter linear, low or
high, each position along a path in one sector, each switch of a network in one position. Within a mode set whose
friction coefficients are constant the equations are linear, x' = A x. Otherwise x' = A x + b T with inputs T: the
friction forces of patches whose coefficient depends on speed, and products of states (rig.solve.forces):

    [ Me   -T_P ] [ a   ]   [ F - K q - D v + sum_closed d_k r_k + sum_limiters                ]
    [ C_P    0  ] [ lam ] = [ rest of dw/dt: W_q v + W_e E + W_s S                               ] x
    d_k = n_k + sigma mu_k t_p (slip, constant law) | n_k (stick, or law over speed) | absent (open)
    Me  = M - sum_closed d_k g_k^T            lam: the friction force that a stuck patch needs

Stick keeps the length of the state: its constraint dw/dt = 0 is solved together with the reaction. The landing
projector Pi = I + M^-1 T (C M^-1 T)^-1 W, mass-weighted, removes the rest of w and changes nothing else.

`signal_rows` gives the outputs of a rig as rows over [x, T] of a mode set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.model.friction_law import Law
from rig.model.system import System
from rig.solve import expm, records
from rig.solve.exact import PLACES, POWERS
from rig.solve.forces import NORMAL
from rig.solve.segment_output import DEGREE

Array = NDArray[np.float64]
_SINGULAR = 1e-12
"""Share of the largest singular value below which a singular value counts as rounding."""


@dataclass(frozen=True)
class ModeSet:
    """One mode set: x' = A x + b T, with every force and guard as a row over x and, if it depends on inputs, over T.

    T: inputs [friction forces, products, rates of laws with memory]. Rows `friction` + `friction_t` T give the friction
    force of every patch (in stick, the reaction), `normal` + `normal_t` T the normal forces, `load` + `load_t` T the
    sum of the closed ones of every patch. `sigma` is +-1 in slip, otherwise 0. `nonlinear`: the patch slips with a
    speed-dependent law. `jam` = det(Me)/det(M).
    """

    key: int
    A: Array
    b: Array
    landing: Array
    friction: Array
    friction_t: Array
    normal: Array
    normal_t: Array
    load: Array
    load_t: Array
    sigma: Array
    nonlinear: NDArray[np.bool_]
    guards: Array
    guards_t: Array
    kinds: NDArray[np.int64]
    owners: NDArray[np.int64]
    jam: float


@dataclass(frozen=True)
class _Contacts:
    """The contacts in a mode set: the law of each patch, whether each normal force is closed.

    `sigma`, `nonlinear` [patch]: see ModeSet. `stuck`: the patches in stick that carry a load.
    """

    laws: list[Law]
    closed: list[bool]
    sigma: Array
    nonlinear: NDArray[np.bool_]
    stuck: list[int]

    @property
    def mu(self) -> list[float]:
        """The constant coefficients of the slipping patches; 0 for others."""
        constant = (self.sigma != 0.0) & ~self.nonlinear
        return [law.numbers[0] if own else 0.0 for law, own in zip(self.laws, constant)]


def _redundant(held: Array) -> bool:
    """Whether stuck contacts constrain the same motion twice. `held` [stuck, stuck]: effect of their forces on them."""
    if len(held) < 2:
        return False
    sizes = np.linalg.svd(held, compute_uv=False)
    return bool(sizes[-1] < _SINGULAR * sizes[0])


def _contacts(system: System, key: int) -> _Contacts:
    patch_modes, normal_modes, *_ = system.modes(key)
    laws = [system.law(p, key) for p in range(len(system.patches))]
    closed = [mode == records.CLOSED for mode in normal_modes]
    loaded = {k.patch for k, holds in zip(system.normals, closed) if holds}
    elastic = {p for p, law in enumerate(laws) if law.presliding}  # its stick is slip of speed zero
    signs = {records.STICK: 0.0, records.SLIP_PLUS: 1.0, records.SLIP_MINUS: -1.0}
    directions = [signs[mode] or float(p in elastic) for p, mode in enumerate(patch_modes)]
    sigma = np.array([sign * (p in loaded) for p, sign in enumerate(directions)])
    over_speed = np.array([not law.constant for law in laws], dtype=bool)
    stuck = [p for p, mode in enumerate(patch_modes) if mode == records.STICK and p in loaded - elastic]
    return _Contacts(laws, closed, sigma, over_speed & (sigma != 0.0), stuck)


def pushes(system: System, key: int, mu: Sequence[float]) -> dict[int, Array]:
    """The directions d_k [coordinate] in which the closed normal forces act with their friction, by index.

    `mu` [patch]: coefficient of each patch in slip.
    """
    patch_modes, normal_modes, *_ = system.modes(key)
    slips = {records.STICK: 0.0, records.SLIP_PLUS: 1.0, records.SLIP_MINUS: -1.0}
    directions = {}
    for k, (normal, mode) in enumerate(zip(system.normals, normal_modes)):
        if mode == records.CLOSED:
            p = normal.patch
            slip = slips[patch_modes[p]]
            directions[k] = normal.direction + slip * mu[p] * system.patches[p].direction
    return directions


def bearing_mass(system: System, key: int, mu: Sequence[float]) -> Array:
    """The mass matrix with friction included, Me, in mode set `key`. `mu`: see `pushes`."""
    Me = system.mass.copy()
    for k, d in pushes(system, key, mu).items():
        Me -= np.outer(d, system.normals[k].inertia)
    return Me


def _applied(system: System, key: int, rows: Array, mu: Sequence[float]) -> Array:
    """The forces on the coordinates but the inputs' of friction, as rows over [x, T]. `rows`: of the normal forces."""
    nq = len(system.coordinates)
    P = len(system.patches)
    change = system.change(system.modes(key)[3])
    R = system.force + system.coupling
    R_t = np.zeros((nq, system.inputs))
    R_t[:, P : system.rates_from] = system.force_t
    R[:, :nq] -= system.stiffness + change.stiffness
    R[:, nq : 2 * nq] -= system.damping + change.damping
    for k, d in pushes(system, key, mu).items():
        R += np.outer(d, rows[k])
        R_t[:, P : system.rates_from] += np.outer(d, system.normals[k].row_t)
    return np.hstack([R, R_t])


def _rates(system: System, key: int) -> tuple[Array, list[float], list[int]]:
    """The rates of network and signals [state, n], the gains of the limiters, and the states held at zero."""
    *_, limiter_modes, _, switch_modes = system.modes(key)
    nq = len(system.coordinates)
    rates = np.vstack([system.network, system.signals])
    gains = [limiter.gain for limiter in system.limiters]
    still: list[int] = []
    for switch, where in zip(system.switches, switch_modes):
        position = switch.positions[where]
        rates[np.array(switch.owned) - 2 * nq] = position.rates
        still += position.still
        for x, gain in position.gains.items():
            gains[x] = gain
    for limiter, gain, mode in zip(system.limiters, gains, limiter_modes):
        at = limiter.state - 2 * nq
        if mode == records.LINEAR:
            rates[at] += gain * limiter.row
        else:
            rates[at, system.one] += gain * (limiter.low if mode == records.LOW else limiter.high)
    return rates, gains, still


def assemble(system: System, key: int) -> ModeSet:
    """The matrices of mode set `key` (numpy, a fraction of a millisecond; runs once for each mode set visited)."""
    nq = len(system.coordinates)
    n = system.n
    inputs = system.inputs
    P = len(system.patches)
    v = slice(nq, 2 * nq)
    contacts = _contacts(system, key)
    stuck = contacts.stuck
    mu = contacts.mu
    change = system.change(system.modes(key)[3])
    rows = np.array([k.row for k in system.normals]).reshape(-1, n) + change.rows
    Me = bearing_mass(system, key, mu)
    applied = _applied(system, key, rows, mu)
    rates, gains, still = _rates(system, key)

    # dw/dt of the stuck patches: W_v a + (the rest, over x)
    W = system.slip_rows[stuck]
    rest = np.zeros((len(stuck), n))
    rest[:, v] += W[:, :nq]
    rest += W[:, 2 * nq : system.one] @ rates[: system.one - 2 * nq]
    rest += W[:, system.one :] @ rates[system.one - 2 * nq :]

    C = -W[:, v]
    directions = np.array([p.direction for p in system.patches]).reshape(P, nq)
    s = len(stuck)
    lhs = np.zeros((nq + s, nq + s))
    lhs[:nq, :nq] = Me
    lhs[:nq, nq:] = -directions[stuck].T
    lhs[nq:, :nq] = C
    rhs = np.zeros((nq + s, n + inputs))
    rhs[:nq] = applied
    rhs[nq:, :n] = rest
    for p in np.flatnonzero(contacts.nonlinear).tolist():
        rhs[:nq, n + p] = directions[p]
    MT = np.linalg.solve(system.mass, directions[stuck].T) if stuck else np.zeros((nq, 0))
    held = C @ MT
    redundant = _redundant(held)
    if redundant:  # the reactions are not unique: take the smallest
        solved = np.linalg.lstsq(lhs, rhs, rcond=_SINGULAR)[0]
    else:
        solved = np.linalg.solve(lhs, rhs) if nq else rhs
    a, reactions = solved[:nq], solved[nq:]

    A = np.zeros((n, n))
    b = np.zeros((n, inputs))
    A[:nq, v] = np.eye(nq)
    A[v] = a[:, :n]
    b[v] = a[:, n:]
    A[2 * nq :] = rates
    for p, patch in enumerate(system.patches):
        b[list(patch.memory), list(system.rates(p))] = 1.0
    landing = np.eye(n)
    if stuck:
        impulses = np.linalg.pinv(held, rcond=_SINGULAR) @ W if redundant else np.linalg.solve(held, W)
        landing[v] += MT @ impulses
    landing[:, still] = 0.0

    loads = _loads(system, rows, a)
    load = np.zeros((P, n + inputs))
    for k, contact in enumerate(system.normals):
        if contacts.closed[k]:
            load[contact.patch] += loads[k]
    friction = _friction(system, contacts, reactions, loads)
    _in_order(system, friction[:, n:], loads[:, n:])
    guards, kinds, owners = _guards(system, key, contacts, friction, loads, gains)
    return ModeSet(
        key=key,
        A=A,
        b=b,
        landing=landing,
        friction=friction[:, :n],
        friction_t=friction[:, n:],
        normal=loads[:, :n],
        normal_t=loads[:, n:],
        load=load[:, :n],
        load_t=load[:, n:],
        sigma=contacts.sigma,
        nonlinear=contacts.nonlinear,
        guards=guards[:, :n],
        guards_t=guards[:, n:],
        kinds=kinds,
        owners=owners,
        jam=float(np.linalg.det(Me) / np.linalg.det(system.mass)) if nq else 1.0,
    )


def _loads(system: System, rows: Array, a: NDArray[Any]) -> Array:
    """The normal forces as rows over [x, T], from their `rows` over x and the accelerations a, rows over [x, T]."""
    P = len(system.patches)
    n = system.n
    loads = np.zeros((len(system.normals), n + system.inputs))
    for k, contact in enumerate(system.normals):
        loads[k, :n] = rows[k] + contact.inertia @ a[:, :n]
        loads[k, n:] = contact.inertia @ a[:, n:]
        loads[k, n + P : n + system.rates_from] += contact.row_t
    return loads


def _friction(system: System, contacts: _Contacts, reactions: NDArray[Any], loads: Array) -> Array:
    """The friction force of each patch as a row over [x, T]; in stick the reaction."""
    friction = np.zeros((len(system.patches), loads.shape[1]))
    friction[contacts.stuck] = reactions
    for p in np.flatnonzero(contacts.nonlinear).tolist():
        friction[p, system.n + p] = 1.0
    for k, contact in enumerate(system.normals):
        p = contact.patch
        if contacts.closed[k] and contacts.sigma[p] != 0.0 and not contacts.nonlinear[p]:
            friction[p] += contacts.sigma[p] * contacts.mu[p] * loads[k]
    return friction


def _in_order(system: System, friction_t: Array, loads_t: Array) -> None:
    """Raise ValueError if a product depends on inputs that are computed after it (see rig.solve.forces)."""
    P = len(system.patches)
    later = [True] * P + [product.level > 0 for product in system.products]
    later += [False] * (system.inputs - len(later))
    for j, product in enumerate(system.products):
        for factor in product.factors:
            if factor.kind == NORMAL and np.any(loads_t[factor.index, later]):
                name = system.normals[factor.index].name
                raise ValueError(
                    f"product {product.name}: its factor, the normal force {name}, depends on another force"
                )
        if product.level == 2 and np.any(loads_t[:, P + j]):
            raise ValueError(
                f"product {product.name}: it has a friction force as a factor, so no normal force may depend on it"
            )
        if product.level == 2 and np.any(friction_t[:, P + j]):
            raise ValueError(
                f"product {product.name}: it has a friction force as a factor, so no stuck contact may depend on it"
            )


def _guards(
    system: System, key: int, contacts: _Contacts, friction: Array, loads: Array, gains: Sequence[float]
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """The guards of a mode set, rows over [x, T] that stay positive while it lasts, with their kinds and owners.

    `gains`: of the limiters; a limiter with gain 0 is out of the network.
    """
    _, _, limiter_modes, sector_modes, _ = system.modes(key)
    guards: list[tuple[Array, int, int]] = []

    def guard(row: Array, kind: int, owner: int) -> None:
        if np.any(row):  # a guard that is identically zero would only give rounding noise
            whole = np.zeros(loads.shape[1])
            whole[: len(row)] = row
            guards.append((whole, kind, owner))

    for p, law in enumerate(contacts.laws):
        sigma = contacts.sigma[p]
        if p in contacts.stuck:
            for sign, kind in ((1.0, records.G_RELEASE_PLUS), (-1.0, records.G_RELEASE_MINUS)):
                limit = np.zeros(loads.shape[1])
                for k, contact in enumerate(system.normals):
                    if contact.patch == p and contacts.closed[k] and not law.states:
                        limit += law.towards(sign).static * loads[k]
                if law.states:  # its input is the limit
                    limit[system.n + p] = 1.0
                guard(limit - sign * friction[p], kind, p)
        elif sigma != 0.0 and law.sticks:
            guard(sigma * system.slip_rows[p], records.G_SLIP, p)
        elif sigma != 0.0 and law.presliding:  # presliding: slip turns back at once
            kind = records.G_RELEASE_MINUS if sigma > 0.0 else records.G_RELEASE_PLUS
            guard(sigma * system.slip_rows[p], kind, p)
    for k, contact in enumerate(system.normals):
        if contact.opens and not _never_changes(loads[k], system):
            if contacts.closed[k]:
                guard(loads[k], records.G_OPEN, k)
            else:
                guard(-loads[k], records.G_CLOSE, k)
    constant = np.eye(system.n)[system.one]
    for x, (limiter, mode) in enumerate(zip(system.limiters, limiter_modes)):
        if gains[x] == 0.0:
            continue
        below = limiter.row - limiter.low * constant
        above = limiter.high * constant - limiter.row
        if mode == records.LINEAR:
            guard(below, records.G_LIMIT_LOW, x)
            guard(above, records.G_LIMIT_HIGH, x)
        else:
            guard(-below if mode == records.LOW else -above, records.G_LIMIT_BACK, x)
    for s, (sector, where) in enumerate(zip(system.sectors, sector_modes)):
        if sector.patch < 0 or contacts.sigma[sector.patch] != 0.0:  # a stuck contact cannot leave its sector
            ends = (*sector.edges, sector.period)
            guard(ends[where + 1] * constant - sector.row, records.G_NEXT, s)
            guard(sector.row - ends[where] * constant, records.G_PREVIOUS, s)
    rows = np.array([row for row, *_ in guards]).reshape(-1, loads.shape[1])
    kinds = np.array([kind for _, kind, _ in guards], dtype=np.int64)
    owners = np.array([owner for *_, owner in guards], dtype=np.int64)
    return rows, kinds, owners


def _never_changes(load: Array, system: System) -> bool:
    """Whether a normal force is constant: it depends only on state variables that nothing drives or writes.

    Only the state "one" is known to be constant. A load written by a command is a state and keeps its guard.
    """
    return bool(np.all(np.flatnonzero(load) == system.one))


def signal_rows(system: System, modes: ModeSet, rows: list[dict[str, float]]) -> tuple[Array, Array]:
    """Rows by name (extended rows) as rows over x [output, n] and over T [output, inputs] of one mode set."""
    nq = len(system.coordinates)
    inputs = np.eye(system.inputs)
    states = np.eye(system.n)
    none = np.zeros(system.inputs)
    no_state = np.zeros(system.n)
    known: dict[str, tuple[Array, Array]] = {}
    for i, name in enumerate(system.names):
        known[name] = (states[i], none)
    for j, product in enumerate(system.products):
        known[product.name] = (no_state, inputs[len(system.patches) + j])
    for i, name in enumerate(system.names[2 * nq :], 2 * nq):
        known[f"{name}'"] = (modes.A[i], modes.b[i])
    for i, name in enumerate(system.coordinates):
        known[f"{name}''"] = (modes.A[nq + i], modes.b[nq + i])
    for p, patch in enumerate(system.patches):
        known[f"T:{patch.name}"] = (modes.friction[p], modes.friction_t[p])
        known[f"w:{patch.name}"] = (system.slip_rows[p], none)
    _, normal_modes, clamped, _, thrown = system.modes(modes.key)
    for k, normal in enumerate(system.normals):
        closed = normal_modes[k] == 0
        known[f"N:{normal.name}"] = (modes.normal[k] * closed, modes.normal_t[k] * closed)
    gains = [switch.positions[at].gains for switch, at in zip(system.switches, thrown)]
    for i, (limiter, mode) in enumerate(zip(system.limiters, clamped)):
        limits = {records.LOW: limiter.low, records.HIGH: limiter.high}
        held = limits.get(mode)
        idle = any(of_position.get(i) == 0.0 for of_position in gains)  # a switch took the limiter out of the network
        row = limiter.row if held is None or idle else held * states[system.one]
        known[f"c:{limiter.name}"] = (row, none)
    over_x = np.zeros((len(rows), system.n))
    over_t = np.zeros((len(rows), system.inputs))
    for i, entries in enumerate(rows):
        for name, value in entries.items():
            row, row_t = known[name]
            over_x[i] += value * row
            over_t[i] += value * row_t
    return over_x, over_t


def changes(modes: ModeSet, rows: Array, step: float, levels: int) -> Array:
    """The changes of `rows` [row, n] from the begin of a cell to its PLACES, as rows over x: [level, row, place, n].

    The cells are step / 2^level long; step in s.
    """
    A = modes.A
    landing = modes.landing
    still = modes.landing - np.eye(len(modes.landing))
    out = np.zeros((levels, len(rows), len(PLACES), len(A)))
    for p, place in enumerate(PLACES.tolist() if out.size else ()):
        out[:, :, p] = rows @ (still + landing @ _ladder(A, place * step, levels) @ landing)
    return out


def reach(A: Array, b: Array, step: float, levels: int) -> Array:
    """The changes of the state, x' = A x + b T, from the begin of a cell to its PLACES: [level, place, n, n + columns].

    The columns belong to x and, for each input, to its value at the begin and its changes to the nodes. The cells are
    step / 2^level long; step in s.
    """
    n, inputs = b.shape
    out = np.zeros((levels, len(PLACES), n, n + inputs * (DEGREE + 1)))
    length = step / 2.0 ** np.arange(levels)[:, None]
    factorials = np.array([math.factorial(k) for k in range(DEGREE + 1)])
    scales = factorials / length ** np.arange(DEGREE + 1)
    chain = np.eye(n + DEGREE + 1, k=1)  # an input and its derivatives
    chain[:n] = 0.0
    chain[:n, :n] = A
    for p, place in enumerate(PLACES.tolist() if levels else ()):
        for k in range(inputs):
            chain[:n, n] = b[:, k]
            E = _ladder(chain, place * step, levels)
            at = n + k * (DEGREE + 1)
            out[:, p, :, :n] = E[:, :n, :n]
            out[:, p, :, at] = E[:, :n, n]
            derivatives = E[:, :n, n + 1 :] * scales[:, None, 1:]
            out[:, p, :, at + 1 : at + 1 + DEGREE] = derivatives @ POWERS
    return out


def _ladder(A: Array, length: float, levels: int) -> Array:
    """exp(A length / 2^level) - 1 for so many levels, [level, n, n]."""
    E = expm.ladder(A, length)[:levels]
    rest = [expm.taylor(A, length / 2.0**level, expm.ORDER) for level in range(len(E), levels)]
    return np.concatenate([E, *(term[None] for term in rest)])
