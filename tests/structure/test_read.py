"""Matrices of every format are the same matrices; faults name file and row, all at once."""

import brake_fe
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from rig.structure.read import Source, structure

ROWS = [(1, 1), (1, 2), (2, 1), (2, 2), (3, 1)]
"""Node and direction of each row of the matrices."""
K = np.array([[4, -1, -2, 0, 0], [-1, 5, 0, -2, 0], [-2, 0, 6, -1, -2.5], [0, -2, -1, 4, 0], [0, 0, -2.5, 0, 3]]) * 1e4
M = np.diag([1.0, 1.0, 2.0, 2.0, 0.25]) + np.diag([0.25] * 4, 1) + np.diag([0.25] * 4, -1)


def text(path, lines):
    path.write_text("".join(line + "\n" for line in lines))
    return path


def rows_csv(folder, rows=ROWS, header=True):
    return text(folder / "rows.csv", ["node,direction"] * header + [f"{node},{'xyz'[k - 1]}" for node, k in rows])


def triangle(matrix, name):
    """Row, column (from one), value of the upper triangle in the order of CalculiX, as text in `name`."""
    size = len(matrix)
    return text(
        name, [f"{i + 1} {j + 1} {float(matrix[i, j])!r}" for j in range(size) for i in range(j + 1) if matrix[i, j]]
    )


def abaqus(matrix, name, whole=False):
    pairs = [(i, j) for i in range(len(matrix)) for j in range(len(matrix)) if (whole or i >= j) and matrix[i, j]]
    label = lambda i: f"{ROWS[i][0]},{ROWS[i][1]}"  # noqa: E731
    return text(name, [f"{label(i)}, {label(j)}, {float(matrix[i, j])!r}" for i, j in pairs])


def written(folder, how):
    """The matrices in files of one format, as arguments of `structure`."""
    files = {"stiffness": K, "mass": M}
    sources, more = [], {"rows": rows_csv(folder)}
    if how == "calculix":
        triangle(K, folder / "job.sti"), triangle(M, folder / "job.mas")
        text(folder / "job.dof", [f"{node}.{k}" for node, k in ROWS])
        return {"sources": [], "job": folder / "job"}
    for of, matrix in files.items():
        name, variable, stored = folder / of, "", "full"
        if how == "matlab":
            name = name.with_suffix(".mat")
            scipy.io.savemat(name, {"A": sp.csc_array(matrix)})
        elif how == "matlab, several":
            name, variable = folder / "all.mat", "K" if of == "stiffness" else "M"
            scipy.io.savemat(name, {"K": sp.csc_array(K), "M": M})
        elif how == "npz":
            name = name.with_suffix(".npz")
            np.savez(name, A=matrix)
        elif how == "npz, lower":
            name, stored = name.with_suffix(".npz"), "lower"
            sp.save_npz(name, sp.csr_array(np.tril(matrix)))
        elif how.startswith("matrix market"):
            name = name.with_suffix(".mtx")
            symmetry = "symmetric" if "symmetric" in how else "general"
            scipy.io.mmwrite(name, sp.coo_array(matrix), precision=17, symmetry=symmetry)
        elif how == "abaqus coordinate":
            name = name.with_suffix(".mtx")
            entries = sp.coo_array(matrix)
            lines = [f"{i + 1}, {j + 1}, {float(v)!r}" for i, j, v in zip(*entries.coords, entries.data)]
            text(name, ["** a comment", *lines])
        else:
            name, more = abaqus(matrix, name.with_suffix(".mtx"), "full" in how), {}
        sources.append(Source(of, of, name, variable=variable, stored=stored))
    return {"sources": sources, **more}


FORMATS = [
    *("calculix", "matlab", "matlab, several", "npz", "npz, lower", "matrix market", "matrix market, symmetric"),
    *("abaqus coordinate", "abaqus", "abaqus, full"),
]


@pytest.mark.parametrize("how", FORMATS)
def test_every_format_gives_the_same_bits(tmp_path, how):
    full, _ = structure(units="m-kg-s", **written(tmp_path, how))
    assert np.array_equal(full.matrix("stiffness", {}).toarray(), K)
    assert np.array_equal(full.matrix("mass", {}).toarray(), M)
    assert list(zip(full.node.tolist(), (full.direction + 1).tolist())) == ROWS


def test_the_brake_of_the_literature():
    brake = brake_fe.brake()
    assert brake.rows == 4669
    assert brake.keys == (brake_fe.SPEED, brake_fe.FRICTION)
    assert [part.matrix.count_nonzero() for part in brake.parts] == [
        93207,
        5682,
        5682,
        66642,
        23884,
        280845,
        21645,
        280871,
    ]
    one = {brake_fe.SPEED: 1.0, brake_fe.FRICTION: 1.0}
    skew = brake.parts[3].matrix
    assert abs(skew + skew.T).max() == 0.0
    assert abs(brake.matrix("mass", one)).max() == 1e3 * 3.065634441901765e-05  # t to kg
