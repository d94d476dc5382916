"""The right-hand side of one mode set, x' = A x + b T(x), with its inputs T.

Inputs are speed-dependent friction forces and products. The arrays of the mode set are taken from the tables once for a
stretch of steps. Functions that run many times in a step are inlined into their callers. Both bring plain array code
close to the speed of C.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner
from rig.solve.exponential import exponential_factors
from rig.solve.friction_coefficient import STRIBECK, coefficient
from rig.solve.product_inputs import early_products, late_products
from rig.solve.rows import dot
from rig.solve.specialised import has_products, state_count

Array = NDArray[np.float64]


class RightHandSide(NamedTuple):
    """The right-hand side of one mode set.

    It holds the tables of the mode set (see rig.model.tables.Tables), the inputs T [friction forces, products], scratch
    for them, and all tables `t`.
    """

    A: Array
    b: Array
    sigma: Array
    code: NDArray[np.int64]
    numbers: Array
    law_speed: Array
    law_load: Array
    law_load_t: Array
    coupled: int
    T: Array
    scratch: Array
    G: Array
    GT: Array
    guard_needs_inputs: NDArray[np.int64]
    mode_set: int
    t: Any


@inlined
def right_hand_side(t, mode_set, T, scratch):
    """The field of a mode set. T [inputs] and `scratch` [patch, patch] are overwritten."""
    count = t.guards[mode_set]
    return RightHandSide(
        t.A[mode_set],
        t.b[mode_set],
        t.sigma[mode_set],
        t.code[mode_set],
        t.numbers[mode_set],
        t.law_speed[mode_set],
        t.law_load[mode_set],
        t.law_load_t[mode_set],
        t.coupled[mode_set],
        T,
        scratch,
        t.G[mode_set, :count],
        t.GT[mode_set, :count],
        t.guard_needs_inputs[mode_set, :count],
        mode_set,
        t,
    )


@inlined
def friction_force(f, p, x, others):
    """The friction force of patch p at x; 0 if its friction does not depend on speed.

    mu(law_speed x) (law_load x + others): both rows carry the sign of the slip; `others` is the part of the load that
    depends on inputs. Rows are summed from their end, because the last state variables do not change during a step.
    """
    force = 0.0
    if f.sigma[p] != 0.0 and f.code[p] != 0:
        last = x.shape[0] - 1
        N = others
        for j in range(last, -1, -1):
            N += f.law_load[p, j] * x[j]
        if f.code[p] == STRIBECK:  # the next stage waits for the exponential: keep the work before and after it short
            u = -(f.numbers[p, 2] * f.law_speed[p, last]) * x[last]
            for j in range(last):
                u -= (f.numbers[p, 2] * f.law_speed[p, j]) * x[j]
            coarse, fine = exponential_factors(u)
            force = N * f.numbers[p, 0] + ((N * f.numbers[p, 1]) * coarse) * fine
        else:
            w = 0.0
            for j in range(last, -1, -1):
                w += f.law_speed[p, j] * x[j]
            force = coefficient(f.code[p], f.numbers[p], w) * N
    return force


@inner
def inputs(t, mode_set, x, T, scratch):
    """T = the inputs at x: friction forces of patches that slip with a speed-dependent law (else 0), products.

    `coupled`: at least one load depends on a friction force.
    """
    f = right_hand_side(t, mode_set, T, scratch)
    early_products(t, mode_set, x, T)
    patches = f.sigma.shape[0]
    for p in range(patches):
        others = 0.0
        for q in range(patches, T.shape[0]):
            others += f.law_load_t[p, q] * T[q]
        T[p] = friction_force(f, p, x, others)
    if f.coupled:
        solve_coupled_friction(f.sigma, f.code, f.numbers, f.law_speed, f.law_load_t, x, T, scratch)
    late_products(t, mode_set, x, T)


@inner
def solve_coupled_friction(sigma, code, numbers, law_speed, law_load_t, x, T, M):
    """Solve T = T0 + diag(mu) bear_t T for the friction forces T; T holds T0 at first. M is scratch.

    Gaussian elimination without pivoting, because the matrix is the identity plus a small coupling.
    """
    P = sigma.shape[0]
    for p in range(P):
        m = 0.0
        if sigma[p] != 0.0 and code[p] != 0:
            m = coefficient(code[p], numbers[p], dot(law_speed[p], x))
        for r in range(P):
            M[p, r] = -m * law_load_t[p, r]
        M[p, p] += 1.0
    for p in range(P):
        for q in range(p + 1, P):
            f = M[q, p] / M[p, p]
            for r in range(p, P):
                M[q, r] -= f * M[p, r]
            T[q] -= f * T[p]
    for p in range(P - 1, -1, -1):
        for r in range(p + 1, P):
            T[p] -= M[p, r] * T[r]
        T[p] /= M[p, p]


@inlined
def derivative(shape, f, nonlinear, x, k):
    """The derivative k = A x + b T(x). `bent`: False for a system that is linear in every mode set (T = 0).

    If no friction force depends on another one, as on most rigs, the friction forces are not stored in memory.
    """
    for i in range(state_count(shape)):
        s = 0.0
        for j in range(state_count(shape)):
            s += f.A[i, j] * x[j]
        k[i] = s
    if nonlinear:
        if not (has_products(shape) or f.coupled):
            for p in range(f.sigma.shape[0]):
                force = friction_force(f, p, x, 0.0)
                for i in range(state_count(shape)):
                    k[i] += f.b[i, p] * force
        else:
            inputs(f.t, f.mode_set, x, f.T, f.scratch)
            for i in range(state_count(shape)):
                for p in range(f.T.shape[0]):
                    k[i] += f.b[i, p] * f.T[p]


@inlined
def guard_at(shape, f, nonlinear, g, x):
    """The value of guard g at x."""
    value = 0.0
    for j in range(state_count(shape)):
        value += f.G[g, j] * x[j]
    if nonlinear:
        if f.guard_needs_inputs[g]:
            inputs(f.t, f.mode_set, x, f.T, f.scratch)
            value += dot(f.GT[g], f.T)
    return value
