"""A plate on a layer of foam as an elastic structure of finite elements.

The lower face of the foam is fixed. Without foam the plate is free: the first six modes are rigid, with a frequency of
zero, and `modes` counts them.
Source: sizes and materials of "A new mechanism for friction-induced vibration and noise", section 3.2.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from annotated_types import Ge, Le
from pydantic import model_validator

from rig.plants.structures.plate_surface import Array, Surface, element_at
from rig.quantities import (
    KilogramPerCubicMetre,
    NonNegativeMetre,
    Pascal,
    PoissonRatio,
    PositiveMetre,
    Ratio,
    Ratios,
    Section,
    refused,
)

if TYPE_CHECKING:
    from rig.plants.structures.hexahedra import Structure

Elements = Annotated[int, Ge(1), Le(64)]
Count = Annotated[int, Ge(1), Le(600)]
LARGEST = 60_000
"""Largest number of unknowns; building such a structure takes less than a minute and 2 GB."""


class Plate(Section):
    """The plate; number of modes; damping ratio of the highest mode, those of the others in proportion to frequency.

    `damping`, instead of `damping_ratio`: damping ratios over frequency, [[Hz, ratio], ...], linear in between. Its
    last frequency is the band limit, above which the model tells nothing (`film.completed`).
    """

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
    damping: Ratios | None = None

    @model_validator(mode="after")
    def _damped(self) -> Self:
        if self.damping is not None and self.damping_ratio:
            raise refused([("damping_ratio", "must be 0 beside damping, which has a ratio at each frequency")])
        return self

    def ratios(self, frequencies: Array) -> Array:
        """The damping ratio of the mode at each of ascending frequencies [Hz]."""
        if self.damping is None:
            return np.asarray(self.damping_ratio * frequencies / float(frequencies[-1]))
        return np.asarray(np.interp(frequencies, *np.array(self.damping).T))


class Foam(Section):
    """The layer under the plate, as large as the plate or larger by `overhang` [m] on all four sides."""

    thickness: PositiveMetre
    young: Pascal
    density: KilogramPerCubicMetre
    poisson: PoissonRatio
    overhang: NonNegativeMetre = 0.0
    elements_through: Elements = 2


def surface(plate: Plate, foam: Foam | None, footprint: tuple[float, float]) -> Surface:
    """Compute the structure at the plate's top face for a slider's `footprint` (length, width) [m]; takes seconds.

    Raises ValueError for more elements than `LARGEST` allows, too few for the modes, or values so far apart that the
    result is lost in rounding.
    """
    unknowns = _unknowns(plate, foam)
    if unknowns > LARGEST:
        raise ValueError(
            f"the elements of plate and foam have {unknowns} unknowns; at most {LARGEST} are allowed: "
            f"lower elements_along, elements_across or elements_through, or foam.overhang"
        )
    from rig.plants.structures import hexahedra  # its import of scipy takes a second

    length, width = footprint
    structure, first = _structure(plate, foam)
    modes = hexahedra.modes(structure, plate.modes)
    x, y, z = structure.axes
    top = structure.lattice[:, 2] == len(z) - 1
    whole = np.zeros((len(structure.free), plate.modes))
    whole[structure.free] = modes.vectors
    nodes = (2 * plate.elements_across + 1, 2 * plate.elements_along + 1)
    on_top = whole.reshape(3, len(top), -1)[:, top]
    shapes = on_top.reshape(3, *nodes, -1).transpose(3, 0, 1, 2)
    x = x[2 * first[0] : len(x) - 2 * first[0]]
    y = y[2 * first[1] : len(y) - 2 * first[1]]
    load = np.zeros((3, len(top)))  # of a pressure of 1 Pa, along z
    middle = 0.5 * (x[0] + x[-1])
    along = _integrals(x, middle - 0.5 * length, middle + 0.5 * length)
    across = _integrals(y, -0.5 * width, 0.5 * width)
    load[2, top] = np.multiply.outer(across, along).ravel()
    force = load.ravel()[structure.free]
    residual = float(force @ hexahedra.left_out(structure, modes, force)) / (length * width)
    if residual < 0.0:
        raise ValueError(hexahedra.LOST)
    elastic = modes.frequencies > 0.0
    omega = 2.0 * math.pi * modes.frequencies[elastic]
    moved = (force @ modes.vectors[:, elastic]) / omega
    compliance = residual + float(moved @ moved) / (length * width)
    return Surface(modes.frequencies, x, y, np.ascontiguousarray(shapes), compliance, residual)


def left_out(
    plate: Plate,
    foam: Foam,
    kept: Surface,
    footprint: tuple[float, float],
    points: tuple[int, int],
    positions: Array,
    side: float,
) -> Array:
    """What the modes of `kept` leave out of the flexibility between the cells of a slider's footprint, per position.

    [position, 2 cells, 2 cells] in m/N: mean displacements along z, then along x, of the `points` (along, across) cells
    on the left half, in order along first, under forces spread evenly over these cells, with `side` 1 and equal forces
    on their images on the right, with -1 and opposite ones. Unit forces on the nodes under the slider's way give all
    positions.
    """
    from rig.plants.structures import hexahedra

    structure, first = _structure(plate, foam)
    length, width = footprint
    along, across = points
    x, y, z = structure.axes
    inside_x = np.arange(2 * first[0], len(x) - 2 * first[0])
    inside_y = np.arange(2 * first[1], len(y) - 2 * first[1])
    number = np.full((len(y), len(x)), -1)
    top = np.flatnonzero(structure.lattice[:, 2] == len(z) - 1)
    number[structure.lattice[top, 1], structure.lattice[top, 0]] = top
    of_plate = number[np.ix_(inside_y, inside_x)].ravel()
    ends = width * (np.arange(across + 1) / across - 0.5)
    strips = np.array([_integrals(kept.y, low, high) for low, high in pairwise(ends)])
    strips = (strips + side * strips[::-1])[across // 2 :]
    under = np.flatnonzero(np.any(strips, axis=0))
    under = under[under >= len(kept.y) // 2]
    folded = np.zeros((len(kept.y), len(under)))
    folded[len(kept.y) - 1 - under, np.arange(len(under))] = side
    folded[under, np.arange(len(under))] = 1.0
    units = np.einsum("yu,xv->yxuv", folded, np.eye(len(kept.x))).reshape(of_plate.size, -1)
    loads = np.zeros((3, len(structure.lattice), 2, units.shape[1]))
    loads[2, of_plate, 0] = loads[0, of_plate, 1] = units
    loads = loads.reshape(3 * len(structure.lattice), -1)
    shapes = [kept.shapes[:, component].reshape(len(kept.shapes), -1) for component in (2, 0)]
    of_modes = np.concatenate([shape @ units for shape in shapes], axis=1)
    of_modes /= 2.0 * math.pi * kept.frequencies[:, None]
    nodal = hexahedra.compliances(structure, loads[structure.free], side) - of_modes.T @ of_modes
    scale = along * across / (length * width)
    flexibilities = []
    for place in positions.tolist():
        ends = place + length * np.arange(along + 1) / along
        lines = np.array([_integrals(kept.x, low, high) for low, high in pairwise(ends)])
        products = np.einsum("sy,lx->lsyx", strips[:, under], lines)
        spread = scale * products.reshape(along * len(strips), -1)
        cells = np.kron(np.eye(2), spread)
        flexibilities.append(cells @ nodal @ cells.T)
    return np.array(flexibilities)


def _structure(plate: Plate, foam: Foam | None) -> tuple[Structure, tuple[int, int]]:
    """The structure of elements, and the numbers of elements before the plate along x and y."""
    from rig.plants.structures import hexahedra
    from rig.plants.structures.hexahedra import Material, Part

    a = plate.elements_along
    b = plate.elements_across
    c = plate.elements_through
    steel = Material(plate.young, plate.poisson, plate.density)
    x = np.linspace(0.0, plate.length, a + 1)
    y = np.linspace(0.0, plate.width, b + 1) - 0.5 * plate.width
    z = np.linspace(0.0, plate.thickness, c + 1)
    if foam is None:
        whole = Part(steel, np.ones((a, b, c), dtype=np.bool_))
        return hexahedra.assemble(x, y, z, [whole], held=False), (0, 0)
    n, m = _beside(plate, foam)
    if foam.overhang:
        x = _widened(x, foam.overhang, n)
        y = _widened(y, foam.overhang, m)
    below = np.linspace(-foam.thickness, 0.0, foam.elements_through + 1)
    of_plate = np.zeros((a + 2 * n, b + 2 * m, foam.elements_through + c), dtype=np.bool_)
    of_plate[n : n + a, m : m + b, foam.elements_through :] = True
    of_foam = np.zeros_like(of_plate)
    of_foam[:, :, : foam.elements_through] = True
    soft = Material(foam.young, foam.poisson, foam.density)
    z = np.concatenate([below, z[1:]])
    parts = [Part(soft, of_foam), Part(steel, of_plate)]
    return hexahedra.assemble(x, y, z, parts, held=True), (n, m)


def _beside(plate: Plate, foam: Foam) -> tuple[int, int]:
    """Numbers of elements of the overhang on one side along x and y; they are not longer than those of the plate."""
    a = plate.length / plate.elements_along
    b = plate.width / plate.elements_across
    return math.ceil(foam.overhang / a - 1e-9), math.ceil(foam.overhang / b - 1e-9)


def _unknowns(plate: Plate, foam: Foam | None) -> int:
    """Number of unknowns of the structure without fixed ones."""
    face = (2 * plate.elements_along + 1) * (2 * plate.elements_across + 1)
    if foam is None:
        return 3 * face * (2 * plate.elements_through + 1)
    n, m = _beside(plate, foam)
    below = (2 * (plate.elements_along + 2 * n) + 1) * (2 * (plate.elements_across + 2 * m) + 1)
    return 6 * (face * plate.elements_through + below * foam.elements_through)


def _widened(lines: Array, by: float, elements: int) -> Array:
    """Boundaries `lines` [m] with `elements` more at both ends over a width of `by` [m]."""
    more = np.linspace(0.0, by, elements + 1)
    return np.concatenate([lines[0] - more[:0:-1], lines, lines[-1] + more[1:]])


def _integrals(nodes: Array, low: float, high: float) -> Array:
    """Integral [m] of each node's shape function from `low` to `high`."""
    integrals = np.zeros(len(nodes))
    for start, end in zip(nodes[:-2:2], nodes[2::2]):
        left = max(start, low)
        right = min(end, high)
        if right > left:
            middle = 0.5 * (left + right)
            half = 0.5 * (right - left)
            points = middle + half / math.sqrt(3.0) * np.array([-1.0, 1.0])  # of Gauss: exact
            first, weights = element_at(nodes, points)
            for i in range(3):
                np.add.at(integrals, first + i, half * weights[i])
    return integrals
