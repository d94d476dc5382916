"""Products: what a rig's equations hold beyond linear terms, e.g. x y, C (cos k phi - 1), N sin k phi.

A product is an input of the equations like the friction force of a law over speed: rows name it, and its value is
found from the state. Factors are states, sine or cosine less one (versine, negative) of a row over the state, what of a
row is positive (a contact that presses and never pulls), normal forces and friction forces. Order of evaluation, so
that nothing depends on itself:

    level 0   states, angles, presses   these may enter a normal force
    level 1   with a normal force
    level 2   with a friction force  these may not act on what a stuck contact needs
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inner
from rig.solve.rows import dot

Array = NDArray[np.float64]
STATE, SINE, VERSINE, NORMAL, FRICTION, PRESS = range(6)


@dataclass(frozen=True)
class Factor:
    """One factor: its kind; which state, normal or patch; the row over the state of an angle [rad] or a press."""

    kind: int
    index: int = 0
    row: Array | None = None


@dataclass(frozen=True)
class Product:
    """The product of some factors, by the name that rows use."""

    name: str
    factors: tuple[Factor, ...]

    @property
    def level(self) -> int:
        """0, 1 or 2: see above."""
        kinds = {factor.kind for factor in self.factors}
        return 2 if FRICTION in kinds else 1 if NORMAL in kinds else 0


class Products(NamedTuple):
    """All products of a system for the kernels, in the order of their levels, and the scratch of their factors."""

    patches: NDArray[np.int64]  # [1] number of friction forces before the products among the inputs
    upto: NDArray[np.int64]  # [3] number of products up to each level
    first: NDArray[np.int64]  # [product + 1] first factor of each
    place: NDArray[np.int64]  # [factor] where in `values` it is
    angles: Array  # [angle, n]
    presses: Array  # [press, n]
    values: Array  # all that may be a factor, one after the other:
    state: Array  # [n]
    sine: Array  # [angle]
    versine: Array  # [angle]
    normal: Array  # [normal]
    friction: Array  # [patch]
    pressed: Array  # [press]


def pack(products: tuple[Product, ...], n: int, patches: int, normals: int) -> Products:
    """The arrays of `products`, which are in the order of their levels."""
    angles: list[Array] = []
    presses: list[Array] = []
    known: dict[tuple[bool, bytes], int] = {}
    kind, index, first = [], [], [0]
    for product in products:
        for factor in product.factors:
            kind.append(factor.kind)
            index.append(factor.index)
            if factor.row is not None:
                pressed = factor.kind == PRESS
                rows = presses if pressed else angles
                index[-1] = known.setdefault((pressed, (factor.row + 0.0).tobytes()), len(rows))  # -0.0 is 0.0
                if index[-1] == len(rows):
                    rows.append(factor.row)
        first.append(len(kind))
    levels = [product.level for product in products]
    ends = np.cumsum([0, n, len(angles), len(angles), normals, patches, len(presses)])  # in the order of the kinds
    values = np.zeros(ends[-1])
    parts = [values[begin:end] for begin, end in pairwise(ends)]
    return Products(
        patches=np.array([patches]),
        upto=np.array([sum(level <= top for level in levels) for top in range(3)]),
        first=np.array(first),
        place=ends[np.array(kind, dtype=np.int64)] + np.array(index, dtype=np.int64),
        angles=np.array(angles).reshape(-1, n),
        presses=np.array(presses).reshape(-1, n),
        values=values,
        **dict(zip(("state", "sine", "versine", "normal", "friction", "pressed"), parts)),
    )


@inner
def _fill(t, begin, end, T):
    """T of the products `begin` to `end`."""
    p = t.products
    for j in range(begin, end):
        value = 1.0
        for f in range(p.first[j], p.first[j + 1]):
            value *= p.values[p.place[f]]
        T[p.patches[0] + j] = value


@inner
def early(t, slot, x, T):
    """T of the products of levels 0 and 1; 0 for what is not known yet, which rows sum over."""
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
            p.normal[k] = dot(t.press[slot, k], x) + dot(t.press_t[slot, k], T)
        _fill(t, p.upto[0], p.upto[1], T)


@inner
def late(t, slot, x, T):
    """T of the products of level 2."""
    p = t.products
    if p.upto[2] > p.upto[1]:
        for q in range(p.friction.shape[0]):
            p.friction[q] = dot(t.friction[slot, q], x) + dot(t.friction_t[slot, q], T)
        _fill(t, p.upto[1], p.upto[2], T)


def tangent(
    products: tuple[Product, ...],
    level: int,
    x: Array,
    forces: tuple[tuple[Array, Array], tuple[Array, Array]],
) -> tuple[Array, Array]:
    """Values [product] and slopes over x [product, n] of the products of one level, 0 for the others.

    `forces`: values and slopes of the normal forces, and of the friction forces, as far as they are known.
    """
    n = len(x)
    values, slopes = np.zeros(len(products)), np.zeros((len(products), n))
    for j, product in enumerate(products):
        if product.level != level:
            continue
        value, slope = 1.0, np.zeros(n)
        for factor in product.factors:
            v, s = _tangent(factor, x, forces)
            value, slope = value * v, slope * v + value * s
        values[j], slopes[j] = value, slope
    return values, slopes


def _tangent(factor: Factor, x: Array, forces: tuple[tuple[Array, Array], tuple[Array, Array]]) -> tuple[float, Array]:
    if factor.kind == STATE:
        return float(x[factor.index]), np.eye(len(x))[factor.index]
    if factor.row is not None:
        angle = float(factor.row @ x)
        if factor.kind == PRESS:
            return max(angle, 0.0), factor.row if angle > 0.0 else np.zeros(len(x))
        if factor.kind == SINE:
            return float(np.sin(angle)), np.cos(angle) * factor.row
        return float(-2.0 * np.sin(0.5 * angle) ** 2), -np.sin(angle) * factor.row
    values, slopes = forces[factor.kind == FRICTION]
    return float(values[factor.index]), slopes[factor.index]
