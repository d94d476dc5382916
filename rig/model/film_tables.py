"""Tables of a film for the method kick: the exact flow of the structure over a step, and the kicks of the points."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.model import energy_forms
from rig.model.film import Film, Mirror, on
from rig.model.formulation import ModeSet
from rig.model.system import System
from rig.solve import expm
from rig.solve.column_blocks import BLOCK, LANE, zeros
from rig.solve.film_steps import GROUP, SUMS, FilmTables, SymmetryClass

Array = NDArray[np.float64]
_ROUNDING = 1e-9
"""Largest entry beside the diagonal that counts as rounding of vibration modes, over the root of both on it."""


class _Uncoupled(NamedTuple):
    """The flow of coordinates that nothing but the film couples, over a step: see FilmTables."""

    turn: Array
    loss: Array
    column: Array


class _Coupled(NamedTuple):
    """The flow of a structure whose coordinates or network are coupled, over a step: see FilmTables."""

    whole: Array
    terms: NDArray[np.int64]
    forms: Array


@cache
def no_film() -> FilmTables:
    """The tables of a rig without a film, the same for all."""
    z = np.zeros
    none = np.zeros(0, dtype=np.int64)
    return FilmTables(
        symmetric=SymmetryClass(z((0, 0, LANE)), none, z((0, LANE)), z((0, LANE)), z((0, LANE)), z(0), z(0)),
        antisymmetric=SymmetryClass(z((0, 0, LANE)), none, z((0, LANE)), z((0, LANE)), z((0, LANE)), z(0), z(0)),
        mirrored=0,
        travel=0,
        slid=0,
        first=0,
        points=0,
        directions=0,
        pitch=0.0,
        longest=0.0,
        stiffness=z(0),
        shear=z(0),
        give=z(0),
        resist=z(0),
        mu=z(0),
        code=z(0, np.int64),
        law=z((0, 0)),
        reach=z(0),
        told=0,
        below=none,
        share=z(0),
        places=z((2, 0)),
        kick=z(0),
        kicks=z((0, LANE)),
        turn=z((4, 0)),
        loss=z((3, 0)),
        damped=z(0),
        before=z(0),
        pushed=none,
        column=z((2, 0, 0)),
        push=z((0, 0)),
        pushes=z((3, 0)),
        signal=z((0, 0)),
        whole=z((0, LANE)),
        terms=none,
        forms=z((0, 0, BLOCK)),
        changed=z(0),
        part=z(BLOCK),
        begins=none,
        entry=none,
        value=z(0),
        summed=none,
        seen=z((0, 0)),
        last=z((0, 0)),
        pull=z(0),
        most=z(0),
        lost=z((3, 0)),
        moved=z(0),
        begun=z((2, 0)),
        held=z(0),
        slider_rows=z((0, 0)),
        stiff_rows=z((0, 0)),
        advance=z(0),
        ahead=z(0),
        pressed=z(0),
        fits=z((0, 0, 0)),
        values=z((0, 0)),
    )


def _couples(matrix: Array) -> bool:
    size = np.abs(np.diag(matrix))
    beside = np.abs(matrix - np.diag(np.diag(matrix)))
    return bool(np.any(beside > _ROUNDING * np.sqrt(np.outer(size, size))))


def _uncoupled(system: System, step: float, first: int, pushed: NDArray[np.int64]) -> _Uncoupled:
    nq = len(system.coordinates)
    m = first - system.one
    turn = np.zeros((4, nq))
    loss = np.zeros((3, nq))
    column = np.zeros((2, m, len(pushed)))
    mass = np.diag(system.mass)
    force = system.force[:, system.one : first]
    signals = system.signals[:m, system.one : first]
    for i in range(nq):
        A = np.zeros((2 + m, 2 + m))
        A[0, 1] = 1.0
        A[1, :2] = -system.stiffness[i, i] / mass[i], -system.damping[i, i] / mass[i]
        A[1, 2:] = force[i] / mass[i]
        A[2:, 2:] = signals
        own = A[:2, :2].copy()
        E = expm.ladder(own, step)
        turn[:, i] = E[0].ravel()
        form = np.array([[[0.0, 0.0], [0.0, system.damping[i, i]]]])
        cell = step / 2.0 ** (len(E) - 1)
        nodes = energy_forms.at_nodes(own, np.eye(2), cell)
        dissipated = energy_forms.work(nodes, form, step, E)[0, 0]
        loss[:, i] = dissipated[0, 0], 2.0 * dissipated[0, 1], dissipated[1, 1]
        for p in np.flatnonzero(pushed == i).tolist():
            column[:, :, p] = expm.ladder(A, step)[0][:2, 2:]
    return _Uncoupled(turn, loss, column)


def _coupled(system: System, modes: ModeSet, step: float, n: int) -> _Coupled:
    """The flow of the first n states over a step. The work of the driving states is left to the kernel."""
    A = np.ascontiguousarray(modes.A[:n, :n])
    force = system.force.copy()
    force[:, system.one :] = 0.0
    powers = energy_forms.powers(replace(system, force=force), modes)
    forms = np.ascontiguousarray(powers[:, :n, :n])
    terms = np.flatnonzero(forms.any(axis=(1, 2)))
    E = expm.ladder(A, step)
    cell = step / 2.0 ** (len(E) - 1)
    nodes = energy_forms.at_nodes(A, np.eye(n), cell)
    integrals = energy_forms.work(nodes, forms[terms], step, E)[0]
    halves = []
    begins = range(0, n, BLOCK)
    for W in integrals:
        half = zeros((n, -(-n // BLOCK) * BLOCK))
        half[:, :n] = np.diag(np.diag(W)) + 2.0 * np.tril(W, -1)
        halves.append(np.concatenate([half[at:, at : at + BLOCK] for at in begins]))
    height = sum(n - at for at in begins)
    forms = zeros((len(terms), height, BLOCK))
    forms[:] = np.array(halves).reshape(forms.shape)
    whole = zeros((n, _lanes(n)))
    whole[:, :n] = E[0].T
    return _Coupled(whole, terms, forms)


def tables(system: System, modes: ModeSet, step: float, outputs: Array, read: int) -> FilmTables:
    """The tables of a system with a film for steps of `step` s.

    `modes`: its only mode set; `outputs` [output, n], of which sensors read the first `read`.
    """
    film = system.film
    assert film is not None
    nq = len(system.coordinates)
    first = system.names.index(on(system.coordinates[0]))
    directions = film.directions
    order = film.order
    m = first - system.one
    force = system.force[:, system.one : first]
    pushed = np.flatnonzero(force.any(axis=1))
    if len(pushed) > nq // 4:
        pushed = np.arange(nq)
    matrices = system.mass, system.damping, system.stiffness
    coupled = len(system.network) > 0 or any(_couples(matrix) for matrix in matrices)
    coupled = coupled or bool(np.any(system.force[:, : system.one]))
    still = no_film()
    flow = still if coupled else _uncoupled(system, step, first, pushed)
    joint = _coupled(system, modes, step, first) if coupled else still
    inverse = np.linalg.inv(system.mass)
    heavy = _couples(system.mass)
    kicks = zeros((nq if heavy else 0, _lanes(nq)))
    if heavy:
        kicks[:, :nq] = 0.5 * step * inverse
    entries = np.nonzero(outputs)
    entries_per_output = np.count_nonzero(outputs, axis=1)
    fixed = (film.rows == film.rows[0]).all(axis=(0, 1, 3)) & (film.pitch > 0.0)
    beside = system.mass - np.diag(np.diag(system.mass))
    slider_coordinates = np.flatnonzero(fixed & ~np.any(beside, axis=1))
    normal, stiff = zeros((2, len(slider_coordinates), _lanes(film.points)))
    normal[:, : film.points] = film.rows[0, 0][np.ix_(slider_coordinates, order)]
    relative = (film.stiffness / film.stiffness[order[0]])[order]
    stiff[:, : film.points] = normal[:, : film.points] * relative
    signals = np.ascontiguousarray(system.signals[:m, system.one : first])
    resist = (film.damping / (2.0 * step))[order] if film.damping.any() else np.zeros(0)
    sums = first + nq + np.arange(len(SUMS))
    codes, numbers = film.packed
    mirror = film.mirror
    alike, against = (_side(film, mirror, parity) for parity in (1.0, -1.0))
    return FilmTables(
        symmetric=alike,
        antisymmetric=against,
        mirrored=int(mirror is not None),
        travel=system.names.index(film.travel or film.slid),
        slid=system.names.index(film.slid),
        first=first,
        points=film.points,
        directions=directions,
        pitch=float(film.pitch),
        longest=float(film.longest),
        stiffness=film.stiffness[order],
        shear=film.shear[order],
        give=1.0 / film.shear[order],
        resist=resist,
        mu=film.mu[order],
        code=codes[order] if film.laws else codes,
        law=numbers[order] if film.laws else numbers,
        reach=film.reach[order],
        told=int(film.tells),
        below=np.array([-1]),
        share=np.zeros(1),
        places=np.array([film.x[order], film.y[order]]),
        kick=0.5 * step / np.diag(system.mass),
        kicks=kicks,
        turn=flow.turn,
        loss=flow.loss,
        damped=zeros(nq),
        before=zeros(_lanes(nq)),
        pushed=pushed,
        column=flow.column,
        push=np.ascontiguousarray(force[pushed].T),
        pushes=zeros((3, _lanes(len(pushed)))),
        signal=expm.ladder(signals, step)[0],
        whole=joint.whole,
        terms=joint.terms,
        forms=joint.forms,
        changed=zeros(joint.whole.shape[1]),
        part=zeros(BLOCK),
        begins=np.concatenate([[0], np.cumsum(entries_per_output)]).astype(np.int64),
        entry=entries[1].astype(np.int64),
        value=outputs[entries],
        summed=np.array([outputs[:read, sums].any()], dtype=np.int64),
        seen=zeros((directions, film.points)),
        last=zeros((directions, film.points)),
        pull=zeros(film.points),
        most=zeros(film.points),
        lost=np.zeros((3, film.points)),
        moved=np.zeros(m),
        begun=np.zeros((2, m)),
        held=np.zeros(len(pushed)),
        slider_rows=normal,
        stiff_rows=stiff,
        advance=step * step / 12.0 / np.diag(system.mass)[slider_coordinates],
        ahead=zeros(len(slider_coordinates)),
        pressed=zeros(_lanes(film.points)),
        fits=_fits(),
        values=np.zeros((GROUP + 1, read)),
    )


def _fits() -> Array:
    fits = np.zeros((GROUP, GROUP + 1, GROUP + 1))
    for steps in range(1, GROUP + 1):
        places = np.linspace(0.0, 1.0, steps + 1)
        powers = np.vander(places, increasing=True)
        fits[steps - 1, : steps + 1, : steps + 1] = np.linalg.inv(powers)
    return fits


def _lanes(count: int) -> int:
    return -(-count // LANE) * LANE


def _side(film: Film, mirror: Mirror | None, parity: float) -> SymmetryClass:
    """The coordinates of one parity (symmetric or antisymmetric); without symmetry all count as symmetric."""
    if mirror is None:
        parities = np.ones(film.rows.shape[2])
        points = film.order
    else:
        parities = mirror.parity
        points = film.order[: film.points // 2]
    which = np.flatnonzero(parities == parity)
    lanes = film.directions * len(points)
    rows = zeros((len(film.rows), len(which), _lanes(lanes)))
    of_side = film.rows[:, :, which][..., points]  # [place, direction, coordinate, point]
    rows[:, :, :lanes] = of_side.transpose(0, 2, 1, 3).reshape(*rows.shape[:2], lanes)
    now = zeros(rows.shape[1:])
    back = zeros((0 if film.pitch else lanes, _lanes(len(which))))
    if not film.pitch:
        now[:] = rows[0]
        back[:, : len(which)] = rows[0, :, :lanes].T
    return SymmetryClass(rows, which, zeros(rows.shape[1:]), now, back, zeros(_lanes(len(which))), zeros(rows.shape[2]))
