"""A slider that rides on the plate."""

from types import SimpleNamespace

import rig
from rig.motion.motion import Motion
from rig.plants import plate
from rig.solve.film_steps import COUNTED

SMALL = {
    "plate.modes": 10,
    "plate.elements_along": 4,
    "plate.elements_across": 4,
    "plate.elements_through": 1,
    "foam.elements_through": 1,
    "film.along": 3,
    "film.across": 2,
}


def ride(changes, duration, h_ns, every_ns=10_000, written=None, method="kick", moved=None):
    """The rig of a small plate carried on by steps of `h_ns`; what its states were every so often, by name."""
    scene = rig.load("plate", SMALL | changes)
    assembly = plate.assemble(scene.parameters, moved or {})
    system = assembly.system()
    count = round(duration * 1e9 / every_ns)
    motion = Motion(system, every_ns, method, substeps=round(every_ns / h_ns), longest=count)
    for name, value in (written or {}).items():
        motion.write(system.names.index(name), value)
    motion.advance(count)
    states = motion.states[-count:].copy()
    film, at = system.film, {name: i for i, name in enumerate(system.names)}

    def of_points(kept):
        return states[:, [at[f"{kept}:{point + 1}"] for point in range(film.points)]]

    return SimpleNamespace(
        p=scene.parameters,
        motion=motion,
        system=system,
        film=film,
        places=states[:, : len(system.coordinates)],
        at=lambda name: states[:, at[name]],
        of_points=of_points,
        openings=states[:, at["film.openings"]] / COUNTED if film else None,
    )
