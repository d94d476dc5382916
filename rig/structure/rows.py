"""Rows over the degrees of freedom of a structure: of rigid motions, of nodes, and of contacts from a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from rig.errors import SceneError
from rig.structure.faces import unit
from rig.structure.full import Array, Full, Points
from rig.structure.mesh import NOTHING, Mesh, direction_number, few, lines_of, tried
from rig.units import brief

OPENED = 0.01
"""Largest offset of the two sides of a gap row over the extent of its nodes. A tilt opens it by offset times angle."""
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


def contact_rows(name: str, path: Path, full: Full) -> Points:
    """The points of a contact from a CSV file with the columns point, what, node, direction, value.

    `what`: normal or along (a coefficient of the row), area [m^2], radius [m] (1 if it is not given). Without a node
    table of the matrices, `node` is the number of the row and `direction` is empty. The first node of a point is
    of the slave.

    Raises SceneError with every fault.
    """
    labels = zip(full.node.tolist(), (full.direction + 1).tolist())
    places = {label: row for row, label in enumerate(labels)}
    values = {what: dict[tuple[str, int], float]() for what in ("normal", "along", "area", "radius")}
    faults: list[str] = []
    lines: list[str] = []
    for number, line in enumerate(tried(lambda: list(lines_of(path)), lines, faults), 1):
        words = [word.strip().lower() for word in line.split(",")]
        if not any(words) or (number == 1 and words[0] == "point"):
            continue
        try:
            point, what, node, direction, value = words
            if direction:
                row = places.get((int(node), direction_number(direction)), -1)
            else:
                row = int(node) - 1 if node and int(node) <= full.rows else -1
            if row < 0 and what in ("normal", "along"):
                faults.append(f"{path.name}, line {number}: the matrices have no row of {node} {direction}")
            size = float(value)
            if not np.isfinite(size) or (size <= 0.0 and what in ("area", "radius")):
                raise ValueError
            if (point, row) in values[what]:
                faults.append(f"{path.name}, line {number}: point {point} has this {what} in a line before too")
            values[what][point, row] = size
        except (ValueError, KeyError):
            expected = "POINT, WHAT, NODE, DIRECTION, VALUE with normal, along, area or radius"
            faults.append(f"{path.name}, line {number}: is {brief(line.strip())}; expected {expected}")
    in_order = dict.fromkeys(point for kept in values.values() for point, _ in kept)
    names = {point: k for k, point in enumerate(in_order)}
    points_of = {}
    for what in ("normal", "along", "area"):
        points_of[what] = {point for point, _ in values[what]}
    for point in names:
        if lacking := [what for what in points_of if point not in points_of[what]]:
            faults.append(f"{path.name}: point {point} has no {' and no '.join(lacking)}")
    if faults or not names:
        raise SceneError(f"contacts.{name}", few(faults, path.name) or [f"{path.name}: has no points"])
    rows = []
    for what in ("normal", "along"):
        at = ([names[point] for point, _ in values[what]], [row for _, row in values[what]])
        rows.append(sp.csr_array((list(values[what].values()), at), shape=(len(names), full.rows)))
    area = np.array([values["area"].get((point, -1), 1.0) for point in names])
    radius = np.array([values["radius"].get((point, -1), 1.0) for point in names])
    place = np.zeros((full.rows, 3))
    sliding = np.zeros((len(names), 3))
    known = np.flatnonzero(np.isin(full.node, full.ids))
    place[known] = full.xyz[np.searchsorted(full.ids, full.node[known])]
    leading: dict[str, int] = {}
    for (point, row), coefficient in values["along"].items():
        first = leading.setdefault(point, int(full.node[row])) == full.node[row]
        if first and 0 <= full.direction[row] < 3:
            sliding[names[point], full.direction[row]] = coefficient
    sliding /= np.maximum(np.linalg.norm(sliding, axis=1, keepdims=True), np.finfo(float).tiny)
    whole = abs(rows[0]).sum(axis=1)
    position = abs(rows[0]) @ place / whole[:, None]
    points = Points(name, rows[0], rows[1], area, radius, position, sliding)
    offset = OPENED * np.ptp(full.xyz, axis=0).max() if len(full.xyz) else np.inf
    for point, motion, size in zip(names, opened(points, full), whole):
        shifted, turned = np.linalg.norm(motion.reshape(2, 3), axis=1) / size
        if _PAIRED < shifted < _GROUND or (shifted <= _PAIRED and 2.0 * turned > offset):
            if shifted > _PAIRED:
                motion_of = "displacement of the whole structure by 1 m"
                opening = shifted
            else:
                motion_of = "turn of the whole structure by 1 rad"
                opening = 2.0 * turned
            what = f"a {motion_of} opens its gap by {opening:.2g} m"
            faults.append(f"{path.name}: point {point}: {what}; interpolate on the faces, or give slave and master")
    if faults:
        raise SceneError(f"contacts.{name}", few(faults, path.name))
    return points


def opened(points: Points, full: Full) -> Array:
    """By how much rigid motions of one metre or one radian open the gap of each point [point, 6]."""
    return np.asarray(points.normal @ rigid_motions(full))
