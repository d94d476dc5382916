"""Products of states and forces, which rows of forces, normal forces and outputs name like a state.

Factors are states, sines of an angle, normal forces and friction forces. `pack` prepares products for the kernels
(rig.solve.forces); `tangent` gives their values and derivatives for a linearisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.solve.column_blocks import LANE, entries_of, zeros
from rig.solve.forces import FRICTION, NORMAL, PRESS, SINE, STATE, ProductTables

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

    @cached_property
    def level(self) -> int:
        """The level 0, 1 or 2 of the product (rig.solve.forces)."""
        kinds = {factor.kind for factor in self.factors}
        if FRICTION in kinds:
            return 2
        return 1 if NORMAL in kinds else 0


def pack(products: tuple[Product, ...], n: int, patches: int, normals: int) -> ProductTables:
    """The arrays of `products`, which must be in the order of their levels."""
    angles: list[Array] = []
    presses: list[Array] = []
    known: dict[tuple[bool, bytes], int] = {}
    kind = []
    index = []
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
    levels = [product.level for product in products]
    ends = np.cumsum([0, n, len(angles), len(angles), normals, patches, len(presses)])  # in the order of the kinds
    values = np.ones(ends[-1] + 1)  # the last one stays: the factor of a product that has fewer
    values[:-1] = 0.0
    values_at = zeros((len(values), LANE))
    values_at[-1] = 1.0
    begins = ends[np.array(kind, dtype=np.int64)]
    places = iter((begins + np.array(index, dtype=np.int64)).tolist())
    most = max((len(product.factors) for product in products), default=0)
    place = np.full((max(most, 2), len(products)), ends[-1])
    for j, product in enumerate(products):
        place[: len(product.factors), j] = [next(places) for _ in product.factors]
    parts = [values[begin:end] for begin, end in pairwise(ends)]
    upto = []
    for top in range(3):
        upto.append(sum(level <= top for level in levels))
    angle_rows = np.array(angles).reshape(-1, n)
    press_rows = np.array(presses).reshape(-1, n)
    return ProductTables(
        patches=np.array([patches]),
        upto=np.array(upto),
        place=place,
        angles=angle_rows,
        presses=press_rows,
        turns=zeros(-(-2 * len(angles) // LANE) * LANE),
        angle_entries=entries_of(angle_rows),
        press_entries=entries_of(press_rows),
        values_at=values_at,
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
    values = np.zeros(len(products))
    slopes = np.zeros((len(products), n))
    for j, product in enumerate(products):
        if product.level != level:
            continue
        value = 1.0
        slope = np.zeros(n)
        for factor in product.factors:
            if factor.kind == STATE:
                v = float(x[factor.index])
                slope *= v
                slope[factor.index] += value
                value *= v
                continue
            v, s = _tangent(factor, x, forces)
            slope = slope * v + value * s
            value = value * v
        values[j] = value
        slopes[j] = slope
    return values, slopes


def _tangent(factor: Factor, x: Array, forces: tuple[tuple[Array, Array], tuple[Array, Array]]) -> tuple[float, Array]:
    if factor.row is not None:
        angle = float(factor.row @ x)
        if factor.kind == PRESS:
            return max(angle, 0.0), factor.row if angle > 0.0 else np.zeros(len(x))
        if factor.kind == SINE:
            return float(np.sin(angle)), np.cos(angle) * factor.row
        return float(-2.0 * np.sin(0.5 * angle) ** 2), -np.sin(angle) * factor.row
    values, slopes = forces[factor.kind == FRICTION]
    return float(values[factor.index]), slopes[factor.index]
