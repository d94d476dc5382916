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

Outputs of the plant as rows over its state: for the sensors and for the plant's own record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.model.system import System
from rig.solve import expm
from rig.solve.exact import PLACES, POWERS
from rig.solve.forces import NORMAL
from rig.solve.records import (
    CLOSED,
    G_CLOSE,
    G_LIMIT_BACK,
    G_LIMIT_HIGH,
    G_LIMIT_LOW,
    G_NEXT,
    G_OPEN,
    G_PREVIOUS,
    G_RELEASE_MINUS,
    G_RELEASE_PLUS,
    G_SLIP,
    HIGH,
    LINEAR,
    LOW,
    OPEN,
    SLIP_PLUS,
    STICK,
)
from rig.solve.segment_output import DEGREE

Array = NDArray[np.float64]
_SINGULAR = 1e-12
"""Share of the largest singular value below which a singular value counts as rounding."""


@dataclass(frozen=True)
class ModeSet:
    """One mode set: x' = A x + b T, with every force and guard as a row over x and, if it depends on inputs, over T.

    T: inputs [friction forces, products]. Rows `friction` + `friction_t` T give the friction force of every patch (in
    stick, the reaction), `normal` + `normal_t` T the normal forces. `sigma` is +-1 in slip, otherwise 0. `nonlinear`:
    the patch slips with a speed-dependent law. `jam` = det(Me)/det(M).
    """

    key: int
    A: Array
    b: Array
    landing: Array
    friction: Array
    friction_t: Array
    normal: Array
    normal_t: Array
    sigma: Array
    nonlinear: NDArray[np.bool_]
    guards: Array
    guards_t: Array
    kinds: NDArray[np.int64]
    owners: NDArray[np.int64]
    jam: float


def _redundant(held: Array) -> bool:
    """Whether stuck contacts constrain the same motion twice. `held` [stuck, stuck]: effect of their forces on them."""
    sizes = np.linalg.svd(held, compute_uv=False)
    return bool(len(sizes) > 1 and sizes[-1] < _SINGULAR * sizes[0])


def assemble(system: System, key: int) -> ModeSet:
    """The matrices of mode set `key` (numpy, a fraction of a millisecond; runs once for each mode set visited)."""
    patch_modes, normal_modes, limiter_modes, sector_modes, switch_modes = system.modes(key)
    nq, n, inputs = len(system.coordinates), system.n, system.inputs
    v = slice(nq, 2 * nq)
    P, K = len(system.patches), len(system.normals)
    laws = [system.law(p, sector_modes) for p in range(P)]
    change = system.change(sector_modes)
    rows = np.array([k.row for k in system.normals]).reshape(K, n) + change.rows
    loaded = [any(k.patch == p and normal_modes[i] == CLOSED for i, k in enumerate(system.normals)) for p in range(P)]
    sigma = np.array(
        [0.0 if m == STICK or not loaded[p] else (1.0 if m == SLIP_PLUS else -1.0) for p, m in enumerate(patch_modes)]
    )
    over_speed = np.array([not law.constant for law in laws], dtype=bool)
    nonlinear = over_speed & (sigma != 0.0)
    stuck = [p for p, m in enumerate(patch_modes) if m == STICK and loaded[p]]

    Me = system.mass.copy()
    R, R_t = system.force + system.coupling, np.zeros((nq, inputs))
    R_t[:, P:] = system.force_t
    R[:, :nq] -= system.stiffness + change.stiffness
    R[:, v] -= system.damping + change.damping
    for k, normal in enumerate(system.normals):
        if normal_modes[k] == OPEN:
            continue
        d = normal.direction.copy()
        p = normal.patch
        if sigma[p] != 0.0 and not nonlinear[p]:
            d += sigma[p] * laws[p].numbers[0] * system.patches[p].direction
        Me -= np.outer(d, normal.inertia)
        R += np.outer(d, rows[k])
        R_t[:, P:] += np.outer(d, normal.row_t)

    first = system.one
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
        if mode == LINEAR:
            rates[at] += gain * limiter.row
        else:
            rates[at, first] += gain * (limiter.low if mode == LOW else limiter.high)
    network, signals = rates[: first - 2 * nq], rates[first - 2 * nq :]

    # dw/dt of the stuck patches: W_v a + (the rest, over x)
    rest = np.zeros((len(stuck), n))
    W = system.slip_rows[stuck]
    rest[:, v] += W[:, :nq]
    rest += W[:, 2 * nq : first] @ network
    rest += W[:, first:] @ signals

    C = -W[:, v]
    directions = np.array([p.direction for p in system.patches]).reshape(P, nq)
    s = len(stuck)
    lhs = np.zeros((nq + s, nq + s))
    lhs[:nq, :nq] = Me
    lhs[:nq, nq:] = -directions[stuck].T
    lhs[nq:, :nq] = C
    rhs = np.zeros((nq + s, n + inputs))
    rhs[:nq, :n], rhs[:nq, n:] = R, R_t
    rhs[nq:, :n] = rest
    for p in range(P):
        if nonlinear[p]:
            rhs[:nq, n + p] = directions[p]
    MT = np.linalg.solve(system.mass, directions[stuck].T) if stuck else np.zeros((nq, 0))
    redundant = _redundant(C @ MT)
    if redundant:  # the reactions are not unique: take the smallest
        solved = np.linalg.lstsq(lhs, rhs, rcond=_SINGULAR)[0]
    else:
        solved = np.linalg.solve(lhs, rhs) if nq else rhs
    a, lam = solved[:nq], solved[nq:]

    A = np.zeros((n, n))
    A[:nq, v] = np.eye(nq)
    A[v] = a[:, :n]
    A[2 * nq :] = rates
    b = np.zeros((n, inputs))
    b[v] = a[:, n:]

    loads, loads_t = np.zeros((K, n)), np.zeros((K, inputs))
    for k, contact in enumerate(system.normals):
        loads[k] = rows[k] + contact.inertia @ a[:, :n]
        loads_t[k] = contact.inertia @ a[:, n:]
        loads_t[k, P:] += contact.row_t
    friction, friction_t = np.zeros((P, n)), np.zeros((P, inputs))
    for p in range(P):
        if p in stuck:
            friction[p], friction_t[p] = lam[stuck.index(p), :n], lam[stuck.index(p), n:]
        elif nonlinear[p]:
            friction_t[p, p] = 1.0
        elif sigma[p] != 0.0:
            for k, contact in enumerate(system.normals):
                if contact.patch == p and normal_modes[k] == CLOSED:
                    friction[p] += sigma[p] * laws[p].numbers[0] * loads[k]
                    friction_t[p] += sigma[p] * laws[p].numbers[0] * loads_t[k]
    _in_order(system, friction_t, loads_t)

    landing = np.eye(n)
    if stuck:
        landing[v] += MT @ (np.linalg.pinv(C @ MT, rcond=_SINGULAR) @ W if redundant else np.linalg.solve(C @ MT, W))
    landing[:, still] = 0.0

    guards, guards_t, kinds, owners = _guards(system, key, sigma, stuck, friction, friction_t, loads, loads_t, gains)
    return ModeSet(
        key=key,
        A=A,
        b=b,
        landing=landing,
        friction=friction,
        friction_t=friction_t,
        normal=loads,
        normal_t=loads_t,
        sigma=sigma,
        nonlinear=nonlinear,
        guards=np.array(guards).reshape(-1, n),
        guards_t=np.array(guards_t).reshape(len(guards), inputs),
        kinds=np.array(kinds, dtype=np.int64),
        owners=np.array(owners, dtype=np.int64),
        jam=float(np.linalg.det(Me) / np.linalg.det(system.mass)) if nq else 1.0,
    )


def _in_order(system: System, friction_t: Array, loads_t: Array) -> None:
    """Raise ValueError if a product depends on inputs that are computed after it (see rig.solve.forces)."""
    P = len(system.patches)
    later = [True] * P + [product.level > 0 for product in system.products]
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
    system: System,
    key: int,
    sigma: Array,
    stuck: Sequence[int],
    friction: Array,
    friction_t: Array,
    loads: Array,
    loads_t: Array,
    gains: Sequence[float],
) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]]:
    """The guards of a mode set, as rows over x and T that stay positive while it lasts, with their kinds and owners.

    `gains`: of the limiters; a limiter with gain 0 is out of the network.
    """
    _, normal_modes, limiter_modes, sector_modes, _ = system.modes(key)
    n, inputs = system.n, system.inputs
    guards: list[Array] = []
    guards_t: list[Array] = []
    kinds: list[int] = []
    owners: list[int] = []

    def guard(row: Array, row_t: Array, kind: int, owner: int) -> None:
        if np.any(row) or np.any(row_t):  # a guard that is identically zero would only give rounding noise
            guards.append(row)
            guards_t.append(row_t)
            kinds.append(kind)
            owners.append(owner)

    for p in range(len(system.patches)):
        static = system.law(p, sector_modes).static
        if p in stuck:
            limit, limit_t = np.zeros(n), np.zeros(inputs)
            for k, contact in enumerate(system.normals):
                if contact.patch == p and normal_modes[k] == CLOSED:
                    limit += static * loads[k]
                    limit_t += static * loads_t[k]
            guard(limit - friction[p], limit_t - friction_t[p], G_RELEASE_PLUS, p)
            guard(limit + friction[p], limit_t + friction_t[p], G_RELEASE_MINUS, p)
        elif sigma[p] != 0.0 and system.law(p, sector_modes).sticks:
            guard(sigma[p] * system.slip_rows[p], np.zeros(inputs), G_SLIP, p)
    for k, contact in enumerate(system.normals):
        if not contact.opens or _never_changes(loads[k], loads_t[k], system):
            continue
        closed = normal_modes[k] == CLOSED
        sign = 1.0 if closed else -1.0
        guard(sign * loads[k], sign * loads_t[k], G_OPEN if closed else G_CLOSE, k)
    one = np.zeros(n)
    one[system.one] = 1.0
    for x, (limiter, mode) in enumerate(zip(system.limiters, limiter_modes)):
        if gains[x] == 0.0:
            continue
        below, above = limiter.row - limiter.low * one, limiter.high * one - limiter.row
        if mode == LINEAR:
            guard(below, np.zeros(inputs), G_LIMIT_LOW, x)
            guard(above, np.zeros(inputs), G_LIMIT_HIGH, x)
        else:
            guard(-below if mode == LOW else -above, np.zeros(inputs), G_LIMIT_BACK, x)
    for s, (sector, where) in enumerate(zip(system.sectors, sector_modes)):
        if sector.patch < 0 or sigma[sector.patch] != 0.0:  # a stuck contact cannot leave its sector
            ends = (*sector.edges, sector.period)
            guard(ends[where + 1] * one - sector.row, np.zeros(inputs), G_NEXT, s)
            guard(sector.row - ends[where] * one, np.zeros(inputs), G_PREVIOUS, s)

    return (
        np.array(guards).reshape(-1, n),
        np.array(guards_t).reshape(len(guards), inputs),
        np.array(kinds, dtype=np.int64),
        np.array(owners, dtype=np.int64),
    )


def _never_changes(row: Array, row_t: Array, system: System) -> bool:
    """Whether a normal force is constant: it depends only on state variables that nothing drives or writes.

    Only the state "one" is known to be constant. A load written by a command is a state and keeps its guard.
    """
    used = np.flatnonzero(row)
    return not np.any(row_t) and bool(np.all(used == system.one))


def signal_rows(system: System, modes: ModeSet, rows: list[dict[str, float]]) -> tuple[Array, Array]:
    """Rows by name (extended rows) as rows over x [output, n] and over T [output, inputs] of one mode set."""
    nq, inputs, states = len(system.coordinates), np.eye(system.inputs), np.eye(system.n)
    known: dict[str, tuple[Array, Array]] = {}
    for i, name in enumerate(system.names):
        known[name] = (states[i], np.zeros(system.inputs))
    for j, product in enumerate(system.products):
        known[product.name] = (np.zeros(system.n), inputs[len(system.patches) + j])
    for i, name in enumerate(system.names[2 * nq :], 2 * nq):
        known[f"{name}'"] = (modes.A[i], modes.b[i])
    for i, name in enumerate(system.coordinates):
        known[f"{name}''"] = (modes.A[nq + i], modes.b[nq + i])
    for p, patch in enumerate(system.patches):
        known[f"T:{patch.name}"] = (modes.friction[p], modes.friction_t[p])
        known[f"w:{patch.name}"] = (system.slip_rows[p], np.zeros(system.inputs))
    for k, normal in enumerate(system.normals):
        closed = system.modes(modes.key)[1][k] == 0
        known[f"N:{normal.name}"] = (modes.normal[k] * closed, modes.normal_t[k] * closed)
    clamped, thrown = system.modes(modes.key)[2], system.modes(modes.key)[4]
    gains = [position.gains for position in (s.positions[at] for s, at in zip(system.switches, thrown))]
    for i, (limiter, mode) in enumerate(zip(system.limiters, clamped)):
        held = {LOW: limiter.low, HIGH: limiter.high}.get(mode)
        idle = any(found.get(i) == 0.0 for found in gains)  # a switch took the limiter out of the network
        within = held is None or idle
        known[f"c:{limiter.name}"] = (limiter.row if within else held * states[system.one], np.zeros(system.inputs))
    over_x, over_t = np.zeros((len(rows), system.n)), np.zeros((len(rows), system.inputs))
    for i, row in enumerate(rows):
        for name, value in row.items():
            over_x[i] += value * known[name][0]
            over_t[i] += value * known[name][1]
    return over_x, over_t


def changes(modes: ModeSet, rows: Array, step: float, levels: int) -> Array:
    """The changes of `rows` [row, n] from the begin of a cell to its PLACES, as rows over x: [level, row, place, n].

    The cells are step / 2^level long; step in s.
    """
    A, landing, still = modes.A, modes.landing, modes.landing - np.eye(len(modes.landing))
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
    scales = np.array([math.factorial(k) for k in range(DEGREE + 1)]) / length ** np.arange(DEGREE + 1)
    chain = np.eye(n + DEGREE + 1, k=1)  # an input and its derivatives
    chain[:n] = 0.0
    chain[:n, :n] = A
    for p, place in enumerate(PLACES.tolist() if levels else ()):
        for k in range(inputs):
            chain[:n, n] = b[:, k]
            E, at = _ladder(chain, place * step, levels), n + k * (DEGREE + 1)
            out[:, p, :, :n] = E[:, :n, :n]
            out[:, p, :, at] = E[:, :n, n]
            out[:, p, :, at + 1 : at + 1 + DEGREE] = (E[:, :n, n + 1 :] * scales[:, None, 1:]) @ POWERS
    return out


def _ladder(A: Array, length: float, levels: int) -> Array:
    """exp(A length / 2^level) - 1 for so many levels, [level, n, n]."""
    E = expm.ladder(A, length)[:levels]
    rest = [expm.taylor(A, length / 2.0**level, expm.ORDER) for level in range(len(E), levels)]
    return np.concatenate([E, *(one[None] for one in rest)])
