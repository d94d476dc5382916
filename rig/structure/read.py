"""Files of finite element programs, or typed numbers, to the parts of a structure in SI units.

CalculiX        job.sti, job.mas (one triangle each), job.dof (node.direction of each row)
MATLAB v5, NPZ, Matrix Market, and Abaqus with FORMAT=COORDINATE       matrices; a CSV file names node and direction
                of each row
Abaqus .mtx     with FORMAT=MATRIX INPUT: node, direction, node, direction, value; held rows (1e36) are left out

`structure` reports all faults at once, each with its file and row. Numbers of rows count from one.
"""

from __future__ import annotations

import io
import itertools
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy.io
import scipy.sparse as sp
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.machine import files
from rig.printable import counted
from rig.structure.eigenvalues import below_count
from rig.structure.full import Array, Full, Of, Part
from rig.structure.mesh import (
    DIRECTIONS,
    LIMIT,
    NOTHING,
    SHOWN,
    Mesh,
    direction_number,
    few,
    included,
    lines_of,
    read_mesh,
    readable,
    tried,
)
from rig.units import brief

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
_HELD = 1e35  # Abaqus writes 1e36 on the diagonal of a held row
_INDEFINITE = -1e-8  # a mass below this, over that of its rows, is not due to rounding
_ROWS = 10_000_000  # most of a matrix
ELSEWHERE = """\
Write the matrices as Matrix Market (.mtx) or MATLAB v5 (.mat) and a CSV file with node and direction of each row:
    Abaqus    *MATRIX GENERATE, STIFFNESS, MASS and *MATRIX OUTPUT, STIFFNESS, MASS, FORMAT=MATRIX INPUT; no CSV needed
    Ansys     APDL Math: *SMAT,K,D,IMPORT,FULL,job.full,STIFF and *EXPORT,K,MMF,K.mtx; the same with MASS
    Nastran   PARAM,EXTOUT,DMIGPCH or OUTPUT4 of KAA and MAA; Python: pyyeti.nastran.op4.read, scipy.io.mmwrite
    COMSOL    LiveLink: A = mphmatrix(model, 'sol1', 'out', {'Kc', 'Ec'}), then save -v7"""


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


@dataclass(frozen=True)
class _Matrix:
    """A matrix as read; `labels` [row, 2]: node and direction (from one) of each row, empty if the file has none."""

    values: sp.csr_array
    labels: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    held: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))


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
    dofs = tried(lambda: _dofs(job.with_name(job.name + ".dof")), None, faults) if job is not None else None
    read: list[tuple[Source, _Matrix]] = []
    for number, source in enumerate(sources):
        of_job = job is not None and number < 2
        if of_job and dofs is None and source.file is not None:
            tried(lambda: readable(source.file), None, faults)  # type: ignore[arg-type]  # noqa: B023
        elif (matrix := tried(lambda: _part(source, dofs if of_job else None), None, faults)) is not None:  # noqa: B023
            read.append((source, matrix))
    table = tried(lambda: _rows(rows), None, faults) if rows else None
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


# Reading


def _part(source: Source, dofs: NDArray[np.int64] | None) -> _Matrix:
    """The matrix of a source, complete; `dofs`: labels of the rows of a CalculiX matrix."""
    if source.file is None:
        values = np.array(source.values if source.values is not None else (), dtype=float)
        read = _Matrix(sp.csr_array(np.atleast_2d(values)))
    elif dofs is not None:
        table = _table(source.file, 3)
        read = _Matrix(_triplets(source.file, table, len(dofs), complete=True), dofs)
    else:
        read = _file(source.file, source.variable)
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
    return _Matrix(sp.csr_array(read.values + half.T), read.labels, read.held)


def _named(source: Source) -> str:
    return f"{source.file.name} ({source.name})" if source.file else source.name


def _finite(matrix: _Matrix, source: Source, dofs: NDArray[np.int64] | None) -> None:
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


def _file(path: Path, variable: str) -> _Matrix:
    """A matrix from a file of any format that is known by its suffix or its first line."""
    readers: Mapping[str, Callable[[], _Matrix]] = {
        ".mat": lambda: _Matrix(_chosen(path, variable, _matlab(path))),
        ".npz": lambda: _Matrix(_chosen(path, variable, _npz(path))),
        ".mtx": lambda: (
            _market(path) if next(lines_of(path), "").lower().startswith("%%matrixmarket") else _abaqus(path)
        ),
    }
    if path.suffix.lower() not in readers:
        raise SceneError("", [f"{path.name}: is of an unknown format; known are .mat, .npz and .mtx. {ELSEWHERE}"])
    readable(path)
    try:
        return readers[path.suffix.lower()]()
    except NotImplementedError:
        fault = "is a MATLAB v7.3 file; write it with save -v7"
    except SceneError:
        raise
    except Exception as error:  # libraries raise all kinds for damaged files
        fault = f"cannot be read, is damaged or truncated ({brief(' '.join(str(error).split()))})"
    raise SceneError("", [f"{path.name}: {fault}"])


def _matlab(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    if b"MATLAB 7.3" not in data[:128]:
        files.matlab_checked(data, LIMIT)
    return {name: value for name, value in scipy.io.loadmat(io.BytesIO(data)).items() if not name.startswith("__")}


def _npz(path: Path) -> dict[str, Any]:
    """The arrays of a file of numpy.savez, or the one matrix of scipy.sparse.save_npz."""
    with zipfile.ZipFile(path) as archive:
        files.unpacked(archive, LIMIT)
    with np.load(path, allow_pickle=False) as arrays:
        if {"format", "data", "shape"} <= set(arrays.files):
            return {path.stem: sp.load_npz(path)}
        return {name: arrays[name] for name in arrays.files}


def _chosen(path: Path, variable: str, arrays: Mapping[str, Any]) -> sp.csr_array:
    """The matrix of a file with several arrays."""
    square = {name: value for name, value in arrays.items() if getattr(value, "ndim", 0) == 2}
    if variable not in square and (variable or len(square) != 1):
        names = ", ".join(square) or "none"
        if variable:
            what = f"has no matrix {variable!r}"
        else:
            what = "has several matrices" if square else "has no matrix"
        raise SceneError("", [f"{path.name}: {what}; it has: {names}. Choose one with name = ..."])
    return _real(path, square[variable or next(iter(square))])


def _real(path: Path, matrix: Any) -> sp.csr_array:
    if matrix.dtype.kind not in "fiub":
        advice = "write the real and the imaginary part as two parts" if matrix.dtype.kind == "c" else "write numbers"
        raise SceneError("", [f"{path.name}: has entries of type {matrix.dtype}; {advice}"])
    if hasattr(matrix, "check_format"):
        matrix.check_format(full_check=True)  # the indices of a damaged file would be used as addresses
    return sp.csr_array(matrix, dtype=np.float64)


def _market(path: Path) -> _Matrix:
    """Matrix Market; scipy's reader ends the process at some damaged files."""
    content = (n for n, line in enumerate(lines_of(path)) if line.strip() and not line.startswith("%"))
    first = 1 + next(content, 0)
    *_, sizes = itertools.islice(lines_of(path), first)
    head = next(lines_of(path)).lower().split()
    kind = (*head[1:], "", "", "", "")[:4]
    layout, numbers, symmetry = kind[1:]
    if numbers == "complex":
        raise SceneError("", [f"{path.name}: is complex; write the real and the imaginary part as two parts"])
    mirrored = {"general": (0.0, 0), "symmetric": (1.0, 1), "skew-symmetric": (-1.0, -1)}
    known = layout in ("coordinate", "array") and numbers in ("real", "double", "integer")
    if not known or symmetry not in mirrored:
        expected = "coordinate or array, real or integer, general, symmetric or skew-symmetric"
        raise SceneError("", [f"{path.name}: its first line says {brief(' '.join(kind[1:]))}; expected {expected}"])
    sign, diagonal = mirrored[symmetry]
    rows, columns, *count = (int(word) for word in sizes.split())
    table = _table(path, 3 if layout == "coordinate" else 1, first)
    if layout == "coordinate":
        entries = count[0]
    elif sign:
        entries = rows * (rows + diagonal) // 2
    else:
        entries = rows * columns
    if len(table) != entries:
        raise SceneError("", [f"{path.name}: has {len(table)} of {entries} entries; it is truncated"])
    if layout == "array":  # column by column
        highest = {0: max(rows, columns), 1: 0, -1: -1}
        below = np.tri(rows, columns, highest[diagonal])
        places = np.argwhere(below.T)[:, ::-1] + 1.0
        table = np.column_stack([places, table])
    matrix = _triplets(path, table, max(rows, columns))[:rows, :columns]
    if sign:
        matrix = sp.csr_array(matrix + sign * sp.tril(matrix, -1).T)
    return _Matrix(matrix)


def _abaqus(path: Path) -> _Matrix:
    """Lines "row, column, value", or "node, direction, node, direction, value" with one triangle or both."""
    first = next((line for line in lines_of(path) if line.strip() and not line.startswith("**")), "")
    columns = len(first.replace(",", " ").split())
    if columns not in (3, 5):
        raise SceneError(
            "", [f"{path.name}: is no matrix of Abaqus or Matrix Market: {brief(first.strip())}. {ELSEWHERE}"]
        )
    table = _table(path, columns)
    if columns == 3:
        if len(held := np.flatnonzero(table[:, 2] >= _HELD)):
            raise SceneError("", [f"{path.name}: row {table[held[0], 0]:g} is held (1e36); use FORMAT=MATRIX INPUT"])
        return _Matrix(_triplets(path, table, int(table[:, :2].max())))
    ends = np.concatenate([table[:, :2], table[:, 2:4]]).astype(np.int64)
    labels, number = np.unique(ends, axis=0, return_inverse=True)
    no_direction = (labels[:, 1] < 1) | (labels[:, 1] > 6)
    odd = np.flatnonzero((labels[:, 0] > 0) & no_direction)
    if len(odd):
        node, direction = labels[odd[0]].tolist()
        raise SceneError("", [f"{path.name}: node {node} has a degree of freedom {direction}; expected 1 to 6"])
    matrix = sp.csr_array((table[:, 4], tuple(number.reshape(2, -1))), shape=(len(labels), len(labels)))
    other = sp.csr_array(matrix - sp.diags_array(matrix.diagonal())).T
    if not (abs(matrix) * abs(other)).count_nonzero():  # each entry stands for its mirror image too
        matrix = sp.csr_array(matrix + other)
    held = matrix.diagonal() >= _HELD
    return _Matrix(sp.csr_array(matrix[~held][:, ~held]), labels[~held], labels[held])


def _triplets(path: Path, table: Array, rows: int, complete: bool = False) -> sp.csr_array:
    """A matrix from row, column (from one), value. `complete`: a file without entries for a row is truncated."""
    if rows > _ROWS:
        raise SceneError("", [f"{path.name}: has {rows} rows; at most {_ROWS} are read"])
    at = table[:, :2]
    wrong = (at != np.floor(at)) | (at < 1) | (at > rows)
    bad = np.flatnonzero(wrong.any(axis=1))
    if len(bad):
        line = table[bad[0]]
        what = f"entry {bad[0] + 1} has row {line[0]:g} and column {line[1]:g}; expected 1 to {rows}"
        raise SceneError("", [f"{path.name}: {what}"])
    i, j = at.astype(np.int64).T - 1
    seen = np.zeros(rows, dtype=bool)
    seen[i] = seen[j] = True
    missing = rows - int(seen.sum())
    if complete and missing:
        last = int(max(i.max(), j.max())) + 1
        what = f"{missing} of {rows} rows have no entry, the last with one is {last}"
        raise SceneError("", [f"{path.name}: {what}; the file is truncated, or belongs to another .dof file"])
    return sp.csr_array((table[:, 2], (i, j)), shape=(rows, rows))


def _table(path: Path, columns: int, skipped: int = 0) -> Array:
    """The numbers [line, column] of a text file after `skipped` lines, separated by blanks or commas.

    Lines that start with ** or % before the first number are comments.
    """
    comma = None
    for line in itertools.islice(lines_of(path), skipped, None):
        if line.strip() and not line.startswith(("**", "%")):
            comma = "," if "," in line else None
            break
        skipped += 1
    else:
        raise SceneError("", [f"{path.name}: is empty"])
    try:
        table = np.loadtxt(path, delimiter=comma, skiprows=skipped, ndmin=2, comments=None)
        if table.shape[1] == columns:
            if _ended(path):
                return table
            what = "its last line does not end, so that digits may be missing"
            raise SceneError("", [f"{path.name}: is truncated: {what}; write it again, or end the line"])
    except ValueError:
        pass
    faults = []
    for number, line in enumerate(lines_of(path), 1):
        words = line.replace(",", " ").split()
        try:
            good = not words or number <= skipped or len([float(word) for word in words]) == columns
        except ValueError:
            good = False
        if not good:
            faults.append(f"{path.name}, line {number}: is {brief(line.strip())}; expected {columns} numbers")
    raise SceneError("", few(faults, path.name) or [f"{path.name}: cannot be read as numbers, {columns} in a line"])


def _ended(path: Path) -> bool:
    """Whether the last line of a file has an end."""
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read() == b"\n"


def _dofs(path: Path) -> NDArray[np.int64]:
    """Node and direction of each row of CalculiX matrices."""
    labels = []
    faults = []
    for number, line in enumerate(lines_of(path), 1):
        if match := re.fullmatch(r"\s*(\d+)\.([1-6])\s*", line):
            labels.append((int(match[1]), int(match[2])))
        elif line.strip():
            faults.append(
                f"{path.name}, line {number}: is {brief(line.strip())}; expected NODE.DIRECTION, such as 12.3"
            )
    if faults or not labels:
        raise SceneError("", few(faults, path.name) or [f"{path.name}: is empty"])
    return np.array(labels, dtype=np.int64)


def _rows(path: Path) -> NDArray[np.int64]:
    """Node and direction (from one) of each row from a CSV file; node 0 for a row without a node.

    Columns "node, direction", or "row, node, direction" in any order of rows. A first line without numbers is a
    header.
    """
    labels: dict[int, tuple[int, int]] = {}
    faults = []
    seen = dict[tuple[int, int], int]()
    for number, line in enumerate(lines_of(path), 1):
        words = [word.strip().strip('"').lower() for word in re.split("[,;]", line.strip())]
        if not any(words) or (number == 1 and words[-2:] == ["node", "direction"]):
            continue
        try:
            row = int(words[0]) if len(words) == 3 else len(labels) + 1
            node = int(words[-2] or 0)
            direction = direction_number(words[-1]) if node > 0 else 0
            if len(words) not in (2, 3):
                raise ValueError
        except (ValueError, IndexError):
            faults.append(
                f"{path.name}, line {number}: is {brief(line.strip())}; expected NODE, DIRECTION such as 12, z"
            )
            continue
        label = (max(node, 0), direction)
        if row in labels:
            faults.append(f"{path.name}, line {number}: row {row} is given twice")
        elif node > 0 and label in seen:
            what = f"node {node} has its direction {DIRECTIONS[direction - 1]} in line {seen[label]} too"
            faults.append(f"{path.name}, line {number}: {what}")
        labels[row] = label
        seen[label] = number
    if not faults and sorted(labels) != list(range(1, len(labels) + 1)):
        faults.append(f"{path.name}: its rows are not 1 to {len(labels)}")
    if faults or not labels:
        raise SceneError("", few(faults, path.name) or [f"{path.name}: is empty"])
    return np.array([labels[row] for row in sorted(labels)], dtype=np.int64)


# Rows and checks


def _one_order(
    read: Sequence[tuple[Source, _Matrix]], table: NDArray[np.int64] | None, faults: list[str]
) -> tuple[list[tuple[Source, _Matrix]], NDArray[np.int64]]:
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
            matrix = _Matrix(sp.csr_array(place @ matrix.values @ place.T), labels)
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
    read: Sequence[tuple[Source, _Matrix]],
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
