"""Rows over the degrees of freedom of a structure: of rigid motions, of nodes, and of contacts from a file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from rig.errors import SceneError
from rig.printable import counted
from rig.structure.faces import FACING, unit
from rig.structure.full import Array, Doubt, Full, Met, Points
from rig.structure.mesh import NOTHING, Mesh, Numbers, direction_number, few, lines_of, tried
from rig.units import brief

OPENED = 0.01
"""Largest offset of the two sides of a gap row over the extent of its nodes. A tilt opens it by offset times angle."""
SMALL = 1e-12
"""Least area of a point over the surface of the mesh [chosen]: less is another unit."""
DOUBTED = 1e-6
"""Least area of a contact over the surface of the mesh without a warning [chosen]."""
WHAT = ("normal", "along", "area", "radius")
"""What a line of a file of contact rows gives."""
SIZES = {"area": 2, "radius": 1}
"""Those of a point, with their power of the unit of length."""
_ALIKE = math.sqrt(1.0 - FACING**2)  # cosine between normal and sliding, at most: as between faces
_LENGTH = 0.02  # deviation of a direction from the length 1, from rounded digits. chosen
_OUTWARD = 0.2  # cosine between the inner side of a face and its normal. chosen
_NONE = 1e-9  # coefficient over the largest one: less is rounding
_PAIRED = 1e-3  # sum of a row over its size: at most, between two bodies
_GROUND = 0.9  # sum of a row over its size: at least, on the ground


def rigid_motions(full: Full) -> Array:
    """The six rigid motions [row, 6]: displacements along x, y, z, and turns about them [m per rad]."""
    motions = np.zeros((full.rows, 6))
    known = np.flatnonzero((full.direction >= 0) & np.isin(full.node, full.ids))
    place = np.zeros((full.rows, 3))
    if len(known):
        place[known] = full.xyz[np.searchsorted(full.ids, full.node[known])]
    for row in known.tolist():
        k = int(full.direction[row])
        if k < 3:
            motions[row, k] = 1.0
            motions[row, 3 + (k + 1) % 3] = place[row, (k + 2) % 3]
            motions[row, 3 + (k + 2) % 3] = -place[row, (k + 1) % 3]
        else:
            motions[row, k] = 1.0
    return motions


def node_vector(full: Full, nodes: Sequence[int], direction: Sequence[float], mesh: Mesh = NOTHING) -> Array:
    """The mean displacement [row] of nodes along a direction; times their number, a force of one newton at each.

    Raises SceneError for nodes that have no row, and for nodes that may follow others along a part of the direction.
    """
    along = unit(np.array(direction, dtype=float))
    vector = np.zeros(full.rows)
    chosen = np.isin(full.node, nodes) & (full.direction >= 0) & (full.direction < 3)
    vector[chosen] = along[full.direction[chosen]] * full.share[chosen] / len(nodes)
    needed = np.flatnonzero(along)
    free = np.array([np.isin(nodes, full.node[chosen & (full.direction == k)]) for k in needed])
    follow = np.isin(nodes, sorted(mesh.following)) | bool(mesh.tied)
    without_row = ~free.any(axis=0)
    lacking = np.flatnonzero(without_row | (follow & ~free.all(axis=0)))
    if len(lacking):
        more = len(lacking) - 1
        at = ", ".join(f"{value + 0.0:g}" for value in direction)
        why = f"moved by others ({mesh.tied or '*EQUATION'})" if follow[lacking[0]] else "without a row"
        which = f"node {nodes[lacking[0]]}" + (f" and {more} others are" if more else " is")
        raise SceneError("", [f"{which} held or {why} along [{at}]; choose free nodes"])
    return vector


class _Lines:
    """The lines of a file of contact rows: `values` by what they are, then by point and row; `first` line of each."""

    def __init__(self, path: Path, full: Full, length: float) -> None:
        self.name = path.name
        self.values: dict[str, dict[tuple[str, int], float]] = {what: {} for what in WHAT}
        self.first: dict[tuple[str, str], int] = {}
        self.faults: list[str] = []
        self._full = full
        self._length = length
        labels = zip(full.node.tolist(), (full.direction + 1).tolist())
        self._places = {label: row for row, label in enumerate(labels)}
        self._labelled = bool((full.direction >= 0).any())
        lines: list[str] = []
        for number, line in enumerate(tried(lambda: list(lines_of(path)), lines, self.faults), 1):
            words = [word.strip().lower() for word in re.split("[,;]", line)]
            if any(words) and not (number == 1 and words[0] == "point"):
                self._read(number, line, words)
        in_order = dict.fromkeys(point for kept in self.values.values() for point, _ in kept)
        self.points = {point: k for k, point in enumerate(in_order)}

    def _read(self, number: int, line: str, words: list[str]) -> None:
        """Keep the value of a line, or its fault."""
        try:
            point, what, node, direction, value = words
            size = float(value)
            if not np.isfinite(size) or (size <= 0.0 and what in SIZES):
                raise ValueError
            known = self.values[what]
            row = -1 if what in SIZES else self._row(node, direction)
        except (ValueError, KeyError):
            expected = "POINT, WHAT, NODE, DIRECTION, VALUE with normal, along, area or radius (these two above 0)"
            self.faults.append(f"{self.name}, line {number}: is {brief(line.strip())}; expected {expected}")
            return
        if what in SIZES and (node or direction):
            self.fault(number, f"{what} belongs to point {point}, not to node {node} {direction}: leave both empty")
        elif what not in SIZES and row < 0:
            self.fault(number, self._absent(node, direction))
        elif (point, row) in known:
            self.fault(number, f"point {point} has this {what} in a line before too")
        else:
            power = SIZES.get(what, int(self._full.direction[row] >= 3))  # lever arms of a turning row
            known[point, row] = size * self._length**power
            self.first.setdefault((point, what), number)

    def _row(self, node: str, direction: str) -> int:
        """The row of a node along a direction, or of this number; -1 for none. Raises ValueError."""
        if direction:
            return self._places.get((int(node), direction_number(direction)), -1)
        row = int(node) - 1
        return row if row < self._full.rows and not self._labelled else -1

    def _absent(self, node: str, direction: str) -> str:
        """Why there is no row of a node along a direction."""
        if not direction and self._labelled:
            return f"node {node} needs a direction: x, y, z, rx, ry, rz or 1 to 6"
        if len(self._full.ids) and direction and int(node) not in self._full.ids:
            return f"node {node} is not in the mesh"
        return f"the matrices have no row of {node} {direction}".rstrip()

    def fault(self, number: int, what: str) -> None:
        """Note what is wrong with a line."""
        self.faults.append(f"{self.name}, line {number}: {what}")

    def rows(self, what: str) -> sp.csr_array:
        """The rows [point, row] of a kind."""
        at = ([self.points[point] for point, _ in self.values[what]], [row for _, row in self.values[what]])
        return sp.csr_array((list(self.values[what].values()), at), shape=(len(self.points), self._full.rows))

    def sizes(self, what: str) -> Array:
        """The area [m^2] or radius [m] of each point, 1 where it is not given."""
        return np.array([self.values[what].get((point, -1), 1.0) for point in self.points])


def contact_rows(name: str, path: Path, full: Full, length: float = 1.0) -> Points:
    """The points of a contact from a CSV file with the columns point, what, node, direction, value.

    `what`: normal or along (a coefficient of the row), area, radius (1 m if it is not given), in units of `length` m:
    those of the matrices. Without a node table of the matrices, `node` is the number of the row and `direction` is
    empty. The first node of a point is of the slave.

    Raises SceneError with every fault.
    """
    given = _Lines(path, full, length)
    for point in given.points:
        lacking = [what for what in ("normal", "along", "area") if (point, what) not in given.first]
        if lacking:
            number = min(given.first[key] for key in given.first if key[0] == point)
            given.fault(number, f"point {point} has no {' and no '.join(lacking)}")
    if given.faults or not given.points:
        raise SceneError(f"contacts.{name}", few(given.faults, path.name) or [f"{path.name}: has no points"])
    normal = given.rows("normal")
    along = given.rows("along")
    area = given.sizes("area")
    _check_directions(given, normal, along)
    _check_areas(given, area, full)
    if given.faults:
        raise SceneError(f"contacts.{name}", few(given.faults, path.name))
    place = np.zeros((full.rows, 3))
    known = np.flatnonzero(np.isin(full.node, full.ids))
    place[known] = full.xyz[np.searchsorted(full.ids, full.node[known])]
    position = abs(normal) @ place / abs(normal).sum(axis=1)[:, None]
    sliding = _leading(given, "along", full)
    met = _met(given, name, {"normal": normal, "along": along}, area, full)
    points = Points(name, normal, along, area, given.sizes("radius"), position, sliding, met=met)
    _check_opening(given, points, full)
    if given.faults:
        raise SceneError(f"contacts.{name}", few(given.faults, path.name))
    return points


def _check_directions(given: _Lines, normal: sp.csr_array, along: sp.csr_array) -> None:
    """Note rows without a coefficient, and those of the sliding that point along the normal."""
    sizes = {}
    for what, rows in (("normal", normal), ("along", along)):
        sizes[what] = np.sqrt(rows.power(2).sum(axis=1))
        for point, k in given.points.items():
            if not sizes[what][k]:
                given.fault(given.first[point, what], f"the {what} of point {point} is zero")
    common = abs(normal.multiply(along).sum(axis=1))
    for point, k in given.points.items():
        whole = sizes["normal"][k] * sizes["along"][k]
        if common[k] > _ALIKE * whole:
            what = f"the sliding of point {point} points along its normal"
            given.fault(given.first[point, "along"], f"{what}; a contact slides along its surface")


def _check_areas(given: _Lines, area: Array, full: Full) -> None:
    """Note areas that no part of the mesh can have."""
    surface, outer = _surface(full)
    for point, k in given.points.items():
        small = area[k] < SMALL * surface
        if small or (outer and area[k] > surface):
            what = f"the area of point {point} is {area[k]:.3g} m^2, but the surface of the mesh is {surface:.3g} m^2"
            given.fault(given.first[point, "area"], f"{what}; areas are in the units of structure.units")


def _surface(full: Full) -> tuple[float, bool]:
    """The area of the outer faces of the mesh [m^2]; without faces that of a box around its nodes, and False."""
    if len(full.faces):
        a, b, c, d = full.xyz[full.faces].transpose(1, 0, 2)
        halves = np.cross(b - a, c - a), np.cross(c - a, d - a)
        return 0.5 * float(sum(np.linalg.norm(half, axis=1).sum() for half in halves)), True
    if not len(full.xyz):
        return 0.0, False
    x, y, z = np.ptp(full.xyz, axis=0).tolist()
    return 2.0 * (x * y + y * z + z * x), False


def _leading(given: _Lines, what: str, full: Full) -> Array:
    """The direction [point, 3] of the coefficients of the first node of each point, of length one, or zero."""
    directions = np.zeros((len(given.points), 3))
    first: dict[str, int] = {}
    for (point, row), coefficient in given.values[what].items():
        leading = first.setdefault(point, int(full.node[row])) == full.node[row]
        if leading and 0 <= full.direction[row] < 3:
            directions[given.points[point], full.direction[row]] = coefficient
    sizes = np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions / np.maximum(sizes, np.finfo(float).tiny))


def _sides(rows: sp.csr_array, directions: Array, full: Full) -> tuple[Numbers, Numbers, Array]:
    """Point, place of the node, and weight of each node of rows along `directions` [point, 3]: above 0 of a slave."""
    entries = rows.tocoo()
    point, row = entries.coords
    known = (full.direction[row] >= 0) & (full.direction[row] < 3) & np.isin(full.node[row], full.ids)
    point = point[known]
    row = row[known]
    at = np.searchsorted(full.ids, full.node[row])
    motion = entries.data[known] * directions[point, full.direction[row]]
    pairs, of = np.unique(point * max(len(full.ids), 1) + at, return_inverse=True)
    weight = np.asarray(np.bincount(of, motion), np.float64)
    weight[abs(weight) < _NONE * abs(weight).max(initial=0.0)] = 0.0
    return pairs // max(len(full.ids), 1), pairs % max(len(full.ids), 1), weight


def _met(given: _Lines, name: str, rows: Mapping[str, sp.csr_array], area: Array, full: Full) -> Met | None:
    """How the sides of the `rows` normal and along meet; None without numbers of the nodes."""
    placed = len(full.ids) > 0
    if not placed:
        ids = np.unique(full.node[full.direction >= 0])
        full = replace(full, ids=ids, xyz=np.full((len(ids), 3), np.nan))
    directions = _leading(given, "normal", full)
    point, at, weight = _sides(rows["normal"], directions, full)
    if not len(point):
        return None
    sides = []
    for side in (weight > 0.0, weight < 0.0):
        total = np.bincount(point[side], abs(weight[side]), len(area))
        moments = np.zeros((len(area), 3))
        np.add.at(moments, point[side], abs(weight[side])[:, None] * full.xyz[at[side]])
        with np.errstate(invalid="ignore"):  # a point on the ground has no master
            sides.append(moments / total[:, None])
    gaps = abs(((sides[0] - sides[1]) * directions).sum(axis=1))
    slaves, masters = (frozenset(full.ids[at[side]].tolist()) for side in (weight > 0.0, weight < 0.0))
    gap = None
    if masters:
        gap = float(np.nanmax(gaps)) if placed else math.nan
    whole = float(area.sum())
    surface = _surface(full)[0] if placed else 0.0
    doubts = [*_odd_lengths(given, name, rows, full)]
    if placed:
        doubts += _turned(given, name, directions, (point, at, weight), full)
    if whole < DOUBTED * surface:
        what = (
            f"contacts.{name}: its rows give an area of {whole:.3g} m^2; the surface of the mesh is {surface:.3g} m^2"
        )
        doubts.append((what, "check the areas: they are in the units of structure.units"))
    return Met(len(slaves), len(slaves), None, whole, gap, doubts=tuple(doubts), slaves=slaves, masters=masters)


def _odd_lengths(given: _Lines, name: str, rows: Mapping[str, sp.csr_array], full: Full) -> Iterator[Doubt]:
    """Yield a doubt for each kind of rows of which a slave does not move by 1 m where it moves by 1 m along them."""
    for what, of_kind in rows.items():
        point, _, weight = _sides(of_kind, _leading(given, what, full), full)
        slave = weight > 0.0
        lengths = np.bincount(point[slave], weight[slave], len(given.points))
        odd = np.flatnonzero((abs(lengths - 1.0) > _LENGTH) & (lengths > 0.0))
        if len(odd):
            k = int(odd[0])
            first = next(label for label, number in given.points.items() if number == k)
            yield (
                f"contacts.{name}: {given.name}, line {given.first[first, what]}: the {what} of point {first} has the "
                f"length {lengths[k]:.3g}; displacements and forces along it are multiplied by it",
                f"give directions of length 1 ({counted(len(odd), 'point')} with another one)",
            )


def _turned(
    given: _Lines, name: str, directions: Array, sides: tuple[Numbers, Numbers, Array], full: Full
) -> Iterator[Doubt]:
    """Yield a doubt if normals, along `directions` [point, 3], point out of the bodies of their slaves.

    The neighbours of a node on a face of solid elements lie on the inner side of it.
    """
    point, at, weight = sides
    parts = [part.factor * part.matrix for part in full.parts if part.of == "stiffness" and not part.key]
    if not parts:
        return
    slave = weight > 0.0
    rows = np.flatnonzero(np.isin(full.node, full.ids[at[slave]]) & (full.direction >= 0) & (full.direction < 3))
    i, j = sp.csr_array(sum(parts))[rows].tocoo().coords
    known = np.isin(full.node[j], full.ids)
    node, other = (np.searchsorted(full.ids, full.node[k[known]]) for k in (rows[i], j))
    inward = np.zeros_like(full.xyz)
    np.add.at(inward, node, full.xyz[other] - full.xyz[node])
    inside = np.zeros((len(given.points), 3))
    np.add.at(inside, point[slave], weight[slave, None] * inward[at[slave]])
    depth = (inside * directions).sum(axis=1)
    turned = np.flatnonzero(depth < -_OUTWARD * np.linalg.norm(inside, axis=1))
    if len(turned):
        first = next(label for label, number in given.points.items() if number == turned[0])
        line = given.first[first, "normal"]
        yield (
            f"contacts.{name}: {given.name}, line {line}: the normal of point {first} points out of its slave: its gap "
            "would grow where the two sides come closer",
            "the normal points from the master into the slave, which is the first node of a point; change the signs "
            f"({counted(len(turned), 'point')} like this)",
        )


def _check_opening(given: _Lines, points: Points, full: Full) -> None:
    """Note the points whose gap a rigid motion opens."""
    whole = abs(points.normal).sum(axis=1)
    offset = OPENED * np.ptp(full.xyz, axis=0).max() if len(full.xyz) else np.inf
    for point, motion, size in zip(given.points, opened(points, full), whole):
        shifted, turned = np.linalg.norm(motion.reshape(2, 3), axis=1) / size
        if _PAIRED < shifted < _GROUND or (shifted <= _PAIRED and 2.0 * turned > offset):
            if shifted > _PAIRED:
                motion_of = "displacement of the whole structure by 1 m"
                opening = shifted
            else:
                motion_of = "turn of the whole structure by 1 rad"
                opening = 2.0 * turned
            what = f"point {point}: a {motion_of} opens its gap by {opening:.2g} m"
            given.fault(given.first[point, "normal"], f"{what}; interpolate on the faces, or give slave and master")


def opened(points: Points, full: Full) -> Array:
    """By how much rigid motions of one metre or one radian open the gap of each point [point, 6]."""
    return np.asarray(points.normal @ rigid_motions(full))
