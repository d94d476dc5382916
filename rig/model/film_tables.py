"""Tables of a film and of the structure under it, as rig.solve.film_steps reads them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.model import energy_forms
from rig.model.film import Film, on
from rig.model.system import System
from rig.solve import expm
from rig.solve.column_blocks import zeros
from rig.solve.film_records import GROUP, FilmTables, SymmetryClass
from rig.solve.film_sums import SUMS
from rig.solve.lanes import LANE

Array = NDArray[np.float64]


def empty() -> FilmTables:
    """The tables of a rig without a film."""
    z, none = np.zeros, np.zeros(0, dtype=np.int64)
    return FilmTables(
        symmetric=SymmetryClass(z((0, 0, LANE)), none, z((0, LANE)), z((0, LANE)), z(0), z(0)),
        antisymmetric=SymmetryClass(z((0, 0, LANE)), none, z((0, LANE)), z((0, LANE)), z(0), z(0)),
        numbers=z(0),
        where=none,
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


def tables(system: System, step: float, outputs: Array, read: int) -> FilmTables:
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
        numbers=np.array([film.pitch, film.longest, film.stiffness, film.damping, film.shear, film.mu]),
        where=np.array(
            [*map(system.names.index, (film.travel, film.slid)), first, film.points, directions, film.damping > 0.0]
        ),
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
