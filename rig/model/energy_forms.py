"""Quadratic forms of the energy balance: powers and stored energy of a mode set, and their integrals over a tick."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.model.formulation import ModeSet
from rig.model.system import System
from rig.solve.energy_balance import NAMES, NODES, RESISTOR, TERMS, WEIGHTS
from rig.solve.expm import ORDER, taylor
from rig.solve.records import LINEAR, LOW

Array = NDArray[np.float64]


def powers(system: System, modes: ModeSet) -> Array:
    """The symmetric quadratic forms of the powers, [term, n, n]; zero for the switch, which acts at once."""
    nq = len(system.coordinates)
    n = system.n
    velocity = np.eye(n)[nq : 2 * nq]
    normal_modes = system.modes(modes.key)[1]
    out = np.zeros((TERMS, n, n))
    surface = supplied(system)
    for p in range(len(system.patches)):
        out[0] += np.outer(modes.friction[p], surface[p])
        out[1] += np.outer(modes.friction[p], system.slip_rows[p])
    out[2] = velocity.T @ damping(system, modes.key) @ velocity
    out[3] = velocity.T @ system.force
    unsymmetric = stiffness(system, modes.key)
    unsymmetric = unsymmetric - unsymmetric.T
    if unsymmetric.any():  # it stores no energy: its work is that of a force
        out[3, :, :nq] -= velocity.T @ (0.5 * unsymmetric)
    for k, contact in enumerate(system.normals):
        if normal_modes[k] == 0:
            out[4] += np.outer(modes.normal[k], contact.direction @ velocity)
    for loss, row in zip(system.losses, loss_rows(system, modes)):
        out[RESISTOR] += loss.conductance * np.outer(row, row)
    return 0.5 * (out + out.transpose(0, 2, 1))


def loss_rows(system: System, modes: ModeSet) -> Array:
    """Rows over x whose square, times the conductance, is the power of each resistor, [loss, n]."""
    network = modes.A[2 * len(system.coordinates) : system.one]
    return np.array([loss.row + loss.rate @ network for loss in system.losses]).reshape(-1, system.n)


def store(system: System, key: int) -> Array:
    """Twice the energy stored in the network as a quadratic form of x [n, n], in mode set `key`."""
    *_, clamped, _, thrown = system.modes(key)
    positions = [switch.positions[mode] for switch, mode in zip(system.switches, thrown)]
    out = system.store + sum(position.store for position in positions)
    for limiter, mode in zip(system.limiters, clamped):
        if mode != LINEAR:
            beyond = limiter.row.copy()
            beyond[system.one] -= limiter.low if mode == LOW else limiter.high
            out += limiter.excess * np.outer(beyond, beyond)
    return np.asarray(out)


def by_name(system: System, terms: Array) -> dict[str, float]:
    """The terms [J] by name; those of the network only if there is one."""
    count = TERMS if system.losses or system.switches else RESISTOR
    return dict(zip(NAMES[:count], terms[:count].tolist()))


def supplied(system: System) -> Array:
    """Rows of the surface speeds through which the drives supply the power of the friction forces, [patch, n]."""
    nq = len(system.coordinates)
    rows = system.slip_rows.copy()
    for p, patch in enumerate(system.patches):
        rows[p, nq : 2 * nq] += patch.direction
    return rows


def damping(system: System, key: int) -> Array:
    """The damping matrix of a mode set."""
    return system.damping + system.change(system.modes(key)[3]).damping


def stiffness(system: System, key: int) -> Array:
    """The stiffness matrix of a mode set."""
    return system.stiffness + system.change(system.modes(key)[3]).stiffness


def stored(system: System, x: Array, key: int) -> float:
    """The kinetic and elastic energy of the structure plus the energy of the network [J]."""
    nq = len(system.coordinates)
    q, v = x[:nq], x[nq : 2 * nq]
    K = stiffness(system, key)
    network = store(system, key)
    return float(0.5 * (v @ system.mass @ v + q @ K @ q + x @ network @ x))


def at_nodes(A: Array, landing: Array, cell: float) -> Array:
    """Propagators to the quadrature nodes of a cell that is short enough for its Taylor series, [node, n, n]."""
    unit = np.eye(len(A))
    propagators = [unit + taylor(A, node * cell, ORDER) for node in NODES]
    return np.array([propagator @ landing for propagator in propagators])


def at_nodes_extended(A: Array, landing: Array, cell: float) -> NDArray[np.longdouble]:
    """The same in extended precision, for `work` in stiff mode sets.

    Their levels are many, and `work` doubles a rounding error from each level to the next.
    """
    unit = np.eye(len(A), dtype=np.longdouble)
    out = []
    for node in NODES:
        C = A * (np.longdouble(node) * cell)
        series = unit
        for k in range(ORDER, 0, -1):
            series = unit + C @ series / k
        out.append(series @ landing)
    return np.array(out)


def work(nodes: Array | NDArray[np.longdouble], forms: Array, step: float, E: Array) -> Array:
    """Integrals of the powers over step / 2^level, [level, term, n, n]. `nodes`: propagators in the finest cell.

    They are computed in the precision of `nodes`.
    """
    levels = len(E)
    out = np.zeros((levels, *forms.shape), dtype=nodes.dtype)
    for Phi, weight in zip(nodes, WEIGHTS):
        out[-1] += weight * step / 2.0 ** (levels - 1) * (Phi.T @ forms @ Phi)
    for level in range(levels - 2, -1, -1):
        Phi = np.eye(len(Phi), dtype=nodes.dtype) + E[level + 1]
        out[level] = out[level + 1] + Phi.T @ out[level + 1] @ Phi
    return out.astype(np.float64)


def gathered(forms: Array, sums: Array, count: int) -> Array:
    """Evaluate sums of x x^T with the forms of the energy terms, [term], and reset the sums.

    `forms` [mode set, term, n, n]; `sums` [mode set, n, n or wider], of which the first `count` mode sets are in use.
    Mode sets that were not visited since the last call are skipped.
    """
    total = np.zeros(forms.shape[1])
    n = forms.shape[2]
    sizes = np.einsum("sii->s", sums[:count, :, :n])
    for mode_set in np.flatnonzero(sizes).tolist():
        total += forms[mode_set].reshape(len(total), -1) @ sums[mode_set, :, :n].ravel()
        sums[mode_set] = 0.0
    return total
