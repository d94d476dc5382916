"""A plate on a layer of foam, reduced to vibration modes at the plate's top face.

    q_i'' + 2 zeta_i w_i q_i' + w_i^2 q_i = sum_p shapes_i(p) . force(p)          modes i of mass one, points p

x runs along the plate from its rear edge, y across it from its middle, z upwards. A slider lies on the plate and moves
along x, with its middle at y = 0: from position 0, where both rear edges meet, to where both front edges meet. The foam
is held at its lower face. Without foam the plate is free: the first six modes are rigid, with a frequency of zero, and
`modes` counts them.

The modes lack a part of the static deflection: the plate yields locally under each point and its neighbours. Springs
in series with the points cannot carry this part, because neighbours share it. `Rest` carries it by further coordinates
with one frequency, the band limit: far below it they follow the forces at once, above it the model tells nothing.
`residual` is the mean of this part over the footprint at mid-travel under uniform pressure, per pressure.
Source: plate and foam of "A new mechanism for friction-induced vibration and noise", section 3.2; `residual`: derived.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, Self

import numpy as np

from rig.plants.structures import contact_map, plate_elements
from rig.plants.structures.plate_elements import Foam, Plate
from rig.plants.structures.plate_surface import Array, Surface, framed, unframed
from rig.structure import model_store

__all__ = ["Foam", "Grid", "Plate", "Reduced", "Surface", "build"]

_HERE = Path(__file__).parent
_SOURCES = ("hexahedra.py", "plate_elements.py", "plate_surface.py")
LARGEST_PITCH = 0.5e-3
"""Largest distance between two positions at which shapes are stored [m] [chosen]."""
STATIONS = 45
"""Number of slider positions at which the flexibility that modes lack is computed; 90 change the least pressure by 5e-4
[chosen]."""
_SMALL = 0.03  # of the largest: combinations of point forces to which the rest yields less are left out


@dataclass(frozen=True)
class Grid:
    """The contact points: centres of `along` times `across` equal cells of the slider's footprint [m]."""

    length: float
    width: float
    along: int
    across: int

    @property
    def x(self) -> Array:
        """Positions [m] of the points along the travel, from the slider's middle."""
        return ((np.arange(self.along) + 0.5) / self.along - 0.5) * self.length

    @property
    def y(self) -> Array:
        """Positions [m] of the points across the travel, from the slider's middle."""
        return ((np.arange(self.across) + 0.5) / self.across - 0.5) * self.width

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the pressure outputs, in order of the lines across the slider from the rear."""
        return tuple(f"pressure_{i}_{j}" for i in range(1, self.along + 1) for j in range(1, self.across + 1))

    @property
    def surface(self) -> contact_map.Surface:
        """The points on a map: x, y on the slider."""
        half = 0.5 * np.array([self.length / self.along, self.width / self.across])
        middles = np.stack([m.ravel() for m in np.meshgrid(self.x, self.y, indexing="ij")], axis=1)
        corners = middles[:, None] + half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        area = np.full(len(middles), self.length * self.width / len(middles))
        shape = self.along, self.across
        return contact_map.Surface("film", self.names, np.ones(1), area, corners, ("x", "y"), shape)

    @property
    def stride(self) -> int:
        """Places from a point to the next one along."""
        return max(math.ceil(self.length / self.along / LARGEST_PITCH - 1e-9), 1)

    @property
    def pitch(self) -> float:
        """Between two places [m]."""
        return self.length / self.along / self.stride


@dataclass(frozen=True)
class Rest:
    """The flexibility that the modes lack under the points of a slider, as coordinates of mass one at `frequency` [Hz].

    `rows` [station, coordinate, 2 (z, x), point on the left half] sqrt(m/N): times the angular frequency they are the
    mode shapes of these coordinates, with the slider at equal steps of its travel. `parity` [coordinate]: 1 if it moves
    both sides alike, -1 if it moves them against each other.
    """

    rows: Array
    parity: Array
    frequency: float = 0.0

    def at(self, travelled: Array) -> Array:
        """Shapes [position, coordinate, 2, point] kg^-0.5 with the slider at these shares of its travel."""
        place = np.clip(travelled, 0.0, 1.0) * (len(self.rows) - 1)
        low = np.minimum(place.astype(np.int64), len(self.rows) - 2)
        share = (place - low)[:, None, None, None]
        between = (1.0 - share) * self.rows[low] + share * self.rows[low + 1]
        return np.asarray(2.0 * math.pi * self.frequency * between)

    @classmethod
    def of(cls, plate: Plate, foam: Foam, surface: Surface, grid: Grid) -> Self:
        """Compute the rest under the points of `grid`; takes seconds."""
        travel = np.linspace(0.0, plate.length - grid.length, STATIONS)
        points = (grid.along, grid.across)
        size = (grid.length, grid.width)
        rows = []
        parity = []
        for side in (1.0, -1.0):
            yields = 0.25 * plate_elements.left_out(plate, foam, surface, size, points, travel, side)
            shares, vectors = np.linalg.eigh(yields.mean(axis=0))
            basis = vectors[:, shares > _SMALL * shares[-1]]
            lower = np.linalg.cholesky(basis.T @ yields @ basis)
            rows.append((lower.transpose(0, 2, 1) @ basis.T).reshape(STATIONS, basis.shape[1], 2, -1))
            parity += [side] * basis.shape[1]
        return cls(np.concatenate(rows, axis=1), np.array(parity))

    def to_bytes(self) -> bytes:
        """The rows as bytes with a checksum."""
        return framed({"shape": self.rows.shape, "parity": self.parity.tolist()}, self.rows.astype("<f8").tobytes())

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """Read what `to_bytes` wrote. Raises ValueError for other content."""
        head, body = unframed(content)
        try:
            rows = np.frombuffer(body, dtype="<f8").astype(np.float64).reshape(head["shape"])
            if rows.ndim != 4 or len(head["parity"]) != rows.shape[1] or len(rows) < 2:
                raise ValueError
            return cls(rows, np.array(head["parity"], dtype=np.float64))
        except (KeyError, TypeError, ValueError):
            raise ValueError("is not the flexibility that modes of a plate lack") from None


@dataclass(frozen=True)
class Reduced:
    """The structure for contact points that move with the slider.

    `shapes` [mode, 3 (x, y, z), line, position] kg^-0.5: on the contact grid's lines along the plate, at positions with
    the distance `grid.pitch` [m]. With the slider at n pitches, point i along is at position n + i `grid.stride`. In
    between, shapes are interpolated linearly. `probe` [mode, 3] kg^-0.5: shapes at `point`, x and y [m]. `rest`: the
    flexibility that the modes lack, if it is asked for.
    """

    surface: Surface
    grid: Grid
    point: tuple[float, float]
    shapes: Array
    probe: Array
    rest: Rest | None = None

    @property
    def frequencies(self) -> Array:
        """Frequencies [Hz] of the modes, ascending."""
        return self.surface.frequencies

    @classmethod
    def of(cls, surface: Surface, grid: Grid, point: tuple[float, float]) -> Self:
        """The model of the plate with this surface. Raises ValueError for a point beside the plate."""
        travel = surface.x[-1] - surface.x[0] - grid.length
        count = math.ceil(travel / grid.pitch - 1e-9) + 1 + (grid.along - 1) * grid.stride
        places = 0.5 * grid.length / grid.along + np.arange(count) * grid.pitch  # the last may be beside the plate
        shapes = np.ascontiguousarray(surface.continued(places, grid.y))
        probe = surface.at(np.array([point[0]]), np.array([point[1]]))[:, :, 0, 0]
        return cls(surface, grid, point, shapes, probe)


def build(plate: Plate, foam: Foam | None, grid: Grid, point: tuple[float, float], completed: bool = False) -> Reduced:
    """The reduced structure for a slider's contact grid, and for a probe at `point` (x, y) [m].

    `completed`: with the flexibility that the modes lack, at the last frequency of the plate's table of damping.
    Takes seconds the first time; then it is read from disk (`model_store`). Raises ValueError for a slider larger than
    the plate, a point beside the plate, and as `plate_elements.surface` does.
    """
    for name in ("length", "width"):
        slider = getattr(grid, name)
        most = getattr(plate, name)
        if slider > most:
            raise ValueError(f"slider.{name} is {slider:g} m; it must be at most plate.{name}, {most:g} m")
    of = _given(plate, foam, grid)
    surface = model_store.stored_or_built(
        f"{_key(of)}.plate",
        build=lambda: plate_elements.surface(plate, foam, (grid.length, grid.width)),
        write=Surface.to_bytes,
        read=Surface.from_bytes,
        of=f"plate {_hash(of)}",
    )
    reduced = Reduced.of(surface, grid, point)
    if not completed or foam is None or plate.damping is None:
        return reduced
    of |= {"points": [grid.along, grid.across], "stations": STATIONS, "small": _SMALL}
    rest = model_store.stored_or_built(
        f"{_key(of)}.rest",
        build=lambda: Rest.of(plate, foam, surface, grid),
        write=Rest.to_bytes,
        read=Rest.from_bytes,
        of=f"rest {_hash(of)}",
    )
    return replace(reduced, rest=replace(rest, frequency=plate.damping[-1][0]))


def _given(plate: Plate, foam: Foam | None, grid: Grid) -> dict[str, Any]:
    """The values that the surface depends on."""
    return {
        "plate": plate.model_dump(exclude={"damping_ratio", "damping"}),
        "foam": foam and foam.model_dump(),
        "footprint": [grid.length, grid.width],
    }


def _key(given: dict[str, Any]) -> str:
    """Hash of all that the surface depends on."""
    return _hash(given | model_store.built_by(_HERE, _SOURCES))


def _hash(values: dict[str, Any]) -> str:
    return sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:32]
