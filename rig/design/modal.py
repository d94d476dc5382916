"""The vibration modes of a sliding rig, and the residue of each mode from a command to a sensor.

A command u excites mode i of the sliding rig, and a sensor measures it, by

    xi_i' = lambda_i xi_i + r_i u,   y = 2 Re sum xi_i,   r_i = (c x_i)(y_i^H b) / (y_i^H x_i)

x_i, y_i: right and left eigenvector; b: input vector of u (with its lag); c: row of the sensor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.design.designer import Designer
from rig.stability.linearisation import Steady, sliding_key, steady

Complex = NDArray[np.complex128]


class VibrationModes(NamedTuple):
    """Vibration modes of `rig` about steady sliding: eigenvalues [1/s], right eigenvectors [moving state, mode]."""

    rig: Steady
    values: Complex
    right: Complex


def vibration_modes(designer: Designer) -> VibrationModes:
    """The vibration modes of a designer's rig."""
    rig = steady(designer.system, sliding_key(designer.system))
    values, right = np.linalg.eig(rig.A[np.ix_(rig.moving, rig.moving)])
    return VibrationModes(rig, values, right)


def residues(designer: Designer, found: VibrationModes, sensor: str, drive: str) -> Complex:
    """The residue r_i [mode] of each mode from the command `drive` to the sensor.

    Raises ValueError for an actuator that is not a state of the rig.
    """
    given = designer.assembly.inputs.get(drive)
    if given is None or not given.state:
        raise ValueError(f"drive: {drive} is not an actuator whose command is a state of the rig")
    command, A, moving = designer.system.names.index(given.state), found.rig.A, found.rig.moving
    rest = np.setdiff1d(np.arange(len(A)), [*moving, command])
    left = np.linalg.inv(found.right)
    read = np.zeros(designer.system.n)
    over = designer.row(designer.sensors[sensor].reads)[: 2 * designer.nq]
    read[: len(over)] = over
    seen = read[moving] @ found.right
    pushed = np.empty(len(found.values), dtype=complex)
    for i, s in enumerate(found.values):  # the lag between command and force, at the eigenvalue of the mode
        behind = np.linalg.solve(s * np.eye(len(rest)) - A[np.ix_(rest, rest)], A[rest, command])
        pushed[i] = left[i] @ (A[moving, command] + A[np.ix_(moving, rest)] @ behind)
    return np.asarray(seen * pushed)
