"""The linearised equations of a mode set at a state: the Jacobian, and the states whose eigenvalues count.

dx' = (A + b dT/dx) dx
T_p = sigma mu(sigma w_p) N_p,   dT_p = sigma mu dN_p + N_p mu' dw_p,   N = load x + load_t T
products by the product rule (rig.solve.product_inputs)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rig.errors import Singular
from rig.model import product_terms
from rig.model.formulation import ModeSet
from rig.model.singular import JAMS
from rig.model.system import System
from rig.solve.state_codes import CLOSED

Array = NDArray[np.float64]
Contact = Callable[[int, float, float], tuple[float, float, float]]
"""(patch, slip speed w, normal force N) -> friction force T, dT/dw, dT/dN."""
_ROUNDS = 60  # iterations of friction and normal force that depend on each other


def own_law(system: System, modes: ModeSet) -> Contact:
    """The friction of slipping patches by their own law; for w of the other sign the value at rest."""
    sectors = system.modes(modes.key)[3]
    laws = [system.law(p, sectors) for p in range(len(system.patches))]

    def contact(p: int, w: float, N: float) -> tuple[float, float, float]:
        sigma, law = float(modes.sigma[p]), laws[p]
        v = max(sigma * w, 0.0)
        mu = law.mu(v)
        return sigma * mu * N, law.slope(v) * N, sigma * mu

    return contact


def linearised(system: System, modes: ModeSet, x: Array, contact: Contact) -> tuple[Array, Array, Array]:
    """The Jacobian at x, and the inputs T and the normal forces [patch] there."""
    T, dT = inputs(system, modes, x, contact)
    load, load_t = loads(system, modes)
    return modes.A + modes.b @ dT, T, load @ x + load_t @ T


def loads(system: System, modes: ModeSet) -> tuple[Array, Array]:
    """Rows of the sum of closed normal forces of each patch: over x [patch, n] and over the inputs [patch, inputs]."""
    P, closed = len(system.patches), system.modes(modes.key)[1]
    load, load_t = np.zeros((P, system.n)), np.zeros((P, system.inputs))
    for k, normal in enumerate(system.normals):
        if closed[k] == CLOSED:
            load[normal.patch] += modes.normal[k]
            load_t[normal.patch] += modes.normal_t[k]
    return load, load_t


def inputs(system: System, modes: ModeSet, x: Array, contact: Contact) -> tuple[Array, Array]:
    """The inputs T at x and their derivatives over x [input, n]: rig.solve.forces with the chain rule."""
    P, n = len(system.patches), system.n
    T, dT = np.zeros(system.inputs), np.zeros((system.inputs, n))
    closed = np.array([mode == CLOSED for mode in system.modes(modes.key)[1]], dtype=bool).reshape(-1, 1)

    def multiply(level: int) -> None:
        pressed = closed[:, 0] * (modes.normal @ x + modes.normal_t @ T), closed * (modes.normal + modes.normal_t @ dT)
        rubbed = modes.friction @ x + modes.friction_t @ T, modes.friction + modes.friction_t @ dT
        values, slopes = product_terms.tangent(system.products, level, x, (pressed, rubbed))
        T[P:] += values
        dT[P:] += slopes

    multiply(0)
    multiply(1)
    load, load_t = loads(system, modes)
    slipping = np.flatnonzero(modes.nonlinear)
    w = system.slip_rows @ x
    by_speed, by_load = np.zeros(P), np.zeros(P)
    for _ in range(_ROUNDS if np.any(load_t[:, :P]) else 1):  # N depends on T if an absorber's inertia contributes to N
        N = load @ x + load_t @ T
        before = T.tolist()
        for p in slipping:
            T[p], by_speed[p], by_load[p] = contact(int(p), float(w[p]), float(N[p]))
        if all(abs(force - last) <= 1e-14 * abs(last) for force, last in zip(T.tolist(), before)):
            break
    change = by_speed[:, None] * system.slip_rows + by_load[:, None] * (load + load_t[:, P:] @ dT[P:])
    try:
        dT[:P] = np.linalg.solve(np.eye(P) - by_load[:, None] * load_t[:, :P], change) if P else change
    except np.linalg.LinAlgError:
        raise Singular(JAMS, system.describe(modes.key), jams=True) from None
    multiply(2)
    return T, dT


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
    rest = np.setdiff1d(np.arange(system.one, system.n), moving)
    own = A[np.ix_(rest, rest)]
    linked = np.eye(len(rest), dtype=bool) | (own != 0.0)
    for _ in range(max(len(rest).bit_length(), 1)):
        steps = linked.astype(np.float64)  # a product of booleans is slow
        linked = steps @ steps > 0.0
    loops = linked & linked.T
    stable = [
        (own[i, i] if loop.sum() == 1 else np.linalg.eigvals(own[np.ix_(loop, loop)]).real.max()) < 0.0
        for i, loop in enumerate(loops)  # the loop that contains the state
    ]
    return np.asarray(rest[np.array(stable, dtype=bool)], dtype=np.int64)
