"""A structure with contact points, as a film of points or as patches of the method exact."""

import numpy as np

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.model.film import Film


def structure(mass, damping, stiffness, points, speed, film, load=None, start=None, velocity=None, tells=False):
    """The assembly of a structure with full matrices [coordinate, coordinate] and contact points.

    points: rows `normal`, `along` [point, coordinate] (compression, displacement along the sliding), `stiffness`,
    `shear`, `mu`, `reach` [point], optional `damping`. `film`: whether they are a film; otherwise each is a patch.
    """
    a = Assembly(title="structure")
    names = [f"q{i + 1}" for i in range(len(mass))]
    for name in names:
        a.coordinate(name, 0.0)
    for target, matrix in ((a.mass, mass), (a.damping, damping), (a.stiffness, stiffness)):
        for i, row in enumerate(names):
            target.update({(row, column): float(matrix[i][j]) for j, column in enumerate(names)})
    for name, force in zip(names, load if load is not None else np.zeros(len(names))):
        a.push(name, {"one": float(force)})
    for name, q, v in zip(
        names,
        start if start is not None else np.zeros(len(names)),
        velocity if velocity is not None else np.zeros(len(names)),
    ):
        a.start |= {name: float(q), f"{name}'": float(v)}
    normal, along = np.atleast_2d(points["normal"]), np.atleast_2d(points["along"])
    count = len(normal)
    k, mu, reach = (np.broadcast_to(points.get(name, 1.0), count) for name in ("stiffness", "mu", "reach"))
    if film:
        a.signal("slid", {"one": speed}, 0.0, "drive")
        a.film = Film(
            rows=np.stack([normal.T, along.T])[None],
            slid="slid",
            stiffness=k,
            shear=points["shear"],
            damping=np.array(points.get("damping", 0.0)),
            mu=mu,
            reach=reach,
            x=np.arange(count) * 1e-3,
            y=np.zeros(count),
            tells=tells,
        )
        return a
    for i in range(count):
        a.patch(
            f"c{i + 1}",
            dict(zip(names, along[i].tolist())),
            {"one": speed * reach[i]},
            friction_law.coulomb(float(mu[i]), float(mu[i])),
        )
        row = dict(zip(names, (k[i] * normal[i]).tolist()))
        a.normal(f"n{i + 1}", f"c{i + 1}", row, dict(zip(names, (-normal[i]).tolist())))
    return a
