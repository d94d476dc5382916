"""Matrices of every format are the same matrices; faults name file and row, all at once."""

import re

import disc_with_pads
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.errors import SceneError
from rig.structure.mesh import read_mesh
from rig.structure.read import Source, files_read, structure

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
            stored_as = matrix if "array" in how else sp.coo_array(matrix)
            scipy.io.mmwrite(name, stored_as, precision=17, symmetry=symmetry)
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
    *("matrix market, array", "matrix market, array, symmetric", "abaqus coordinate", "abaqus", "abaqus, full"),
]


@pytest.mark.parametrize("how", FORMATS)
def test_every_format_gives_the_same_bits(tmp_path, how):
    full, _ = structure(units="m-kg-s", **written(tmp_path, how))
    assert np.array_equal(full.matrix("stiffness", {}).toarray(), K)
    assert np.array_equal(full.matrix("mass", {}).toarray(), M)
    assert list(zip(full.node.tolist(), (full.direction + 1).tolist())) == ROWS


@pytest.mark.parametrize("kind", [np.array, sp.coo_array])
def test_half_of_a_skew_matrix_of_matrix_market_is_completed(tmp_path, kind):
    skew = np.triu(K, 1) - np.triu(K, 1).T
    scipy.io.mmwrite(tmp_path / "skew.mtx", kind(skew), precision=17, symmetry="skew-symmetric")
    full, _ = structure([*parts(tmp_path), Source("turning", "damping", tmp_path / "skew.mtx")], "m-kg-s")
    assert np.array_equal(full.matrix("damping", {}).toarray(), skew)


def parts(folder, **matrices):
    """The matrices as Matrix Market files; those that are not given are whole."""
    sources = []
    for of, matrix in ({"stiffness": K, "mass": M} | matrices).items():
        scipy.io.mmwrite(folder / f"{of}.mtx", sp.coo_array(matrix), precision=17, symmetry="general")
        sources.append(Source(of, of, folder / f"{of}.mtx"))
    return sources


def refused(sources, units="m-kg-s", **more):
    with pytest.raises(SceneError) as refusal:
        structure(sources, units, **more)
    return refusal.value.faults


def changed(matrix, *entries):
    matrix = matrix.copy()
    for i, j, value in entries:
        matrix[i, j] = value
    return matrix


MATRICES = [
    ("stiffness", np.triu(K), r'stiffness.mtx \(stiffness\): .* upper triangle only; write stored = "upper"'),
    ("mass", np.tril(M), r'mass.mtx \(mass\): .* lower triangle only; write stored = "lower"'),
    ("stiffness", changed(K, (0, 2, -2e4 + 1e-4)), r"row 1 \(node 1, direction x\) and row 3 .* differ by 0.0001"),
    ("mass", changed(M, (3, 3, 0.0)), r"row 4 \(node 2, direction y\) has the mass 0; it must be positive"),
    ("mass", changed(M, (0, 0, -1.0), (4, 4, 0.0)), r"row 1 .* has the mass -1"),
    ("mass", changed(M, (0, 1, 1.5), (1, 0, 1.5)), r"not positive: the entry of row 1 .* and row 2 .* is larger than"),
    (
        "mass",
        changed(np.eye(5), *[(i, j, -0.5) for i in range(5) for j in range(5) if i != j]),
        "not positive: 1 motion with",
    ),
    ("mass", 1e6 * M, r"total mass along x is 3.25e\+06 kg; expected 1e-06 to 1e\+06 kg. Is structure.units"),
    ("mass", 1e-7 * M, r"total mass along x is 3.25e-07 kg"),
    ("stiffness", changed(K, (4, 4, np.nan)), "1 entries that are not finite: row 5, column 5"),
    ("stiffness", K[:4], "has 4 rows and 5 columns; expected a square matrix"),
    ("stiffness", K[:4, :4], r"mass.mtx \(mass\): has 5 rows, but stiffness.mtx \(stiffness\) has 4"),
    ("stiffness", K + 1j * K, "stiffness.mtx: is complex; write the real and the imaginary part as two parts"),
]


@pytest.mark.parametrize(("of", "matrix", "fault"), MATRICES)
def test_a_matrix_that_cannot_be_is_refused_with_its_rows(tmp_path, of, matrix, fault):
    faults = refused(parts(tmp_path, **{of: matrix}), rows=rows_csv(tmp_path))
    assert re.search(fault, "\n".join(faults))


@pytest.mark.parametrize(("beside", "positive"), [(0.0, True), (0.499, True), (0.502, False)])
def test_the_mass_of_many_rows_is_positive_or_refused(beside, positive):
    """A band matrix: its smallest eigenvalue is 1 - 2 beside cos(pi / 401)."""
    band = sp.diags_array([np.full(399, beside), np.ones(400), np.full(399, beside)], offsets=[-1, 0, 1]).toarray()
    sources = [Source("K", "stiffness", values=np.eye(400)), Source("M", "mass", values=band)]
    if positive:
        structure(sources, "m-kg-s")
    else:
        assert "not positive: 11 motions with a negative mass" in refused(sources)[0]


def test_rounding_of_a_writer_is_no_fault(tmp_path):
    structure(parts(tmp_path, stiffness=changed(K, (0, 2, -2e4 * (1 + 1e-12)))), "m-kg-s")


def test_what_friction_adds_may_be_unsymmetric_and_gyroscopic_matrices_skew(tmp_path):
    skew = np.triu(K, 1) - np.triu(K, 1).T
    friction = Source("friction", "stiffness", values=np.triu(K, 1), key="friction.mu")
    full, _ = structure([*parts(tmp_path), friction, Source("turning", "damping", values=skew)], "m-kg-s")
    assert full.keys == ("friction.mu",)
    assert np.array_equal(full.matrix("stiffness", {"friction.mu": 0.5}).toarray(), K + 0.5 * np.triu(K, 1))
    assert np.array_equal(full.matrix("damping", {"friction.mu": 0.5}).toarray(), skew)


def test_half_of_any_matrix_of_a_file_is_refused(tmp_path):
    skew = np.triu(K, 1)
    halves = {"damping": np.triu(K), "turning": skew, "speed": np.tril(K), "friction": skew}
    sources = parts(tmp_path, **halves)[:2]
    for name in halves:
        key = "drive.speed" if name in ("speed", "friction") else ""
        sources.append(Source(name, "stiffness" if key else "damping", tmp_path / f"{name}.mtx", key=key))
    faults = refused(sources)
    assert len(faults) == 3  # friction alone may be one triangle
    words = ['upper triangle only; write stored = "upper"', "half of a skew one", 'write stored = "lower"']
    assert all(word in fault for word, fault in zip(words, faults))


def test_a_row_of_a_node_below_the_last_that_the_mesh_lacks_is_refused(tmp_path):
    mesh = text(tmp_path / "mesh.inp", ["*NODE", "1, 0, 0, 0", "3, 1, 0, 0"])
    [fault] = refused(parts(tmp_path), rows=rows_csv(tmp_path), nodes=mesh)
    assert fault.startswith("row 3 belongs to node 2, which mesh.inp does not have, and 1 more")


def spoiled(folder, name, change):
    """A whole job of CalculiX and matrices beside it, one file of which is changed."""
    written(folder, "calculix")
    for of in ("stiffness", "mass"):
        scipy.io.savemat(folder / f"{of}.mat", {"A": K if of == "stiffness" else M})
        np.savez(folder / f"{of}.npz", A=K if of == "stiffness" else M)
    parts(folder), rows_csv(folder)
    path = folder / name
    content = path.read_bytes()
    path.write_bytes(change(content))
    suffix = path.suffix
    if suffix in (".sti", ".mas", ".dof"):
        return refused([], job=folder / "job")
    suffix = ".mtx" if suffix == ".csv" else suffix
    sources = [Source(of, of, folder / f"{of}{suffix}") for of in ("stiffness", "mass")]
    return refused(sources, rows=folder / "rows.csv")


def line(number, text):
    """Replaces a line of a text file."""

    def change(content):
        lines = content.decode().splitlines()
        lines[number - 1 : number] = [text] if text else []
        return ("\n".join(lines) + "\n").encode()

    return change


FILES = [
    ("job.sti", lambda content: content[:-3], "job.sti: is truncated: its last line does not end"),
    ("job.mas", line(2, "1 2 x"), "job.mas, line 2: is '1 2 x'; expected 3 numbers"),
    ("job.mas", line(2, "1 2 nan"), r"job.mas .*: has 1 entries that are not finite: .*; CalculiX .* nonlinear \*MPC"),
    ("job.sti", line(1, "2 1 4"), "stored is 'upper', but row 2 has an entry in column 1"),
    (
        "job.dof",
        line(5, "3.1\n4.1"),
        "job.sti: 1 of 6 rows have no entry, the last with one is 5; the file is truncated",
    ),
    ("stiffness.mtx", lambda content: content[: len(content) // 2], "stiffness.mtx: is truncated"),
    ("stiffness.mtx", line(1, "%%MatrixMarket matrix coordinate pattern general"), "its first line says .*pattern"),
    ("stiffness.mat", lambda content: b"not from MATLAB", "stiffness.mat: cannot be read"),
    ("stiffness.mat", lambda content: content[:124] + b"\x00\x02" + content[126:], "MATLAB v7.3 file; write it with"),
    ("stiffness.npz", lambda content: content[: len(content) // 2], "stiffness.npz: cannot be read"),
    ("mass.mtx", lambda content: b"1,1,1,1\n", "is no matrix of Abaqus or Matrix Market: '1,1,1,1'"),
    ("rows.csv", line(4, "2,w"), "rows.csv, line 4: is '2,w'; expected NODE, DIRECTION"),
    ("rows.csv", line(4, "1,y"), "rows.csv, line 4: node 1 has its direction y in line 3 too"),
]


@pytest.mark.parametrize(("name", "change", "fault"), FILES)
def test_a_damaged_file_is_refused_with_its_line(tmp_path, name, change, fault):
    assert re.search(fault, "\n".join(spoiled(tmp_path, name, change)))


def test_all_faults_of_all_files_are_reported_at_once(tmp_path):
    sources = [
        *parts(tmp_path),
        Source("damping", "damping", tmp_path / "damping.op4"),
        Source("friction", "stiffness", tmp_path / "missing.mtx"),
    ]
    (tmp_path / "damping.op4").write_text("binary")
    mesh = text(tmp_path / "mesh.inp", ["*NODE", "1, 0., 0.", "2, a, 0., 0."])
    rows = text(tmp_path / "rows.csv", ["1,x", "1,u", "2"])
    faults = refused(sources, rows=rows, nodes=mesh, job=tmp_path / "none")
    words = ["mesh.inp, line 3", "damping.op4: is of an unknown format", "missing.mtx: cannot be"]
    words += [f"none.{suffix}: cannot be read" for suffix in ("sti", "mas", "dof")]
    for word in [*words, "rows.csv, line 2", "rows.csv, line 3"]:
        assert sum(word in fault for fault in faults) == 1
    [advice] = [fault for fault in faults if "unknown format" in fault]
    assert all(program in advice for program in ("Abaqus", "Ansys", "Nastran", "COMSOL"))


def test_units_of_millimetres_and_tonnes_become_si(tmp_path):
    """Two translations and a turn: N/mm, N, N mm; t, t mm, t mm^2."""
    of_turn = np.array([[3.0, 0.5, 0.25], [0.5, 2.0, -0.5], [0.25, -0.5, 1.0]])
    sources = [Source(of, of, values=of_turn) for of in ("mass", "stiffness")]
    rows = text(tmp_path / "rows.csv", ["1,x", "1,2", "1,rz"])
    full, mesh = structure(sources, "mm-t-s", rows=rows, nodes=text(tmp_path / "nodes.csv", ["node,x,y,z", "1,1,2,3"]))
    expected = of_turn * [[1e3, 1e3, 1.0], [1e3, 1e3, 1.0], [1.0, 1.0, 1e-3]]
    for of in ("mass", "stiffness"):
        assert full.matrix(of, {}).toarray() == pytest.approx(expected, rel=1e-15)
    assert full.direction.tolist() == [0, 1, 5]
    assert mesh.xyz == pytest.approx(np.array([[1e-3, 2e-3, 3e-3]]))


def test_units_that_do_not_fit_mass_and_size_are_refused(tmp_path):
    job, mesh = disc_with_pads.unpacked(tmp_path), tmp_path / "disc.inp"
    assert (
        "3341 kg, and the mesh extends over 0.00025 m; nothing is so heavy"
        in refused([], "mm-t-s", job=job, nodes=mesh)[0]
    )
    words = [line.split(",") for line in mesh.read_text().splitlines()[1:1801]]
    lines = [f"{n}, {', '.join(str(1e3 * float(x)) for x in place)}" for n, *place in words]
    nodes = text(tmp_path / "mm.inp", ["*NODE", *lines])
    assert "3.341 kg, and the mesh extends over 250 m; nothing is so light" in refused([], job=job, nodes=nodes)[0]


def test_matrices_of_abaqus_with_held_and_inner_rows(tmp_path):
    """A held row has 1e36 on its diagonal; an inner node has a negative number; rows may have an order of their own."""
    lines = ["2,1,2,1,5.", "2,1,1,1,-2.", "1,1,1,1,3.", "1,2,1,2,1e36", "-4,1,-4,1,7.", "-4,1,1,1,-1."]
    stiffness = text(tmp_path / "k.mtx", lines)
    mass = text(tmp_path / "m.mtx", ["1,1,1,1,1.", "1,2,1,2,1.", "2,1,2,1,1.", "-4,1,-4,1,1."])
    full, _ = structure([Source("K", "stiffness", stiffness), Source("M", "mass", mass)], "m-kg-s")
    assert full.node.tolist() == [-4, 1, 2]
    assert full.direction.tolist() == [-1, 0, 0]
    assert full.matrix("stiffness", {}).toarray().tolist() == [[7.0, -1.0, 0.0], [-1.0, 3.0, -2.0], [0.0, -2.0, 5.0]]


def test_rows_in_any_order_and_without_a_node(tmp_path):
    rows = text(tmp_path / "rows.csv", ["\ufeffrow;node;direction", "2;1;y", "1;1;x", "5;3;x", "4;2;2", "3;0;"])
    full, _ = structure(parts(tmp_path), "m-kg-s", rows=rows)
    assert full.node.tolist() == [1, 1, 0, 2, 3]
    assert full.direction.tolist() == [0, 1, -1, 1, 0]


def test_the_keywords_of_an_input_file(tmp_path):
    lines = [
        "*NODE, NSET=All",
        "1, 0., 0., 0.",
        "2, 1., 0., 0.",
        "3, 1., 1.",
        "4, , 1., 0.",
        "*include, input=more.inp",
    ]
    text(tmp_path / "more.inp", ["*node", *[f"{k + 10}, {k % 2}., {k // 2}., 1." for k in range(4)]])
    lines += ["*ELEMENT, TYPE=S4R,", " ELSET=Shell", "7, 1, 2, 3,", "4", "*ELEMENT, TYPE=SPRING1, ELSET=s", "8, 1"]
    lines += ["*NSET, NSET=Even, GENERATE", "2, 4, 2", "*NSET, NSET=both", "EVEN, 13,", "*Nset, nset=of, elset=SHELL"]
    lines += ["*EQUATION", "3", "12, 3, 1., 1, 3, -0.5", "2, 3, -0.5", "2", "EVEN, 1, 1., 3, 1, -1."]
    lines += ["** *NODE", "*MATERIAL, NAME=x", "*ELASTIC", "1e11, 0.3"]
    mesh = read_mesh(text(tmp_path / "mesh.inp", lines), 1e-3)
    assert mesh.ids.tolist() == [1, 2, 3, 4, 10, 11, 12, 13]
    assert mesh.xyz[2:5].tolist() == [[1e-3, 1e-3, 0.0], [0.0, 1e-3, 0.0], [0.0, 0.0, 1e-3]]
    sets = {name: nodes.tolist() for name, nodes in mesh.sets.items()}
    assert sets == {"ALL": [1, 2, 3, 4], "EVEN": [2, 4], "BOTH": [2, 4, 13], "OF": [1, 2, 3, 4]}
    assert mesh.following == {2, 4, 12}
    assert mesh.faces.tolist() == [[0, 1, 2, 3, -1, -1, -1, -1]]
    read = files_read([], nodes=tmp_path / "mesh.inp", job=None)
    assert [path.name for path in read] == ["mesh.inp", "more.inp"]


def test_a_surface_is_the_set_of_its_nodes(tmp_path):
    lines = ["*NODE", *[f"{k + 1}, {k % 2}, {k // 2 % 2}, {k // 4}" for k in range(8)], "9,0.5,0,0"]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=BODY", "1, 1,2,4,3, 5,6,8,7", "*ELEMENT, TYPE=S3, ELSET=SKIN", "2, 1,2,9"]
    lines += ["*SURFACE, NAME=top", "BODY, S2", "*SURFACE, NAME=side, TYPE=ELEMENT", "1, S3", "*SURFACE, NAME=Skin"]
    lines += ["SKIN, SPOS", "*NSET, NSET=pair", "2, 3", "*SURFACE, NAME=both, TYPE=NODE", "PAIR, 1.", "8,"]
    lines += ["*ELEMENT, TYPE=C3D10", "3, 1,2,3,5, 9,6,7,8,4,2", "*SURFACE, NAME=pair", "3, S2"]
    sets = {name: nodes.tolist() for name, nodes in read_mesh(text(tmp_path / "m.inp", lines), 1.0).sets.items()}
    expected = {"TOP": [5, 6, 7, 8], "SIDE": [1, 2, 5, 6], "SKIN": [1, 2, 9], "BOTH": [2, 3, 8], "PAIR": [2, 3]}
    assert sets == expected
    lines[-2] = "*SURFACE, NAME=face"
    assert read_mesh(text(tmp_path / "m.inp", lines), 1.0).sets["FACE"].tolist() == [1, 2, 4, 5, 8, 9]


MESHES = [
    (["*NODE", "1,0,0,0", "*NSET", "1"], r"line 4: .* \*NSET has no name, NSET="),
    (["*NODE", "1,0,0,0", "*SURFACE, NAME=s", "pads, S1"], "line 4: .* set pads is not defined before"),
    (["*NODE", "1,0,0,0", "1,0,0,1"], "line 3: .* node 1 has another place before"),
    (["*NODE", "1,0,0,nan"], "line 2: .* a coordinate is not finite"),
    (["*NODE", "1,0,0,0", "*NSET, NSET=a", "1, 5"], "set A contains node 5, which is not in the mesh"),
    (["*NODE", "1,0,0,0", "*ELEMENT, TYPE=C3D4", "1,1,1,1,2"], "element 1 has node 2, which is not in the mesh"),
    (["*NODE", "1,0,0,0", "*ELEMENT, TYPE=C3D4", "1,1,1,1,1,1"], "line 4: .* expected 4 nodes"),
    (["*PART, NAME=p", "*NODE", "1,0,0,0"], r"line 1: .* \*PART makes or moves nodes; write a flat input"),
    (["*NODE", "1,0,0,0", "*ELEMENT, TYPE=S9R5", "1,1,1"], "line 3: .* this element type is not known"),
    (["*INCLUDE, INPUT=mesh.inp"], "include each other"),
    (["*INCLUDE, INPUT=other.inp"], "other.inp: cannot be read: No such file"),
]


@pytest.mark.parametrize(("lines", "fault"), MESHES)
def test_an_input_file_that_cannot_be_is_refused(tmp_path, lines, fault):
    with pytest.raises(SceneError) as refusal:
        read_mesh(text(tmp_path / "mesh.inp", lines), 1.0)
    assert re.search(f"(mesh|other).inp.*{fault}|^{fault}", "\n".join(refusal.value.faults))


entries = st.dictionaries(st.tuples(st.integers(0, 7), st.integers(0, 7)), st.floats(-1e3, 1e3), max_size=20)


@settings(max_examples=30, deadline=None)
@given(entries, st.permutations(range(8)), st.randoms(use_true_random=False))
def test_half_of_a_matrix_is_the_same_in_any_order_of_nodes_and_lines(tmp_path_factory, offered, numbers, chance):
    """Abaqus: each entry may be given as it is or mirrored, the lines and the nodes may have any order."""
    folder = tmp_path_factory.mktemp("abaqus")
    matrix = np.diag(np.arange(1.0, 9.0) * 1e4)
    for (i, j), value in offered.items():
        if i != j:
            matrix[i, j] = matrix[j, i] = value
    lines = []
    for i in range(8):
        for j in range(i + 1):
            a, b = chance.sample((i, j), 2)
            if matrix[i, j]:
                lines.append(f"{numbers[a] + 1},1,{numbers[b] + 1},1,{float(matrix[i, j])!r}")
    chance.shuffle(lines)
    full, _ = structure(
        [
            Source("K", "stiffness", text(folder / "k.mtx", lines)),
            Source("M", "mass", text(folder / "m.mtx", [f"{k},1,{k},1,1." for k in range(1, 9)])),
        ],
        "m-kg-s",
    )
    order = np.argsort(numbers)
    assert np.array_equal(full.matrix("stiffness", {}).toarray(), matrix[np.ix_(order, order)])
