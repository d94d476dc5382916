"""The plate on foam, reduced to modes: independent finite elements, closed forms.

Reference: tests/reference/plate.json.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from reference import numbers

import rig
from rig.plants.structures.plate_elements import left_out, surface
from rig.plants.structures.plate_model import Foam, Grid, Plate, build

REFERENCE = numbers("plate")
GRID = Grid(0.043, 0.0253, 12, 8)
SIZE = (GRID.length, GRID.width)
STEEL = {"length": 0.0867, "width": 0.0766, "thickness": 0.0126, "young": 230e9, "density": 7740.0, "poisson": 0.28}


def plate(mesh=(10, 8, 2), **changes):
    names = ("elements_along", "elements_across", "elements_through")
    return Plate(**STEEL | dict(zip(names, mesh)) | changes)


def foam(thickness=0.018, young=7e9, through=2, **changes):
    given = {"thickness": thickness, "young": young, "density": 1000.0, "poisson": 0.25, "elements_through": through}
    return Foam(**given | changes)


@pytest.fixture(scope="module")
def soft():
    """40 modes, to 50 kHz, on the foam of 18 mm and 7 GPa: the frequencies are those of independent elements."""
    found = build(plate(), foam(), GRID, (0.01, 0.02))
    hertz = REFERENCE["foam"][1]["Hz"]
    assert found.frequencies[: len(hertz)] == pytest.approx(hertz, rel=1e-4)
    assert found.frequencies[-1] == pytest.approx(REFERENCE["highest_of_40"], rel=1e-6)
    return found


@pytest.mark.parametrize("mesh", ["6x5x1", "12x10x2"])
def test_a_free_plate_has_the_frequencies_of_independent_elements_on_the_same_mesh(mesh):
    found = surface(plate(tuple(map(int, mesh.split("x"))), modes=16), None, SIZE).frequencies
    assert (found[:6] == 0.0).all()
    assert found[6:] == pytest.approx(REFERENCE["free"][mesh], rel=1e-6)
    if mesh == "12x10x2":  # frequencies go with the root of the modulus; the printed ones are of 200 GPa
        printed = found[6:9] * (200.0 / 230.0) ** 0.5
        assert printed == pytest.approx(REFERENCE["free_200_GPa"], rel=3e-3)


@pytest.mark.parametrize("case", REFERENCE["thickness"][::3] + REFERENCE["overhang"][1:3], ids=str)
def test_thickness_and_overhang_of_the_foam_move_the_frequencies(case):
    below = foam(case["thickness"], 10e9, overhang=case.get("overhang", 0.0))
    found = surface(plate((6, 5, 1), modes=3), below, SIZE).frequencies
    assert found == pytest.approx(case["Hz"], rel=1.5e-3)


def test_what_modes_leave_out_is_in_the_residual():
    pressure, stiff = REFERENCE["pressure"], foam(0.010, 10e9)
    few, many = (surface(plate(modes=n), stiff, SIZE) for n in (12, 40))
    assert few.compliance == pytest.approx(many.compliance, rel=1e-9)
    assert 1e9 * pressure * many.compliance == pytest.approx(REFERENCE["deflection_nm"], rel=0.01)
    assert 1e9 * pressure * many.residual == pytest.approx(REFERENCE["residual_nm"], rel=0.05)
    assert few.residual > many.residual


def test_what_modes_leave_out_under_points_sums_up_to_that_of_an_even_pressure():
    """At mid-travel; the residual comes from another solution, without cells."""
    steel, soft, middle = plate((6, 5, 1), modes=12), foam(through=1), np.array([0.5 * (0.0867 - GRID.length)])
    kept = surface(steel, soft, SIZE)
    [yields] = left_out(steel, soft, kept, SIZE, (GRID.along, GRID.across), middle, 1.0)
    assert yields == pytest.approx(yields.T, abs=1e-9 * yields.max())
    assert np.linalg.eigvalsh(yields).min() > -1e-12 * yields.max()
    half = GRID.along * GRID.across // 2
    even = yields[:half, :half].sum() * SIZE[0] * SIZE[1] / (2 * half) ** 2
    assert even == pytest.approx(kept.residual, rel=1e-6)


COARSE = {
    "plate.elements_along": 6,
    "plate.elements_across": 6,
    "plate.elements_through": 1,
    "film.along": 6,
    "film.across": 4,
    "foam.elements_through": 1,
    "slider.position": 0.0047,
    "slider.travels": False,
}


def pressures(scene, **changes):
    """Least and largest pressure of steady sliding [Pa], and growth and frequency of each mode that flutters."""
    loaded = rig.load(scene, {key.replace("__", "."): value for key, value in changes.items()})
    sliding = rig.modes(loaded).sliding
    found = [
        value for name, value in sliding.equilibrium.items() if name.startswith("pressure_") and "centre" not in name
    ]
    return min(found), max(found), [(m.growth, m.frequency) for m in sliding.modes if m.growth > 0.0]


def test_pressures_of_a_completed_plate_do_not_depend_on_the_number_of_its_modes():
    changes = {key.replace(".", "__"): value for key, value in COARSE.items()}
    completed = [pressures("plate_converged", **changes, plate__modes=n)[:2] for n in (12, 40)]
    assert completed[0] == pytest.approx(completed[1], rel=0.05)
    few, more = (pressures("plate", **changes, plate__modes=n)[0] for n in (12, 40))
    assert few > 1.2 * completed[1][0]  # 12 modes leave the plate rigid
    assert more < 0.7 * completed[1][0]


def test_a_free_plate_has_its_mass():
    found = surface(plate((4, 4, 1), modes=8), None, SIZE)
    for i in range(3):
        assert found.shapes[i, i] ** -2.0 == pytest.approx(REFERENCE["mass"], rel=1e-4)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"grid": Grid(0.09, 0.0253, 4, 4)}, "slider.length is 0.09 m; it must be at most plate.length, 0.0867 m"),
        ({"foam": foam(poisson=0.4999999999)}, "lost in rounding, because sizes"),
        ({"plate": plate((4, 4, 1), thickness=1e-6), "foam": None}, "bring values that lie far apart closer together"),
    ],
)
def test_what_cannot_be_built_is_refused(given, message):
    whole = {"plate": plate((4, 4, 1)), "foam": foam(), "grid": GRID, "point": (0.01, 0.0)} | given
    with pytest.raises(ValueError, match=message):
        build(**whole)


BUILD = """
import sys, hashlib
from rig.plants.structures.plate_model import Foam, Grid, Plate, Reduced, build
size = {"length": 0.0867, "width": 0.0766, "thickness": 0.0126, "young": 230e9, "density": 7740.0, "poisson": 0.28}
mesh = {"elements_along": 4, "elements_across": 4, "elements_through": 1, "modes": 8}
foam = Foam(thickness=0.018, young=7e9, density=1000.0, poisson=0.25)
found = build(Plate(**size, **mesh), foam, Grid(0.043, 0.0253, 12, 8), (0.01, 0.02))
print(hashlib.sha256(found.surface.to_bytes()).hexdigest(), "skfem" in sys.modules, "scipy.sparse" in sys.modules)
"""


def start(folder, **environment):
    """A process that builds a model."""
    given = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "RIG_MODELS": str(folder)} | environment
    return subprocess.Popen([sys.executable, "-c", BUILD], stdout=subprocess.PIPE, text=True, env=given)


def test_every_process_builds_the_same_bits_however_many_threads_its_libraries_have(tmp_path):
    """And together they write one file, which the next process reads without the libraries that build."""
    processes = [start(tmp_path / "models", OPENBLAS_NUM_THREADS=threads) for threads in ("1", "2")]
    told = {process.communicate(timeout=120)[0].split()[0] for process in processes}
    assert len(told) == len(list((tmp_path / "models").iterdir())) == 1
    assert start(tmp_path / "models").communicate(timeout=120)[0].split() == [*told, "False", "False"]
