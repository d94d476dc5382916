"""Beam, plate and block as files of matrices in t, mm, s: closed forms with the order of the elements, own models."""

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from rig.plants.structures import bending, hexahedra
from rig.structure import eigenvalues
from rig.structure.read import Source, structure

IN_MM = 1e-3
"""A length of one millimetre [m]."""


def through_files(folder, stiffness, mass, rows):
    """The structure of matrices in SI units that were written in t, mm, s; `rows`: node and direction of each."""
    turning = np.array([direction in ("rx", "ry", "rz") for _, direction in rows])
    scale = sp.diags_array(np.where(turning, 1.0, IN_MM))  # of a motion of one unit
    sources = []
    for of, matrix in (("stiffness", stiffness), ("mass", mass)):
        written = (scale @ sp.csr_array(matrix) @ scale) / IN_MM
        scipy.io.mmwrite(folder / f"{of}.mtx", sp.coo_array(written), precision=17, symmetry="symmetric")
        sources.append(Source(of, of, folder / f"{of}.mtx"))
    table = folder / "rows.csv"
    table.write_text("node,direction\n" + "".join(f"{node},{direction}\n" for node, direction in rows))
    return structure(sources, "mm-t-s", rows=table)[0]


def lowest(full, count):
    found = eigenvalues.modes(full.matrix("stiffness", {}), full.matrix("mass", {}), count)
    return np.sqrt(found.square[:count]) / (2.0 * np.pi)


def test_a_clamped_beam_converges_to_the_closed_form_with_the_fourth_order(tmp_path):
    length, height, width, young, density = 0.4, 0.01, 0.02, 2.1e11, 7850.0
    area, inertia = width * height, width * height**3 / 12.0
    roots = np.array([1.8751040687119611, 4.694091132974174, 7.854757438237612])  # cos x cosh x = -1
    exact = roots**2 / (2.0 * np.pi * length**2) * np.sqrt(young * inertia / (density * area))
    errors = []
    for elements in (6, 12):
        matrices = bending.matrices(young * inertia, young * area, density * area, length, elements)
        names = ("x", "y", "rz")
        rows = [(node, names[k]) for node in range(1, elements + 2) for k in range(3)][3:]
        full = through_files(tmp_path, *(matrix[3:, 3:] for matrix in matrices), rows)
        errors.append(lowest(full, 3) / exact - 1.0)
    assert np.all(errors[1] > 0.0)  # from above
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.15)
    assert errors[1] == pytest.approx(0.0, abs=3e-4)


def hermite(length, elements):
    """Integrals over a line of cubic functions by value and slope: second derivatives, functions, slopes, mixed."""
    h, order = length / elements, 4
    at, weights = np.polynomial.legendre.leggauss(order)
    s, weights = 0.5 * (at + 1.0), 0.5 * h * weights
    values = np.array([1 - 3 * s**2 + 2 * s**3, h * (s - 2 * s**2 + s**3), 3 * s**2 - 2 * s**3, h * (s**3 - s**2)])
    slopes = np.array([6 * s**2 - 6 * s, h * (1 - 4 * s + 3 * s**2), 6 * s - 6 * s**2, h * (3 * s**2 - 2 * s)]) / h
    curved = np.array([12 * s - 6, h * (6 * s - 4), 6 - 12 * s, h * (6 * s - 2)]) / h**2
    whole = np.zeros((4, 2 * elements + 2, 2 * elements + 2))
    for e in range(elements):
        own = slice(2 * e, 2 * e + 4)
        for k, (a, b) in enumerate(((curved, curved), (values, values), (slopes, slopes), (curved, values))):
            whole[k, own, own] += (a * weights) @ b.T
    return whole


def test_a_supported_plate_converges_to_the_closed_form_with_the_fourth_order(tmp_path):
    a, b, thickness, young, poisson, density = 0.5, 0.3, 0.004, 7e10, 0.3, 2700.0
    rigidity = young * thickness**3 / (12.0 * (1.0 - poisson**2))
    numbers = sorted((m**2 / a**2 + n**2 / b**2) for m in range(1, 5) for n in range(1, 5))[:4]
    exact = 0.5 * np.pi * np.array(numbers) * np.sqrt(rigidity / (density * thickness))
    errors = []
    for elements in (6, 12):
        along, across = hermite(a, elements), hermite(b, elements)
        stiffness = np.kron(along[0], across[1]) + np.kron(along[1], across[0])
        stiffness += poisson * (np.kron(along[3], across[3].T) + np.kron(along[3].T, across[3]))
        stiffness = rigidity * (stiffness + 2.0 * (1.0 - poisson) * np.kron(along[2], across[2]))
        mass = density * thickness * np.kron(along[1], across[1])
        # Of each node: deflection, turns about x and y, and the twist, a row without a node
        count = elements + 1
        rows, free, signs = [], [], []
        for i, k, j, m in np.ndindex(count, 2, count, 2):
            node, kind = i * count + j + 1, 2 * k + m
            rows.append((0, "") if kind == 3 else (node, ("z", "rx", "ry")[kind]))
            signs.append(-1.0 if kind == 2 else 1.0)
            free.append((k or i not in (0, elements)) and (m or j not in (0, elements)))
        at = np.flatnonzero(free)
        sign = np.array(signs)[at]
        chosen = [sign[:, None] * matrix[np.ix_(at, at)] * sign for matrix in (stiffness, mass)]
        full = through_files(tmp_path, *chosen, [rows[k] for k in at])
        assert (full.direction == -1).sum() == count**2
        errors.append(lowest(full, 4) / exact - 1.0)
    assert np.all(errors[1] > 0.0)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)
    assert errors[1] == pytest.approx(0.0, abs=1e-3)


def test_a_block_as_a_job_of_calculix_has_the_frequencies_of_its_own_model(tmp_path):
    lines = [np.linspace(0.0, size, number + 1) for size, number in ((0.2, 5), (0.05, 2), (0.02, 2))]
    whole = np.ones((5, 2, 2), dtype=bool)
    block = hexahedra.assemble(*lines, [hexahedra.Part(hexahedra.Material(2.1e11, 0.3, 7850.0), whole)], held=True)
    for suffix, matrix in ((".sti", block.stiffness), (".mas", block.mass)):
        entries = sp.triu(matrix).tocoo()
        table = np.array([entries.coords[0] + 1, entries.coords[1] + 1, entries.data]).T
        np.savetxt(tmp_path / f"block{suffix}", table, fmt="%d %d %.17e")
    nodes = len(block.lattice)
    dofs = [f"{node + 1}.{k + 1}" for k in range(3) for node in range(nodes)]
    free = [dof for dof, moves in zip(dofs, block.free) if moves]
    (tmp_path / "block.dof").write_text("\n".join(free) + "\n")
    places = np.array([axis[number] for axis, number in zip(block.axes, block.lattice.T)]).T
    table = [f"{node + 1},{x!r},{y!r},{z!r}" for node, (x, y, z) in enumerate(places.tolist())]
    (tmp_path / "block.csv").write_text("node,x,y,z\n" + "\n".join(table))
    full, _ = structure([], "m-kg-s", job=tmp_path / "block", nodes=tmp_path / "block.csv")
    assert lowest(full, 10) == pytest.approx(hexahedra.modes(block, 10).frequencies, rel=1e-9)
    moved = (full.direction == 1).astype(float)
    assert 0.0 < moved @ full.matrix("mass", {}) @ moved < 0.2 * 0.05 * 0.02 * 7850.0
