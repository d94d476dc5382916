"""The plate on foam, reduced to modes: independent finite elements, closed forms, what a user builds on.

Reference: tests/reference/plate.json.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from rig.plants.plate_model import Foam, Grid, Plate, build, surface

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "plate.json").read_text())
GRID = Grid(0.043, 0.0253, 12, 8)
STEEL = {"length": 0.0867, "width": 0.0766, "thickness": 0.0126, "young": 230e9, "density": 7740.0, "poisson": 0.28}


def plate(mesh=(10, 8, 2), **changes):
    names = ("elements_along", "elements_across", "elements_through")
    return Plate(**STEEL | dict(zip(names, mesh)) | changes)


def foam(thickness=0.018, young=7e9, through=2, **changes):
    given = {"thickness": thickness, "young": young, "density": 1000.0, "poisson": 0.25, "elements_through": through}
    return Foam(**given | changes)


@pytest.fixture(scope="module")
def soft():
    """40 modes on the foam of 18 mm and 7 GPa."""
    return build(plate(), foam(), GRID, (0.01, 0.02))


@pytest.mark.parametrize("mesh", REFERENCE["free"])
def test_a_free_plate_has_the_frequencies_of_independent_elements_on_the_same_mesh(mesh):
    found = surface(plate(tuple(map(int, mesh.split("x"))), modes=16), None, GRID).frequencies
    assert (found[:6] == 0.0).all()
    assert found[6:] == pytest.approx(REFERENCE["free"][mesh], rel=1e-6)


def test_the_modulus_of_the_printed_frequencies_is_200_gpa():
    found = surface(plate((12, 10, 2), modes=9, young=200e9), None, GRID).frequencies
    assert found[6:] == pytest.approx(REFERENCE["free_200_GPa"], rel=3e-3)


@pytest.mark.parametrize("case", REFERENCE["foam"], ids=lambda case: f"{1e3 * case['thickness']:g} mm")
def test_on_foam_the_frequencies_are_those_of_independent_elements(case):
    *mesh, through = case["elements"]
    found = surface(plate(tuple(mesh), modes=8), foam(case["thickness"], case["young"], through), GRID).frequencies
    assert found[: len(case["Hz"])] == pytest.approx(case["Hz"], rel=1e-4)


@pytest.mark.parametrize("case", REFERENCE["thickness"] + REFERENCE["overhang"], ids=str)
def test_thickness_and_overhang_of_the_foam_move_the_frequencies(case):
    below = foam(case["thickness"], 10e9, overhang=case.get("overhang", 0.0))
    found = surface(plate((6, 5, 1), modes=3), below, GRID).frequencies
    assert found == pytest.approx(case["Hz"], rel=1.5e-3)


def test_forty_modes_reach_50_khz(soft):
    assert soft.frequencies[-1] == pytest.approx(REFERENCE["highest_of_40"], rel=1e-6)


def test_what_modes_leave_out_is_in_the_residual():
    pressure, stiff = REFERENCE["pressure"], foam(0.010, 10e9)
    few, many = (surface(plate(modes=n), stiff, GRID) for n in (12, 40))
    assert few.compliance == pytest.approx(many.compliance, rel=1e-9)
    assert 1e9 * pressure * many.compliance == pytest.approx(REFERENCE["deflection_nm"], rel=0.01)
    assert 1e9 * pressure * many.residual == pytest.approx(REFERENCE["residual_nm"], rel=0.05)
    assert few.residual > many.residual


def test_shapes_at_places_are_those_of_the_surface(soft):
    assert soft.pitch <= 0.5e-3
    assert soft.pitch * soft.stride == pytest.approx(0.043 / 12)
    points = np.array([3, 7])
    position = 100 * soft.pitch
    there = soft.surface.at(position + (points + 0.5) * 0.043 / 12, GRID.lines)
    assert soft.shapes[..., 100 + points * soft.stride] == pytest.approx(there, rel=1e-12, abs=1e-12)
    travel = 0.0867 - 0.043
    assert soft.shapes.shape == (40, 3, 8, np.ceil(travel / soft.pitch) + 1 + 11 * soft.stride)


def test_a_probe_has_the_shapes_of_its_point(soft):
    assert soft.probe == pytest.approx(soft.surface.at(np.array([0.01]), np.array([0.02]))[:, :, 0, 0])
