"""A plate on a layer of foam, reduced to vibration modes at the plate's top face.

    q_i'' + 2 zeta_i w_i q_i' + w_i^2 q_i = sum_p shapes_i(p) . force(p)          modes i of mass one, points p

x runs along the plate from its rear edge, y across it from its middle, z upwards. A slider lies on the plate and moves
along x, with its middle at y = 0: from position 0, where both rear edges meet, to where both front edges meet. The foam
is held at its lower face. Without foam the plate is free: the first six modes are rigid, with a frequency of zero, and
`modes` counts them. Who wants only elastic modes drops these six.

What the modes left out would yield is in `residual`: under uniform pressure on the footprint at mid-travel, the mean
deflection of the footprint that is missing, per pressure. It acts in series with the film between slider and plate.
Source: sizes and materials of paper 002 (detachment and reattachment in friction-induced vibration), section 3.2; the
elements: rig.plants.hexahedra.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from rig.plants import hexahedra
from rig.plants.hexahedra import Material, Part, Structure
from rig.quantities import KilogramPerCubicMetre, Pascal, PoissonRatio, PositiveMetre, Ratio, Section, SomeMetre

Array = NDArray[np.float64]
Elements = Annotated[int, Ge(1), Le(64)]
Count = Annotated[int, Ge(1), Le(200)]
LARGEST_PITCH = 0.5e-3
"""Between two places at which shapes are kept [m]. # chosen"""


class Plate(Section):
    """The plate; how many modes are taken, and the damping ratio of the highest: the others' follow the frequency."""

    length: PositiveMetre
    width: PositiveMetre
    thickness: PositiveMetre
    young: Pascal
    density: KilogramPerCubicMetre
    poisson: PoissonRatio
    damping_ratio: Ratio = 0.0
    modes: Count = 40
    elements_along: Elements = 10
    elements_across: Elements = 8
    elements_through: Elements = 2


class Foam(Section):
    """The layer under the plate, as large as the plate or `overhang` larger on all four sides."""

    thickness: PositiveMetre
    young: Pascal
    density: KilogramPerCubicMetre
    poisson: PoissonRatio
    overhang: SomeMetre = 0.0
    elements_through: Elements = 2


@dataclass(frozen=True)
class Grid:
    """Contact points at the middles of `along` times `across` equal cells of the slider's footprint [m]."""

    length: float
    width: float
    along: int
    across: int

    @property
    def lines(self) -> Array:
        """Places of the rows across the plate, y [m]."""
        return ((np.arange(self.across) + 0.5) / self.across - 0.5) * self.width

    @property
    def stride(self) -> int:
        """Places from a point to the next one along."""
        return max(math.ceil(self.length / self.along / LARGEST_PITCH - 1e-9), 1)

    @property
    def pitch(self) -> float:
        """Between two places [m]."""
        return self.length / self.along / self.stride


@dataclass(frozen=True)
class Surface:
    """The structure as seen at the plate's top face.

    `frequencies` [mode] Hz, ascending. `x`, `y`: places of the nodes [m], two for each element and one more. `shapes`
    [mode, 3 (x, y, z), y, x] kg^-0.5, of mass one. `compliance` [m/Pa]: mean deflection of the slider's footprint at
    mid-travel under uniform pressure on it; `residual` [m/Pa]: how much of it the modes leave out.
    """

    frequencies: Array
    x: Array
    y: Array
    shapes: Array
    compliance: float
    residual: float

    def at(self, x: Array, y: Array) -> Array:
        """Shapes [mode, 3, y, x] kg^-0.5 at all pairs of the places `x` [m] and `y` [m].

        Raises ValueError for places beside the plate.
        """
        for name, places, nodes in (("x", x, self.x), ("y", y, self.y)):
            beyond = places[(places < nodes[0]) | (places > nodes[-1])]
            if len(beyond):
                raise ValueError(f"{name} is {beyond[0]:g} m; the plate reaches from {nodes[0]:g} to {nodes[-1]:g} m")
        return self.continued(x, y)

    def continued(self, x: Array, y: Array) -> Array:
        """The same, where places beside the plate have the polynomial of the element at its edge."""
        along = _interpolated(self.shapes, self.x, x)
        return _interpolated(along.swapaxes(2, 3), self.y, y).swapaxes(2, 3)


@dataclass(frozen=True)
class Reduced:
    """The structure for contact points that ride with the slider.

    `shapes` [mode, 3 (x, y, z), line, place] kg^-0.5: at the contact grid's lines along the plate, at places `pitch`
    [m] apart. With the slider at position n `pitch`, point i along is at place n + i `stride`. In between, shapes
    are interpolated linearly. `probe` [mode, 3] kg^-0.5: at `point`, x and y [m].
    """

    surface: Surface
    grid: Grid
    point: tuple[float, float]
    shapes: Array
    probe: Array

    @property
    def frequencies(self) -> Array:
        """Of the modes, ascending [Hz]."""
        return self.surface.frequencies

    @property
    def residual(self) -> float:
        """What the modes leave out, in series with the film [m/Pa]."""
        return self.surface.residual

    @property
    def pitch(self) -> float:
        """Between two places [m]."""
        return self.grid.pitch

    @property
    def stride(self) -> int:
        """Places from a contact point to the next one along."""
        return self.grid.stride


def build(plate: Plate, foam: Foam | None, grid: Grid, point: tuple[float, float]) -> Reduced:
    """The reduced structure for a slider's contact grid, and for a probe at `point` (x, y) [m]; takes seconds.

    Raises ValueError for a slider that is no smaller than the plate, a point beside it, or more modes than its elements
    can give.
    """
    return reduced(surface(plate, foam, grid), grid, point)


def reduced(face: Surface, grid: Grid, point: tuple[float, float]) -> Reduced:
    """The same from a structure that is known. Raises ValueError for a point beside the plate."""
    travel = face.x[-1] - face.x[0] - grid.length
    count = math.ceil(travel / grid.pitch - 1e-9) + 1 + (grid.along - 1) * grid.stride
    places = 0.5 * grid.length / grid.along + np.arange(count) * grid.pitch  # the last may be beside the plate
    shapes = np.ascontiguousarray(face.continued(places, grid.lines))
    probe = face.at(np.array([point[0]]), np.array([point[1]]))[:, :, 0, 0]
    return Reduced(face, grid, point, shapes, probe)


def surface(plate: Plate, foam: Foam | None, grid: Grid) -> Surface:
    """The structure at the plate's top face. Raises ValueError as `build` does."""
    for name in ("length", "width"):
        if not getattr(grid, name) < getattr(plate, name):
            raise ValueError(
                f"slider.{name} is {getattr(grid, name):g} m; it must be below plate.{name}, {getattr(plate, name):g} m"
            )
    structure, first = _structure(plate, foam)
    found = hexahedra.modes(structure, plate.modes)
    x, y, z = structure.axes
    top = structure.lattice[:, 2] == len(z) - 1
    whole = np.zeros((len(structure.free), plate.modes))
    whole[structure.free] = found.vectors
    nodes = (2 * plate.elements_across + 1, 2 * plate.elements_along + 1)
    shapes = whole.reshape(3, len(top), -1)[:, top].reshape(3, *nodes, -1).transpose(3, 0, 1, 2)
    x, y = (axis[2 * n : len(axis) - 2 * n] for axis, n in zip((x, y), first))
    load = np.zeros((3, len(top)))  # of a pressure of 1 Pa, along z
    middle = 0.5 * (x[0] + x[-1])
    along = _integrals(x, middle - 0.5 * grid.length, middle + 0.5 * grid.length)
    load[2, top] = np.multiply.outer(_integrals(y, -0.5 * grid.width, 0.5 * grid.width), along).ravel()
    force = load.ravel()[structure.free]
    area = grid.length * grid.width
    residual = float(force @ hexahedra.left_out(structure, found, force)) / area
    elastic = found.frequencies > 0.0
    given = (force @ found.vectors[:, elastic]) / (2.0 * math.pi * found.frequencies[elastic])
    return Surface(
        found.frequencies, x, y, np.ascontiguousarray(shapes), residual + float(given @ given) / area, residual
    )


def _structure(plate: Plate, foam: Foam | None) -> tuple[Structure, tuple[int, int]]:
    """The elements, and how many of them lie before the plate along x and y."""
    a, b, c = plate.elements_along, plate.elements_across, plate.elements_through
    steel = Material(plate.young, plate.poisson, plate.density)
    x, y, z = (
        np.linspace(0.0, size, n + 1) for size, n in zip((plate.length, plate.width, plate.thickness), (a, b, c))
    )
    y -= 0.5 * plate.width
    if foam is None:
        return hexahedra.assemble(x, y, z, [Part(steel, np.ones((a, b, c), dtype=np.bool_))], held=False), (0, 0)
    beside = [math.ceil(foam.overhang / size - 1e-9) for size in (plate.length / a, plate.width / b)]
    if foam.overhang:
        x, y = (_widened(lines, foam.overhang, n) for lines, n in zip((x, y), beside))
    below = np.linspace(-foam.thickness, 0.0, foam.elements_through + 1)
    n, m = beside
    of_plate = np.zeros((a + 2 * n, b + 2 * m, foam.elements_through + c), dtype=np.bool_)
    of_plate[n : n + a, m : m + b, foam.elements_through :] = True
    of_foam = np.zeros_like(of_plate)
    of_foam[:, :, : foam.elements_through] = True
    soft = Material(foam.young, foam.poisson, foam.density)
    lines = (x, y, np.concatenate([below, z[1:]]))
    return hexahedra.assemble(*lines, [Part(soft, of_foam), Part(steel, of_plate)], held=True), (n, m)


def _widened(lines: Array, by: float, elements: int) -> Array:
    """Boundaries with as many `elements` more at either end, over a width of `by` [m]."""
    more = np.linspace(0.0, by, elements + 1)
    return np.concatenate([lines[0] - more[:0:-1], lines, lines[-1] + more[1:]])


def _quadratic(nodes: Array, places: Array) -> tuple[NDArray[np.int64], Array]:
    """First node of the element at each place; weights [3, place] of its three nodes."""
    ends = nodes[::2]
    element = np.clip(np.searchsorted(ends, places, side="right") - 1, 0, len(ends) - 2)
    t = (places - ends[element]) / (ends[element + 1] - ends[element])
    return 2 * element, np.stack([(2.0 * t - 1.0) * (t - 1.0), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)])


def _interpolated(values: Array, nodes: Array, places: Array) -> Array:
    """`values` [..., node] at each place [..., place]; no library's product of matrices: the same bits everywhere."""
    first, weights = _quadratic(nodes, places)
    return weights[0] * values[..., first] + weights[1] * values[..., first + 1] + weights[2] * values[..., first + 2]  # type: ignore[no-any-return]


def _integrals(nodes: Array, low: float, high: float) -> Array:
    """Integral [m] of each node's shape function from `low` to `high`."""
    found = np.zeros(len(nodes))
    for start, end in zip(nodes[:-2:2], nodes[2::2]):
        left, right = max(start, low), min(end, high)
        if right > left:
            middle, half = 0.5 * (left + right), 0.5 * (right - left)
            first, weights = _quadratic(nodes, middle + half / math.sqrt(3.0) * np.array([-1.0, 1.0]))  # Gauss: exact
            for i in range(3):
                np.add.at(found, first + i, half * weights[i])
    return found
