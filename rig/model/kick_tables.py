"""Tables of the method kick: the exact flow of the structure over a step, and the kicks of the contacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.model import energy_forms
from rig.model.formulation import ModeSet
from rig.model.product_terms import Factor, Product
from rig.model.system import System
from rig.model.system_parts import Normal
from rig.solve import energy_balance, expm
from rig.solve.column_blocks import BLOCK, blocks, zeros
from rig.solve.kick import KickTables
from rig.solve.product_inputs import PRESS

Array = NDArray[np.float64]


def refusal(system: System) -> str:
    """The reason why the method kick does not support this system; "" if it does."""
    positions = slice(len(system.coordinates))
    if not any(k.opens and np.any(k.row[positions]) for k in system.normals):
        return "no contact of this rig opens: use exact or dopri5"
    over_speed = [p.name for i, p in enumerate(system.patches) if any(not law.constant for law in system.laws(i))]
    if over_speed:
        return f"the friction of {', '.join(over_speed)} depends on speed: use dopri5"
    if system.products or system.limiters or system.sectors or system.switches:
        return "supports neither products, limiters, sectors nor switches: use exact or dopri5"
    velocities = slice(len(system.coordinates), system.one)
    for k in system.normals:
        if np.any(k.inertia) or np.any(k.row[velocities]):
            return f"the normal force {k.name} depends on more than positions: use exact or dopri5"
    return ""


def pressed(system: System) -> System:
    """The system with every contact that opens turned into a product: the positive part of its row.

    These contacts have no mode any more. The product of a normal force k is called N:k, like its output. All of them
    together are one normal force of the patch.
    """
    points = [k for k in system.normals if k.opens]
    count = len(points)
    products = tuple(Product(f"N:{k.name}", (Factor(PRESS, 0, k.row),)) for k in points)
    sums = [np.array([1.0 if k.patch == p else 0.0 for k in points]) for p in range(len(system.patches))]
    none, still = np.zeros(system.n), np.zeros(len(system.coordinates))
    kept = [replace(k, row_t=np.zeros(count)) for k in system.normals if not k.opens]
    loads = [Normal(f"points of {patch.name}", p, none, sums[p], still, still, False)
             for p, patch in enumerate(system.patches) if sums[p].any()]  # fmt: skip
    force_t = np.array([k.direction for k in points]).reshape(count, -1).T
    return replace(system, normals=(*kept, *loads), products=products, force_t=force_t)


def _whole(columns: int) -> int:
    return -(-columns // BLOCK) * BLOCK


def empty(system: System | None, guards: int) -> KickTables:
    """Tables without a mode set, for a system from `pressed` with at most `guards` guards; of length zero for None."""
    n, nq, P, points = 0, 0, 0, 0
    if system is not None:
        n, nq, P, points = system.n, len(system.coordinates), len(system.patches), len(system.products)
    rows = guards + 2 * P
    width = _whole(nq + rows + guards + P + n)
    return KickTables(
        step=zeros((0, _whole(n) // BLOCK, n, BLOCK)),
        rows=zeros((0, _whole(points + rows) // BLOCK, n, BLOCK)),
        push=zeros((0, width // BLOCK, points, BLOCK)),
        work=zeros((0, energy_balance.TERMS, n, n)),
        whole=zeros((0, n, _whole(n))),
        moved=zeros(_whole(n)),
        seen=zeros(_whole(points + rows)),
        given=zeros(width),
        filled=zeros(_whole(n)),
        force=zeros(points),
        before=zeros(guards),
        spring=zeros(1),
    )


def tables(system: System, modes: ModeSet, forms: Array, step: float, guards: int) -> dict[str, Array]:
    """The tables of one mode set.

    `forms`: quadratic forms of the powers; `step` in s; `guards`: number of guards for which all mode sets have room.
    """
    P, points = len(system.patches), len(system.products)
    E = expm.ladder(modes.A, step)
    nodes = energy_forms.at_nodes(modes.A, modes.landing, step / 2.0 ** (len(E) - 1))
    E = (modes.landing - np.eye(len(modes.A))) + modes.landing @ E @ modes.landing
    press = _rows(system)
    rows = np.zeros((guards + 2 * P, system.n))
    at_once = np.zeros((guards, points))
    rows[: len(modes.guards)], at_once[: len(modes.guards)] = modes.guards, modes.guards_t[:, P:]
    rows[guards:] = np.concatenate([energy_forms.supplied(system), system.slip_rows])
    b = modes.b[:, P:]
    nq = len(system.coordinates)
    springs = (compliances(system)[:, None] * press).T
    taken = np.concatenate([springs[:nq], springs[2 * nq :]])
    push = np.concatenate([b[nq : 2 * nq], rows @ b, at_once, modes.friction_t[:, P:], system.force_t, taken])
    return {
        "step": blocks(E[0]),
        "rows": blocks(np.concatenate([press, rows])),
        "push": blocks(push),
        "work": energy_forms.work(nodes, forms, step, E)[0],
        "whole": np.zeros((system.n, _whole(system.n))),
    }


def _rows(system: System) -> Array:
    """The normal force of each point before it is cut at zero, as a row over the state."""
    return np.array([product.factors[0].row for product in system.products], dtype=np.float64)


def compliances(system: System) -> Array:
    """The compliance of each point [m/N], [point]: compression of its spring per newton, as its row states it.

    0 for a force that depends on no position.
    """
    rows = _rows(system)[:, : len(system.coordinates)]
    stiff = np.sum(rows * rows, axis=1)
    give = np.einsum("pi,ip->p", rows, system.force_t)
    return np.asarray(-give / np.where(stiff > 0.0, stiff, np.inf), dtype=np.float64)


def spring_energy(system: System, x: Array) -> float:
    """The energy in the springs of the points at x [J]."""
    force = np.maximum(_rows(system) @ x, 0.0)
    return float(0.5 * np.sum(compliances(system) * force * force))
