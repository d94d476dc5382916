"""The parts of a structure in SI units, from files of matrices (rig.structure.matrix_files) or from typed numbers.

`structure` puts the matrices over one list of rows, checks them, and reports all faults at once, each with its file and
row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.printable import counted
from rig.structure.eigenvalues import below_count
from rig.structure.full import Full, Of, Part
from rig.structure.matrix_files import ReadMatrix, matrix_of, matrix_of_job, rows_of_job, rows_of_table
from rig.structure.mesh import (
    DIRECTIONS,
    NOTHING,
    SHOWN,
    Mesh,
    few,
    included,
    read_mesh,
    readable,
    tried,
)

Stored = Literal["full", "lower", "upper"]
UNITS = {"m-kg-s": 1.0, "mm-t-s": 1e-3}
"""System of units of the matrices -> its unit of length [m]; force in N in both."""
LEAST_MASS = 1e-6  # kg
MOST_MASS = 1e6  # kg
LEAST_DENSITY = 1e-5
"""Mass over the cube of the size of the mesh [kg/m^3] of a thin wire."""
MOST_DENSITY = 1e5
"""The same of a block of metal."""
SYMMETRIC = 1e-9
"""Largest difference of mirrored entries of a symmetric matrix, over its largest entry."""
_INDEFINITE = -1e-8  # a mass below this, over that of its rows, is not due to rounding


@dataclass(frozen=True)
class Source:
    """Where one part comes from: a `file` with its `variable` ("": the only one), or typed `values` [row, row].

    `stored`: the triangle that the matrix contains, if it is symmetric and not complete. `key`, `power`, `factor`: see
    `Part`.
    """

    name: str
    of: Of
    file: Path | None = None
    values: Sequence[Sequence[float]] | None = None
    variable: str = ""
    stored: Stored = "full"
    key: str = ""
    power: int = 1
    factor: float = 1.0


def structure(
    sources: Sequence[Source],
    units: Literal["m-kg-s", "mm-t-s"],
    *,
    job: Path | None = None,
    nodes: Path | None = None,
    rows: Path | None = None,
    flaws: list[str] | None = None,
) -> tuple[Full, Mesh]:
    """The matrices in SI units and the mesh.

    `job`: CalculiX matrices, without suffix, beside the `sources`. `nodes`: an .inp file, or a CSV file: node, x, y,
    z. `rows`: the CSV file with node and direction of each row. Raises SceneError with every fault. What is wrong with
    the entries of the matrices is added to `flaws` if it is given: contacts and places can be checked all the same.
    """
    faults: list[str] = []
    length = UNITS[units]
    mesh = tried(lambda: read_mesh(nodes, length), NOTHING, faults) if nodes else NOTHING
    if job is not None:
        sources = [
            Source("stiffness", "stiffness", job.with_name(job.name + ".sti"), stored="upper"),
            Source("mass", "mass", job.with_name(job.name + ".mas"), stored="upper"),
            *sources,
        ]
    dofs = tried(lambda: rows_of_job(job.with_name(job.name + ".dof")), None, faults) if job is not None else None
    read: list[tuple[Source, ReadMatrix]] = []
    for number, source in enumerate(sources):
        of_job = job is not None and number < 2
        if of_job and dofs is None and source.file is not None:
            tried(lambda: readable(source.file), None, faults)  # type: ignore[arg-type]  # noqa: B023
        elif (matrix := tried(lambda: _part(source, dofs if of_job else None), None, faults)) is not None:  # noqa: B023
            read.append((source, matrix))
    table = tried(lambda: rows_of_table(rows), None, faults) if rows else None
    if faults:
        raise SceneError("structure", faults)
    read, labels = _one_order(read, table, faults)
    if job is not None and len(mesh.ids) and not mesh.tied and not mesh.following:
        faults += [f"{job.name}.dof, {fault}" for fault in _mislabelled(labels, read[1][1].values, mesh)]
    inner = labels[:, 0] <= 0
    if len(mesh.ids):
        inner |= ~np.isin(labels[:, 0], mesh.ids)
    direction = np.where(inner, -1, labels[:, 1] - 1)
    if len(mesh.ids) and len(labels) and inner.all():
        faults.append(f"{nodes and nodes.name}: none of its nodes has a row in the matrices; take the mesh they are of")
    else:
        of_node = (labels[:, 0] > 0) & (labels[:, 0] < mesh.ids.max(initial=0))
        strange = np.flatnonzero(inner & of_node)
        if len(strange):
            missing = labels[strange[0], 0]
            what = f"row {strange[0] + 1} belongs to node {missing}, which {nodes and nodes.name} does not have"
            faults.append(f"{what}, and {len(strange) - 1} more rows are like it; take the mesh of the matrices")
    if not faults:
        size = float(np.ptp(mesh.xyz, axis=0).max()) if len(mesh.ids) else 0.0
        of_mesh = np.where(inner, -1, labels[:, 0])
        wrong = _flawed(read, of_mesh, direction, length, size)
        (faults if flaws is None else flaws).extend(wrong)
    if faults:
        raise SceneError("structure", faults)
    turning = direction >= 3
    parts = tuple(
        Part(source.name, source.of, _si(matrix.values, turning, length), source.key, source.power, source.factor)
        for source, matrix in read
    )
    node = labels[:, 0]
    faces = mesh.corners(labels[~inner, 0])
    return Full(parts, node=node, direction=direction, ids=mesh.ids, xyz=mesh.xyz, faces=faces), mesh


def files_read(
    sources: Sequence[Source], *, job: Path | None = None, nodes: Path | None = None, rows: Path | None = None
) -> tuple[Path, ...]:
    """Every file that `structure` reads for these arguments. Raises SceneError for one that cannot be read."""
    paths = [source.file for source in sources if source.file is not None]
    paths += [job.with_name(job.name + suffix) for suffix in (".sti", ".mas", ".dof")] if job else []
    paths += [rows] if rows else []
    faults: list[str] = []
    for path in paths:
        tried(lambda: readable(path), None, faults)  # noqa: B023
    paths += tried(lambda: list(included(nodes)), [], faults) if nodes else []
    if faults:
        raise SceneError("structure", faults)
    return tuple(dict.fromkeys(paths))


def _si(matrix: sp.csr_array, turning: NDArray[np.bool_], length: float) -> sp.csr_array:
    """A matrix in N, m, rad from one in N, `length` m, rad. `turning` [row]: the row is an angle."""
    if length == 1.0:
        return matrix
    entries = matrix.tocoo()
    rows, columns = entries.coords
    power = turning[rows].astype(int) + turning[columns] - 1
    scale = np.array([1.0 / length, 1.0, length])[power + 1]
    return sp.csr_array((entries.data * scale, entries.coords), shape=matrix.shape)


def _part(source: Source, dofs: NDArray[np.int64] | None) -> ReadMatrix:
    """The matrix of a source, complete; `dofs`: labels of the rows of a CalculiX matrix."""
    if source.file is None:
        values = np.array(source.values if source.values is not None else (), dtype=float)
        read = ReadMatrix(sp.csr_array(np.atleast_2d(values)))
    elif dofs is not None:
        read = matrix_of_job(source.file, dofs)
    else:
        read = matrix_of(source.file, source.variable)
    _finite(read, source, dofs)
    rows, columns = read.values.shape
    if rows != columns or not rows:
        raise SceneError("", [f"{_named(source)}: has {rows} rows and {columns} columns; expected a square matrix"])
    if source.stored == "full":
        return read
    low = sp.tril(read.values, -1)
    high = sp.triu(read.values, 1)
    other = (low if source.stored == "upper" else high).tocoo()
    if entries := np.flatnonzero(other.data).tolist():
        row = int(other.coords[0][entries[0]])
        column = int(other.coords[1][entries[0]])
        what = f"stored is {source.stored!r}, but row {row + 1} has an entry in column {column + 1}"
        raise SceneError("", [f'{_named(source)}: {what}; write stored = "full"'])
    half = high if source.stored == "upper" else low
    return ReadMatrix(sp.csr_array(read.values + half.T), read.labels, read.held)


def _named(source: Source) -> str:
    return f"{source.file.name} ({source.name})" if source.file else source.name


def _finite(matrix: ReadMatrix, source: Source, dofs: NDArray[np.int64] | None) -> None:
    """Raise SceneError for entries that are not finite."""
    entries = matrix.values.tocoo()
    bad = np.flatnonzero(~np.isfinite(entries.data))
    if len(bad):
        rows, columns = entries.coords
        places = [f"row {rows[k] + 1}, column {columns[k] + 1}" for k in bad[:SHOWN]]
        advice = "; CalculiX writes them beside a nonlinear *MPC: use *EQUATION or *RIGID BODY" * (dofs is not None)
        raise SceneError(
            "", [f"{_named(source)}: has {len(bad)} entries that are not finite: {'; '.join(places)}{advice}"]
        )


def _one_order(
    read: Sequence[tuple[Source, ReadMatrix]], table: NDArray[np.int64] | None, faults: list[str]
) -> tuple[list[tuple[Source, ReadMatrix]], NDArray[np.int64]]:
    """The matrices over one list of rows, and node and direction (from one) of each, 0 where they are not known."""
    labelled = [matrix.labels for _, matrix in read if len(matrix.labels)]
    if not labelled:
        count = read[0][1].values.shape[0] if read else 0
        if table is None:
            table = np.zeros((count, 2), dtype=np.int64)
        elif len(table) != count:
            faults.append(f"the file of rows has {len(table)} rows, but {_named(read[0][0])} has {count}")
        labels = table
    elif all(np.array_equal(labelled[0], other) for other in labelled):
        labels = labelled[0]
    else:
        labels = np.unique(np.concatenate(labelled), axis=0)
    held = np.concatenate([np.zeros((0, 2), dtype=np.int64), *(matrix.held for _, matrix in read)])
    if len(held):
        labels = labels[~np.isin(labels @ [8, 1], held @ [8, 1])]
    ordered = []
    for source, matrix in read:
        if len(matrix.labels) and not np.array_equal(matrix.labels, labels):
            number = {label: row for row, label in enumerate(map(tuple, labels.tolist()))}
            rows = [number.get(label, -1) for label in map(tuple, matrix.labels.tolist())]
            to = np.array(rows, dtype=np.int64)
            known = np.flatnonzero(to >= 0)
            place = sp.csr_array((np.ones(len(known)), (to[known], known)), shape=(len(labels), len(to)))
            matrix = ReadMatrix(sp.csr_array(place @ matrix.values @ place.T), labels)
        else:
            count = len(labels) if labelled else read[0][1].values.shape[0]
            if matrix.values.shape[0] != count:
                first = _named(read[0][0])
                faults.append(f"{_named(source)}: has {matrix.values.shape[0]} rows, but {first} has {count}")
        ordered.append((source, matrix))
    return ordered, labels


def _mislabelled(labels: NDArray[np.int64], mass: sp.csr_array, mesh: Mesh) -> list[str]:
    """Lines of a .dof file that name the wrong row: given twice, or of another direction than the rows beside it.

    The mass of an element couples motions of its nodes along one direction only.
    """

    def named(row: int) -> str:
        return f"line {row + 1}: node {labels[row, 0]}, direction {DIRECTIONS[labels[row, 1] - 1]}"

    _, first, of = np.unique(labels, axis=0, return_index=True, return_inverse=True)
    twice = [] if mesh.layered else np.flatnonzero(first[of] != np.arange(len(labels))).tolist()
    if twice:
        advice = "one of the two stands for another row; let CalculiX write the file again"
        return few([f"{named(row)} is in line {first[of[row]] + 1} too; {advice}" for row in twice], "the file")
    entries = mass.tocoo()
    i, j = entries.coords
    other = (i != j) & np.isin(labels[i, 0], mesh.ids) & np.isin(labels[j, 0], mesh.ids)
    sizes = np.where(other, np.abs(entries.data), 0.0)
    alike = labels[i, 1] == labels[j, 1]
    total = np.bincount(i, sizes, len(labels))
    same = np.bincount(i, sizes * alike, len(labels))
    wrong = np.flatnonzero(same < 0.5 * total).tolist()
    what = "has mass in common with rows of other directions; the line stands for another row"
    return few([f"{named(row)} {what}" for row in wrong], "the file")


def _flawed(
    read: Sequence[tuple[Source, ReadMatrix]],
    node: NDArray[np.int64],
    direction: NDArray[np.int64],
    length: float,
    size: float,
) -> list[str]:
    """What is wrong with the matrices, in the units of the files; `size` of the mesh [m], 0 without one."""
    faults = []

    def row(number: int) -> str:
        known = f" (node {node[number]}, direction {DIRECTIONS[direction[number]]})" if direction[number] >= 0 else ""
        return f"row {number + 1}{known}"

    for of in ("mass", "stiffness"):
        if not any(source.of == of for source, _ in read):
            faults.append(f"no part is of {of!r}; a structure needs mass and stiffness")
    for source, matrix in read:
        values = matrix.values
        symmetric = not source.key and source.of != "damping"
        low = sp.tril(values, -1).count_nonzero()
        high = sp.triu(values, 1).count_nonzero()
        used = (values != 0).sum(axis=1) + (values != 0).sum(axis=0) > 0
        whole = bool((values.diagonal()[used] != 0.0).all())  # as it is in half of a symmetric matrix
        if bool(low) != bool(high) and (symmetric or (source.file and (whole or source.of == "damping"))):
            stored = "upper" if high else "lower"
            advice = f'write stored = "{stored}" if this is half of a symmetric matrix'
            advice = advice if whole else "write the whole matrix if this is half of a skew one"
            faults.append(f"{_named(source)}: has entries in its {stored} triangle only; {advice}")
            continue
        if not symmetric:
            continue
        unequal = abs(values - values.T).tocoo()
        largest = abs(values).max()
        if unequal.nnz and unequal.data.max() > SYMMETRIC * largest:
            worst = int(np.argmax(unequal.data))
            difference = unequal.data[worst]
            i, j = sorted((int(unequal.coords[0][worst]), int(unequal.coords[1][worst])))
            faults.append(
                f"{_named(source)}: is not symmetric: {row(i)} and {row(j)} differ by {difference:.3g}, which is "
                f"{difference / largest:.1e} of the largest entry. Move what friction adds to a part of its own with "
                'times = "factors.NAME", and gyroscopic terms to a part of "damping"'
            )
    constant = [source.factor * matrix.values for source, matrix in read if source.of == "mass" and not source.key]
    if faults or not constant:
        return faults
    mass = sum(constant[1:], constant[0])
    return _mass_flaws(mass, row, direction, length, size)


def _mass_flaws(
    mass: sp.csr_array, row: Callable[[int], str], direction: NDArray[np.int64], length: float, size: float
) -> list[str]:
    """Why a mass matrix is not positive, or not plausible."""
    diagonal = mass.diagonal()
    empty = np.flatnonzero(diagonal <= 0.0)
    if len(empty):
        faults = [f"mass: {row(int(k))} has the mass {diagonal[k]:g}; it must be positive" for k in empty[:SHOWN]]
        if len(empty) > SHOWN:
            faults.append(f"mass: {len(empty) - SHOWN} more rows without mass; give them mass, or condense them")
        return faults
    scale = sp.diags_array(diagonal**-0.5)
    scaled = (scale @ mass @ scale).tocsr()
    pairs = sp.triu(scaled, 1).tocoo()
    if pairs.nnz and abs(pairs.data).max() > 1.0 - _INDEFINITE:
        worst = int(np.argmax(abs(pairs.data)))
        i = int(pairs.coords[0][worst])
        j = int(pairs.coords[1][worst])
        return [f"mass: is not positive: the entry of {row(i)} and {row(j)} is larger than their own masses"]
    if negative := below_count(scaled, sp.eye_array(len(diagonal), format="csr"), _INDEFINITE):
        return [f"mass: is not positive: {counted(negative, 'motion')} with a negative mass; check the element masses"]
    along = next((k for k in range(3) if (direction == k).any()), None)
    if along is None:
        total = float(diagonal.sum())
        what = "the sum of its diagonal"
    else:
        moved = (direction == along).astype(float)
        total = float(moved @ (mass @ moved))
        what = f"the total mass along {DIRECTIONS[along]}"
    total /= length
    if not LEAST_MASS <= total <= MOST_MASS:
        expected = f"expected {LEAST_MASS:g} to {MOST_MASS:g} kg"
        return [f"mass: {what} is {total:.4g} kg; {expected}. Is structure.units that of the matrices?"]
    if size and along is not None and not LEAST_DENSITY <= total / size**3 <= MOST_DENSITY:
        what = f"{what} is {total:.4g} kg, and the mesh extends over {size:.4g} m"
        return [f"mass: {what}; nothing is so {'heavy' if total > size**3 else 'light'}. Is structure.units right?"]
    return []
