"""One formulation for every rig: the matrices of one mode set.

Each friction patch is in slip+ (w > 0), slip- or stick, each normal force closed or open, each limiter linear, low or
high. Within a mode set whose friction coefficients are constant the motion is linear, x' = A x. A patch whose
coefficient depends on speed contributes x' = A x + b T with its friction force T as input:

    [ Me   -T_P ] [ a   ]   [ F - K q - D v + sum_closed d_k r_k + sum_limiters                ]
    [ C_P    0  ] [ lam ] = [ rest of dw/dt: W_q v + W_e E + W_s S                               ] x
    d_k = n_k + sigma mu_k t_p (slip, constant law) | n_k (stick, or law over speed) | absent (open)
    Me  = M - sum_closed d_k g_k^T            lam: the friction force a stuck patch needs

Stick keeps the state's length: its constraint dw/dt = 0 is solved with the reaction, and the landing projector
Pi = I + M^-1 T (C M^-1 T)^-1 W, mass-weighted, removes the rest of w and moves nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.solve.laws import Law

Array = NDArray[np.float64]

SLIP_PLUS, SLIP_MINUS, STICK = range(3)
CLOSED, OPEN = range(2)
LINEAR, LOW, HIGH = range(3)

# kinds of guards: what happens when the guard falls through zero
G_SLIP, G_RELEASE_PLUS, G_RELEASE_MINUS, G_OPEN, G_CLOSE, G_LIMIT_LOW, G_LIMIT_HIGH, G_LIMIT_BACK = range(8)
GUARD_NAMES = ("slip ends", "releases +", "releases -", "opens", "closes", "clamps low", "clamps high", "unclamps")


@dataclass(frozen=True)
class Patch:
    """A friction patch: `direction` [coordinate] of the friction force, `surface` speed row [state], its law."""

    name: str
    direction: Array
    surface: Array
    law: Law


@dataclass(frozen=True)
class Normal:
    """A normal force N = row x + inertia . a of patch number `patch`, acting along `direction`."""

    name: str
    patch: int
    row: Array
    direction: Array
    inertia: Array
    opens: bool


@dataclass(frozen=True)
class Limiter:
    """A clamp: the derivative of state `state` gains `gain * min(max(row x, low), high)`."""

    name: str
    row: Array
    low: float
    high: float
    state: int
    gain: float


@dataclass(frozen=True)
class System:
    """A rig as matrices over x = [q, v, network, signals]; the first signal is the constant one."""

    names: tuple[str, ...]
    coordinates: tuple[str, ...]
    mass: Array
    damping: Array
    stiffness: Array
    force: Array
    network: Array
    signals: Array
    patches: tuple[Patch, ...]
    normals: tuple[Normal, ...]
    limiters: tuple[Limiter, ...]
    start: Array
    slip_rows: Array = field(init=False)

    def __post_init__(self) -> None:
        nq = len(self.coordinates)
        rows = np.array([p.surface for p in self.patches]).reshape(-1, self.n)
        for i, patch in enumerate(self.patches):
            rows[i, nq : 2 * nq] -= patch.direction
        object.__setattr__(self, "slip_rows", rows)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.names)

    @property
    def one(self) -> int:
        """Index of the constant signal."""
        return 2 * len(self.coordinates) + len(self.network)

    @property
    def keys(self) -> int:
        """Number of mode sets."""
        return int(3 ** len(self.patches) * 2 ** len(self.normals) * 3 ** len(self.limiters))

    def key(self, patches: Sequence[int], normals: Sequence[int], limiters: Sequence[int]) -> int:
        """Mixed-radix number of a mode set."""
        key, base = 0, 1
        for modes, radix in ((patches, 3), (normals, 2), (limiters, 3)):
            for mode in modes:
                key += int(mode) * base
                base *= radix
        return key

    def modes(self, key: int) -> tuple[list[int], list[int], list[int]]:
        """The mode set of a number."""
        out: list[list[int]] = []
        for count, radix in ((len(self.patches), 3), (len(self.normals), 2), (len(self.limiters), 3)):
            modes = []
            for _ in range(count):
                modes.append(key % radix)
                key //= radix
            out.append(modes)
        return out[0], out[1], out[2]

    def describe(self, key: int) -> str:
        """The mode set in words, e.g. "contact slip+"."""
        patches, normals, limiters = self.modes(key)
        words = [f"{p.name} {('slip+', 'slip-', 'stick')[m]}" for p, m in zip(self.patches, patches)]
        words += [f"{k.name} open" for k, m in zip(self.normals, normals) if m == OPEN]
        words += [f"{x.name} {('', 'low', 'high')[m]}" for x, m in zip(self.limiters, limiters) if m]
        return ", ".join(words) or "free"


@dataclass(frozen=True)
class ModeSet:
    """One mode set: x' = A x + b T, every output and guard a row over x and, where a law needs it, over T.

    T [patch]: friction force; rows `friction` + `friction_t` T give the force of every patch (reaction in stick),
    `normal` + `normal_t` T the normal forces. `sigma` is +-1 in slip, 0 else. `jam` = det(Me)/det(M).
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


def assemble(system: System, key: int) -> ModeSet:
    """The matrices of mode set `key` (numpy, a fraction of a millisecond; runs once for each set visited)."""
    patch_modes, normal_modes, limiter_modes = system.modes(key)
    nq, n = len(system.coordinates), system.n
    v = slice(nq, 2 * nq)
    P, K = len(system.patches), len(system.normals)
    loaded = [any(k.patch == p and normal_modes[i] == CLOSED for i, k in enumerate(system.normals)) for p in range(P)]
    sigma = np.array(
        [0.0 if m == STICK or not loaded[p] else (1.0 if m == SLIP_PLUS else -1.0) for p, m in enumerate(patch_modes)]
    )
    over_speed = np.array([not p.law.constant for p in system.patches], dtype=bool)
    nonlinear = over_speed & (sigma != 0.0)
    stuck = [p for p, m in enumerate(patch_modes) if m == STICK and loaded[p]]

    Me = system.mass.copy()
    R = system.force.copy()
    R[:, :nq] -= system.stiffness
    R[:, v] -= system.damping
    for k, normal in enumerate(system.normals):
        if normal_modes[k] == OPEN:
            continue
        d = normal.direction.copy()
        p = normal.patch
        if sigma[p] != 0.0 and not nonlinear[p]:
            d += sigma[p] * system.patches[p].law.numbers[0] * system.patches[p].direction
        Me -= np.outer(d, normal.inertia)
        R += np.outer(d, normal.row)

    signals = system.signals.copy()
    first = system.one
    for limiter, mode in zip(system.limiters, limiter_modes):
        at = limiter.state - first
        if mode == LINEAR:
            signals[at] += limiter.gain * limiter.row
        else:
            signals[at, first] += limiter.gain * (limiter.low if mode == LOW else limiter.high)

    # dw/dt of the stuck patches: W_v a + (the rest, over x)
    rest = np.zeros((len(stuck), n))
    W = system.slip_rows[stuck]
    rest[:, v] += W[:, :nq]
    rest += W[:, 2 * nq : first] @ system.network
    rest += W[:, first:] @ signals

    C = -W[:, v]
    directions = np.array([p.direction for p in system.patches]).reshape(P, nq)
    s = len(stuck)
    lhs = np.zeros((nq + s, nq + s))
    lhs[:nq, :nq] = Me
    lhs[:nq, nq:] = -directions[stuck].T
    lhs[nq:, :nq] = C
    rhs = np.zeros((nq + s, n + P))
    rhs[:nq, :n] = R
    rhs[nq:, :n] = rest
    for p in range(P):
        if nonlinear[p]:
            rhs[:nq, n + p] = directions[p]
    solved = np.linalg.solve(lhs, rhs) if nq else rhs
    a, lam = solved[:nq], solved[nq:]

    A = np.zeros((n, n))
    A[:nq, v] = np.eye(nq)
    A[v] = a[:, :n]
    A[2 * nq : first] = system.network
    A[first:] = signals
    b = np.zeros((n, P))
    b[v] = a[:, n:]

    loads, loads_t = np.zeros((K, n)), np.zeros((K, P))
    for k, contact in enumerate(system.normals):
        loads[k] = contact.row + contact.inertia @ a[:, :n]
        loads_t[k] = contact.inertia @ a[:, n:]
    friction, friction_t = np.zeros((P, n)), np.zeros((P, P))
    for p in range(P):
        if p in stuck:
            friction[p], friction_t[p] = lam[stuck.index(p), :n], lam[stuck.index(p), n:]
        elif nonlinear[p]:
            friction_t[p, p] = 1.0
        elif sigma[p] != 0.0:
            for k, contact in enumerate(system.normals):
                if contact.patch == p and normal_modes[k] == CLOSED:
                    friction[p] += sigma[p] * system.patches[p].law.numbers[0] * loads[k]
                    friction_t[p] += sigma[p] * system.patches[p].law.numbers[0] * loads_t[k]

    landing = np.eye(n)
    if stuck:
        MT = np.linalg.solve(system.mass, directions[stuck].T)
        landing[v] += MT @ np.linalg.solve(C @ MT, W)

    guards, guards_t, kinds, owners = _guards(system, key, sigma, stuck, friction, friction_t, loads, loads_t)
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
        guards_t=np.array(guards_t).reshape(len(guards), P),
        kinds=np.array(kinds, dtype=np.int64),
        owners=np.array(owners, dtype=np.int64),
        jam=float(np.linalg.det(Me) / np.linalg.det(system.mass)) if nq else 1.0,
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
) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]]:
    """What holds while the mode set lasts, as rows over x and T that stay positive; their kinds and owners."""
    _, normal_modes, limiter_modes = system.modes(key)
    n, P = system.n, len(system.patches)
    guards: list[Array] = []
    guards_t: list[Array] = []
    kinds: list[int] = []
    owners: list[int] = []

    def guard(row: Array, row_t: Array, kind: int, owner: int) -> None:
        if np.any(row) or np.any(row_t):  # a guard that vanishes identically is only noise
            guards.append(row)
            guards_t.append(row_t)
            kinds.append(kind)
            owners.append(owner)

    for p, patch in enumerate(system.patches):
        if p in stuck:
            limit, limit_t = np.zeros(n), np.zeros(P)
            for k, contact in enumerate(system.normals):
                if contact.patch == p and normal_modes[k] == CLOSED:
                    limit += patch.law.static * loads[k]
                    limit_t += patch.law.static * loads_t[k]
            guard(limit - friction[p], limit_t - friction_t[p], G_RELEASE_PLUS, p)
            guard(limit + friction[p], limit_t + friction_t[p], G_RELEASE_MINUS, p)
        elif sigma[p] != 0.0:
            guard(sigma[p] * system.slip_rows[p], np.zeros(P), G_SLIP, p)
    for k, contact in enumerate(system.normals):
        if not contact.opens or _never_changes(loads[k], loads_t[k], system):
            continue
        closed = normal_modes[k] == CLOSED
        sign = 1.0 if closed else -1.0
        guard(sign * loads[k], sign * loads_t[k], G_OPEN if closed else G_CLOSE, k)
    one = np.zeros(n)
    one[system.one] = 1.0
    for x, (limiter, mode) in enumerate(zip(system.limiters, limiter_modes)):
        below, above = limiter.row - limiter.low * one, limiter.high * one - limiter.row
        if mode == LINEAR:
            guard(below, np.zeros(P), G_LIMIT_LOW, x)
            guard(above, np.zeros(P), G_LIMIT_HIGH, x)
        else:
            guard(-below if mode == LOW else -above, np.zeros(P), G_LIMIT_BACK, x)

    return (
        np.array(guards).reshape(-1, n),
        np.array(guards_t).reshape(len(guards), P),
        np.array(kinds, dtype=np.int64),
        np.array(owners, dtype=np.int64),
    )


def _never_changes(row: Array, row_t: Array, system: System) -> bool:
    """Whether a normal force is a constant: it rests on signals alone that nothing drives or writes.

    Only the signal "one" is known to stay; a load written by a command is a state and keeps its guard.
    """
    used = np.flatnonzero(row)
    return not np.any(row_t) and bool(np.all(used == system.one))
