"""Contacts between faces: areas, normals and interpolation against geometry; the disc that CalculiX made."""

import shutil
import subprocess

import disc_with_pads
import numpy as np
import pytest
import scipy.sparse.linalg as sl
from disc_with_pads import disc, paired

from rig.errors import SceneError
from rig.structure.contacts import contact_rows, opened
from rig.structure.read import structure


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


@pytest.mark.parametrize("points", [(2, 2), (3, 4), (4, 6), None])
def test_rigid_motions_open_no_gap(points):
    full, _ = disc()
    for side in paired(points):
        assert abs(opened(side, full)).max() < 1e-12
        assert side.area.sum() == pytest.approx(8 * SECTOR * (0.118**2 - 0.080**2))
        assert len(side.area) == (45 if points is None else points[0] * points[1])


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
    bad = ["9,normal,1,z,1", "9,along,77777,x,1", "9,area,,,-1", "9,normal,1600,q,1", "9,normal"]
    path.write_text("\n".join(good + bad))
    with pytest.raises(SceneError) as refusal:
        contact_rows("up", path, disc()[0])
    first = len(good)
    words = ["no row of 1 z", "no row of 77777 x", "-1", "1600,q", "expected POINT"]
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
