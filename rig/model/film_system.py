"""A system with a film of points: its additional states, whether kick supports it, and its highest frequency."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rig.model.film import Film, at, on, over
from rig.model.named_rows import Rows
from rig.model.system import System
from rig.solve.film_sums import SUMS

_EXAMINED = 9  # number of examined positions of the slider


def add_film_states(a: Rows, film: Film) -> None:
    """Add the states of a film to a rig, after all others."""
    if on(a.coordinates[0]) in a.signals:
        return
    for name in a.coordinates:
        a.signal(on(name), {}, 0.0, "film")
        a.push(name, {on(name): 1.0})
    for name in SUMS:
        a.signal(over(name), {}, 0.0, "film")
    for kept in film.of_points():
        for point in range(film.points):
            a.signal(at(kept, point), {}, 0.0, "film")
    for point in range(film.points):
        for kept in ("f", "g")[: film.directions - 1]:
            a.stores.append((1.0 / film.shear, {at(kept, point): 1.0}))
        if film.damping > 0.0:
            a.stores.append((film.stiffness, {at("c", point): 1.0}))
        else:
            a.stores.append((1.0 / film.stiffness, {at("P", point): 1.0}))


def refusal(system: System) -> str:
    """The reason why kick does not support this system with a film; "" if it does."""
    if system.limiters or system.sectors or system.switches or system.products or len(system.network):
        return "supports structures, a film and command states only: no drive or load with both a lag and limits"
    for matrix in (system.mass, system.damping, system.stiffness):
        if np.any(matrix - np.diag(np.diag(matrix))):
            return "needs coordinates that are modes of the structure, coupled by the film alone"
    if np.any(system.force[:, : system.one]):
        return "forces of the structure must come from command states"
    return ""


def with_film_contacts(system: System) -> System:
    """The system whose only contacts are those in the film."""
    return replace(system, patches=(), normals=())


def fastest(system: System, h: float) -> float:
    """The highest angular frequency [rad/s] with every point closed and stuck, over all positions of the slider.

    A damped film at steps of `h` [s] counts as stiffer, by the value of its three-point damping for alternating
    positions.
    """
    film, highest = system.film, 0.0
    assert film is not None
    stiffness = film.stiffness + 4.0 * film.damping / h
    root = 1.0 / np.sqrt(np.diag(system.mass))
    for place in np.linspace(0.0, film.longest, _EXAMINED).tolist():
        normal, *sticking = film.everywhere(place)
        K = system.stiffness + stiffness * (normal @ normal.T) + sum(film.shear * (one @ one.T) for one in sticking)
        highest = max(highest, float(np.linalg.eigvalsh(root[:, None] * K * root)[-1]))
    return math.sqrt(highest)
