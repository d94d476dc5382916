"""Tables of the method kick: the exact flow of the structure over a step, the kicks of its contacts or of a film."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.model import energy_forms
from rig.model.film import Film, on
from rig.model.formulation import ModeSet
from rig.model.system import Factor, Normal, Product, System
from rig.solve import energy_balance, expm
from rig.solve.column_blocks import BLOCK, LANE, blocks, zeros
from rig.solve.film_steps import GROUP, SUMS, FilmTables, SymmetryClass
from rig.solve.forces import PRESS
from rig.solve.kick import KickTables

Array = NDArray[np.float64]


def no_film() -> FilmTables:
    """The tables of a rig without a film."""
    z, none = np.zeros, np.zeros(0, dtype=np.int64)
    return FilmTables(
        symmetric=SymmetryClass(z((0, 0, LANE)), none, z((0, LANE)), z((0, LANE)), z(0), z(0)),
        antisymmetric=SymmetryClass(z((0, 0, LANE)), none, z((0, LANE)), z((0, LANE)), z(0), z(0)),
        travel=0,
        slid=0,
        first=0,
        points=0,
        directions=0,
        pitch=0.0,
        longest=0.0,
        stiffness=0.0,
        damping=0.0,
        shear=0.0,
        mu=0.0,
        below=none,
        share=z(0),
        places=z((2, 0)),
        kick=z(0),
        turn=z((4, 0)),
        loss=z((3, 0)),
        damped=z(0),
        before=z(0),
        pushed=none,
        column=z((0, 2, 0)),
        push=z((0, 0)),
        signal=z((0, 0)),
        begins=none,
        entry=none,
        value=z(0),
        summed=none,
        seen=z((0, 0)),
        last=z((0, 0)),
        gives=z((0, 0)),
        lost=z((3, 0)),
        moved=z(0),
        begun=z((2, 0)),
        held=z(0),
        slider_rows=z((0, 0)),
        advance=z(0),
        ahead=z(0),
        pressed=z(0),
        fits=z((0, 0, 0)),
        values=z((0, 0)),
    )


def tables_of_film(system: System, step: float, outputs: Array, read: int) -> FilmTables:
    """The tables of a system with a film for steps of `step` s.

    `outputs` [output, n], of which sensors read the first `read`.
    """
    film = system.film
    assert film is not None
    nq, first = len(system.coordinates), system.names.index(on(system.coordinates[0]))
    directions = film.directions
    m = first - system.one
    turn, loss = np.zeros((4, nq)), np.zeros((3, nq))
    mass, force = np.diag(system.mass), system.force[:, system.one : first]
    pushed = np.flatnonzero(force.any(axis=1))
    signals = np.ascontiguousarray(system.signals[:m, system.one : first])
    column = np.zeros((len(pushed), 2, m))
    for i in range(nq):
        A = np.zeros((2 + m, 2 + m))
        A[0, 1] = 1.0
        A[1, :2] = -system.stiffness[i, i] / mass[i], -system.damping[i, i] / mass[i]
        A[1, 2:], A[2:, 2:] = force[i] / mass[i], signals
        own = A[:2, :2].copy()
        E = expm.ladder(own, step)
        turn[:, i] = E[0].ravel()
        form = np.array([[[0.0, 0.0], [0.0, system.damping[i, i]]]])
        taken = energy_forms.work(energy_forms.at_nodes(own, np.eye(2), step / 2.0 ** (len(E) - 1)), form, step, E)[
            0, 0
        ]
        loss[:, i] = taken[0, 0], 2.0 * taken[0, 1], taken[1, 1]
        for p in np.flatnonzero(pushed == i).tolist():
            column[p] = expm.ladder(A, step)[0][:2, 2:]
    entries = np.nonzero(outputs)
    slider_coordinates = np.flatnonzero((film.rows == film.rows[0]).all(axis=(0, 1, 3)))
    room = -(-film.points // LANE) * LANE
    normal = zeros((len(slider_coordinates), room))
    normal[:, : film.points] = film.everywhere(0.0)[0, slider_coordinates]
    sums = first + nq + np.arange(len(SUMS))
    return FilmTables(
        symmetric=_side(film, 1.0),
        antisymmetric=_side(film, -1.0),
        travel=system.names.index(film.travel),
        slid=system.names.index(film.slid),
        first=first,
        points=film.points,
        directions=directions,
        pitch=float(film.pitch),
        longest=float(film.longest),
        stiffness=float(film.stiffness),
        damping=float(film.damping),
        shear=float(film.shear),
        mu=float(film.mu),
        below=np.array([-1]),
        share=np.zeros(1),
        places=np.array([film.x, film.y]),
        kick=0.5 * step / mass,
        turn=turn,
        loss=loss,
        damped=zeros(nq),
        before=zeros(nq),
        pushed=pushed,
        column=column,
        push=np.ascontiguousarray(force[pushed]),
        signal=expm.ladder(signals, step)[0],
        begins=np.concatenate([[0], np.cumsum(np.count_nonzero(outputs, axis=1))]).astype(np.int64),
        entry=entries[1].astype(np.int64),
        value=outputs[entries],
        summed=np.array([outputs[:read, sums].any()], dtype=np.int64),
        seen=zeros((directions, film.points)),
        last=zeros((directions, film.points)),
        gives=zeros((directions, film.points)),
        lost=np.zeros((3, film.points)),
        moved=np.zeros(m),
        begun=np.zeros((2, m)),
        held=np.zeros(len(pushed)),
        slider_rows=normal,
        advance=step * step / 12.0 / mass[slider_coordinates],
        ahead=zeros(len(slider_coordinates)),
        pressed=zeros(room),
        fits=_fits(),
        values=np.zeros((GROUP + 1, read)),
    )


def _fits() -> Array:
    fits = np.zeros((GROUP, GROUP + 1, GROUP + 1))
    for steps in range(1, GROUP + 1):
        fits[steps - 1, : steps + 1, : steps + 1] = np.linalg.inv(
            np.vander(np.linspace(0.0, 1.0, steps + 1), increasing=True)
        )
    return fits


def _side(film: Film, parity: float) -> SymmetryClass:
    """The coordinates of one parity (symmetric or antisymmetric)."""
    which = np.flatnonzero(film.parity == parity)
    lanes = film.directions * (film.points // 2)
    rows = zeros((len(film.rows), len(which), -(-lanes // LANE) * LANE))
    rows[:, :, :lanes] = film.rows[:, :, which].transpose(0, 2, 1, 3).reshape(*rows.shape[:2], -1)
    return SymmetryClass(
        rows, which, zeros(rows.shape[1:]), zeros(rows.shape[1:]), zeros(len(which)), zeros(rows.shape[2])
    )


def refusal(system: System) -> str:
    """The reason why the method kick does not support this system; "" if it does."""
    positions = slice(len(system.coordinates))
    if not any(k.opens and np.any(k.row[positions]) for k in system.normals):
        return "no contact of this rig opens: use auto"
    over_speed = [p.name for i, p in enumerate(system.patches) if any(not law.constant for law in system.laws(i))]
    if over_speed:
        return f"the friction of {', '.join(over_speed)} depends on speed: use auto"
    if system.products or system.limiters or system.sectors or system.switches:
        return "supports neither products, limiters, sectors nor switches: use auto"
    velocities = slice(len(system.coordinates), system.one)
    for k in system.normals:
        if np.any(k.inertia) or np.any(k.row[velocities]):
            return f"the normal force {k.name} depends on more than positions: use auto"
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
