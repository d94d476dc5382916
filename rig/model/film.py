"""A film of points between a structure and a rigid slider that travels over it.

    d = n(s) . q             compression of a point         n, t: rows over the coordinates, by the travel s
    u = t(s) . q             how far the coordinates carry it along
    P = k d + c d'           what it presses with; not below zero, and none where d <= 0
    f                        what its friction pushes the structure with: |f| <= mu P
    M q'' + D q' + K q = other forces + sum (-n P + t f)

A point sticks by the shear of the film itself, f' = k_t (s' - u') while |f| < mu P. That stiffness is the material's,
no number of ours: nothing has to be solved for all points at once, and a point that sticks creeps by mu P / k_t at most
before it slips. Across the travel, where asked, t has a second row and (f_x, f_y) keeps to a circle.

Rows are given at equal steps of the travel and are interpolated between them at every step of the integrator.
What the points do are states of the rig, which a step of rig.solve.film_steps writes anew: forces on the coordinates,
sums over the points, and of each point what it presses with and what its friction is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.solve.film_sums import SUMS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Film:
    """The points of a film; `travel`: the signal that says where the slider is, `slid`: how far the points have slid.

    The rig is its own mirror image on both sides of the line of travel, so that half of the points says it all: the
    first half, and then their images. A coordinate moves both sides alike (`parity` 1; across the travel against each
    other) or against each other (-1): half the work of rows for all of them.

    rows [place, direction, coordinate, pair]: normal, along and, where asked, across the travel, at each `pitch` [m].
    `longest`: how far the slider can travel [m].
    parity [coordinate]. `stiffness`, `shear` [N/m], `damping` [N s/m]: of each point. `mu`: friction. x, y [point]:
    where the points are on the slider [m].
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
        """How many."""
        return 2 * int(self.rows.shape[3])

    @property
    def directions(self) -> int:
        """Two, or three with friction across the travel."""
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
        """States where all points slide and the contacts press with `pressed` [N]; one that would pull is open."""
        P = np.maximum(pressed, 0.0)
        normal = float(P.sum())
        share = P / normal if normal else P
        sums = normal, self.mu * normal, float(np.mean(P > 0.0)), float(self.x @ share), float(self.y @ share), 0.0
        found = {over(name): value for name, value in zip(SUMS, sums)}
        return found | {at("P", point): value for point, value in enumerate(P.tolist())}

    def creep(self, force: float) -> float:
        """How far a point gives way before it slips [m], where `force` [N] presses it: the error of its stick."""
        return self.mu * force / self.shear

    def of_points(self) -> list[str]:
        """What is kept of each point, in the order of the states."""
        kept = ["P", "f"] + ["g"] * (self.directions - 2)
        return kept + ["c", "before"] * (self.damping > 0.0)


def on(coordinate: str) -> str:
    """The state that says what the film pushes a coordinate with."""
    return f"film:{coordinate}"


def over(quantity: str) -> str:
    """The state of one of `SUMS`."""
    return f"film.{quantity}"


def at(kept: str, point: int) -> str:
    """The state of something that is kept of a point, by its number."""
    return f"{kept}:{point + 1}"
