"""A film of contact points between a structure and a rigid slider that travels over it.

    d = n(s) . q             compression of a point         n, t: rows over the coordinates, by the travel s
    u = t(s) . q             displacement of the structure along the travel
    P = k d + c d'           pressure force; not below zero, and none where d <= 0
    f                        friction force on the structure: |f| <= mu P
    M q'' + D q' + K q = other forces + sum (-n P + t f)

A point sticks by the shear of the film itself: f' = k_t (s' - u') while |f| < mu P. This stiffness belongs to the
material; it is not a numerical parameter. So stick need not be solved for all points at once, and a stuck point creeps
by at most mu P / k_t before it slips. With friction across the travel, t has a second row, and (f_x, f_y) stays within
a circle.

Rows are given at equal steps of the travel and interpolated at every step of the integrator. Forces on the coordinates,
sums over the points, and pressure and friction of each point are states of the rig, which each step of
rig.solve.film_steps overwrites.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.solve.film_steps import SUMS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Film:
    """The points of a film. `travel`: the state with the slider's position; `slid`: the state with the distance slid.

    The rig is mirror-symmetric about the line of travel, so half of the points suffice: the first half, followed by
    their images. A coordinate moves both sides alike (`parity` 1; across the travel in opposite directions) or in
    opposite directions (-1). This halves the work with the rows.

    rows [place, direction, coordinate, pair]: normal, along and, if present, across the travel, at each `pitch` [m].
    `longest`: longest travel of the slider [m]. parity [coordinate]. `stiffness`, `shear` [N/m], `damping` [N s/m]: of
    each point. `mu`: friction coefficient. x, y [point]: positions of the points on the slider [m].
    """

    rows: Array
    parity: Array
    pitch: float
    travel: str
    slid: str
    longest: float
    stiffness: float
    damping: float
    shear: float
    mu: float
    x: Array
    y: Array

    @property
    def points(self) -> int:
        """The number of points."""
        return 2 * int(self.rows.shape[3])

    @property
    def directions(self) -> int:
        """The number of directions: two, or three with friction across the travel."""
        return int(self.rows.shape[1])

    def everywhere(self, place: float) -> Array:
        """The rows of all points [direction, coordinate, point] with the slider at `place` [m]."""
        at = min(max(place / self.pitch, 0.0), len(self.rows) - 1.0)
        low = min(int(at), len(self.rows) - 2)
        here = self.rows[low] + (at - low) * (self.rows[low + 1] - self.rows[low])
        mirrored = here * self.parity[:, None]
        mirrored[2:] *= -1.0
        return np.concatenate([here, mirrored], axis=2)

    def sliding(self, pressed: Array) -> dict[str, float]:
        """The states when all points slide and the contacts press with `pressed` [N].

        A contact with a negative force counts as open.
        """
        P = np.maximum(pressed, 0.0)
        normal = float(P.sum())
        share = P / normal if normal else P
        sums = normal, self.mu * normal, float(np.mean(P > 0.0)), float(self.x @ share), float(self.y @ share), 0.0
        states = {over(name): value for name, value in zip(SUMS, sums)}
        return states | {at("P", point): value for point, value in enumerate(P.tolist())}

    def creep(self, force: float) -> float:
        """The displacement [m] of a point under `force` [N] before it slips: the error of its stick."""
        return self.mu * force / self.shear

    def of_points(self) -> list[str]:
        """The kinds of states that each point has, in the order of the states."""
        kept = ["P", "f"] + ["g"] * (self.directions - 2)
        return kept + ["c", "before"] * (self.damping > 0.0)


def on(coordinate: str) -> str:
    """The name of the state that holds the force of the film on a coordinate."""
    return f"film:{coordinate}"


def over(quantity: str) -> str:
    """The name of the state that holds one of `SUMS`."""
    return f"film.{quantity}"


def at(kept: str, point: int) -> str:
    """The name of a state of one point, by its index."""
    return f"{kept}:{point + 1}"
