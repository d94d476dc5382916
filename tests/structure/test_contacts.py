"""Contacts between faces: areas, normals and interpolation against geometry; the disc that CalculiX made."""

import shutil
import subprocess

import disc_with_pads
import numpy as np
import pytest
import scipy.sparse.linalg as sl
from disc_with_pads import disc, paired

from rig.structure.contacts import opened
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
