"""Elements against exact solutions of three-dimensional elasticity, and what their modes promise.

Lame's modes of a square plate have no shear at its edges and change no volume. They are exact for any Poisson's ratio
and any thickness. Without lateral contraction bars and columns of layers have exact solutions, too.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from rig.plants.structures.hexahedra import Material, Part, assemble, left_out, modes

STEEL = Material(200e9, 0.3, 7800.0)
FOAM, STIFF = Material(10e9, 0.0, 1000.0), Material(200e9, 0.0, 7800.0)


def free(size, boxes, material=STEEL):
    """A free body of one material."""
    lines = (np.linspace(0.0, length, n + 1) for length, n in zip(size, boxes))
    return assemble(*lines, [Part(material, np.ones(boxes, dtype=bool))], held=False)


def column(boxes, side=0.01, heights=(0.018, 0.0126)):
    """Two layers of `boxes` elements each, held below."""
    lower, upper = (np.linspace(0.0, height, boxes + 1) for height in heights)
    below = np.zeros((1, 1, 2 * boxes), dtype=bool)
    below[:, :, :boxes] = True
    lines = np.array([0.0, side]), np.array([0.0, side]), np.concatenate([lower, heights[0] + upper[1:]])
    return assemble(*lines, [Part(FOAM, below), Part(STIFF, ~below)], held=True)


def nearest(found, exact):
    """Relative error of the frequency next to `exact`."""
    errors = found.frequencies / exact - 1.0
    return errors[np.argmin(np.abs(errors))]


def lame(boxes, side=0.1):
    shear = STEEL.young / (2.0 * (1.0 + STEEL.poisson))
    return nearest(
        modes(free((side, side, 0.02), (boxes, boxes, 1)), 16), math.sqrt(shear / STEEL.density / 2.0) / side
    )


def bar(boxes, length=0.1):
    exact = math.sqrt(STIFF.young / STIFF.density) / (2.0 * length)
    return nearest(modes(free((length, 0.02, 0.02), (boxes, 1, 1), STIFF), 14), exact)


def layers(boxes):
    def balance(omega):
        turns = (omega * h * math.sqrt(m.density / m.young) for h, m in zip((0.018, 0.0126), (FOAM, STIFF)))
        below, above = (math.sqrt(m.young * m.density) for m in (FOAM, STIFF))
        return below / math.tan(next(turns)) - above * math.tan(next(turns))

    return nearest(modes(column(boxes), 4), brentq(balance, 6.5e4, 8e4) / (2.0 * math.pi))


@pytest.mark.parametrize(("exact", "boxes"), [(lame, (6, 8, 10)), (bar, (6, 8, 10)), (layers, (2, 3, 4))])
def test_frequencies_converge_from_above_to_exact_solutions_with_the_fourth_power(exact, boxes):
    errors = [exact(n) for n in boxes]
    assert min(errors) > 0.0
    assert errors[-1] < 2e-5
    assert -np.polyfit(np.log(boxes), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.12)


def test_a_slender_plate_bends_as_a_beam():
    length, thickness = 1.0, 0.01
    found = modes(free((length, 0.01, thickness), (24, 1, 1)), 10)
    radius = thickness / math.sqrt(12.0)
    for order, root in ((0, 4.730040745), (1, 7.853204624)):
        speed = math.sqrt(STEEL.young / STEEL.density)
        exact = root**2 * speed * radius / (2.0 * math.pi * length**2)  # shear and turning inertia take 1e-3 of it
        assert found.frequencies[6 + 2 * order] == pytest.approx(exact, rel=2e-3)


def test_a_thin_plate_converges_to_the_theory_of_thin_plates():
    """Free square, a hundredth as thick as wide. Elements much longer than thick are a little too stiff in bending, so
    that the error falls with the square of their size; at the plate's own proportions it is the fourth power."""
    side, thickness, boxes = 0.1, 0.001, np.array([3, 4, 6, 8, 12])
    rigidity = STEEL.young * thickness**3 / (12.0 * (1.0 - STEEL.poisson**2))
    unit = math.sqrt(rigidity / (STEEL.density * thickness)) / (2.0 * math.pi * side**2)
    exact = np.array([13.468, 19.596, 24.270])  # Leissa, J. Sound Vib. 31 (1973) 257, Poisson's ratio 0.3
    found = np.array([modes(free((side, side, thickness), (n, n, 1)), 9).frequencies[6:] for n in boxes])
    errors = found / (unit * exact) - 1.0
    assert np.abs(errors[-1]) == pytest.approx(0.0, abs=5e-3)
    for bending in (1, 2):
        assert (np.diff(errors[:, bending]) < 0.0).all()
        assert -np.polyfit(np.log(boxes), np.log(errors[:, bending]), 1)[0] == pytest.approx(2.1, abs=0.2)


def test_modes_have_mass_one_and_are_orthogonal():
    for structure, count in ((free((0.08, 0.07, 0.012), (6, 5, 1)), 24), (column(4), 8)):
        found = modes(structure, count)
        squares = (2.0 * math.pi * found.frequencies) ** 2
        mass = found.vectors.T @ (structure.mass @ found.vectors)
        stiffness = found.vectors.T @ (structure.stiffness @ found.vectors)
        assert mass == pytest.approx(np.eye(count), abs=1e-12)
        assert stiffness == pytest.approx(np.diag(squares), abs=1e-11 * squares[-1])
        assert (np.diff(found.frequencies) >= -1e-9 * found.frequencies[1:]).all()


@pytest.mark.parametrize("held", [True, False])
def test_no_mode_is_left_out(held):
    """All classes are complete up to the highest mode: more of them show the same ones first."""
    structure = column(4) if held else free((0.08, 0.08, 0.02), (3, 3, 1))
    few, many = modes(structure, 9), modes(structure, 20)
    assert few.frequencies == pytest.approx(many.frequencies[:9], rel=1e-9)
    dense = np.linalg.eigvals(np.linalg.solve(structure.mass.toarray(), structure.stiffness.toarray()))
    lowest = np.sqrt(np.abs(np.sort(dense.real))[:20]) / (2.0 * math.pi)
    first = 0 if held else 6
    assert many.frequencies[first:] == pytest.approx(lowest[first:], rel=1e-6)


def test_two_modes_of_one_frequency_are_told_apart_by_symmetry_and_no_rounding_changes_them():
    """A square plate has pairs; a change of its size by 1e-12 leaves every shape as it was."""
    found, again = (modes(free((0.08, 0.08, size), (4, 4, 1)), 24) for size in (0.012, 0.012 * (1.0 + 1e-12)))
    pairs = np.diff(found.frequencies[6:]) < 1e-9 * found.frequencies[7:]
    assert pairs.sum() >= 4
    assert again.vectors == pytest.approx(found.vectors, abs=1e-6 * np.abs(found.vectors).max())
    for entries in found.vectors.T[6:]:
        assert entries[np.abs(entries) > (1.0 - 1e-6) * np.abs(entries).max()][0] > 0.0


def test_what_modes_leave_out_of_a_load_completes_them():
    structure = column(4)
    load = np.zeros(structure.stiffness.shape[0])
    load[-9:] = 1.0  # the nodes on top, along z
    exact = np.linalg.solve(structure.stiffness.toarray(), load)
    found = modes(structure, 5)
    given = found.vectors @ ((found.vectors.T @ load) / (2.0 * math.pi * found.frequencies) ** 2)
    rest = left_out(structure, found, load)
    assert given + rest == pytest.approx(exact, rel=1e-9, abs=1e-9 * np.abs(exact).max())
    assert np.abs(found.vectors.T @ (structure.mass @ rest)).max() < 1e-12 * np.linalg.norm(exact)


def test_modes_that_elements_cannot_give_are_refused():
    with pytest.raises(ValueError, match="modes is 6; a free structure has 6 rigid modes: take at least 7"):
        modes(free((0.08, 0.07, 0.012), (2, 2, 1)), 6)
