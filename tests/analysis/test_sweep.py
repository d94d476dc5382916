"""Eigenvalues along a parameter: branches that are followed, critical values that are found.

Numbers: Kroeger, Neubauer, Popp (2008) with calibrated parameters, by independent code (tests/reference) or in closed
form where the formula stands beside it.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from swept_matrices import beside, over, turning

import rig
from rig.analysis.linear.eigenvalue_curves import Growth, brackets, looked, root, stretches

HERE = Path(__file__).parents[1] / "reference"
BOUNDS = json.loads((HERE / "tuned_mass.json").read_text())["bounds"]
SPEED = math.log(20.0 * 0.32 / (0.05 * 2.0)) * 0.05  # F0 (mu_s - mu_d) / v_s exp(-v / v_s) = d


def test_the_speed_above_which_sliding_is_stable():
    found = rig.sweep("belt", "drive.speed", np.linspace(0.05, 0.4, 50))
    [one] = found.critical
    assert one.value == pytest.approx(SPEED, rel=1e-12)
    assert one.value == pytest.approx(0.20794415416810286, rel=1e-10)  # the independent code's
    assert (one.kind, one.becomes, one.branch) == ("flutter", "stable", 0)
    assert one.frequency == pytest.approx(math.sqrt(500.0) / (2.0 * math.pi), rel=1e-9)
    assert found.rates[3, 0] == pytest.approx(complex(*at_belt(found.axis.values[3])), rel=1e-12)


def at_belt(speed):
    slope = 0.32 / 0.05 * math.exp(-speed / 0.05)
    growth = (slope * 20.0 - 2.0) / 10.0
    return growth, math.sqrt(500.0 - growth**2)


@pytest.mark.parametrize("ratio", BOUNDS)
def test_the_tilts_at_which_a_tuned_mass_begins_to_work(ratio):
    scene = rig.load("belt_tuned_mass", {"tuned_mass.damping_ratio": float(ratio)})
    found = rig.sweep(scene, "tuned_mass.angle", np.linspace(-1.5, 1.5, 16))
    assert [one.value for one in found.critical] == pytest.approx(BOUNDS[ratio], rel=1e-9)
    assert [one.becomes for one in found.critical] == ["unstable", "stable"]


def test_norths_body_flutters_and_tips_over_at_limits_of_their_own():
    flutter, divergence = [], []
    for scene, ends in (("north", (0.0, 0.5)), ("north_divergence", (0.5, 1.5))):
        [one] = rig.sweep(scene, "friction.mu", np.linspace(*ends, 8)).critical
        (flutter if one.kind == "flutter" else divergence).append(one)
    assert flutter[0].value == pytest.approx(0.252694977574783, rel=1e-9)
    assert divergence[0].value == pytest.approx(1.0 + (1.0 / 2e7 + 1.0 / 8e7) * 200.0 / 0.012**2, rel=1e-12)
    assert divergence[0].frequency == 0.0


def test_the_energy_of_a_divergence_is_weighed_by_displacement():
    """m x^2 + J tilt^2: at its critical value nothing moves; beside it the velocities have the same shares."""
    [one] = rig.sweep("north_divergence", "friction.mu", np.linspace(0.5, 1.5, 8)).critical
    mass, inertia = rig.load("north_divergence").assemble().system().mass.diagonal()
    x, tilt = mass * abs(one.shape["x"]) ** 2, inertia * abs(one.shape["tilt"]) ** 2
    assert one.energy == pytest.approx({"x": x / (x + tilt), "tilt": tilt / (x + tilt)}, rel=1e-9)
    assert not {"x'", "tilt'"} & one.shape.keys()
    beside = rig.modes(rig.load("north_divergence", {"friction.mu": one.value + 1e-4})).sliding.modes[0]
    assert beside.kind == "divergence"
    assert beside.energy == pytest.approx(one.energy, abs=1e-3)


def test_without_damping_flutter_begins_where_two_frequencies_meet():
    """(m k22 + J k11)^2 = 4 m J det K; before it growth is none, after it a square root."""
    m, J, c1, c2, c_phi, h, s = 0.5, 7.2e-5, 2e7, 8e7, 1.5e4, 0.012, 0.003
    mu = np.polynomial.Polynomial([0.0, 1.0])
    sum_ = m * (c_phi + s * c2 * (s - mu * h)) + J * (c1 + c2)
    roots = (sum_**2 - 4.0 * m * J * ((c1 + c2) * c_phi + c1 * c2 * s * (s - mu * h))).roots()
    scene = rig.load("north", {"body.damping": 0.0, "body.tilt_damping": 0.0})
    [one] = rig.sweep(scene, "friction.mu", np.linspace(0.0, 0.5, 21)).critical
    assert one.value == pytest.approx(float(roots.real.min()), rel=1e-9)
    assert (one.kind, one.becomes) == ("flutter", "unstable")


def test_a_pin_jams_where_friction_takes_up_its_inertia():
    found = rig.sweep("pin", "friction.mu", np.linspace(0.0, 1.5, 16))
    g = math.radians(25.0)
    flutter, jamming = found.critical
    assert flutter.value == pytest.approx(math.tan(g) + 2.0 * 2.0 / (20.0 * math.sin(2.0 * g)), rel=1e-10)
    assert jamming.value == pytest.approx((0.2 + math.sin(g) ** 2) / (math.sin(g) * math.cos(g)), rel=1e-10)
    assert jamming.kind == "jamming"
    assert np.isnan(found.rates[np.array(found.axis.values) > jamming.value]).all()
    assert found.notes[-1] == "jams"


def test_an_absorber_jams_under_a_falling_law_too():
    changes = {"body.mass": 0.1, "tuned_mass.mass": 1.0, "tuned_mass.angle": 1.2}

    s, c = math.sin(1.2), math.cos(1.2)
    slope = rig.load("belt_tuned_mass").parameters.friction.slope
    expected = (0.1 + c * c) / (s * c) + slope * 0.06  # mu at the belt speed
    for share, slides in ((1.0 - 1e-9, True), (1.0 + 1e-9, False)):
        found = rig.modes(rig.load("belt_tuned_mass", changes | {"friction.mu_zero": share * expected})).sliding
        assert slides is ("friction takes up all of the inertia" not in found.why)


def test_growth_that_leaps_over_zero_is_told_as_a_jump():
    """The falling law ends in its floor at (0.4 - 0.05) / 0.8 m/s."""
    [one] = rig.sweep("belt_b", "drive.speed", np.linspace(0.05, 0.6, 9)).critical
    assert (one.kind, one.becomes) == ("jump", "stable")
    assert one.value == pytest.approx(0.4375, rel=1e-10)
    assert one.frequency == pytest.approx(math.sqrt(500.0 - 1.4**2) / (2.0 * math.pi), rel=1e-9)


def test_branches_cross_where_shapes_say_so_and_veer_where_they_are_coupled():
    def modes(coupling):
        return lambda p: beside(turning(-1.0, 10.0 + 4.0 * p), turning(-1.2, 14.0 - 4.0 * p), coupling)

    crossing, veering = over(modes(0.0)), over(modes(0.3))
    ends = [sorted((f[0], f[-1]) for f in found.frequency.T if np.isfinite(f[0])) for found in (crossing, veering)]
    assert 2.0 * math.pi * np.array(ends[0]) == pytest.approx(np.array([[10.0, 14.0], [14.0, 10.0]]), rel=1e-9)
    assert ends[1][0][1] < ends[1][1][1]
    assert np.abs(np.diff(crossing.rates, axis=0)).max() == pytest.approx(0.4, rel=1e-9)  # each step is one of its own


def test_a_critical_value_on_a_value_of_the_sweep_is_told_once():
    found = over(lambda p: turning(p - 0.5, 5.0), count=11)
    assert [one.value for one in found.critical] == [pytest.approx(0.5, rel=1e-12)]


@pytest.mark.parametrize(
    ("start", "end", "becomes", "sides"),
    [
        (0.0, 0.5, "unstable", (0, None)),
        (0.5, 1.0, "unstable", (0, 2)),
        (1.0, 0.5, "unstable", (0, 2)),
    ],
)
def test_a_critical_value_at_an_end_of_the_axis_is_told(start, end, becomes, sides):
    [one] = over(lambda p: turning(p - 0.5, 5.0), start, end, 6).critical
    assert one.value == pytest.approx(0.5, rel=1e-7)
    assert (one.becomes, one.below, one.above) == (becomes, *sides)


@pytest.mark.parametrize(("count", "width"), [(3, 0.0317), (4, 1e-3), (11, 1e-3)])
def test_two_critical_values_far_closer_than_the_grid_are_found(count, width):
    found = over(lambda p: turning(width**2 - (p - 0.47) ** 2, 5.0), count=count)
    assert [one.value for one in found.critical] == pytest.approx([0.47 - width, 0.47 + width], rel=1e-9)
    assert [one.becomes for one in found.critical] == ["unstable", "stable"]
    assert [(one.below, one.above) for one in found.critical] == [(0, 2), (2, 0)]
    assert found.resolution <= 1.0 / (count - 1)


FORCE = 2.0 / (0.32 / 0.05 * math.exp(-1.2))  # slope(v0) F0 = d


@pytest.mark.parametrize("values", [np.linspace(0.0, 40.0, 9), np.linspace(40.0, 0.0, 9), np.geomspace(0.01, 40, 5)])
def test_a_critical_value_next_to_a_point_without_sliding_is_found(values):
    found = rig.sweep("belt", "load.force", values)
    [one] = found.critical
    assert one.value == pytest.approx(FORCE, rel=1e-12)
    assert (one.below, one.above) == (0, 2)
    assert [gap[:2] for gap in found.gaps] == [(0.0, 0.0)] * (0.0 in values)
    assert ("no steady sliding at 0 N: nothing presses contact" in found.text()) is (0.0 in values)


def test_a_loop_is_swept_through_a_point_without_sliding():
    """(slope(v) F0 - d - mu(v) K) / 2 m = 0 for a loop without delay; sample and hold moves it by 1e-4."""
    found = rig.sweep("belt_normal_force", "drive.speed", np.linspace(0.0, 0.1, 5), controller="nf")
    [one] = found.critical

    def growth(v):
        falling = 0.32 * math.exp(-v / 0.05)
        return falling / 0.05 * 20.0 - 2.0 - (0.18 + falling) * 200.0

    assert one.value == pytest.approx(brentq(growth, 0.01, 0.1), rel=1e-3)
    assert found.notes[0] == "no loop"
    assert "no loop at 0 m/s: no steady sliding" in found.text()


def test_one_of_two_growing_motions_leaves():
    """north: the stiffness is singular at (c1 + c2) c_phi + c1 c2 s (s - mu h) = 0; another divergence goes on."""
    found = rig.sweep(rig.load("north", {"limits.displacement": "none"}), "friction.mu", np.linspace(20.0, 30.0, 11))
    [one] = found.critical
    assert one.value == pytest.approx((0.003 + 1e8 * 1.5e4 / (2e7 * 8e7 * 0.003)) / 0.012, rel=1e-9)
    grow = np.count_nonzero(found.rates.real > 1.0, axis=1)
    assert (one.below, one.above) == (grow[0], grow[-1]) == (2, 1)
    assert "unstable on both sides: 2 eigenvalues grow below, 1 above" in found.text()
    assert "stable above" not in found.text()
    assert one.value == pytest.approx(found.gaps[0].start, rel=1e-6)  # beyond a divergence the contact would pull


def test_a_motion_without_damping_is_not_critical_everywhere():
    assert over(lambda p: turning(0.0, 5.0 + p)).critical == ()
    assert over(lambda p: beside(turning(0.0, 5.0 + p), turning(-0.1, 7.0))).critical == ()


@pytest.mark.parametrize("size", [2, 5])
@pytest.mark.parametrize("seed", range(2))
def test_as_many_motions_begin_to_grow_as_growth_rates_pass_zero(seed, size):
    """Each critical value changes the number of growing eigenvalues: a pair by flutter, one by divergence."""
    random = np.random.default_rng(seed)
    here, there = random.normal(size=(2, size, size))
    found = over(lambda p: (1.0 - p) * here + p * there, count=41)
    grown = [np.count_nonzero(np.linalg.eigvals(A).real > 0.0) for A in (here, there)]
    weights = {"flutter": 2, "divergence": 1}
    change = sum(weights[one.kind] * (1 if one.becomes == "unstable" else -1) for one in found.critical)
    assert change == grown[1] - grown[0]
    for one in found.critical:
        rates = np.linalg.eigvals((1.0 - one.value) * here + one.value * there)
        assert np.abs(rates.real).min() < 1e-9


def test_a_range_of_sliding_between_two_values_without_is_found():
    """Only the one end of this sweep slides, and so does a range in its middle."""
    found = rig.sweep(rig.load("disc_slider", {"limits.height": "none"}), "drive.speed", [900.0, 930.0])
    edges = [(gap.start, gap.end) for gap in found.gaps]
    assert edges == [pytest.approx((911.974, 917.596), abs=1e-3), pytest.approx((924.753, 930.0), abs=1e-3)]
    assert all("would have to pull" in gap.why for gap in found.gaps)
    assert any(917.6 < one.value < 924.7 for one in found.critical)


def test_a_sign_that_changes_over_a_range_without_sliding_is_no_crossing():
    """Of two such ranges each keeps its own edges: what slides between both is not taken for a part of one."""

    def growths(value):
        if 0.48 <= value <= 0.52 or 0.6 <= value <= 0.65:
            return None
        return Growth(np.array([-1.0 if value < 0.5 else 1.0]), np.zeros(1))

    def look(grid):
        return grid, [root(b, growths) for part in stretches(grid, growths) for b in brackets(part, growths)]

    for values in ((0.0, 0.4, 1.0), (1.0, 0.4, 0.0)):
        grid, found = looked(values, growths, look)
        assert found == []
        assert grid == sorted(grid, reverse=values[0] > values[-1])
        assert any(0.52 < value < 0.6 and growths(value) is not None for value in grid)
