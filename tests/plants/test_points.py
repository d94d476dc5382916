"""The plate on many points: its modes and its contacts against closed forms, written once more without its rows."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

import rig
from rig.plants.points import HALF_WAVES, shapes
from rig.solve.records import OPEN, SLIP_PLUS
from rig.stability.linearisation import sliding_key, steady


@pytest.fixture(scope="module")
def scene():
    return rig.load("points")


def test_modes_are_of_mass_one(scene):
    """The plate's mass is spread evenly: m times the mean of phi_i phi_j is 1 for i = j and 0 else."""
    plate = scene.parameters.plate
    for i, j in ((0, 0), (3, 3), (9, 9), (0, 5), (2, 7)):
        value, _ = dblquad(
            lambda y, x, i=i, j=j: plate.mass * shapes(plate, x, y)[0][f"q{i}"] * shapes(plate, x, y)[0][f"q{j}"],
            0.0, 1.0, 0.0, 1.0, epsabs=1e-8,
        )  # fmt: skip
        assert value == pytest.approx(float(i == j), abs=1e-6)


def test_turns_are_the_slopes_of_the_shapes(scene):
    plate, h = scene.parameters.plate, 1e-6
    low, high = shapes(plate, 0.3 - h, 0.4)[0], shapes(plate, 0.3 + h, 0.4)[0]
    for name, turn in shapes(plate, 0.3, 0.4)[1].items():
        assert (high[name] - low[name]) / (2.0 * h * plate.length) == pytest.approx(turn, rel=1e-6, abs=1e-6)


def test_off_its_points_the_plate_has_its_own_modes(scene):
    system = scene.assemble().system()
    key = system.key([SLIP_PLUS], [OPEN] * len(system.normals), [])
    values = steady(system, key).eigenvalues()
    found = np.sort(np.abs(values[values.imag > 0.0])) / (2.0 * math.pi)
    assert found == pytest.approx(np.linspace(1e3, 12e3, len(HALF_WAVES)), rel=1e-9)


def test_on_its_points_it_stands_and_vibrates_as_the_matrices_say(scene):
    """K + k (phi + mu l phi') phi^T, sums over the points; the static deflection carries the preload."""
    p = scene.parameters
    at = [((i + 0.5) / 6, (j + 0.5) / 4) for i in range(6) for j in range(4)]
    phi = np.array([list(shapes(p.plate, x, y)[0].values()) for x, y in at]).T
    push = phi + p.friction.mu * p.contact.lever * np.array([list(shapes(p.plate, x, y)[1].values()) for x, y in at]).T
    omega = 2.0 * math.pi * np.linspace(1e3, 12e3, 10)
    K = np.diag(omega**2) + p.contact.stiffness * push @ phi.T
    A = np.block([[np.zeros((10, 10)), np.eye(10)], [-K, -np.diag(2.0 * p.plate.damping_ratio * omega)]])
    expected = np.linalg.eigvals(A)
    system = scene.assemble().system()
    sliding = steady(system, sliding_key(system))
    assert np.sort_complex(sliding.eigenvalues()) == pytest.approx(np.sort_complex(expected), rel=1e-8)
    assert sliding.x[:10] == pytest.approx(np.linalg.solve(K, push.sum(axis=1) * p.load.force / 24.0), rel=1e-9)


def test_the_points_press_what_the_run_says_and_never_pull(scene):
    run = rig.simulate(scene, 0.005)
    N = run.signals["normal_force"]
    assert N.min() >= 0.0
    assert run.signals["friction_force"] == pytest.approx(0.45 * N, rel=1e-12)
    assert N.mean() == pytest.approx(24.0, rel=0.5)


@pytest.mark.parametrize(("along", "across"), [(31, 2), (32, 32)])
def test_any_number_of_points_is_served(along, across):
    """62 points have more mode sets than an int64 counts."""
    changes = {"contact.along": along, "contact.across": across, "contact.stiffness": 4.8e7 / (along * across)}
    found = rig.load("points", changes)
    assert found.assemble().system().keys == 3 * 2 ** (along * across)
    run = rig.simulate(found, 0.0002)
    assert run.signals["normal_force"].min() >= 0.0
    assert np.isfinite(run.signals["displacement"]).all()


@pytest.mark.parametrize("along", [2, 6])
def test_an_audit_sees_the_rig_as_the_method_does(along):
    """A limit that is never met and a lag of what never moves change nothing, whether contacts are modes or not."""
    scene = rig.load("points", {"load.lag": 1e-3, "load.force_max": 100.0, "contact.along": along})
    found = {one["effect"]: one for one in rig.simulate(scene, 0.004).summary["audit"]}
    assert found["load limits"]["share"] < 1e-9
    assert found["load lag"]["share"] < 1e-9
