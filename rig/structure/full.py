"""The full matrices of a structure: parts that numbers of a scene multiply, and rows of contacts and nodes over them.

    M = sum of mass parts,   D(p) = sum of damping parts,   K(p) = sum of stiffness parts
    part(p) = factor * p[key]^power * matrix                      for example  W G,  D1 / W,  s KR,  W^2 K2

All numbers are in SI units. Directions: 0 to 2 for x, y, z, 3 to 5 for turns about them, -1 for a row without a node
(an inner degree of freedom of an element).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Matrix = Any
"""A sparse array of a full structure, a dense one of a reduced structure."""
Of = Literal["mass", "damping", "stiffness"]
Doubt = tuple[str, str]
"""What may be wrong with a structure, and what to do."""
FRICTION = "friction.mu"
"""The number of the scene that is the coefficient of friction of all points."""
STACK = ("piezo.first", "piezo.second")
"""Names of the vectors of the ends of a piezo stack; the second may be missing: the stack stands on the ground."""
SYMMETRIC = 1e-9
"""Largest difference between a matrix and its transpose, over its largest entry, that counts as rounding [chosen]."""


@dataclass(frozen=True)
class Part:
    """One matrix [row, row] with what multiplies it: `factor` and the number of the scene `key` to the `power`.

    `key` is "" for a constant part.
    """

    name: str
    of: Of
    matrix: Matrix
    key: str = ""
    power: int = 1
    factor: float = 1.0

    def times(self, values: Mapping[str, float]) -> float:
        """The number that multiplies the matrix, for these `values` by key."""
        return self.factor * (values[self.key] ** self.power if self.key else 1.0)

    @property
    def symmetric(self) -> bool:
        """Whether the matrix equals its transpose."""
        return bool(abs(self.matrix - self.matrix.T).max() <= SYMMETRIC * abs(self.matrix).max())


@dataclass(frozen=True)
class Met:
    """How much of a slave meets its master.

    `nodes`: of the slave faces along the normal; `pairs`: those that meet a master face within the search. `offered`,
    `met`: their areas [m^2]; `gap`: the largest of a pair [m]. Rows of a file name the nodes and areas that meet, and
    offer no others (None); on the ground they have no gap (None), and without places of the nodes it is not known
    (NaN). `asked`: points that the scene asks for, 0 for one at each node. `doubts`: what may be wrong. `slaves`,
    `masters`: numbers of the nodes that take part. `faces`: the nodes of each slave face that takes part.
    """

    nodes: int
    pairs: int
    offered: float | None
    met: float
    gap: float | None
    asked: int = 0
    doubts: tuple[Doubt, ...] = ()
    slaves: frozenset[int] = field(default=frozenset(), repr=False, compare=False)
    masters: frozenset[int] = field(default=frozenset(), repr=False, compare=False)
    faces: frozenset[tuple[int, ...]] = field(default=frozenset(), repr=False, compare=False)


@dataclass(frozen=True)
class Points:
    """The points of one contact: rows [point, row] of the gap and of the relative displacement along the sliding.

    A gap that closes is negative: N_c = -k_c normal_c x - d_c normal_c x' with k_c and d_c = stiffness and damping per
    area times `area` [m^2]. The slip speed is `radius` times the speed of the drive minus along_c x'; `radius` is 1 for
    sliding along a line. `position` [point, 3] and `sliding` [point, 3], a unit vector, are for pictures. `flexibility`
    [point] in m/N is in series with the spring of each point: what a basis leaves out. `met`: how much of the slave
    meets the master, if a mesh or a file tells.
    """

    name: str
    normal: Matrix
    along: Matrix
    area: Array
    radius: Array
    position: Array
    sliding: Array
    flexibility: Array | float = 0.0
    met: Met | None = None

    @property
    def friction_key(self) -> str:
        """The number of the scene that is the coefficient of friction of these points alone, in steady sliding."""
        return f"contacts.{self.name}.{FRICTION}"

    @property
    def stiffness_key(self) -> str:
        """The number of the scene that is the normal stiffness per area [N/m^3]."""
        return f"contacts.{self.name}.stiffness"

    @property
    def damping_key(self) -> str:
        """The number of the scene that is the normal damping per area [N s/m^3]."""
        return f"contacts.{self.name}.damping"

    def springs(self, values: Mapping[str, float]) -> Array:
        """The normal stiffness of each point [N/m] for these `values` by key."""
        stiffness = values[self.stiffness_key] * self.area
        return np.asarray(stiffness / (1.0 + stiffness * self.flexibility))

    def dampers(self, values: Mapping[str, float]) -> Array:
        """The normal damping of each point [N s/m], beside its spring; both are in series with the flexibility."""
        series = 1.0 + values[self.stiffness_key] * self.area * self.flexibility
        return np.asarray(values.get(self.damping_key, 0.0) * self.area / series**2)

    def stiffness(self, values: Mapping[str, float]) -> Matrix:
        """sum_c k_c (n_c + mu t_c) n_c^T: what closed points that slide add to the stiffness."""
        return self._sliding(self.springs(values), values)

    def damping(self, values: Mapping[str, float]) -> Matrix:
        """sum_c d_c (n_c + mu t_c) n_c^T: what they add to the damping."""
        return self._sliding(self.dampers(values), values)

    def _sliding(self, numbers: Array, values: Mapping[str, float]) -> Matrix:
        rows = self.normal + values.get(self.friction_key, values.get(FRICTION, 0.0)) * self.along
        return rows.T @ (sp.diags_array(numbers) @ self.normal)


@dataclass(frozen=True)
class Full:
    """A structure: its parts, the node and direction of each row, its contacts, and other rows by name.

    `node`, `direction` [row]; `ids` [node number], `xyz` [node, 3] in m; `faces` [face, 4]: the corners of outer faces,
    places in `ids`, the last one twice for a triangle. `vectors` [row]: directions of loads, sensors and
    actuators by name: the force of one newton, or the row of a displacement. `finer`: the same contacts with more
    points, for a check of their number. `total` [kg]: the mass of all rows along one direction, None where no direction
    is known. `regions`: rows of bodies and of sets, by name. `doubts`: what may be wrong, beside that of the contacts.
    """

    parts: tuple[Part, ...]
    node: NDArray[np.int64]
    direction: NDArray[np.int64]
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    xyz: Array = field(default_factory=lambda: np.zeros((0, 3)))
    contacts: tuple[Points, ...] = ()
    vectors: Mapping[str, Array] = field(default_factory=dict)
    finer: tuple[Points, ...] = ()
    faces: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int32))
    total: float | None = None
    regions: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()

    @property
    def all_doubts(self) -> tuple[Doubt, ...]:
        """What may be wrong with the structure and with its contacts."""
        of_contacts = [points.met.doubts for points in self.contacts if points.met is not None]
        return sum(of_contacts, self.doubts)

    @property
    def rows(self) -> int:
        """The number of degrees of freedom."""
        return int(self.parts[0].matrix.shape[0])

    @property
    def share(self) -> Array:
        """What the motion of a row is of that of its node [row]: CalculiX writes several rows of a node of a shell.

        They lie behind each other in the thickness; the node moves with their mean.
        """
        label = np.where(self.direction >= 0, 8 * self.node + self.direction, -1 - np.arange(len(self.node)))
        _, of, count = np.unique(label, return_inverse=True, return_counts=True)
        return np.asarray(1.0 / count[of])

    @property
    def keys(self) -> tuple[str, ...]:
        """The numbers of the scene that multiply parts, in order of appearance."""
        return tuple(dict.fromkeys(part.key for part in self.parts if part.key))

    @property
    def numbers(self) -> tuple[str, ...]:
        """All numbers of the scene that the matrices depend on: of parts, contact stiffnesses, friction."""
        contacts = [points.stiffness_key for points in self.contacts] + [FRICTION] * bool(self.contacts)
        return tuple(dict.fromkeys([*self.keys, *contacts]))

    def matrix(self, of: Of, values: Mapping[str, float]) -> Matrix:
        """The sum of the parts of one kind for these `values` by key, without the springs of contacts."""
        shape = (self.rows, self.rows)
        total: Matrix = sp.csr_array(shape) if sp.issparse(self.parts[0].matrix) else np.zeros(shape)
        for part in self.parts:
            if part.of == of:
                total = total + part.times(values) * part.matrix
        return total

    def pencil(self, values: Mapping[str, float]) -> tuple[Matrix, Matrix, Matrix]:
        """M, D and K of small motions about steady sliding with all points closed, for these `values` by key."""
        damping = self.matrix("damping", values)
        stiffness = self.matrix("stiffness", values)
        for points in self.contacts:
            stiffness = stiffness + points.stiffness(values)
            if values.get(points.damping_key):
                damping = damping + points.damping(values)
        return self.matrix("mass", values), damping, stiffness

    @property
    def forces(self) -> tuple[Matrix, Matrix]:
        """Rows a, b [i, row] of what a rig adds to the matrices, forces a_i c_i(l) b_i^T x at the eigenvalue l.

        Friction at a point depends on its slip and on its gap; a stack and its network on the extension, the last row.
        """
        ends = [self.vectors[end] for end in STACK if end in self.vectors]
        stack = np.zeros((0, self.rows))
        if ends:
            extension = ends[0] - ends[-1] if len(ends) > 1 else ends[0]
            stack = extension[None]
        along = [points.along for points in self.contacts]
        gaps = [points.normal for points in self.contacts]
        if not sp.issparse(self.parts[0].matrix):
            return np.vstack([*along, *along, stack]), np.vstack([*along, *gaps, stack])
        last = sp.csr_array(stack)
        return sp.vstack([*along, *along, last]), sp.vstack([*along, *gaps, last])

    def symmetric_stiffness(self, values: Mapping[str, float], closed: bool) -> Matrix:
        """The symmetric parts of K, and if `closed` the springs of the contacts, without friction."""
        symmetric = tuple(part for part in self.parts if part.of != "stiffness" or part.symmetric)
        kept = replace(self, parts=symmetric)
        total = kept.matrix("stiffness", values)
        for points in self.contacts if closed else ():
            total = total + points.stiffness({**values, points.friction_key: 0.0})
        return total

    def frictionless(self, values: Mapping[str, float]) -> dict[str, float]:
        """These `values` without friction: what multiplies an unsymmetric stiffness is zero."""
        friction = {p.key for p in self.parts if p.of == "stiffness" and p.key and p.power > 0 and not p.symmetric}
        own = {points.friction_key for points in self.contacts}
        return {**values, **dict.fromkeys(sorted(friction | own | {FRICTION}), 0.0)}
