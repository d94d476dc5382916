"""Matrices from files of finite element programs, and the node and direction of each of their rows.

CalculiX        job.sti, job.mas (one triangle each), job.dof (node.direction of each row)
MATLAB v5, NPZ, Matrix Market, and Abaqus with FORMAT=COORDINATE       matrices; a CSV file names node and direction
                of each row
Abaqus .mtx     with FORMAT=MATRIX INPUT: node, direction, node, direction, value; held rows (1e36) are left out

Numbers of rows count from one.
"""

from __future__ import annotations

import io
import itertools
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.machine import files
from rig.structure.full import Array
from rig.structure.mesh import DIRECTIONS, LIMIT, direction_number, few, lines_of, readable
from rig.units import brief

_HELD = 1e35  # Abaqus writes 1e36 on the diagonal of a held row
_ROWS = 10_000_000  # most of a matrix
ELSEWHERE = """\
Write the matrices as Matrix Market (.mtx) or MATLAB v5 (.mat) and a CSV file with node and direction of each row:
    Abaqus    *MATRIX GENERATE, STIFFNESS, MASS and *MATRIX OUTPUT, STIFFNESS, MASS, FORMAT=MATRIX INPUT; no CSV needed
    Ansys     APDL Math: *SMAT,K,D,IMPORT,FULL,job.full,STIFF and *EXPORT,K,MMF,K.mtx; the same with MASS
    Nastran   PARAM,EXTOUT,DMIGPCH or OUTPUT4 of KAA and MAA; Python: pyyeti.nastran.op4.read, scipy.io.mmwrite
    COMSOL    LiveLink: A = mphmatrix(model, 'sol1', 'out', {'Kc', 'Ec'}), then save -v7"""


@dataclass(frozen=True)
class ReadMatrix:
    """A matrix as read; `labels` [row, 2]: node and direction (from one) of each row, empty if the file has none."""

    values: sp.csr_array
    labels: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    held: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))


def matrix_of(path: Path, variable: str) -> ReadMatrix:
    """A matrix from a file of any format that is known by its suffix or its first line."""
    readers: Mapping[str, Callable[[], ReadMatrix]] = {
        ".mat": lambda: ReadMatrix(_chosen(path, variable, _matlab(path))),
        ".npz": lambda: ReadMatrix(_chosen(path, variable, _npz(path))),
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


def _market(path: Path) -> ReadMatrix:
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
    return ReadMatrix(matrix)


def _abaqus(path: Path) -> ReadMatrix:
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
        return ReadMatrix(_triplets(path, table, int(table[:, :2].max())))
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
    return ReadMatrix(sp.csr_array(matrix[~held][:, ~held]), labels[~held], labels[held])


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


def matrix_of_job(path: Path, dofs: NDArray[np.int64]) -> ReadMatrix:
    """A matrix of CalculiX, whose rows have the labels `dofs`."""
    table = _table(path, 3)
    return ReadMatrix(_triplets(path, table, len(dofs), complete=True), dofs)


def rows_of_job(path: Path) -> NDArray[np.int64]:
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


def rows_of_table(path: Path) -> NDArray[np.int64]:
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
