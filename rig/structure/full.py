"""The full matrices of a structure: parts that numbers of a scene multiply, and rows of contacts and nodes over them.

    M = sum of mass parts,   D(p) = sum of damping parts,   K(p) = sum of stiffness parts
    part(p) = factor * p[key]^power * matrix                      for example  W G,  D1 / W,  s KR,  W^2 K2

All numbers are in SI units. Directions: 0 to 2 for x, y, z, 3 to 5 for turns about them, -1 for a row without a node
(an inner degree of freedom of an element).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Of = Literal["mass", "damping", "stiffness"]


@dataclass(frozen=True)
class Part:
    """One matrix [row, row] with what multiplies it: `factor` and the number of the scene `key` to the `power`.

    `key` is "" for a constant part.
    """

    name: str
    of: Of
    matrix: sp.csr_array
    key: str = ""
    power: int = 1
    factor: float = 1.0

    def times(self, values: Mapping[str, float]) -> float:
        """The number that multiplies the matrix, for these `values` by key."""
        return self.factor * (values[self.key] ** self.power if self.key else 1.0)


@dataclass(frozen=True)
class Points:
    """The points of one contact: rows [point, row] of the gap and of the relative displacement along the sliding.

    A gap that closes is negative: N_c = -k_c normal_c x with k_c = stiffness per area times `area` [m^2]. The slip
    speed is `radius` times the speed of the drive minus along_c x'; `radius` is 1 for sliding along a line. `position`
    [point, 3] and `sliding` [point, 3], a unit vector, are for pictures.
    """

    name: str
    normal: sp.csr_array
    along: sp.csr_array
    area: Array
    radius: Array
    position: Array
    sliding: Array


@dataclass(frozen=True)
class Full:
    """A structure: its parts, the node and direction of each row, its contacts, and other rows by name.

    `node`, `direction` [row]; `ids` [node number], `xyz` [node, 3] in m. `vectors` [row]: directions of loads, sensors
    and actuators by name: the force of one newton, or the row of a displacement.
    """

    parts: tuple[Part, ...]
    node: NDArray[np.int64]
    direction: NDArray[np.int64]
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    xyz: Array = field(default_factory=lambda: np.zeros((0, 3)))
    contacts: tuple[Points, ...] = ()
    vectors: Mapping[str, Array] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """The number of degrees of freedom."""
        return int(self.parts[0].matrix.shape[0])

    @property
    def keys(self) -> tuple[str, ...]:
        """The numbers of the scene that multiply parts, in order of appearance."""
        return tuple(dict.fromkeys(part.key for part in self.parts if part.key))

    def matrix(self, of: Of, values: Mapping[str, float]) -> sp.csr_array:
        """The sum of the parts of one kind for these `values` by key."""
        total = sp.csr_array((self.rows, self.rows))
        for part in self.parts:
            if part.of == of:
                total = total + part.times(values) * part.matrix
        return total
