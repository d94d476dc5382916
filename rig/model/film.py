"""A film of contact points on a structure: each point opens, sticks and slips on its own.

    d = n . q                compression of a point         n, t: rows over the coordinates
    u = t . q                displacement of the structure along the sliding
    P = k d + c d'           pressure force; not below zero, and none where d <= 0
    f                        friction force on the structure: |f| <= mu P
    M q'' + D q' + K q = other forces + sum (-n P + t f)

A point sticks by the shear of the film itself: f' = k_t (r s' - u') while |f| < mu P, where the drive slides by s and
its surface passes the point by r s: r is 1 along a line, the radius on a disc. The shear stiffness belongs to the
material; it is not a numerical parameter. So stick need not be solved for all points at once, and a stuck point creeps
by at most mu P / k_t before it slips. With friction across the sliding, t has a second row, and (f_x, f_y) stays within
a circle.

Points of a slider that travels over the structure have rows at equal steps of the travel, which are interpolated at
every step of the integrator. Forces on the coordinates, sums over the points, and pressure and friction of each point
are states of the rig, which each step of rig.solve.film_steps overwrites.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.model.friction_law import Law, pack, width
from rig.solve.film_steps import OPEN, SLIDES, STICKS, SUMS

Array = NDArray[np.float64]
_ALIKE = 1e-9
"""Largest difference of two mirrored rows, relative to the largest entry of a coordinate."""


class Mirror(NamedTuple):
    """A mirror symmetry of a film's rows: `order` [point] has one of each pair of points first, then their images.

    Stiffness, friction and the other numbers of two images may differ: each point has its own.

    `parity` [coordinate]: 1 if it moves both sides alike (in opposite directions across the sliding), -1 if it moves
    them in opposite directions.
    """

    order: NDArray[np.int64]
    parity: Array


@dataclass(frozen=True, eq=False)
class Film:
    """The points of a film. `slid`: the state with the distance slid by the drive.

    rows [place, direction, coordinate, point]: normal, along and, if present, across the sliding. Rows of points on a
    travelling slider have several places, at each `pitch` [m] of the state `travel`; its travel is at most `longest` m.
    `stiffness`, `shear` [N/m], `damping` [N s/m], `mu` (friction coefficient at rest) and `reach` (r above) are of each
    point; one number serves all. x, y [point]: positions of the points, for the centre of pressure [m]. `laws`, of each
    point or one for all: in slip the coefficient of a point is that of its law, which is `mu` at rest; by default it is
    `mu`. `tells`: slip speed and contact state of each point are states too.
    """

    rows: Array
    slid: str
    stiffness: Array
    shear: Array
    mu: Array
    x: Array
    y: Array
    damping: Array = field(default_factory=lambda: np.zeros(1))
    reach: Array = field(default_factory=lambda: np.ones(1))
    travel: str = ""
    pitch: float = 0.0
    longest: float = 0.0
    laws: tuple[Law, ...] = ()
    tells: bool = False

    def __post_init__(self) -> None:
        for name in ("stiffness", "shear", "damping", "mu", "reach"):
            of_points = np.array(np.broadcast_to(getattr(self, name), self.points), dtype=np.float64)
            object.__setattr__(self, name, of_points)
        bare = np.flatnonzero(~((self.stiffness > 0.0) & (self.shear > 0.0)))
        if len(bare):
            raise ValueError(f"points {', '.join(map(str, bare + 1))} of the film have no stiffness: they need an area")
        if self.laws:
            object.__setattr__(self, "tells", True)
            if any(law.states or law.backward is not None for law in self.laws):
                raise ValueError("the points of a film support no law with memory or with a direction")
            if self.directions > 2:
                raise ValueError("the points of a film support a law over speed along the sliding only")
            same = all(law.constant and law.numbers[0] == law.static for law in self.laws)
            object.__setattr__(self, "laws", () if same else self.laws * (self.points // len(self.laws)))

    @property
    def points(self) -> int:
        """The number of points."""
        return int(self.rows.shape[3])

    @property
    def directions(self) -> int:
        """The number of directions: two, or three with friction across the sliding."""
        return int(self.rows.shape[1])

    def everywhere(self, place: float) -> Array:
        """The rows of all points [direction, coordinate, point] with the slider at `place` [m]."""
        if len(self.rows) == 1:
            return np.asarray(self.rows[0])
        at = min(max(place / self.pitch, 0.0), len(self.rows) - 1.0)
        low = min(int(at), len(self.rows) - 2)
        return np.asarray(self.rows[low] + (at - low) * (self.rows[low + 1] - self.rows[low]))

    @cached_property
    def mirror(self) -> Mirror | None:
        """The mirror symmetry of the points, which halves the work with the rows; None if there is none."""
        if self.points % 2:
            return None
        half = self.points // 2
        others = (point for point in range(1, self.points) if point != half)
        for partner in (half, *others):
            mirror = self._mirrored(partner)
            if mirror is not None:
                return mirror
        return None

    def _mirrored(self, partner: int) -> Mirror | None:
        """The mirror symmetry in which `partner` is the image of the first point."""
        size = np.abs(self.rows).max(axis=(0, 1, 3))
        scale = np.where(size > 0.0, size, 1.0)
        rows = (self.rows[0] / scale[:, None]).transpose(2, 1, 0).copy()  # [point, coordinate, direction]
        images = rows.copy()
        images[:, :, 2:] *= -1.0
        parity = np.zeros(rows.shape[1])
        free = np.ones(self.points, dtype=bool)
        first: list[int] = []
        second: list[int] = []
        for point in range(self.points):
            if not free[point]:
                continue
            free[point] = False
            known = parity != 0.0
            turned = np.where(known, parity, 1.0)[:, None] * rows[point]
            far = np.abs(images - turned)
            against = np.abs(images + turned)
            far = np.where(known[:, None], far, np.minimum(far, against))
            alike = free & (far.max(axis=(1, 2)) < _ALIKE)
            if not first:
                alike &= np.arange(self.points) == partner
            if not alike.any():
                return None
            image = int(np.argmax(alike))
            free[image] = False
            first.append(point)
            second.append(image)
            products = np.sum(rows[point] * images[image], axis=1)
            parity = np.where(known | (np.abs(products) < _ALIKE**2), parity, np.sign(products))
        parity[parity == 0.0] = 1.0
        signs = np.array([1.0, 1.0, -1.0])[: self.directions, None] * parity
        mirrored = signs[:, :, None] * self.rows[..., first]
        far = np.abs(self.rows[..., second] - mirrored).max(axis=(0, 1, 3))
        return Mirror(np.array(first + second), parity) if (far <= _ALIKE * size).all() else None

    @cached_property
    def packed(self) -> tuple[NDArray[np.int64], Array]:
        """Codes [point] and numbers [point, width] of the laws for the kernels; of length zero without laws."""
        if not self.laws:
            return np.zeros(0, np.int64), np.zeros((0, 0))
        return pack(self.laws, [(0, 0)] * self.points, width(self.laws))

    @property
    def order(self) -> NDArray[np.int64]:
        """The points in the order of their states: with one of each mirrored pair first, then their images."""
        return np.arange(self.points) if self.mirror is None else self.mirror.order

    def sliding(self, pressed: Array, slip: Array) -> dict[str, float]:
        """The states when the contacts press with `pressed` [N, point] and slip at `slip` [m/s, point].

        A contact with a negative force counts as open; one without slip counts as stuck, without shear.
        """
        P = np.maximum(pressed, 0.0)
        mu = self.mu
        if self.laws:
            mu = np.array([law.mu(speed) for law, speed in zip(self.laws, np.abs(slip).tolist())])
        f = np.sign(slip) * mu * P
        normal = float(P.sum())
        share = P / normal if normal else P
        sums = normal, float(f.sum()), float(np.mean(P > 0.0)), float(self.x @ share), float(self.y @ share), 0.0
        states = {over(name): value for name, value in zip(SUMS, sums)}
        if_closed = np.where(slip == 0.0, STICKS, SLIDES)
        kinds = {
            "P": P,
            "f": f,
            "g": np.zeros(self.points),
            "c": P / self.stiffness,
            "before": pressed / self.stiffness,
            "w": slip,
            "s": np.where(P > 0.0, if_closed, OPEN),
        }
        for kind, of_points in kinds.items():
            states |= {at(kind, point): value for point, value in enumerate(of_points.tolist())}
        return states

    def start(self, coordinates: list[str], start: Mapping[str, float], speed: float) -> dict[str, float]:
        """The states at the start of a rig with these states, where the drive slides at `speed`."""
        q = np.array([start.get(name, 0.0) for name in coordinates])
        v = np.array([start.get(f"{name}'", 0.0) for name in coordinates])
        normal, along, *_ = self.everywhere(start.get(self.travel, 0.0))
        states = self.sliding(self.stiffness * (q @ normal), self.reach * speed - v @ along)
        P = np.array([states[at("P", point)] for point in range(self.points)])
        f = np.array([states[at("f", point)] for point in range(self.points)])
        forces = along @ f - normal @ P
        return states | {on(name): force for name, force in zip(coordinates, forces.tolist())}

    def creep(self, pressed: float | Array) -> float:
        """The largest displacement [m] of a point before it slips: the error of its stick. `pressed` [N, point]."""
        return float((self.mu / self.shear * pressed).max())

    def states(self, coordinates: list[str]) -> list[str]:
        """The names of the states that the film adds to a rig with these coordinates."""
        forces = [on(name) for name in coordinates]
        order = self.order.tolist()
        return [*forces, *map(over, SUMS), *(at(kind, point) for kind in self.of_points() for point in order)]

    def of_points(self) -> list[str]:
        """The kinds of states that each point has, in the order of the states."""
        kept = ["P", "f"] + ["g"] * (self.directions - 2)
        return kept + ["c", "before"] * bool(self.damping.any()) + ["w", "s"] * self.tells


def on(coordinate: str) -> str:
    """The name of the state that holds the force of the film on a coordinate."""
    return f"film:{coordinate}"


def over(quantity: str) -> str:
    """The name of the state that holds one of `SUMS`."""
    return f"film.{quantity}"


def at(kept: str, point: int) -> str:
    """The name of a state of one point, by its index."""
    return f"{kept}:{point + 1}"
