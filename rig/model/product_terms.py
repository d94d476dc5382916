"""Products of states, forces and angles as a rig states them, their packing for the kernels, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.solve.product_inputs import FRICTION, NORMAL, PRESS, SINE, STATE, ProductTables

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Factor:
    """One factor of a product.

    `kind`: of the factor; `index`: of the state, normal force or patch; `row`: over the state, of an angle [rad] or of
    a press.
    """

    kind: int
    index: int = 0
    row: Array | None = None


@dataclass(frozen=True)
class Product:
    """A product of factors, with the name by which rows refer to it."""

    name: str
    factors: tuple[Factor, ...]

    @property
    def level(self) -> int:
        """The level 0, 1 or 2 of the product (rig.solve.product_inputs)."""
        kinds = {factor.kind for factor in self.factors}
        return 2 if FRICTION in kinds else 1 if NORMAL in kinds else 0


def pack(products: tuple[Product, ...], n: int, patches: int, normals: int) -> ProductTables:
    """The arrays of `products`, which must be in the order of their levels."""
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
    return ProductTables(
        patches=np.array([patches]),
        upto=np.array([sum(level <= top for level in levels) for top in range(3)]),
        first=np.array(first),
        place=ends[np.array(kind, dtype=np.int64)] + np.array(index, dtype=np.int64),
        angles=np.array(angles).reshape(-1, n),
        presses=np.array(presses).reshape(-1, n),
        values=values,
        **dict(zip(("state", "sine", "versine", "normal", "friction", "pressed"), parts)),
    )


def tangent(
    products: tuple[Product, ...],
    level: int,
    x: Array,
    forces: tuple[tuple[Array, Array], tuple[Array, Array]],
) -> tuple[Array, Array]:
    """Values [product] and derivatives over x [product, n] of the products of one level; 0 for the other products.

    `forces`: values and derivatives of the normal forces, and of the friction forces, as far as they are known.
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
