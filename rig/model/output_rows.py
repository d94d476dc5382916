"""Outputs of the plant as rows over its state: for the sensors and for the plant's own record."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rig.model.formulation import ModeSet
from rig.model.system import System
from rig.solve import expm
from rig.solve.segments import DEGREE
from rig.solve.state_codes import HIGH, LOW
from rig.solve.stiff_cells import PLACES, POWERS

Array = NDArray[np.float64]


def signal_rows(system: System, modes: ModeSet, rows: list[dict[str, float]]) -> tuple[Array, Array]:
    """Rows by name (extended rows) as rows over x [output, n] and over T [output, inputs] of one mode set."""
    nq, inputs, states = len(system.coordinates), np.eye(system.inputs), np.eye(system.n)
    known: dict[str, tuple[Array, Array]] = {}
    for i, name in enumerate(system.names):
        known[name] = (states[i], np.zeros(system.inputs))
    for j, product in enumerate(system.products):
        known[product.name] = (np.zeros(system.n), inputs[len(system.patches) + j])
    for i, name in enumerate(system.names[2 * nq :], 2 * nq):
        known[f"{name}'"] = (modes.A[i], modes.b[i])
    for i, name in enumerate(system.coordinates):
        known[f"{name}''"] = (modes.A[nq + i], modes.b[nq + i])
    for p, patch in enumerate(system.patches):
        known[f"T:{patch.name}"] = (modes.friction[p], modes.friction_t[p])
        known[f"w:{patch.name}"] = (system.slip_rows[p], np.zeros(system.inputs))
    for k, normal in enumerate(system.normals):
        closed = system.modes(modes.key)[1][k] == 0
        known[f"N:{normal.name}"] = (modes.normal[k] * closed, modes.normal_t[k] * closed)
    clamped, thrown = system.modes(modes.key)[2], system.modes(modes.key)[4]
    gains = [position.gains for position in (s.positions[at] for s, at in zip(system.switches, thrown))]
    for i, (limiter, mode) in enumerate(zip(system.limiters, clamped)):
        held = {LOW: limiter.low, HIGH: limiter.high}.get(mode)
        idle = any(found.get(i) == 0.0 for found in gains)  # a switch took the limiter out of the network
        within = held is None or idle
        known[f"c:{limiter.name}"] = (limiter.row if within else held * states[system.one], np.zeros(system.inputs))
    over_x, over_t = np.zeros((len(rows), system.n)), np.zeros((len(rows), system.inputs))
    for i, row in enumerate(rows):
        for name, value in row.items():
            over_x[i] += value * known[name][0]
            over_t[i] += value * known[name][1]
    return over_x, over_t


def changes(modes: ModeSet, rows: Array, step: float, levels: int) -> Array:
    """The changes of `rows` [row, n] from the begin of a cell to its PLACES, as rows over x: [level, row, place, n].

    The cells are step / 2^level long; step in s.
    """
    A, landing, still = modes.A, modes.landing, modes.landing - np.eye(len(modes.landing))
    out = np.zeros((levels, len(rows), len(PLACES), len(A)))
    for p, place in enumerate(PLACES.tolist() if out.size else ()):
        out[:, :, p] = rows @ (still + landing @ _ladder(A, place * step, levels) @ landing)
    return out


def reach(A: Array, b: Array, step: float, levels: int) -> Array:
    """The changes of the state, x' = A x + b T, from the begin of a cell to its PLACES: [level, place, n, n + columns].

    The columns belong to x and, for each input, to its value at the begin and its changes to the nodes. The cells are
    step / 2^level long; step in s.
    """
    n, inputs = b.shape
    out = np.zeros((levels, len(PLACES), n, n + inputs * (DEGREE + 1)))
    length = step / 2.0 ** np.arange(levels)[:, None]
    scales = np.array([math.factorial(k) for k in range(DEGREE + 1)]) / length ** np.arange(DEGREE + 1)
    chain = np.eye(n + DEGREE + 1, k=1)  # an input and its derivatives
    chain[:n] = 0.0
    chain[:n, :n] = A
    for p, place in enumerate(PLACES.tolist() if levels else ()):
        for k in range(inputs):
            chain[:n, n] = b[:, k]
            E, at = _ladder(chain, place * step, levels), n + k * (DEGREE + 1)
            out[:, p, :, :n] = E[:, :n, :n]
            out[:, p, :, at] = E[:, :n, n]
            out[:, p, :, at + 1 : at + 1 + DEGREE] = (E[:, :n, n + 1 :] * scales[:, None, 1:]) @ POWERS
    return out


def _ladder(A: Array, length: float, levels: int) -> Array:
    """exp(A length / 2^level) - 1 for so many levels, [level, n, n]."""
    E = expm.ladder(A, length)[:levels]
    rest = [expm.taylor(A, length / 2.0**level, expm.ORDER) for level in range(len(E), levels)]
    return np.concatenate([E, *(one[None] for one in rest)])
