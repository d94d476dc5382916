"""Products: the nonlinear terms in the equations of a rig, e.g. x y, C (cos k phi - 1), N sin k phi.

A product is an input of the equations, like a speed-dependent friction force: rows refer to it, and its value is
computed from the state. Its factors are states, the sine or the versine of an angle (cosine minus one, negative; the
angle is a row over the state), the positive part of a row (a contact that presses and never pulls), normal forces and
friction forces. Products are evaluated in levels, so that none depends on itself:

    level 0   states, angles, presses   these may enter a normal force
    level 1   with a normal force
    level 2   with a friction force  these must not act on what a stuck contact needs
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inner
from rig.solve.rows import dot

Array = NDArray[np.float64]
STATE, SINE, VERSINE, NORMAL, FRICTION, PRESS = range(6)


class ProductTables(NamedTuple):
    """All products of a system for the kernels, in the order of their levels, with scratch for their factors."""

    patches: NDArray[np.int64]  # [1] number of friction forces, which precede the products among the inputs
    upto: NDArray[np.int64]  # [3] number of products up to each level
    first: NDArray[np.int64]  # [product + 1] first factor of each
    place: NDArray[np.int64]  # [factor] its index in `values`
    angles: Array  # [angle, n]
    presses: Array  # [press, n]
    values: Array  # everything that may be a factor, stored one after the other:
    state: Array  # [n]
    sine: Array  # [angle]
    versine: Array  # [angle]
    normal: Array  # [normal]
    friction: Array  # [patch]
    pressed: Array  # [press]


@inner
def _fill(t, begin, end, T):
    """T of the products `begin` to `end` - 1."""
    p = t.products
    for j in range(begin, end):
        value = 1.0
        for f in range(p.first[j], p.first[j + 1]):
            value *= p.values[p.place[f]]
        T[p.patches[0] + j] = value


@inner
def early_products(t, mode_set, x, T):
    """T of the products of levels 0 and 1, and 0 for inputs not known yet, because rows sum over all inputs."""
    p = t.products
    if p.upto[2] == 0:
        return
    for i in range(T.shape[0]):
        T[i] = 0.0
    for i in range(x.shape[0]):
        p.state[i] = x[i]
    for a in range(p.angles.shape[0]):
        angle = dot(p.angles[a], x)
        half = np.sin(0.5 * angle)
        p.sine[a], p.versine[a] = np.sin(angle), -2.0 * half * half
    for a in range(p.presses.shape[0]):
        p.pressed[a] = max(dot(p.presses[a], x), 0.0)
    _fill(t, 0, p.upto[0], T)
    if p.upto[2] > p.upto[0]:
        for k in range(p.normal.shape[0]):
            p.normal[k] = dot(t.press[mode_set, k], x) + dot(t.press_t[mode_set, k], T)
        _fill(t, p.upto[0], p.upto[1], T)


@inner
def late_products(t, mode_set, x, T):
    """T of the products of level 2."""
    p = t.products
    if p.upto[2] > p.upto[1]:
        for q in range(p.friction.shape[0]):
            p.friction[q] = dot(t.friction[mode_set, q], x) + dot(t.friction_t[mode_set, q], T)
        _fill(t, p.upto[1], p.upto[2], T)
