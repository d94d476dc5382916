"""The energy ledger: where the energy of structure and network comes from and where it goes, each term on its own.

    stored'  = v.M a + q.K v + (x.H x / 2)' = drive - friction - damper + forces + normal - resistor - switch + edges
    drive    = sum_p T_p V_p      supplied by the belt or disc; V_p = w_p + t_p.v
    friction = sum_p T_p w_p      turned into heat at the contacts, never negative
    damper   = v.D v
    forces   = v.(F x + F_t T)    supplied by external forces and products
    normal   = sum_k N_k n_k.v    supplied through normal forces
    resistor = sum i^2 R          heat of the network's resistors
    edges    = q.dK q / 2         comes in with the stiffness of the next sector, at once
    switch                        what the network stores less after a switch was thrown: a current interrupted

Every power is a quadratic form x.Q x of the mode set; its integral over a cell is x.W x with W from the same ladder as
the propagator, W(2h) = W(h) + Phi(h)^T W(h) Phi(h). No term is the difference of the others, so that their sum is a
check. For laws over speed the forms hold the part that is linear in x; the rest is summed on the dense output.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inner
from rig.solve.expm import ORDER, taylor
from rig.solve.formulation import ModeSet
from rig.solve.system import LINEAR, LOW, System

Array = NDArray[np.float64]
NAMES = ("drive", "friction", "damper", "forces", "normal", "resistor", "switch")
SIGNS = np.array([1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0])
TERMS = len(NAMES)
RESISTOR, SWITCH = TERMS - 2, TERMS - 1
NODES, WEIGHTS = (0.5 * (a + o) for a, o in zip(np.polynomial.legendre.leggauss(8), (1.0, 0.0)))


def powers(system: System, modes: ModeSet) -> Array:
    """Quadratic forms of the powers, [term, n, n], symmetric; that of a switch, which acts at once, is zero."""
    nq, n = len(system.coordinates), system.n
    velocity = np.eye(n)[nq : 2 * nq]
    normal_modes = system.modes(modes.key)[1]
    out = np.zeros((TERMS, n, n))
    surface = supplied(system)
    for p in range(len(system.patches)):
        out[0] += np.outer(modes.friction[p], surface[p])
        out[1] += np.outer(modes.friction[p], system.slip_rows[p])
    out[2] = velocity.T @ damping(system, modes.key) @ velocity
    out[3] = velocity.T @ system.force
    for k, contact in enumerate(system.normals):
        if normal_modes[k] == 0:
            out[4] += np.outer(modes.normal[k], contact.direction @ velocity)
    for loss, row in zip(system.losses, loss_rows(system, modes)):
        out[RESISTOR] += loss.conductance * np.outer(row, row)
    return 0.5 * (out + out.transpose(0, 2, 1))


def loss_rows(system: System, modes: ModeSet) -> Array:
    """What each resistor's heat is the square of, as rows over x [loss, n]."""
    network = modes.A[2 * len(system.coordinates) : system.one]
    return np.array([loss.row + loss.rate @ network for loss in system.losses]).reshape(-1, system.n)


def store(system: System, key: int) -> Array:
    """Twice the energy stored in the network as a form of x [n, n], in mode set `key`."""
    *_, clamped, _, thrown = system.modes(key)
    out = system.store + sum(s.positions[mode].store for s, mode in zip(system.switches, thrown))
    for limiter, mode in zip(system.limiters, clamped):
        if mode != LINEAR:
            beyond = limiter.row.copy()
            beyond[system.one] -= limiter.low if mode == LOW else limiter.high
            out += limiter.excess * np.outer(beyond, beyond)
    return np.asarray(out)


def by_name(system: System, terms: Array) -> dict[str, float]:
    """The terms [J] by name, those of the network where there is one."""
    told = TERMS if system.losses or system.switches else RESISTOR
    return dict(zip(NAMES[:told], terms[:told].tolist()))


def supplied(system: System) -> Array:
    """Rows of the surface speeds that friction forces draw their power from, [patch, n]."""
    nq = len(system.coordinates)
    rows = system.slip_rows.copy()
    for p, patch in enumerate(system.patches):
        rows[p, nq : 2 * nq] += patch.direction
    return rows


def damping(system: System, key: int) -> Array:
    """Damping matrix of a mode set."""
    return system.damping + system.change(system.modes(key)[3]).damping


def stored(system: System, x: Array, key: int) -> float:
    """Kinetic and elastic energy of the structure, and that of the network [J]."""
    nq = len(system.coordinates)
    q, v = x[:nq], x[nq : 2 * nq]
    stiffness = system.stiffness + system.change(system.modes(key)[3]).stiffness
    return float(0.5 * (v @ system.mass @ v + q @ stiffness @ q + x @ store(system, key) @ x))


def at_nodes(A: Array, landing: Array, cell: float) -> Array:
    """Propagators to the nodes of a cell so short that its Taylor series serves, [node, n, n]."""
    return np.array([(np.eye(len(A)) + taylor(A, node * cell, ORDER)) @ landing for node in NODES])


def work(nodes: Array, forms: Array, step: float, E: Array) -> Array:
    """Integrals of the powers over step / 2^level, [level, term, n, n]; `nodes`: propagators in the finest cell."""
    levels = len(E)
    out = np.zeros((levels, *forms.shape))
    for Phi, weight in zip(nodes, WEIGHTS):
        out[-1] += weight * step / 2.0 ** (levels - 1) * (Phi.T @ forms @ Phi)
    for level in range(levels - 2, -1, -1):
        Phi = np.eye(len(Phi)) + E[level + 1]
        out[level] = out[level + 1] + Phi.T @ out[level + 1] @ Phi
    return out


def gathered(forms: Array, sums: Array, count: int) -> Array:
    """What sums of x x^T, [slot, n, n or wider], come to under `forms` [slot, term, n, n]: [term]; empties them.

    Of the first `count` slots; few of many have been met since the last call.
    """
    total, n = np.zeros(forms.shape[1]), forms.shape[2]
    sizes = np.einsum("sii->s", sums[:count, :, :n])
    for slot in np.flatnonzero(sizes).tolist():
        total += forms[slot].reshape(len(total), -1) @ sums[slot, :, :n].ravel()
        sums[slot] = 0.0
    return total


@inner
def held(H, x):
    """Energy stored in the network, from twice its form."""
    s = 0.0
    for i in range(x.shape[0]):
        for j in range(x.shape[0]):
            s += x[i] * H[i, j] * x[j]
    return 0.5 * s


@inner
def book(W, active, x, energy):
    """energy[term] += x.W[term] x for the terms that are active."""
    n = x.shape[0]
    for term in range(energy.shape[0]):
        if active[term]:
            s = 0.0
            for i in range(n):
                r = 0.0
                for j in range(n):
                    r += W[term, i, j] * x[j]
                s += x[i] * r
            energy[term] += s
