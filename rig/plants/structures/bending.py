"""A clamped beam by finite elements, reduced to vibration modes and two attachment modes at its tip.

Euler-Bernoulli elements with cubic deflection and linear extension, consistent mass; shear deformation and rotatory
inertia are left out (of the third mode of a beam 18 times as long as thick they take 3 %). Frequencies converge from
above with the fourth power of the element's length in bending, with the second in extension. What a force at the tip
does statically is exact, with any number of elements.

The modes of the clamped beam leave out some of that. So the static shapes of a force across and one along the axis
stand beside them (attachment modes), and the eigenvectors of all together are the coordinates: orthogonal, of mass one,
and statically exact at the tip.
Source: textbook elements; attachment modes as in Craig, Int. J. Anal. Exp. Modal Anal. 2 (1987) 59.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]
ELEMENTS = 24
"""Enough for the frequencies of six modes to 1e-5, but for those of extension, which 1e-3 of are left."""


@dataclass(frozen=True)
class Modes:
    """Coordinates of mass one: `omega` [rad/s]; `tip` [kg^-0.5], of each its motion across and along the axis.

    `clamp` [N / (kg^0.5 m)]: what each, moved by one, pushes the clamp with, across and along.
    """

    omega: Array
    tip: Array
    clamp: Array


def matrices(bending: float, extension: float, line: float, length: float, elements: int) -> tuple[Array, Array]:
    """Stiffness and mass of a free beam; at each node motion along, motion across, turn.

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
    """The beam clamped at one end: its lowest `modes` modes and two attachment modes. See `matrices`."""
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
