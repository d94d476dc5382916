"""Crossings on a grid whose neighbours hide a range in which nothing slides steadily."""

import numpy as np
import pytest

from rig.analysis.eigenvalue_curves import Growth, absent, brackets, looked, root, stretches
from rig.analysis.sweep import search


def growth(value):
    """Passes zero at 0.3 upwards, at 0.9 downwards; between 0.5 and 0.7 there is none, and the sign changes over it."""
    if 0.5 <= value <= 0.7:
        return None
    rate = value - 0.3 if value < 0.5 else 0.9 - value
    return Growth(np.array([rate]), np.zeros(1))


def changes_over_the_hole(value):
    return None if 0.5 <= value <= 0.7 else Growth(np.array([-1.0 if value < 0.5 else 1.0]), np.zeros(1))


def roots(values, growths):
    def look(grid):
        return grid, [root(b, growths) for one in stretches(grid, growths) for b in brackets(one, growths)]

    return looked(values, growths, look)


@pytest.mark.parametrize("values", [(0.0, 0.4, 0.8, 1.0), (1.0, 0.8, 0.4, 0.0)])
def test_a_sign_that_changes_over_a_hole_is_no_crossing(values):
    grid, found = roots(values, changes_over_the_hole)
    assert found == []
    inside = [value for value in grid if changes_over_the_hole(value) is None]
    assert (min(inside), max(inside)) == (pytest.approx(0.5, abs=1e-9), pytest.approx(0.7, abs=1e-9))
    assert grid == sorted(grid, reverse=values[0] > values[-1])


def test_crossings_beside_a_hole_are_found():
    _, found = roots((0.0, 0.45, 0.75, 1.0), growth)
    assert found == [pytest.approx(0.3, rel=1e-12), pytest.approx(0.9, rel=1e-12)]


def test_of_two_holes_each_keeps_its_own_edges():
    """The sign changes in the first; what slides between both is not taken for a part of it."""

    def growths(value):
        if 0.48 <= value <= 0.52 or 0.6 <= value <= 0.65:
            return None
        return Growth(np.array([-1.0 if value < 0.5 else 1.0]), np.zeros(1))

    grid, found = roots((0.0, 0.4, 1.0), growths)
    assert found == []
    assert any(0.52 < value < 0.6 and growths(value) is not None for value in grid)


def test_a_search_tells_the_hole_as_a_gap():
    def spectra(value):
        if 0.5 <= value <= 0.7:
            return absent("no steady sliding", "the reason")
        rate = np.array([[-1.0 if value < 0.5 else 1.0 + 0j]])
        one = np.eye(1, dtype=np.complex128)
        return absent("", "")._replace(
            rates=rate[0].astype(complex), right=one, left=one, names=("x",), own=1, counts=True, exists=True
        )

    values = (0.0, 0.4, 0.8, 1.0)
    found = search(values, np.zeros((4, 1), dtype=np.complex128), spectra)
    assert found.critical == ()
    [gap] = found.gaps
    assert (gap.start, gap.end) == (pytest.approx(0.5, abs=1e-8), pytest.approx(0.7, abs=1e-8))
    assert gap.why == "the reason"
