"""Contacts between the faces of two node sets, as rows over the degrees of freedom.

Each slave node meets the point of a master face that lies on its normal. The motion of this point is interpolated from
the nodes of the face, linearly over triangles of the face: a rigid motion of the whole structure opens no gap. A node
has the share of the geometric area of the slave faces around it. Points are weighted means over the nodes of a cell.

The master is the body that the drive moves: `along` is the motion of the slave relative to it, along its sliding.
The gap grows along the normal, which points from the master into the slave.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.structure.faces import FACING, Surface, facing, meeting, surface, unit
from rig.structure.full import Array, Doubt, Full, Met, Points
from rig.structure.mesh import Mesh, Numbers, Selection, tried

_EDGE = 0.01  # of the area met: more beyond the edge of the master is doubted. chosen
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
    both = np.intersect1d(slave, master)
    if len(both):
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
    toward = None if isinstance(contact.normal, str) else unit(np.array(contact.normal))
    own = surface(mesh, slave, toward, "slave")
    other = surface(mesh, master, toward, "master")
    if toward is None and not own.closed:
        raise SceneError("", ['normal: "face" needs solid elements at the slave; give a direction'])
    nodes = len(mesh.ids)
    face_areas = np.linalg.norm(own.outward, axis=1)
    across = unit(own.outward) if toward is None else np.tile(toward, (len(own.corners), 1))
    met, _, _, beside = meeting(own.corners.mean(axis=1), across, other, contact.search, nodes)
    sizes = face_areas * met  # without faces that meet nothing, such as the sides of a pad
    area = np.zeros(nodes)
    inward = np.zeros((nodes, 3))
    np.add.at(area, own.nodes, own.shares * sizes[:, None])
    against = -(own.outward * met[:, None])
    np.add.at(inward, own.nodes, own.shares[:, :, None] * against[:, None, :])
    own_nodes = np.unique(own.nodes[own.shares > 0.0])
    at = np.flatnonzero(area) if met.any() else own_nodes
    if toward is None and met.any():
        normal = unit(inward[at])
    else:
        normal = np.tile(across[0], (len(at), 1))
    face_met = met
    met, weights, gap, miss = meeting(mesh.xyz[at], normal, other, contact.search, nodes)
    if not area.any() or not met.any():
        closest = int(np.argmin(np.hypot(gap, miss)))
        what = "no master face lies on the normal of a slave node"
        if np.isfinite(gap[closest]):
            what = f"the closest slave node, {mesh.ids[at[closest]]}, has a gap of {gap[closest]:.3g} m"
            if miss[closest]:
                what += f" and lies {miss[closest]:.3g} m beyond the master"
        raise SceneError("", [f"no pair lies within search = {contact.search:g} m: {what}; check sets and normal"])
    lost = at[~met]
    doubts = (
        *_beyond(contact, mesh, own, other, across, face_met, lost, area[lost], inward[lost]),
        *_over_the_edge(contact, face_areas[face_met], beside[face_met]),
    )
    slaves = mesh.ids[at[met]]
    masters = mesh.ids[np.unique(weights[met].indices)]
    found = Met(
        nodes=len(own_nodes),
        pairs=int(met.sum()),
        offered=float(face_areas.sum()),
        met=float(area[at[met]].sum()),
        gap=float(gap[met].max()),
        asked=contact.points[0] * contact.points[1] if contact.points else 0,
        doubts=doubts,
        slaves=frozenset(slaves.tolist()),
        masters=frozenset(masters.tolist()),
        faces=frozenset(map(tuple, own.nodes[face_met].tolist())) if len(mesh.faces) else frozenset(),
    )
    at = at[met]
    normal = normal[met]
    weights = weights[met]
    if own.closed and (inward[at] * normal).sum() < 0.0:
        normal = -normal
    place = mesh.xyz[at]
    area = area[at]
    sliding, radius = _sliding(contact, mesh, at, normal)
    slave_nodes = sp.csr_array((np.ones(len(at)), (range(len(at)), at)), shape=(len(at), nodes))
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
        sliding=unit(mean @ sliding),
        met=found,
    )


def _beyond(
    contact: Contact,
    mesh: Mesh,
    own: Surface,
    other: Surface,
    across: Array,
    met: NDArray[np.bool_],
    lost: Numbers,
    area: Array,
    inward: Array,
) -> tuple[Doubt, ...]:
    """The part of the slave that a master face faces beyond the search.

    `met` [face]: those within. `lost`: nodes of faces within that are beyond themselves, with their `area`, and minus
    their normals.
    """
    outward = np.where((own.outward * across).sum(axis=1) < 0.0, -1.0, 1.0)[:, None] * across
    places = np.concatenate([own.corners.mean(axis=1)[~met], mesh.xyz[lost]])
    directions = np.concatenate([outward[~met], -unit(inward)])
    sizes = np.concatenate([np.linalg.norm(own.outward, axis=1)[~met], area])
    distance = facing(places, directions, other, own.closed, contact.search)
    faced = np.isfinite(distance) & (distance > contact.search)
    if not faced.any():
        return ()
    share = sizes[~np.isnan(distance)].sum() / sizes.sum()
    nearest = distance[faced].min()
    farthest = distance[faced].max()
    what = (
        f"contacts.{contact.name}: {sizes[faced].sum() / share:.3g} m^2 of its slave take no part: the master faces "
        f"them {nearest:.3g} to {farthest:.3g} m away, beyond search = {contact.search:g} m"
    )
    return ((what, f"raise contacts.{contact.name}.search, or leave these nodes out of the slave"),)


def _over_the_edge(contact: Contact, areas: Array, beside: Array) -> Iterator[Doubt]:
    """Yield a doubt if faces of these areas that meet the master lie `beside` it [m], within the search."""
    over = float(areas[beside > 0.0].sum())
    if over > _EDGE * areas.sum():
        yield (
            f"contacts.{contact.name}: {over:.3g} m^2 of the area met hang over the edge of the master by up to "
            f"{beside.max():.3g} m, within search = {contact.search:g} m",
            f"lower contacts.{contact.name}.search, or leave these nodes out of the slave",
        )


def _sliding(contact: Contact, mesh: Mesh, at: Numbers, normal: Array) -> tuple[Array, Array]:
    """The direction of sliding [node, 3] across the normals of the nodes `at`, and the radius [node] about an axis."""
    if contact.axis is not None:
        axis = unit(np.array(contact.axis))
        arms = np.cross(axis, mesh.xyz[at] - np.array(contact.centre))
        radius = np.linalg.norm(arms, axis=1)
        on_axis = np.flatnonzero(radius < 1e-9 * np.ptp(mesh.xyz, axis=0).max())
        if on_axis.size:
            node = mesh.ids[at[on_axis[0]]]
            raise SceneError("", [f"node {node} lies on the axis, where nothing slides; leave it out"])
        sliding = arms / radius[:, None]
    else:
        sliding = np.tile(unit(np.array(contact.sliding)), (len(at), 1))
        radius = np.ones(len(at))
    through = (sliding * normal).sum(axis=1)
    sliding = sliding - through[:, None] * normal
    along_normal = np.flatnonzero(np.linalg.norm(sliding, axis=1) < FACING)
    if along_normal.size:
        node = mesh.ids[at[along_normal[0]]]
        what = f"the sliding at node {node} points along the normal"
        raise SceneError("", [f"{what}; a contact slides along its surface"])
    return unit(sliding), radius


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


def _rows(full: Full, mesh: Mesh, pairs: sp.csr_array, directions: Array) -> sp.csr_array:
    """The rows [pair, row] of the relative displacements `pairs` [pair, node] along `directions` [pair, 3].

    A node without a row is held: it does not move.
    """
    free = np.flatnonzero((full.direction >= 0) & (full.direction < 3))
    at = mesh.at(full.node[free])
    total = sp.csr_array((len(directions), full.rows))
    for k in range(3):
        along_axis = full.direction[free] == k
        rows = free[along_axis]
        nodes = at[along_axis]
        place = sp.csr_array((full.share[rows], (nodes, rows)), shape=(len(mesh.ids), full.rows))
        total = total + sp.diags_array(directions[:, k]) @ (pairs @ place)
    total.eliminate_zeros()
    return sp.csr_array(total)


def _cells(contact: Contact, place: Array, sliding: Array, normal: Array) -> Numbers:
    """The cell of each node: across the sliding (or along the radius) times along it (or around)."""
    assert contact.points is not None
    if contact.axis is not None:
        axis = unit(np.array(contact.axis))
        arms = place - np.array(contact.centre)
        across = np.linalg.norm(np.cross(axis, arms), axis=1)
        first = arms[0] - (arms[0] @ axis) * axis
        second = np.cross(axis, first)
        angle = np.arctan2(second @ arms.T, first @ arms.T)
        ordered = np.sort(angle)
        holes = np.diff(ordered, append=ordered[0] + 2.0 * np.pi)
        widest = int(np.argmax(holes))
        begin = ordered[(widest + 1) % len(holes)]
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
