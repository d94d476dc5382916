"""Surfaces of triangles between nodes of a mesh, and where lines along normals meet them.

The motion of a point of a triangle is interpolated from the nodes of its face, linearly: a rigid motion of the whole
structure opens no gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from rig.errors import SceneError
from rig.structure.full import Array
from rig.structure.mesh import Mesh, Numbers

FACING = 0.5
"""Least cosine between the normal and a face that takes part."""

_PAIRS = 10_000_000  # of lines and triangles that `facing` tries: 3 s. Of more lines it takes some at equal intervals
_AT_ONCE = 500_000  # of these pairs
_INSIDE = 1e-9  # of a triangle: a line through its edge meets it


@dataclass(frozen=True)
class Surface:
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


def unit(vectors: Array) -> Array:
    """The vectors [..., 3] of length one."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)  # type: ignore[no-any-return]


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


def surface(mesh: Mesh, nodes: Numbers, toward: Array | None, side: str) -> Surface:
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
        outward = _areas(places)
        from_body = places.mean(axis=1) - within
        away = (from_body * outward).sum(axis=1)
        outward = np.where(away < 0.0, -1.0, 1.0)[:, None] * outward
        sizes = np.linalg.norm(outward, axis=1)
        kept = sizes > 0.0
        if toward is not None:
            kept &= abs(outward @ toward) >= FACING * sizes
        if kept.any():
            closed = bool(np.isfinite(within[kept]).all())
            return Surface(places[kept], members[kept], spread[kept], shares[kept], outward[kept], closed)
    if parts:
        raise SceneError("", [f"{side}: none of its {len(chosen)} faces faces along the normal; turn the normal"])
    what = f"none of the outer faces has all its nodes among the {len(nodes)} chosen ones"
    raise SceneError("", [f"{side}: {what}; choose all nodes of faces"])


def _areas(corners: Array) -> Array:
    """The normals of triangles with these corners [triangle, 3, 3] m, each of the length of the area [m^2]."""
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    return np.asarray(0.5 * np.cross(first, second))


def _flat(mesh: Mesh, nodes: Numbers, toward: Array | None, side: str) -> Surface:
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
    outward = _areas(places)
    outward = -np.abs(outward @ toward)[:, None] * toward
    spread = np.zeros((len(triangles), 3, 8))
    shares = np.zeros((len(triangles), 8))
    spread[:, :, :3] = np.eye(3)
    shares[:, :3] = 1.0 / 3.0
    return Surface(places, members, spread, shares, outward, False)


def meeting(
    places: Array, normal: Array, other: Surface, search: float, nodes: int
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
    inner = np.stack([1.0 - u - v, u, v], axis=1)  # barycentric
    edges = np.stack([(c - b)[face], (c - a)[face], (b - a)[face]])
    sides = np.linalg.norm(edges, axis=2).T
    heights = 2.0 * area[faced][:, None] / sides
    beyond = -(inner * heights).min(axis=1)
    outside = np.flatnonzero(beyond >= 1e-9 * heights.max(axis=1))
    miss = np.zeros(len(face))
    projected = places[slave[outside]] - gap[outside, None] * normal[slave[outside]]
    miss[outside] = _from_edges(projected, other.corners[face[outside]])
    reach = np.hypot(gap, miss) / max(search, 1e-12)
    distance = np.round(reach, 9)
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


def _from_edges(places: Array, corners: Array) -> Array:
    """The distance [place] of each place to the next edge of its triangle, `corners` [place, 3, 3] m."""
    edges = np.roll(corners, -1, axis=1) - corners
    from_corner = places[:, None] - corners
    share = (from_corner * edges).sum(axis=2) / (edges * edges).sum(axis=2)
    feet = corners + np.clip(share, 0.0, 1.0)[:, :, None] * edges
    return np.linalg.norm(places[:, None] - feet, axis=2).min(axis=1)  # type: ignore[no-any-return]


def facing(places: Array, outward: Array, other: Surface, closed: bool, search: float) -> Array:
    """The distance [m] from each place along `outward` (of length one) to the next face turned to it.

    It is infinite where there is none. `closed`: the sense of `outward` is known; faces behind a place then count
    within ten times `search`: bodies that overlap. Of many places some are tried; it is NaN at the others.
    """
    distances = np.full(len(places), np.nan)
    if not len(places):
        return distances
    a, b, c = other.corners.transpose(1, 0, 2)
    count = max(1, min(len(places), _PAIRS // len(a)))
    chosen = np.unique(np.linspace(0, len(places) - 1, count).astype(np.int64))
    batches = -(-len(chosen) * len(a) // _AT_ONCE)
    for some in np.array_split(chosen, batches):
        ray = outward[some][:, None]
        across = np.cross(ray, (c - a)[None])
        volume = (across * (b - a)).sum(axis=2)
        parallel = abs(ray @ other.outward.T)[:, 0] < FACING * np.linalg.norm(other.outward, axis=1)
        volume = np.where(parallel, np.nan, volume)
        start = places[some][:, None] - a[None]
        u = (across * start).sum(axis=2) / volume
        turned = np.cross(start, (b - a)[None])
        v = (ray * turned).sum(axis=2) / volume
        distance = (turned * (c - a)).sum(axis=2) / volume
        hit = (u >= -_INSIDE) & (v >= -_INSIDE) & (u + v <= 1.0 + _INSIDE)
        if closed:
            hit &= distance > -10.0 * search
            if other.closed:
                turned_to = (ray @ other.outward.T)[:, 0] < 0.0
                leaving = np.where(hit & ~turned_to & (distance < 0.0), distance, -np.inf).max(axis=1)
                hit &= turned_to & (distance > leaving[:, None])  # beyond it a place lies outside of the body
        distances[some] = np.where(hit, abs(distance), np.inf).min(axis=1)
    return distances
