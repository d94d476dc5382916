"""What tells a user whether a structure is the one that was meant: its mass, its bodies, doubts about it.

A doubt is no fault: the structure can be computed. It is stated as a warning.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse import csgraph

from rig.printable import counted
from rig.structure.full import Doubt, Full, Points
from rig.structure.mesh import Mesh, Numbers

SPEEDS = (10.0, 5e4)
"""Speeds of sound [m/s] that a structure can have: a third of that of soft rubber, 2.5 times that of diamond."""
_FEW = 8  # nodes: fewer make no mesh
_MOST = 8  # bodies or sets that shapes are named by
_SAME = 0.9  # nodes in common over all nodes: a set that is a body
_WHOLE = 0.99  # of all nodes: a set that tells nothing


def total_mass(full: Full) -> float | None:
    """The mass that moves along one direction [kg]; None where no direction is known."""
    mass = full.matrix("mass", dict.fromkeys(full.keys, 1.0))
    totals = []
    for k in range(3):
        moved = (full.direction == k).astype(float)
        totals.append(float(moved @ (mass @ moved)))
    return max(totals) if any(totals) else None


def doubts(full: Full) -> tuple[Doubt, ...]:
    """What may be wrong with a structure: contacts that share nodes, material that does not exist."""
    return (*_shared(full.contacts), *_unlike_material(full))


def _shared(contacts: Sequence[Points]) -> Iterator[Doubt]:
    known = [(points.name, points.met) for points in contacts if points.met is not None]
    for i, (name, met) in enumerate(known):
        for other, of_other in known[:i]:
            both = f"contacts.{other} and contacts.{name}"
            if common := sorted(met.slaves & of_other.slaves):
                which = f"{both} share {counted(len(common), 'slave node')}, the first is {common[0]}"
                of_faces = bool(met.faces and of_other.faces)
                if of_faces and not met.faces & of_other.faces:
                    yield (
                        f"{which}: their faces adjoin there; no area has two springs",
                        "check that both sets are meant",
                    )
                else:
                    springs = f"two springs {'' if of_faces else 'may '}act at the same area"
                    remedy = "give each contact slave nodes of its own, or leave one of the contacts out"
                    yield f"{which}: {springs}", remedy
            elif met.slaves & of_other.masters and met.masters & of_other.slaves:
                node = min(met.slaves & of_other.masters)
                yield (
                    f"{both} join the same two faces, as slave and master and the other way round (node {node}): two "
                    "springs act at the same area",
                    "leave one of the contacts out",
                )


def _unlike_material(full: Full) -> Iterator[Doubt]:
    speed = speed_of_sound(full)
    if speed is not None and not SPEEDS[0] <= speed <= SPEEDS[1]:
        what = (
            f"stiffness and mass give a speed of sound of about {speed:.1g} m/s on this mesh; in solids it is "
            "30 to 20000 m/s"
        )
        yield what, "check structure.units, and the units of elastic modulus and density in the mesh"


def speed_of_sound(full: Full) -> float | None:
    """The median over the nodes of distance times highest frequency [m/s]; None without a mesh.

    A wave passes the `distance` to the nearest node that is coupled with a node in the time of a vibration of this node
    alone, within a factor of about two for solid elements.
    """
    known = (full.direction >= 0) & (full.direction < 3) & np.isin(full.node, full.ids)
    if not known.any():
        return None
    values = dict.fromkeys(full.keys, 1.0)
    constant = [part for part in full.parts if part.of == "stiffness" and not part.key]
    if not constant:
        return None
    stiffness = sp.csr_array(sum(part.factor * part.matrix for part in constant))
    mass = np.asarray(abs(sp.csr_array(full.matrix("mass", values))).sum(axis=1))
    node = np.searchsorted(full.ids, np.where(known, full.node, full.ids[0]))
    entries = stiffness.tocoo()
    i, j = entries.coords
    coupled = known[i] & known[j] & (entries.data != 0.0)
    distance = np.linalg.norm(full.xyz[node[i[coupled]]] - full.xyz[node[j[coupled]]], axis=1)
    apart = distance > 1e-9 * np.ptp(full.xyz, axis=0).max()
    nearest = np.full(len(full.ids), np.inf)
    np.minimum.at(nearest, node[i[coupled]][apart], distance[apart])
    square = np.where(known, abs(stiffness.diagonal()) / np.maximum(mass, np.finfo(float).tiny), 0.0)
    fastest = np.zeros(len(full.ids))
    np.maximum.at(fastest, node[known], square[known])
    of_mesh = np.isfinite(nearest)
    speeds = nearest[of_mesh] * np.sqrt(fastest[of_mesh])
    return float(np.median(speeds)) if speeds.size >= _FEW else None


def regions(full: Full, mesh: Mesh) -> dict[str, Numbers]:
    """Rows of the bodies of a structure, by name, the largest first; of one body those of its sets.

    A body is named by the set that contains its nodes, otherwise by the largest set in it, or by its first node.
    """
    of_mesh = full.direction >= 0
    if not of_mesh.any():
        return {}
    moving = np.unique(full.node[of_mesh])
    sets = {name: np.intersect1d(nodes, moving) for name, nodes in {**mesh.groups, **mesh.sets}.items()}
    coupled: Any = sum(abs(sp.csr_array(part.matrix)) for part in full.parts if part.of != "damping")
    count, body = csgraph.connected_components(coupled, directed=False)
    rows = np.bincount(body[of_mesh], minlength=count)
    bodies = [int(k) for k in np.argsort(-rows, kind="stable") if rows[k]]
    named: dict[str, Numbers] = {}
    some = {name: nodes for name, nodes in sets.items() if 0 < len(nodes) < _WHOLE * len(moving)}
    if len(bodies) > 1 or not some:
        for k in bodies[:_MOST]:
            of_body = np.flatnonzero(body == k)
            nodes = np.unique(full.node[of_body][of_mesh[of_body]])
            name = _name(nodes, sets)
            named[name if name not in named else f"body of node {nodes[0]}"] = of_body
        return named
    for name in sorted(some, key=lambda name: -len(some[name]))[:_MOST]:
        inside = np.flatnonzero(np.isin(full.node, some[name]) & (full.direction >= 0))
        named[name] = inside
    return named


def _name(nodes: Numbers, sets: Mapping[str, Numbers]) -> str:
    """The name of a body."""
    common = {name: len(np.intersect1d(members, nodes)) for name, members in sets.items()}
    alike = {name: common[name] / len(np.union1d(members, nodes)) for name, members in sets.items()}
    best = max(alike, key=lambda name: alike[name], default="")
    if best and alike[best] >= _SAME:
        return best
    inside = [name for name, members in sets.items() if 0 < common[name] == len(members)]
    if inside:
        return f"body of {max(inside, key=lambda name: common[name])}"
    return f"body of node {nodes[0]}"
