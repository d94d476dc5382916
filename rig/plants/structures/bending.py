"""A clamped beam by finite elements, reduced to vibration modes and two attachment modes at its tip.

Euler-Bernoulli elements with cubic deflection and linear extension, consistent mass; shear deformation and rotatory
inertia are neglected (they lower the third frequency of a beam 18 times as long as thick by 3 %). Frequencies converge
from above with the fourth power of the element length in bending, with the second in extension. The static deflection
under a force at the tip is exact with any number of elements.

A truncated set of modes of the clamped beam lacks a part of this deflection. Therefore the static shapes under a force
across and a force along the axis are added (attachment modes). The coordinates are the eigenvectors of the whole set:
orthogonal, of unit modal mass, and statically exact at the tip.
Source: textbook elements; attachment modes as in Craig, Int. J. Anal. Exp. Modal Anal. 2 (1987) 59.

A bending brake disc: modes of a free annular plate replace the axial motion and the tilt of a rigid disc.

    u_z = w(theta) = sum R(r) (C cos l theta + S sin l theta),   u_x = x - b dw / (r dtheta),   theta = a / r

for the point at the distance a along the circle on which the pads rub and b from the middle plane. For a rigid disc
these are z - a phi and x + b phi. The springs of a rigid disc along z and phi represent bending and are not used here.
At the speeds of a braking disc (l Omega of a few rad/s) the effect of the rotation on a pair of modes is far below its
damping and is neglected.
Source: rig.effects.disc_modes; slope as in Liu and Ouyang, Meccanica 55 (2020), section 3; derived.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from rig.effects.disc_modes import Disc, Mode, free_modes
from rig.model.named_rows import Row
from rig.plants.structures.multibody import Body

Array = NDArray[np.float64]
ELEMENTS = 24
"""Number of elements. The frequencies of six modes have a relative error of 1e-5, those of extension modes 1e-3."""


@dataclass(frozen=True)
class Modes:
    """Modes of unit modal mass: `omega` [rad/s]; `tip` [kg^-0.5]: shapes at the tip across and along the axis.

    `clamp` [N / (kg^0.5 m)]: forces on the clamp across and along the axis per unit of each modal coordinate.
    """

    omega: Array
    tip: Array
    clamp: Array


def matrices(bending: float, extension: float, line: float, length: float, elements: int) -> tuple[Array, Array]:
    """Stiffness and mass matrix of a free beam; unknowns of each node: motion along, motion across, rotation.

    `bending` E I [N m^2], `extension` E A [N], `line` [kg/m], `length` [m].
    """
    h = length / elements
    bar = extension / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
    heavy_bar = line * h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    beam = bending / h**3 * np.array(
        [
            [12.0, 6.0 * h, -12.0, 6.0 * h],
            [6.0 * h, 4.0 * h**2, -6.0 * h, 2.0 * h**2],
            [-12.0, -6.0 * h, 12.0, -6.0 * h],
            [6.0 * h, 2.0 * h**2, -6.0 * h, 4.0 * h**2],
        ]
    )  # fmt: skip
    heavy_beam = line * h / 420.0 * np.array(
        [
            [156.0, 22.0 * h, 54.0, -13.0 * h],
            [22.0 * h, 4.0 * h**2, 13.0 * h, -3.0 * h**2],
            [54.0, 13.0 * h, 156.0, -22.0 * h],
            [-13.0 * h, -3.0 * h**2, -22.0 * h, 4.0 * h**2],
        ]
    )  # fmt: skip
    K, M = np.zeros((2, 3 * elements + 3, 3 * elements + 3))
    for e in range(elements):
        for local, stiff, heavy in (((0, 3), bar, heavy_bar), ((1, 2, 4, 5), beam, heavy_beam)):
            at = np.ix_([3 * e + i for i in local], [3 * e + i for i in local])
            K[at] += stiff
            M[at] += heavy
    return K, M


def clamped(
    bending: float, extension: float, line: float, length: float, modes: int, elements: int = ELEMENTS
) -> Modes:
    """The lowest `modes` modes of the beam clamped at one end, and two attachment modes. Arguments: see `matrices`."""
    K, M = matrices(bending, extension, line, length, elements)
    free = slice(3, None)
    stiff, heavy = K[free, free], M[free, free]
    _, shapes = scipy.linalg.eigh(stiff, heavy, subset_by_index=(0, modes - 1))
    forces = np.zeros((len(stiff), 2))
    forces[-2, 0] = forces[-3, 1] = 1.0
    held = np.linalg.solve(stiff, forces)
    basis = np.hstack([shapes, held - shapes @ (shapes.T @ heavy @ held)])
    basis /= np.sqrt(np.einsum("ij,ij->j", basis, heavy @ basis))
    squares, turns = scipy.linalg.eigh(basis.T @ stiff @ basis, basis.T @ heavy @ basis)
    basis = basis @ turns
    basis *= np.where(basis[-2] + basis[-3] < 0.0, -1.0, 1.0)
    return Modes(np.sqrt(squares), basis[[-2, -3]].T, (-K[:3, free] @ basis)[[1, 0]].T)


class Bending(Body):
    """A bending disc: its mass along x, its points; deflection of `disc` at `radius` [m]."""

    disc: Disc
    radius: float

    def coordinates(self, name: str) -> dict[str, tuple[float, float, float]]:
        """See `Body.coordinates`."""
        modes = [(part, mode.omega) for mode in free_modes(self.disc) for part in _names(name, mode)]
        bends = {part: (1.0, 2.0 * self.disc.damping_ratio * omega, omega**2) for part, omega in modes}
        return {f"{name}.x": (self.mass, 0.0, 0.0)} | bends

    def row(self, name: str, a: float, b: float, direction: str) -> Row:
        """See `Body.row`."""
        row: Row = {f"{name}.x": 1.0} if direction == "x" else {}
        for mode in free_modes(self.disc):
            l, deflection = mode.diameters, mode.at(self.radius)
            turn = l * a / self.radius
            shapes = (math.cos(turn), math.sin(turn))
            slopes = (-l * math.sin(turn) / self.radius, l * math.cos(turn) / self.radius)
            for part, shape, slope in zip(_names(name, mode), shapes, slopes):
                row[part] = deflection * (shape if direction == "z" else -b * slope if direction == "x" else -slope)
        return row

    def acts_on(self, point: str, direction: str) -> bool:
        """See `Body.acts_on`."""
        return bool(point) or direction == "x"


def _names(name: str, mode: Mode) -> tuple[str, ...]:
    which = f"{mode.diameters}.{mode.circles}" if mode.circles else f"{mode.diameters}"
    return (f"{name}.C{which}", f"{name}.S{which}") if mode.pair else (f"{name}.C{which}",)
