"""Eigenvalues at the sliding equilibrium, and averaged under dither.

Numbers: set PEND of Kroeger, Neubauer, Popp (2008) (m = 5, c = 2500, d = 2, F0 = 20, v0 = 0.06; characteristic A:
0.5, 0.18, 0.05), computed independently; the closed forms are theirs, sections 2 and 4.
"""

import json
import math
import re

import numpy as np
import pytest

import rig
from rig.analysis.averaged import mean_friction
from rig.analysis.modes import modes, motion
from rig.model import friction_law

COULOMB = friction_law.coulomb(0.4, 0.25)
STRIBECK = friction_law.stribeck(0.5, 0.18, 0.05)


def test_sliding_of_characteristic_a_flutters():
    sliding = modes(rig.load("belt")).sliding
    assert sliding.growth == pytest.approx(3.6552859127349846, rel=1e-9)
    assert sliding.modes[0].frequency == pytest.approx(3.5109410356792674, rel=1e-9)
    assert sliding.equilibrium["displacement"] == pytest.approx(0.0022110571824952375, rel=1e-12)
    assert not sliding.stable


def test_growth_of_a_linear_law_is_its_slope_against_the_damper():
    assert modes(rig.load("belt_b")).sliding.growth == pytest.approx((0.8 * 20.0 - 2.0) / 10.0, rel=1e-12)


def test_coulomb_friction_leaves_the_damper_alone():
    mode = modes(rig.load("belt_c_damped")).sliding.modes[0]
    assert mode.growth == pytest.approx(-2.0 / 10.0, rel=1e-12)
    assert mode.damping == pytest.approx(2.0 / (2.0 * math.sqrt(5.0 * 2500.0)), rel=1e-12)
    assert modes(rig.load("belt_c")).sliding.modes[0].kind == "neutral"


def test_what_stays_is_no_divergence():
    """An open shunt keeps its charge and its current: two eigenvalues that are zero, not small."""
    kinds = {mode.kind: mode for mode in modes(rig.load("brake_shunt")).sliding.modes}
    assert kinds.keys() == {"flutter", "stays", "decays"}
    assert kinds["stays"].growth == kinds["stays"].frequency == 0.0


@pytest.mark.parametrize(("speed", "stable"), [(0.20794, False), (0.20795, True)])
def test_sliding_is_stable_above_a_speed(speed, stable):
    assert modes(rig.load("belt", {"drive.speed": speed})).sliding.stable is stable


def test_the_pendulum_is_the_mass_on_the_belt_at_its_contact():
    belt, pendulum = modes(rig.load("belt")).sliding, modes(rig.load("pendulum")).sliding
    assert pendulum.growth == pytest.approx(belt.growth, rel=1e-12)
    assert pendulum.equilibrium["displacement"] == pytest.approx(belt.equilibrium["displacement"], rel=1e-12)


def test_the_shape_of_an_oscillation_has_its_velocity_turned_by_the_eigenvalue():
    mode = modes(rig.load("belt")).sliding.modes[0]
    rate = complex(mode.growth, 2.0 * math.pi * mode.frequency)
    assert mode.shape["x'"] / mode.shape["x"] == pytest.approx(rate, rel=1e-12)


def test_a_belt_at_rest_has_no_steady_sliding():
    found = modes(rig.load("belt", {"drive.speed": 0.0}))
    assert not found.sliding.exists
    assert "does not move" in found.text()


@pytest.mark.parametrize(
    ("speed", "amplitude", "growth"),
    [(0.06, 0.03, 4.01), (0.06, 0.08, -7.07), (0.06, 0.10, -3.64), (0.215, 0.10, 0.196)],
)
def test_dither_damps_above_the_belt_speed_and_feeds_below(speed, amplitude, growth):
    scene = rig.load("belt_dither", {"drive.speed": speed, "dither.amplitude": amplitude})
    assert modes(scene).dithered.growth == pytest.approx(growth, rel=5e-3)


def test_sliding_that_decays_grows_under_dither():
    found = modes(rig.load("belt_dither", {"drive.speed": 0.215}))
    assert found.sliding.growth == pytest.approx(-0.0263, rel=5e-3)
    assert found.dithered.growth > 0.0


@pytest.mark.parametrize(
    ("amplitude", "mu"), [(0.08, 0.1123), (0.10, 0.0717), (0.15, 0.0401), (0.2, 0.0303), (0.3, 0.0215)]
)
def test_dither_lowers_the_effective_friction(amplitude, mu):
    assert mean_friction(STRIBECK, 0.06, 1.0, amplitude)[0] == pytest.approx(mu, abs=5e-5)


@pytest.mark.parametrize("w", [-0.09, 0.0, 0.02, 0.0999])
def test_averaged_coulomb_friction_is_an_arc_sine(w):
    T, slope, _ = mean_friction(COULOMB, w, 20.0, 0.1)
    assert T == pytest.approx(20.0 * 0.25 * 2.0 / math.pi * math.asin(w / 0.1), abs=1e-12)
    assert slope == pytest.approx(20.0 * 0.25 * 2.0 / math.pi / math.sqrt(0.01 - w * w), rel=1e-9)


@pytest.mark.parametrize("fast", [0.03, 0.1 + 0.02j, 0.3j])
@pytest.mark.parametrize("load", [0.0, 5.0 - 2.0j, 30.0])
def test_the_slopes_of_averaged_friction_are_its_derivatives(fast, load):
    w, N, h = 0.06, 20.0, 1e-6
    _, by_speed, by_load = mean_friction(STRIBECK, w, N, fast, load)
    T = [mean_friction(STRIBECK, w + s * h, N, fast, load)[0] for s in (1.0, -1.0)]
    assert by_speed == pytest.approx((T[0] - T[1]) / (2.0 * h), rel=1e-5)
    T = [mean_friction(STRIBECK, w, N + s * h, fast, load)[0] for s in (1.0, -1.0)]
    assert by_load == pytest.approx((T[0] - T[1]) / (2.0 * h), rel=1e-5)


def test_a_force_on_the_mass_shakes_as_much_as_the_belt_would():
    turn = 2.0 * math.pi * 150.0
    belt = rig.load("belt_dither", {"dither.amplitude": 0.1})
    mass = rig.load("belt_dither", {"dither.on": "mass", "dither.amplitude": 0.1 * 5.0 * turn})
    assert modes(mass).dithered.growth == pytest.approx(modes(belt).dithered.growth, rel=2e-3)


def test_a_report_is_plain():
    found = json.loads(json.dumps(modes(rig.load("belt_dither")).to_json()))
    assert found["modes"][0]["kind"] == "flutter"
    assert found["dither"]["stable"]
    assert np.isfinite([row[1:4] for row in modes(rig.load("belt_dither")).table()]).all()


def test_long_shapes_are_told_by_their_large_amplitudes():
    found = modes(rig.load("disc_slider"))
    assert len(found.sliding.modes[0].shape) == 18
    rows = [row[-1] for row in found.table()]
    assert all(len(row) < 140 for row in rows)
    assert re.match(r"s [\d.]+ % at 5 deg, u [\d.]+ % at 0 deg", rows[0])
    assert "'" not in "".join(rows)  # a velocity is the amplitude times the eigenvalue


def test_a_shape_is_told_by_energy_which_weighs_metres_and_radians_alike():
    """north: kinetic energy m |x'|^2 + J |tilt'|^2, whatever the unit of the tilt."""
    first = modes(rig.load("north")).sliding.modes[0]
    x, tilt = 0.5 * abs(first.shape["x"]) ** 2, 7.2e-5 * abs(first.shape["tilt"]) ** 2
    assert first.energy == pytest.approx({"x": x / (x + tilt), "tilt": tilt / (x + tilt)}, rel=1e-12)
    assert first.shape["x"] == 1.0
    assert abs(first.shape["tilt"]) > 30.0  # rad/m: far larger as a number, a sixth of the energy
    assert sum(first.energy.values()) == pytest.approx(1.0)
    assert "x 83.4 % at 0 deg, tilt 16.6 % at 100 deg" in modes(rig.load("north")).text()


def test_a_motion_that_stays_has_no_velocity_and_is_weighed_by_displacement():
    """A free body beside a spring: rates 0 and +-i omega; the masses weigh what moves for nothing."""
    form = np.diag([0.0, 0.0, 2.0, 3.0])
    amplitudes, energy = motion(("x", "y", "x'", "y'"), np.array([1.0, 1e-17, 1e-30, 4e-17]), form, 0.0, 2)
    assert energy == pytest.approx({"x": 1.0, "y": 0.0}, abs=1e-30)
    assert amplitudes == {"x": 1.0, "y": 1e-17}


def test_a_resonance_of_the_network_is_no_motion_of_the_structure():
    slow, fast = modes(rig.load("belt_shunt")).sliding.modes
    assert slow.energy["x"] == pytest.approx(1.0, abs=1e-5)
    assert fast.energy["shunt.voltage"] == pytest.approx(0.5, abs=1e-3)
    assert fast.energy["shunt.current"] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "names"), [("pin", ["damping", "mass", "stiffness"]), ("north", ["flutter", "divergence"])]
)
def test_limits_of_friction_are_told(name, names):
    found = modes(rig.load(name))
    assert list(found.limits) == names == list(found.to_json()["limits"])
    assert f"{names[0]} {found.limits[names[0]]:.6g}" in found.text()
    assert "never" in modes(rig.load("north_divergence")).text()


@pytest.mark.parametrize(
    ("name", "changes", "why", "counts"),
    [
        ("belt", {"drive.speed": 0.0}, "the surface at contact does not move", False),
        ("north", {"load.force": 0.0}, "nothing presses contact", True),
        ("north_divergence", {"friction.mu": 1.2}, "contact would have to pull (normal force -", True),
        ("pin", {"friction.mu": 2.2}, "contact would have to pull (normal force -", False),  # jams: nothing moves so
    ],
)
def test_what_keeps_a_rig_from_sliding_is_told(name, changes, why, counts):
    found = modes(rig.load(name, changes))
    assert not found.sliding.exists
    assert why in found.sliding.why
    assert found.sliding.counts is counts
    assert ("growth 1/s" in found.text()) is counts


def test_beyond_divergence_the_growth_is_still_told():
    mode = modes(rig.load("north_divergence", {"friction.mu": 1.2})).sliding.modes[0]
    assert (mode.kind, mode.frequency) == ("divergence", 0.0)
    assert mode.growth > 0.0


@pytest.mark.parametrize("name", ["brake", "brake_3400", "brake_shunt", "brake_shunt_sound", "belt_shunt"])
def test_an_equilibrium_tells_no_rounding(name):
    """Preloads balance contact forces, and nothing flows: what is left there is not told as 1e-23 m."""
    told = modes(rig.load(name)).sliding.equilibrium
    assert not [key for key, value in told.items() if value and abs(value) < 1e-9]
    assert told["slip_speed"] > 0.01


def test_a_rig_that_jams_says_so_without_a_load_too():
    assert "inertia" in modes(rig.load("pin", {"friction.mu": 1.2, "load.force": 0.0})).sliding.why
