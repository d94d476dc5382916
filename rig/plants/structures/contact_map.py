"""Contact points as areas of a map: the corners of the cell of each point, its area, and its output.

A map shows a contact in the plane of two axes of the mesh, those that its normal points along least. A cell ends
half-way to the next points: along the sliding and across it, or around the axis and along the radius.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # it loads scipy.sparse, which a finished model does not need
    from rig.structure.full import Points

Array = NDArray[np.float64]
_ROUND = 0.7  # cosine between axis and normal above which the contact is seen as a sector of a disc


@dataclass(frozen=True, eq=False)
class Surface:
    """A contact on a map. `outputs`: of the points; over `per` [m^2, or 1 for a pressure] they are pressures in Pa.

    `corners` [point, 4, 2] m, along `axes`; `area` [point] m^2; `shape`: of the points in arrays.
    """

    name: str
    outputs: tuple[str, ...]
    per: Array
    area: Array
    corners: Array
    axes: tuple[str, str]
    shape: tuple[int, ...]

    @cached_property
    def places(self) -> Array:
        """The middles of the cells [point, 2] m."""
        return np.asarray(self.corners.mean(axis=1))

    @property
    def x(self) -> Array:
        """The middles of the cells along the first axis [m], in the shape of the points."""
        return self.places[:, 0].reshape(self.shape)

    @property
    def y(self) -> Array:
        """The middles of the cells along the second axis [m], in the shape of the points."""
        return self.places[:, 1].reshape(self.shape)

    def maps(self, signals: Mapping[str, Array]) -> Array:
        """Pressures [instant, *shape] in Pa; 0 where a point is open."""
        table = np.stack([signals[name] for name in self.outputs], axis=-1) / self.per
        return np.asarray(table.reshape(*table.shape[:-1], *self.shape))

    def centre(self, pressures: Array) -> tuple[float, float]:
        """The pressure centre [m] of pressures in the shape of the points; NaN where nothing presses."""
        weights = pressures.ravel() * self.area
        total = float(weights.sum())
        x, y = weights @ self.places / total if total > 0.0 else (math.nan, math.nan)
        return float(x), float(y)


def surface_of(
    points: Points, outputs: tuple[str, ...], normal: Array | None, axis: Array | None, centre: Array
) -> Surface | None:
    """The map of a contact; None for points without places.

    `outputs`: normal forces [N] of the points. `normal`: by default that of the plane through the points. `axis`:
    about which the other side turns, through `centre` [m].
    """
    place = points.position
    sliding = points.sliding
    spread = float(np.ptp(place, axis=0).max(initial=0.0))
    if not np.linalg.norm(sliding, axis=1).all() or (len(place) > 1 and spread == 0.0):
        return None
    if normal is None:
        in_plane = np.vstack([place - place.mean(axis=0), (spread or 1.0) * sliding])
        normal = np.linalg.svd(in_plane)[2][-1]
    kept = [k for k in range(3) if k != int(np.abs(normal).argmax())]
    along = sliding[0]
    if axis is not None and abs(axis @ normal) > _ROUND * np.linalg.norm(axis) * np.linalg.norm(normal):
        axis = axis / np.linalg.norm(axis)
        arms = place - centre
        heights = np.outer(arms @ axis, axis)
        radii = arms - heights
        first = radii.mean(axis=0) if len(place) > 1 else radii[0]
        if not np.linalg.norm(first) > 1e-6 * spread:
            first = radii[0]
        first = first / np.linalg.norm(first)
        second = np.cross(axis, first)
        radius = np.linalg.norm(radii, axis=1)
        angle = np.arctan2(arms @ second, arms @ first)
        dr, da = _halves(radius, angle, radius, points.area)
        r = radius[:, None] + dr
        a = angle[:, None] + da
        turned = np.cos(a)[:, :, None] * first + np.sin(a)[:, :, None] * second
        corners = centre + heights[:, None, :] + np.maximum(r, 0.0)[:, :, None] * turned
    else:
        across = np.cross(normal, along)
        across = across / np.linalg.norm(across)
        u = place @ across
        v = place @ along
        du, dv = _halves(u, v, np.ones(len(place)), points.area)
        corners = place[:, None, :] + du[:, :, None] * across + dv[:, :, None] * along
    axes = "xyz"[kept[0]], "xyz"[kept[1]]
    return Surface(points.name, outputs, points.area, points.area, corners[:, :, kept], axes, (len(place),))


def _halves(u: Array, v: Array, size: Array, area: Array) -> tuple[Array, Array]:
    """Offsets (u, v) [point, 4] of the corners from each point; `size`: length [m] of one unit of v at the point."""
    out = np.zeros((2, len(u), 4))
    for i in range(len(u)):
        du = u - u[i]
        dv = size[i] * (v - v[i])
        reach = []
        for distance, aside in ((du, dv), (dv, du)):
            below = _half_way(-distance, aside)
            above = _half_way(distance, aside)
            reach.append([above if math.isnan(below) else below, below if math.isnan(above) else above])
        for k in (0, 1):  # a line of points, or one alone: as wide as its area asks
            if math.isnan(reach[k][0]):
                length = sum(reach[1 - k])
                width = area[i] / length if length > 0.0 else math.sqrt(area[i])
                reach[k] = [0.5 * width] * 2
        (low_u, high_u), (low_v, high_v) = reach
        out[0, i] = -low_u, high_u, high_u, -low_u
        out[1, i] = np.array([-low_v, -low_v, high_v, high_v]) / size[i]
    return out[0], out[1]


def _half_way(distance: Array, aside: Array) -> float:
    """Half the way to the nearest point ahead that is not farther aside than ahead; NaN if there is none."""
    ahead = 0.5 * distance[(distance > 0.0) & (np.abs(aside) <= distance)]
    return float(ahead.min()) if len(ahead) else math.nan
