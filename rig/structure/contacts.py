"""Contacts between the faces of two node sets, as rows over the degrees of freedom.

Each slave node meets the point of a master face that lies on its normal. The motion of this point is interpolated from
the nodes of the face, linearly over triangles of the face: a rigid motion of the whole structure opens no gap. A node
has the share of the geometric area of the slave faces around it. Points are weighted means over the nodes of a cell.

The master is the body that the drive moves: `along` is the motion of the slave relative to it, along its sliding.
The gap grows along the normal, which points from the master into the slave.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from rig.errors import SceneError
from rig.structure.full import Array, Full, Points
from rig.structure.mesh import NOTHING, Mesh, Numbers, Selection, direction_number, few, lines_of, tried
from rig.units import brief

OPENED = 0.01
"""Largest offset of the two sides of a gap row over the extent of its nodes. A tilt opens it by offset times angle."""
_PAIRED = 1e-3  # sum of a row over its size: at most, between two bodies
_GROUND = 0.9  # sum of a row over its size: at least, on the ground
_FACING = 0.5  # least cosine between the normal and a face that takes part
_EVEN = 1e-9  # of a cell: a node on the boundary of two belongs to the lower one, whatever the rounding


@dataclass(frozen=True)
class Contact:
    """What a scene says of a contact.

    `normal`: a direction, or "face": that of the faces at each node. Its sense is found from solid elements; without
    them it points from the master into the slave.
    `sliding`: the direction in which the master moves along a straight line. `axis` through `centre` [m]: it turns
    about this line instead. `points`: cells across and along the sliding (with an axis: along the radius and around);
    None: every node is a point. `search` [m]: largest gap, and largest distance beyond the edge of the master. Slave
    faces that meet no master face within it take no part.
    """

    name: str
    slave: Selection
    master: Selection
    normal: tuple[float, float, float] | Literal["face"]
    sliding: tuple[float, float, float] | None = None
    axis: tuple[float, float, float] | None = None
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    points: tuple[int, int] | None = None
    search: float = 1e-3


@dataclass(frozen=True)
class _Surface:
    """Triangles of faces: `corners` [triangle, 3, 3] m; `nodes` [triangle, 8] places in the mesh.

    `weights` [triangle, 3, 8]: the motion of each corner from those of the nodes; `shares` [triangle, 8]: of the area.
    `outward` [triangle, 3]: normals of the length of the area; their sense is known if `closed`.
    """

    corners: Array
    nodes: Numbers
    weights: Array
    shares: Array
    outward: Array
    closed: bool


def contact_points(contact: Contact, full: Full, mesh: Mesh) -> Points:
    """The points of a contact. Raises SceneError with every fault."""
    faults: list[str] = []
    none = np.zeros(0, dtype=np.int64)
    slave = mesh.at(tried(lambda: contact.slave.of(mesh), none, faults, "slave: "))
    master = mesh.at(tried(lambda: contact.master.of(mesh), none, faults, "master: "))
    if contact.slave.box is not None and contact.master.box is None:  # where two bodies touch, a box has nodes of both
        slave = np.setdiff1d(slave, master)
    elif contact.master.box is not None and contact.slave.box is None:
        master = np.setdiff1d(master, slave)
    if len(both := np.intersect1d(slave, master)):
        what = f"{len(both)} nodes are slave and master, the first is {mesh.ids[both[0]]}"
        advice = " (a box leaves out those of a set or a list)" * (contact.slave.box is not None)
        faults.append(f"{what}; the two sides need nodes of their own{advice}")
    points = None
    if not faults:
        points = tried(lambda: _points(contact, full, mesh, slave, master), None, faults)
    if points is None:
        raise SceneError(f"contacts.{contact.name}", faults)
    return points


def _points(contact: Contact, full: Full, mesh: Mesh, slave: Numbers, master: Numbers) -> Points:
    toward = None if isinstance(contact.normal, str) else _unit(np.array(contact.normal))
    own = _surface(mesh, slave, toward, "slave")
    other = _surface(mesh, master, toward, "master")
    if toward is None and not own.closed:
        raise SceneError("", ['normal: "face" needs solid elements at the slave; give a direction'])
    across = _unit(own.outward) if toward is None else np.tile(toward, (len(own.corners), 1))
    met = _met(own.corners.mean(axis=1), across, other, contact.search, len(mesh.ids))[0]
    sizes = np.linalg.norm(own.outward, axis=1) * met  # without faces that meet nothing, such as the sides of a pad
    area = np.zeros(len(mesh.ids))
    facing = np.zeros((len(mesh.ids), 3))
    np.add.at(area, own.nodes, own.shares * sizes[:, None])
    inward = -(own.outward * met[:, None])
    np.add.at(facing, own.nodes, own.shares[:, :, None] * inward[:, None, :])
    at = np.flatnonzero(area) if met.any() else np.unique(own.nodes[own.shares > 0.0])
    if toward is None and met.any():
        normal = _unit(facing[at])
    else:
        normal = np.tile(across[0], (len(at), 1))
    met, weights, gap, miss = _met(mesh.xyz[at], normal, other, contact.search, len(mesh.ids))
    if not area.any() or not met.any():
        closest = int(np.argmin(np.hypot(gap, miss)))
        what = "no master face lies on the normal of a slave node"
        if np.isfinite(gap[closest]):
            what = f"the closest slave node, {mesh.ids[at[closest]]}, has a gap of {gap[closest]:.3g} m"
            if miss[closest]:
                what += f" and lies {miss[closest]:.3g} m beyond the master"
        raise SceneError("", [f"no pair lies within search = {contact.search:g} m: {what}; check sets and normal"])
    at = at[met]
    normal = normal[met]
    weights = weights[met]
    if own.closed and (facing[at] * normal).sum() < 0.0:
        normal = -normal
    place = mesh.xyz[at]
    area = area[at]
    sliding, radius = _sliding(contact, mesh, at, normal)
    slave_nodes = sp.csr_array((np.ones(len(at)), (range(len(at)), at)), shape=(len(at), len(mesh.ids)))
    pairs = slave_nodes - weights
    _refuse_tied(full, mesh, pairs)
    cell = np.arange(len(at)) if contact.points is None else _cells(contact, place, sliding, normal)
    cells, number = np.unique(cell, return_inverse=True)
    mean = sp.csr_array((area, (number, range(len(at)))), shape=(len(cells), len(at)))
    whole = mean.sum(axis=1)
    mean = sp.csr_array(sp.diags_array(1.0 / whole) @ mean)
    return Points(
        name=contact.name,
        normal=sp.csr_array(mean @ _rows(full, mesh, pairs, normal)),
        along=sp.csr_array(mean @ _rows(full, mesh, pairs, sliding)),
        area=whole,
        radius=mean @ radius if contact.axis is not None else np.ones(len(cells)),
        position=mean @ place,
        sliding=_unit(mean @ sliding),
    )


def _sliding(contact: Contact, mesh: Mesh, at: Numbers, normal: Array) -> tuple[Array, Array]:
    """The direction of sliding [node, 3] across the normals of the nodes `at`, and the radius [node] about an axis."""
    if contact.axis is not None:
        axis = _unit(np.array(contact.axis))
        arms = np.cross(axis, mesh.xyz[at] - np.array(contact.centre))
        radius = np.linalg.norm(arms, axis=1)
        on_axis = np.flatnonzero(radius < 1e-9 * np.ptp(mesh.xyz, axis=0).max())
        if on_axis.size:
            node = mesh.ids[at[on_axis[0]]]
            raise SceneError("", [f"node {node} lies on the axis, where nothing slides; leave it out"])
        sliding = arms / radius[:, None]
    else:
        sliding = np.tile(_unit(np.array(contact.sliding)), (len(at), 1))
        radius = np.ones(len(at))
    sliding = sliding - (sliding * normal).sum(axis=1)[:, None] * normal
    along_normal = np.flatnonzero(np.linalg.norm(sliding, axis=1) < _FACING)
    if along_normal.size:
        what = f"the sliding at node {mesh.ids[at[along_normal[0]]]} points along the normal"
        raise SceneError("", [f"{what}; a contact slides along its surface"])
    return _unit(sliding), radius


def _refuse_tied(full: Full, mesh: Mesh, pairs: sp.csr_array) -> None:
    """Raise SceneError if a node of the `pairs` [pair, node] is held or follows others."""
    met_nodes = mesh.ids[np.unique(pairs.indices[pairs.data != 0.0])]
    following = np.intersect1d(met_nodes, np.array(sorted(mesh.following), dtype=np.int64))
    displacements = (full.direction >= 0) & (full.direction < 3)
    moving, rows = np.unique(full.node[displacements], return_counts=True)
    absent = following
    if mesh.tied:  # a node may follow in one direction
        absent = np.setdiff1d(met_nodes, moving[rows >= 3])
    if len(absent):
        why = "follows others by *EQUATION" if len(following) else f"is held, or follows others by {mesh.tied}"
        what = f"node {absent[0]} {why}"
        raise SceneError("", [f"{what}; a contact needs free nodes: keep tied nodes out of it"])


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)  # type: ignore[no-any-return]


def _rows(full: Full, mesh: Mesh, pairs: sp.csr_array, directions: Array) -> sp.csr_array:
    """The rows [pair, row] of the relative displacements `pairs` [pair, node] along `directions` [pair, 3].

    A node without a row is held: it does not move.
    """
    free = np.flatnonzero((full.direction >= 0) & (full.direction < 3))
    at = mesh.at(full.node[free])
    total = sp.csr_array((len(directions), full.rows))
    for k in range(3):
        rows = free[full.direction[free] == k]
        nodes = at[full.direction[free] == k]
        place = sp.csr_array((full.share[rows], (nodes, rows)), shape=(len(mesh.ids), full.rows))
        total = total + sp.diags_array(directions[:, k]) @ (pairs @ place)
    total.eliminate_zeros()
    return sp.csr_array(total)


# Faces


def _pattern(count: int) -> tuple[list[tuple[int, int, int]], Array, Array]:
    """Triangles of a face with so many nodes, the motion of their corners [corner, node] and the share of its area.

    A face with four corners has a corner in its middle, so that no diagonal is preferred.
    """
    if count in (3, 6):
        triangles = [(0, 1, 2)] if count == 3 else [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]
        return triangles, np.eye(count), np.eye(count)
    ring = list(range(4)) if count == 4 else [0, 4, 1, 5, 2, 6, 3, 7]
    middle = np.full(4, 0.25) if count == 4 else np.repeat([-0.25, 0.5], 4)
    triangles = [(a, b, count) for a, b in zip(ring, (*ring[1:], ring[0]))]
    motion = np.vstack([np.eye(count), middle])
    share = np.vstack([np.eye(count), np.full(count, 1.0 / count)])
    return triangles, motion, share


def _surface(mesh: Mesh, nodes: Numbers, toward: Array | None, side: str) -> _Surface:
    """The triangles of the faces between these nodes that face along `toward`, or against it."""
    if not len(mesh.faces):
        return _flat(mesh, nodes, toward, side)
    own = np.isin(mesh.faces, nodes) | (mesh.faces < 0)
    chosen = np.flatnonzero(own.all(axis=1))
    counts = (mesh.faces[chosen] >= 0).sum(axis=1)
    parts = []
    for count in np.unique(counts).tolist():
        triangles, motion, share = _pattern(count)
        faces = chosen[counts == count]
        members = mesh.faces[faces][:, :count]
        corners = np.einsum("cn,fnk->fck", motion, mesh.xyz[members])
        for triangle in triangles:
            spread = np.zeros((len(faces), 3, 8))
            spread[:, :, :count] = motion[list(triangle)]
            shares = np.zeros((len(faces), 8))
            shares[:, :count] = share[list(triangle)].mean(axis=0)
            parts.append((corners[:, triangle], mesh.faces[faces], spread, shares, mesh.within[faces]))
    if parts:
        places, members, spread, shares, within = [np.concatenate(arrays) for arrays in zip(*parts)]
        outward = 0.5 * np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
        away = ((places.mean(axis=1) - within) * outward).sum(axis=1)
        outward = np.where(away < 0.0, -1.0, 1.0)[:, None] * outward
        sizes = np.linalg.norm(outward, axis=1)
        kept = sizes > 0.0
        if toward is not None:
            kept &= abs(outward @ toward) >= _FACING * sizes
        if kept.any():
            closed = bool(np.isfinite(within[kept]).all())
            return _Surface(places[kept], members[kept], spread[kept], shares[kept], outward[kept], closed)
    if parts:
        raise SceneError("", [f"{side}: none of its {len(chosen)} faces faces along the normal; turn the normal"])
    what = f"none of the outer faces has all its nodes among the {len(nodes)} chosen ones"
    raise SceneError("", [f"{side}: {what}; choose all nodes of faces"])


def _flat(mesh: Mesh, nodes: Numbers, toward: Array | None, side: str) -> _Surface:
    """Triangles between nodes without elements, in the plane across `toward`."""
    if toward is None:
        raise SceneError("", ['normal: "face" needs the elements of the mesh; give a direction'])
    first = np.linalg.svd(toward[None, :])[2][1:]
    try:
        triangles = Delaunay(mesh.xyz[nodes] @ first.T).simplices
    except (QhullError, ValueError):
        what = f"its {len(nodes)} nodes span no surface across the normal"
        remedy = "give such a contact by its rows, rows = './contact.csv'"
        raise SceneError("", [f"{side}: {what}; {remedy}"]) from None
    members = np.full((len(triangles), 8), -1, dtype=np.int64)
    members[:, :3] = nodes[triangles]
    places = mesh.xyz[members[:, :3]]
    outward = 0.5 * np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    outward = -np.abs(outward @ toward)[:, None] * toward
    spread = np.zeros((len(triangles), 3, 8))
    shares = np.zeros((len(triangles), 8))
    spread[:, :, :3] = np.eye(3)
    shares[:, :3] = 1.0 / 3.0
    return _Surface(places, members, spread, shares, outward, False)


def _met(
    places: Array, normal: Array, other: _Surface, search: float, nodes: int
) -> tuple[NDArray[np.bool_], sp.csr_array, Array, Array]:
    """For each place whether it meets a face within `search`, the weights [place, node] there, gap and miss [m].

    The miss is the distance beyond the edge of the face; the motion is extrapolated there.
    """
    a, b, c = other.corners.transpose(1, 0, 2)
    middle = other.corners.mean(axis=1)
    radius = np.linalg.norm(other.corners - middle[:, None], axis=2).max(axis=1)
    slaves = [np.arange(len(places))]
    near = [cKDTree(middle).query(places)[1]]  # for a message, where nothing is in reach
    sizes = np.frexp(radius)[1]  # few of a graded mesh are large, and only these have a long reach
    for size in np.unique(sizes):
        alike = np.flatnonzero(sizes == size)
        distance = radius[alike].max() + 2.0 * search
        neighbours = cKDTree(middle[alike]).query_ball_point(places, distance)
        counts = [len(faces) for faces in neighbours]
        slaves.append(np.repeat(np.arange(len(places)), counts))
        near.append(alike[np.concatenate(neighbours).astype(np.int64)])
    slave = np.concatenate(slaves)
    face = np.concatenate(near)
    # place = a + u (b - a) + v (c - a) + gap * normal
    system = np.stack([(b - a)[face], (c - a)[face], normal[slave]], axis=2)
    volume = np.linalg.det(system)
    area = np.linalg.norm(other.outward, axis=1)[face]
    faced = abs(volume) > 2.0 * 0.1 * area
    slave = slave[faced]
    face = face[faced]
    system = system[faced]
    from_corner = places[slave] - a[face]
    u, v, gap = np.linalg.solve(system, from_corner[:, :, None])[:, :, 0].T
    inner = np.stack([1.0 - u - v, u, v], axis=1)
    edges = np.stack([(c - b)[face], (c - a)[face], (b - a)[face]])
    sides = np.linalg.norm(edges, axis=2).T
    heights = 2.0 * area[faced][:, None] / sides
    miss = np.maximum(0.0, -(inner * heights).min(axis=1))
    miss = np.where(miss < 1e-9 * heights.max(axis=1), 0.0, miss)
    distance = np.round(np.hypot(gap, miss) / max(search, 1e-12), 9)
    order = np.lexsort((face, distance, slave))
    first = order[np.r_[True, np.diff(slave[order]) > 0]] if len(order) else order
    gaps = np.full(len(places), np.inf)
    misses = np.zeros(len(places))
    gaps[slave[first]] = abs(gap[first])
    misses[slave[first]] = miss[first]
    met = (gaps <= search) & (misses <= search)
    kept = first[met[slave[first]]]
    weights = np.einsum("pc,pcn->pn", inner[kept], other.weights[face[kept]])
    members = np.maximum(other.nodes[face[kept]], 0)
    rows = np.repeat(slave[kept], weights.shape[1])
    matrix = sp.csr_array((weights.ravel(), (rows, members.ravel())), shape=(len(places), nodes))
    return met, matrix, gaps, misses


def _cells(contact: Contact, place: Array, sliding: Array, normal: Array) -> Numbers:
    """The cell of each node: across the sliding (or along the radius) times along it (or around)."""
    assert contact.points is not None
    if contact.axis is not None:
        axis = _unit(np.array(contact.axis))
        arms = place - np.array(contact.centre)
        across = np.linalg.norm(np.cross(axis, arms), axis=1)
        first = arms[0] - (arms[0] @ axis) * axis
        angle = np.arctan2(np.cross(axis, first) @ arms.T, first @ arms.T)
        ordered = np.sort(angle)
        holes = np.diff(ordered, append=ordered[0] + 2.0 * np.pi)
        begin = ordered[(int(np.argmax(holes)) + 1) % len(holes)]
        along = (angle - begin + 1e-9) % (2.0 * np.pi)
    else:
        along = place @ sliding[0]
        across = place @ np.cross(normal[0], sliding[0])
    number = np.zeros(len(place), dtype=np.int64)
    for values, count in zip((across, along), contact.points):
        low = values.min()
        high = values.max()
        share = (values - low) / (high - low) if high > low else np.zeros(len(values))
        cell = np.clip(np.floor(share * count - _EVEN), 0, count - 1)
        number = number * count + cell.astype(np.int64)
    return number


# Rows


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
    along = _unit(np.array(direction, dtype=float))
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
