"""The modes of a sliding rig, and what a command and a sensor have to do with each.

A command u moves mode i of the sliding rig, and a sensor sees it, by

    xi_i' = lambda_i xi_i + r_i u,   y = 2 Re sum xi_i,   r_i = (c x_i)(y_i^H b) / (y_i^H x_i)

x_i, y_i: right and left eigenvector, b: what a unit of u does to the rig (its lag included), c: what the sensor reads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.design.designer import Designer
from rig.stability.linearisation import Steady, sliding_key, steady

Complex = NDArray[np.complex128]


class Motions(NamedTuple):
    """Small motions about steady sliding of `rig`: eigenvalues [1/s], right eigenvectors [moving state, mode]."""

    rig: Steady
    values: Complex
    right: Complex


def motions(designer: Designer) -> Motions:
    """Of a designer's rig."""
    rig = steady(designer.system, sliding_key(designer.system))
    values, right = np.linalg.eig(rig.A[np.ix_(rig.moving, rig.moving)])
    return Motions(rig, values, right)


def residues(designer: Designer, found: Motions, sensor: str, drive: str) -> Complex:
    """What a unit of a command does to each mode, measured in what the sensor reads of it."""
    given = designer.assembly.inputs.get(drive)
    if given is None or not given.state:
        raise ValueError(f"drive: {drive} is no actuator that a state carries")
    command, A, moving = designer.system.names.index(given.state), found.rig.A, found.rig.moving
    rest = np.setdiff1d(np.arange(len(A)), [*moving, command])
    left = np.linalg.inv(found.right)
    read = np.zeros(designer.system.n)
    over = designer.row(designer.sensors[sensor].reads)[: 2 * designer.nq]
    read[: len(over)] = over
    seen = read[moving] @ found.right
    pushed = np.empty(len(found.values), dtype=complex)
    for i, s in enumerate(found.values):  # through the lags behind the command, at the pace of the mode
        behind = np.linalg.solve(s * np.eye(len(rest)) - A[np.ix_(rest, rest)], A[rest, command])
        pushed[i] = left[i] @ (A[moving, command] + A[np.ix_(moving, rest)] @ behind)
    return np.asarray(seen * pushed)
