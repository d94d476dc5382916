"""Contacts between faces: areas, normals and interpolation against geometry; the disc that CalculiX made."""

import re
import shutil
import subprocess
from dataclasses import replace

import disc_with_pads
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as sl
from disc_with_pads import contacts, disc, paired
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rig.errors import SceneError
from rig.structure.basis import Reduction, build
from rig.structure.contacts import Contact, contact_points
from rig.structure.full import FRICTION, Full, Part
from rig.structure.mesh import Selection, read_mesh
from rig.structure.read import structure
from rig.structure.rows import contact_rows, node_vector, opened


def lowest(full, count):
    """The lowest frequencies [Hz]."""
    stiffness, mass = full.matrix("stiffness", {}).tocsc(), full.matrix("mass", {}).tocsc()
    start = np.ones(full.rows)
    squares = sl.eigsh(stiffness, count, mass, sigma=-1e6, v0=start, return_eigenvectors=False)
    return np.sqrt(np.sort(squares)) / (2.0 * np.pi)


def test_the_frequencies_are_those_of_calculix():
    full, _ = disc()
    own = disc_with_pads.frequencies()
    assert len(own) == 40
    assert lowest(full, 40) == pytest.approx(own, rel=1e-6)


SECTOR = 0.5 * np.sin(2.0 * np.pi / 60.0)
"""Area of the triangle between the axis and an edge of the disc, over the square of its radius."""


def test_rows_of_inner_nodes_carry_no_mass_of_the_disc():
    """An element C3D8I has three nodes that the input does not name: 9 rows of each of the 1032 elements."""
    full, mesh = disc()
    assert (full.direction == -1).sum() == 9 * 1032
    assert len(mesh.ids) == 1800
    outer = 60 * SECTOR * (0.125**2 - 0.072**2) * 0.012 * 7100.0
    # Elements at the held bore: the square of a motion that grows from 0 to 1 along the radius
    inner = 60 * SECTOR * (0.072**2 - 0.060**2) * 0.012 * 7100.0 * (0.060 / 3 + 0.012 / 4) / 0.066
    pads = 2 * 8 * SECTOR * (0.118**2 - 0.080**2) * (0.010 * 2500.0 + 0.005 * 7850.0)
    moved = (full.direction == 2).astype(float)
    assert moved @ full.matrix("mass", {}) @ moved == pytest.approx(outer + inner + pads, rel=1e-9)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
def test_calculix_makes_the_stored_matrices_again(tmp_path):
    disc_with_pads.DECK["write"](tmp_path)
    for name in ("matrices", "frequencies"):
        subprocess.run(["ccx", "-i", f"disc_{name}"], cwd=tmp_path, check=True, timeout=300, stdout=subprocess.DEVNULL)
    full, _ = structure([], "m-kg-s", job=tmp_path / "disc_matrices", nodes=tmp_path / "disc.inp")
    for part, stored in zip(full.parts, disc()[0].parts):
        assert abs(part.matrix - stored.matrix).max() <= 1e-12 * abs(stored.matrix).max()
    own = disc_with_pads.frequencies(tmp_path / "disc_frequencies.dat")[:40]
    assert lowest(full, 40) == pytest.approx(own, rel=1e-6)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
def test_meshes_that_do_not_match_squeal_alike(tmp_path):
    """The pads turned by half an element of the disc: the contact is interpolated."""
    disc_with_pads.DECK["write"](tmp_path, shift=0.5)
    command = ["ccx", "-i", "disc_matrices"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=300, stdout=subprocess.DEVNULL)
    full, mesh = structure([], "m-kg-s", job=tmp_path / "disc_matrices", nodes=tmp_path / "disc.inp")
    shifted = squeal(full, [contact_points(described, full, mesh) for described in contacts((4, 6))], 0.3)
    matched = squeal(disc()[0], paired((4, 6)), 0.3)
    assert shifted.imag == pytest.approx(matched.imag, rel=0.02)
    assert shifted.real == pytest.approx(matched.real, rel=0.07)


def squeal(full, sides, *mu):
    """The first unstable eigenvalues [rad/s] with 0.2 % damping at 3 kHz, by closed modes and attachment vectors."""
    at = {side.stiffness_key: 1e11 for side in sides}
    reduced = build(replace(full, contacts=tuple(sides)), Reduction(modes=40, at=at))
    damping = 0.002 / (np.pi * 3000.0) * reduced.model.matrix("stiffness", {})
    first = []
    for friction in mu:
        values = reduced.eigenvalues(at | {FRICTION: friction}, damping)[0]
        growing = values[(values.real > 1.0) & (values.imag > 2.0 * np.pi * 1500.0)]
        first.append(growing[np.argmin(growing.imag)])
    return np.array(first)


def test_the_first_squeal_hardly_depends_on_the_number_of_points():
    """An independent program found for all pairs 1567 Hz with 68.5 1/s, and 1566 Hz with 147.4 1/s."""
    full, _ = disc()
    coarse, fine = (squeal(full, paired(points), 0.3, 0.6) for points in ((4, 6), None))
    assert coarse.imag == pytest.approx(fine.imag, rel=0.02)
    assert coarse.real == pytest.approx(fine.real, rel=0.07)
    assert fine.imag == pytest.approx(2.0 * np.pi * np.array([1567.0, 1566.0]), rel=1e-3)
    assert fine.real == pytest.approx(np.array([68.5, 147.4]), rel=0.01)


@pytest.mark.parametrize("points", [(2, 2), (3, 4), (4, 6), None])
def test_rigid_motions_open_no_gap(points):
    full, _ = disc()
    for side in paired(points):
        assert abs(opened(side, full)).max() < 1e-12
        assert side.area.sum() == pytest.approx(8 * SECTOR * (0.118**2 - 0.080**2))
        assert len(side.area) == (45 if points is None else points[0] * points[1])


def test_a_node_of_a_shell_moves_with_the_mean_of_its_rows():
    """CalculiX expands shells and writes the rows of the nodes above each other under one number."""
    full, mesh = disc()
    again = np.flatnonzero(np.isin(full.node, mesh.sets["DISC_UP"]))
    twice = np.r_[np.arange(full.rows), again]
    parts = tuple(replace(part, matrix=part.matrix[twice][:, twice]) for part in full.parts)
    shell = replace(full, parts=parts, node=full.node[twice], direction=full.direction[twice])
    side = contact_points(contacts((4, 6))[0], shell, mesh)
    assert abs(opened(side, shell)).max() < 1e-12
    row = node_vector(shell, [full.node[again[0]]], [0.0, 0.0, 1.0])
    assert row[row != 0.0].tolist() == [0.5, 0.5]


@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
def test_a_force_on_a_shell_moves_it_as_in_calculix(tmp_path):
    """A strip of two elements S4, held at one end: the displacement of a node under one newton."""
    lines = ["*NODE", *[f"{3 * j + i + 1}, {0.1 * i}, {0.1 * j}, 0." for j in range(2) for i in range(3)]]
    lines += ["*ELEMENT, TYPE=S4, ELSET=ALL", "1, 1, 2, 5, 4", "2, 2, 3, 6, 5", "*NSET, NSET=END", "6"]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", "2e11, 0.3", "*DENSITY", "7800."]
    lines += ["*SHELL SECTION, ELSET=ALL, MATERIAL=M", "0.01", "*BOUNDARY", "1, 1, 6", "4, 1, 6"]
    steps = {
        "matrices": ["*FREQUENCY, SOLVER=MATRIXSTORAGE", "1"],
        "static": ["*STATIC", "*CLOAD", "6, 3, 1.", "*NODE PRINT, NSET=END", "U"],
    }
    for name, step in steps.items():
        (tmp_path / f"{name}.inp").write_text("\n".join([*lines, "*STEP", *step, "*END STEP", ""]))
        subprocess.run(["ccx", "-i", name], cwd=tmp_path, check=True, timeout=60, stdout=subprocess.DEVNULL)
    full, _ = structure([], "m-kg-s", job=tmp_path / "matrices", nodes=tmp_path / "static.inp")
    row = node_vector(full, [6], [0.0, 0.0, 1.0])
    moved = row @ sl.spsolve(full.matrix("stiffness", {}).tocsc(), row)
    assert moved == pytest.approx(float((tmp_path / "static.dat").read_text().split()[-1]), rel=1e-6)


FOLLOWING = {
    "*EQUATION": ["*EQUATION", "2", "7,1,1.,8,1,-1."],
    "*MPC": ["*MPC", "MEANROT,7,7,7,8,8,8,11,11,11,99"],
    "*RIGID BODY": ["*RIGID BODY, NSET=END, REF NODE=98"],
    "*COUPLING": [
        "*SURFACE, NAME=S, TYPE=NODE",
        "END",
        "*COUPLING, REF NODE=98, SURFACE=S, CONSTRAINT NAME=C",
        "*KINEMATIC",
        "1,3",
    ],
}


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
@pytest.mark.parametrize("keyword", FOLLOWING)
def test_nodes_that_follow_others_have_the_frequencies_of_calculix(tmp_path, keyword):
    """A bar of six bricks, held at one end."""
    places = [(i, j, k) for i in range(7) for k in range(2) for j in range(2)]
    lines = ["*NODE", *[f"{n}, {0.1 * i}, {0.03 * j}, {0.02 * k}" for n, (i, j, k) in enumerate(places, 1)]]
    lines += ["98, 0.8, 0., 0.", "99, 0., 0., 1.", "*ELEMENT, TYPE=C3D8, ELSET=ALL"]
    lines += [f"{e}, {', '.join(str(4 * (e - 1) + n) for n in (1, 5, 6, 2, 3, 7, 8, 4))}" for e in range(1, 7)]
    lines += ["*NSET, NSET=END", "25, 26, 27, 28", "*MATERIAL, NAME=M"]
    lines += ["*ELASTIC", "2e11, 0.3", "*DENSITY", "7800.", "*SOLID SECTION, ELSET=ALL, MATERIAL=M"]
    lines += [*FOLLOWING[keyword], "*BOUNDARY", "1, 1, 3", "2, 1, 3", "3, 1, 3", "4, 1, 3"]
    for name, step in (("bar_matrices", ", SOLVER=MATRIXSTORAGE"), ("bar_frequencies", "")):
        (tmp_path / f"{name}.inp").write_text("\n".join([*lines, "*STEP", f"*FREQUENCY{step}", "6", "*END STEP", ""]))
        subprocess.run(["ccx", "-i", name], cwd=tmp_path, check=True, timeout=60, stdout=subprocess.DEVNULL)
    full, mesh = structure([], "m-kg-s", job=tmp_path / "bar_matrices", nodes=tmp_path / "bar_matrices.inp")
    assert (mesh.tied, len(mesh.following)) == (("", 1) if keyword == "*EQUATION" else (keyword, 0))
    own = disc_with_pads.frequencies(tmp_path / "bar_frequencies.dat")[:6]
    assert lowest(full, 6) == pytest.approx(own, rel=1e-6)


def exported(side, path):
    """Write the rows of a contact as a CSV file."""
    full, _ = disc()
    lines = ["point,what,node,direction,value"]
    for k in range(len(side.area)):
        for what, rows in (("normal", side.normal), ("along", side.along)):
            row = rows[[k]].tocoo()
            order = np.argsort(-full.node[row.coords[1]], kind="stable")  # the pad has the higher numbers
            for place, value in zip(row.coords[1][order].tolist(), row.data[order].tolist()):
                lines.append(f"{k},{what},{full.node[place]},{'xyz'[full.direction[place]]},{value!r}")
        lines += [f"{k},area,,,{float(side.area[k])!r}", f"{k},radius,,,{float(side.radius[k])!r}"]
    path.write_text("\n".join(lines))
    return path


def test_rows_of_a_file_are_the_contact_that_was_written(tmp_path):
    [up, _] = paired((2, 2))
    read = contact_rows("up", exported(up, tmp_path / "rows.csv"), disc()[0])
    for name in ("normal", "along"):
        assert abs(getattr(read, name) - getattr(up, name)).max() == 0.0
    assert np.array_equal(read.area, up.area)
    assert np.array_equal(read.radius, up.radius)
    assert read.position == pytest.approx(up.position, abs=1e-3)
    assert (read.sliding * up.sliding).sum(axis=1) == pytest.approx(1.0, abs=0.05)


def test_rows_of_a_file_are_refused_all_at_once(tmp_path):
    path = exported(paired((2, 2))[0], tmp_path / "rows.csv")
    good = path.read_text().splitlines()
    bad = ["9,normal,1,z,1", good[1], "9,area,,,-1", "9,normal,1600,q,1", "9,normal"]
    path.write_text("\n".join(good + bad))
    with pytest.raises(SceneError) as refusal:
        contact_rows("up", path, disc()[0])
    first = len(good)
    words = ["no row of 1 z", "in a line before too", "-1", "1600,q", "expected POINT"]
    for number, word in enumerate(words, 1):
        assert any(f"rows.csv, line {first + number}: " in fault and word in fault for fault in refusal.value.faults)
    assert len(refusal.value.faults) >= len(bad)


def test_a_row_that_a_rigid_motion_opens_is_refused(tmp_path):
    """A pad node against a disc node beside it, as the nearest nodes of other meshes are; and weights with a fault."""
    _, mesh = disc()
    pad = int(mesh.sets["PAD_UP"][0])
    near = [int(node) for node in mesh.sets["DISC_UP"]]
    away = np.linalg.norm(mesh.xyz[mesh.at(np.array(near))] - mesh.xyz[mesh.at(np.array([pad]))], axis=1)
    order = np.argsort(away)
    beside, at = near[int(order[1])], near[int(order[0])]
    along = f"1,along,{pad},y,1\n1,along,{at},y,-1\n1,area,,,1e-4\n"
    for other, weight, word in ((at, -1.0, ""), (beside, -1.0, "rad"), (at, -0.7, "displacement")):
        path = tmp_path / "rows.csv"
        path.write_text(f"1,normal,{pad},z,1\n1,normal,{other},z,{weight}\n{along}")
        if not word:
            contact_rows("up", path, disc()[0])
            continue
        with pytest.raises(SceneError, match=f"point 1: .*{word}"):
            contact_rows("up", path, disc()[0])


BRICK = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 0, 2], [2, 0, 2], [2, 2, 2], [0, 2, 2]])
"""Corners of a cell of a lattice whose odd numbers are midside nodes."""
TETRAHEDRA = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
WEDGES = [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)]
SQUARE = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
RINGS = {
    4: [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)],
    6: [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
    8: SQUARE,
}
"""The edges of an element by the number of its corners, in the order of their midside nodes."""
CELLS = {
    "C3D8I": ([tuple(range(8))], False),
    "C3D20R": ([tuple(range(8))], True),
    "C3D4": (TETRAHEDRA, False),
    "C3D10": (TETRAHEDRA, True),
    "C3D6": (WEDGES, False),
    "C3D15": (WEDGES, True),
}


class Blocks:
    """Input of bodies of bricks."""

    def __init__(self):
        self.nodes, self.elements, self.lines = {}, 0, ["*HEADING", "two blocks", "** a comment"]

    def add(self, name, kind, counts, low, high):
        """A box of elements of one kind; its nodes are the set `name`."""
        cells, middles = CELLS[kind]
        numbers, elements = {}, []
        for cell in np.ndindex(*counts):
            corners = BRICK + 2 * np.array(cell)
            for part in cells:
                ends = RINGS[len(part)] if middles else []
                places = [*corners[list(part)], *[(corners[part[i]] + corners[part[j]]) // 2 for i, j in ends]]
                elements.append(
                    [numbers.setdefault(tuple(map(int, place)), len(self.nodes) + len(numbers) + 1) for place in places]
                )
        low, high = np.array(low, float), np.array(high, float)
        for place, number in numbers.items():
            self.nodes[number] = low + (high - low) * np.array(place) / (2.0 * np.array(counts))
        self.lines += [
            f"*Node, nset={name}",
            *[f"{n}, {', '.join(map(repr, self.nodes[n].tolist()))}" for n in numbers.values()],
        ]
        self.lines += [f"*ELEMENT, type={kind}, ELSET=E_{name}"]
        for nodes in elements:
            self.elements += 1
            words = [str(self.elements), *map(str, nodes)]
            self.lines += [
                ", ".join(words[:9]) + "," * (len(words) > 9),
                *([", ".join(words[9:])] if len(words) > 9 else []),
            ]
        return self

    def read(self, folder, turn=None):
        """The mesh, turned, and a structure in which every node moves."""
        (folder / "blocks.inp").write_text("\n".join(self.lines) + "\n")
        mesh = read_mesh(folder / "blocks.inp", 1.0)
        turn = np.eye(3) if turn is None else turn
        mesh = replace(mesh, xyz=mesh.xyz @ turn.T, within=mesh.within @ turn.T)
        identity = sp.eye_array(3 * len(mesh.ids), format="csr")
        node, direction = np.repeat(mesh.ids, 3), np.tile(np.arange(3), len(mesh.ids))
        return Full((Part("M", "mass", identity),), node, direction, mesh.ids, mesh.xyz), mesh


def pad_on_plate(kind="C3D8I", gap=0.0, low=(0.2, 0.3), high=(0.7, 0.9), cells=(3, 4)):
    """A pad above the plate z < 0, the meshes of which do not match."""
    blocks = Blocks().add("PLATE", kind, (5, 5, 1), (0, 0, -0.2), (1, 1, 0))
    return blocks.add("PAD", kind, (*cells, 1), (*low, gap), (*high, gap + 0.2))


def contact(points=None, **changes):
    described = {"normal": (0.0, 0.0, 1.0), "sliding": (1.0, 0.0, 0.0), "search": 0.01}
    return Contact("pad", Selection(set="pad"), Selection(set="plate"), points=points, **described | changes)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -2.0), "face"])
@pytest.mark.parametrize("kind", CELLS)
def test_areas_are_positive_and_linear_motions_open_no_gap(tmp_path, kind, normal):
    full, mesh = pad_on_plate(kind).read(tmp_path)
    bottom = Selection(box=((0.2, 0.3, -0.01), (0.7, 0.9, 0.01)))
    points = contact_points(replace(contact(normal=normal), slave=bottom), full, mesh)  # without those of the plate
    assert points.area.min() > 0.0
    assert points.area.sum() == pytest.approx(0.5 * 0.6)
    assert points.area @ points.position == pytest.approx(0.3 * np.array([0.45, 0.6, 0.0]), abs=1e-12)
    slope = np.random.default_rng(3).standard_normal((3, 3))
    moved = (mesh.xyz @ slope.T + slope[0]).ravel()
    assert abs(points.normal @ moved).max() < 1e-12
    assert abs(points.along @ moved).max() < 1e-12
    lifted = (mesh.xyz[:, 2] >= -1e-9) * np.isin(mesh.ids, mesh.sets["PAD"])
    assert points.normal @ (lifted[:, None] * [0.3, 0.2, 1.0]).ravel() == pytest.approx(1.0)
    assert points.along @ (lifted[:, None] * [0.3, 0.2, 1.0]).ravel() == pytest.approx(0.3)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), "face"])
def test_of_a_whole_body_only_the_faces_that_meet_the_other_take_part(tmp_path, normal):
    full, mesh = pad_on_plate(gap=1e-3).read(tmp_path)
    points = contact_points(contact(normal=normal), full, mesh)
    assert points.area.sum() == pytest.approx(0.5 * 0.6)
    assert points.position[:, 2] == pytest.approx(1e-3)
    assert abs(opened(points, full)).max() < 1e-12


def test_what_hangs_over_the_edge_does_not_touch(tmp_path):
    full, mesh = pad_on_plate(low=(0.5, 0.0), high=(1.5, 1.0), cells=(4, 2)).read(tmp_path)
    points = contact_points(contact(), full, mesh)
    assert points.position[:, 0].max() == pytest.approx(1.0)
    assert 0.5 <= points.area.sum() <= 0.625  # half of the pad, and at most what its nodes at the edge share
    assert points.met.doubts == ()


def test_what_meets_the_master_beyond_its_edge_is_doubted(tmp_path):
    """Half of the pad hangs over the edge. Of a face three triangles of four have their middle within 0.15 m of it."""
    full, mesh = pad_on_plate(low=(0.5, 0.0), high=(1.5, 1.0), cells=(4, 2)).read(tmp_path)
    met = contact_points(contact(search=0.15), full, mesh).met
    [(what, remedy)] = met.doubts  # and none of the back of the pad, although the plate is in reach behind it
    assert "0.188 m^2 of the area met hang over the edge of the master by up to 0.125 m" in what
    assert remedy == "lower contacts.pad.search, or leave these nodes out of the slave"


def test_a_normal_points_from_the_master_into_the_slave():
    up, down = paired((2, 2))
    for side, sense in ((up, 1.0), (down, -1.0)):
        full, mesh = disc()
        nodes = mesh.sets["PAD_UP" if sense > 0 else "PAD_DOWN"]
        lifted = node_vector(full, nodes.tolist(), (0.0, 0.0, sense)) * len(nodes)
        assert side.normal @ lifted == pytest.approx(1.0)
        assert np.sign(side.along @ node_vector(full, nodes.tolist(), (0.0, 1.0, 0.0))).tolist() == [1.0] * 4


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["C3D8I", "C3D10"]), st.floats(0.0, 5e-3))
def test_a_turned_structure_has_turned_rows(tmp_path_factory, seed, kind, gap):
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    folder = tmp_path_factory.mktemp("turned")
    blocks = pad_on_plate(kind, gap)
    full, mesh = blocks.read(folder)
    turned, other = blocks.read(folder, turn)
    first = contact_points(contact((2, 3)), full, mesh)
    second = contact_points(contact((2, 3), normal=tuple(turn[:, 2]), sliding=tuple(turn[:, 0])), turned, other)
    assert second.area == pytest.approx(first.area)
    for name in ("normal", "along"):
        rows = (getattr(first, name).toarray().reshape(len(first.area), -1, 3) @ turn.T).reshape(len(first.area), -1)
        assert getattr(second, name).toarray() == pytest.approx(rows, abs=1e-9)


def test_other_meshes_meet_by_interpolation(tmp_path):
    """Pads turned by half an element: nearest nodes would open by 5 mm per radian."""
    disc_with_pads.DECK["write"](tmp_path, shift=0.5)
    mesh = read_mesh(tmp_path / "disc.inp", 1.0)
    full, _ = disc()
    full = replace(full, xyz=mesh.xyz)
    for described in contacts((3, 4)):
        points = contact_points(described, full, mesh)
        assert abs(opened(points, full)).max() < 1e-12
        assert points.area.sum() == pytest.approx(8 * SECTOR * (0.118**2 - 0.080**2))


def test_nodes_without_elements_meet_too(tmp_path):
    full, mesh = pad_on_plate().read(tmp_path)
    bare = replace(mesh, faces=np.zeros((0, 8), dtype=np.int64), within=np.zeros((0, 3)))
    sides = {
        name: Selection(
            nodes=tuple(mesh.ids[(abs(mesh.xyz[:, 2]) < 1e-9) & np.isin(mesh.ids, mesh.sets[name.upper()])])
        )
        for name in ("pad", "plate")
    }
    points = contact_points(replace(contact(), slave=sides["pad"], master=sides["plate"]), full, bare)
    assert points.area.sum() == pytest.approx(0.5 * 0.6)
    assert abs(opened(points, full)).max() < 1e-12


def test_two_contacts_may_share_nodes_and_a_held_master_does_not_move(tmp_path):
    full, mesh = pad_on_plate().read(tmp_path)
    free = np.isin(full.node, mesh.sets["PAD"])
    held = replace(
        full,
        node=full.node[free],
        direction=full.direction[free],
        parts=(Part("M", "mass", sp.eye_array(int(free.sum()), format="csr")),),
    )
    both = [contact_points(contact((2, 2)), held, mesh), contact_points(contact(), held, mesh)]
    for points in both:
        assert points.normal.sum(axis=1) == pytest.approx(1.0)
    with pytest.raises(SceneError, match=r"node .* is held, or follows others by \*TIE; .*keep tied nodes out"):
        contact_points(contact(), held, replace(mesh, tied="*TIE"))
    flat = replace(full, direction=np.where(free & (full.direction == 2), -1, full.direction))
    of_pad = frozenset(mesh.sets["PAD"].tolist())
    for tied, following, why in (
        ("*MPC", frozenset(), "is held, or follows others by .MPC"),
        ("", of_pad, "follows others by .EQUATION"),
    ):
        follow = replace(mesh, tied=tied, following=following)
        with pytest.raises(SceneError, match=rf"node \d+ {why}"):
            contact_points(contact(), flat, follow)
        two = mesh.sets["PAD"][:2].tolist()
        assert (
            node_vector(flat, two, (1.0, 0.0, 1.0)).sum() == node_vector(flat, two, (1.0, 0.0, -1.0), mesh).sum() > 0.0
        )
        assert node_vector(flat, two, (1.0, 0.0, 0.0), follow).sum() == pytest.approx(1.0)
        with pytest.raises(
            SceneError, match=rf"node {two[0]} and 1 others are held or moved by others .* along .1, 0, 1."
        ):
            node_vector(flat, two, (1.0, 0.0, 1.0), follow)


BAD = [
    ({"slave": Selection(set="pads")}, "slave: the mesh has no node set 'pads'; it has: PAD"),
    (
        {"master": Selection(box=((5, 5, 5), (6, 6, 6)))},
        "master: no node lies in the box; the mesh extends over 0 to 1 m",
    ),
    ({"slave": Selection(nodes=(1, 9999))}, "slave: the mesh has no node 9999"),
    ({"slave": Selection(nodes=(73,))}, "slave: none of the outer faces has all its nodes among the 1 chosen"),
    ({"slave": Selection()}, "slave: no nodes are given"),
    ({"normal": (1.0, 0.0, 0.0), "sliding": (0.0, 1.0, 0.0)}, "no pair lies within search = 0.01 m: "),
    ({"sliding": (0.0, 0.0, 1.0)}, "the sliding at node .* points along the normal"),
    ({"sliding": None, "axis": (0.0, 0.0, 1.0), "centre": (0.2, 0.3, 0.0)}, "node .* lies on the axis"),
    ({"slave": Selection(set="plate")}, "72 nodes are slave and master, the first is 1"),
    (
        {"slave": Selection(box=((0, 0, -1), (1, 1, 1))), "master": Selection(box=((0, 0, -1), (1, 1, 0)))},
        r"slave and master, the first is 1; .* of their own \(a box leaves out those of a set or a list\)",
    ),
    ({"search": 1e-9}, "no pair lies within search = 1e-09 m: the closest slave node, .*, has a gap of 0.001 m"),
]


@pytest.mark.parametrize(("changes", "fault"), BAD)
def test_a_contact_that_cannot_be_is_refused(tmp_path, changes, fault):
    full, mesh = pad_on_plate(gap=1e-3).read(tmp_path)
    with pytest.raises(SceneError) as refusal:
        contact_points(replace(contact(), **changes), full, mesh)
    assert refusal.value.where == "contacts.pad"
    assert re.search(fault, "\n".join(refusal.value.faults))
