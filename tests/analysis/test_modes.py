"""Eigenvalues at the sliding equilibrium, and averaged under dither.

Numbers: set PEND of Kroeger, Neubauer, Popp (2008) (m = 5, c = 2500, d = 2, F0 = 20, v0 = 0.06; characteristic A:
0.5, 0.18, 0.05), computed independently; the closed forms are theirs, sections 2 and 4.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rig
from rig.analysis import map as maps
from rig.analysis.cycles.averaged import mean_friction
from rig.analysis.linear.modes import modes
from rig.analysis.linear.modes_report import Mode
from rig.analysis.linear.regions import regions
from rig.bench.free_rig import TIGHT, FreeRig
from rig.errors import SceneError, UsageError
from rig.model import friction_law
from rig.scenes.axis import Axis, axes

COULOMB = friction_law.coulomb(0.4, 0.25)
STRIBECK = friction_law.stribeck(0.5, 0.18, 0.05)


@pytest.mark.parametrize("name", ["belt", "pendulum"])
def test_sliding_of_characteristic_a_flutters(name):
    """The pendulum is the mass on the belt at its contact."""
    sliding = modes(rig.load(name)).sliding
    assert sliding.growth == pytest.approx(3.6552859127349846, rel=1e-9)
    mode = sliding.modes[0]
    assert mode.frequency == pytest.approx(3.5109410356792674, rel=1e-9)
    assert sliding.equilibrium["displacement"] == pytest.approx(0.0022110571824952375, rel=1e-12)
    assert not sliding.stable
    if name == "belt":
        rate = complex(mode.growth, 2.0 * math.pi * mode.frequency)
        assert mode.shape["x'"] / mode.shape["x"] == pytest.approx(rate, rel=1e-12)


def test_growth_of_a_linear_law_is_its_slope_against_the_damper_and_coulomb_friction_leaves_the_damper_alone():
    assert modes(rig.load("belt_b")).sliding.growth == pytest.approx((0.8 * 20.0 - 2.0) / 10.0, rel=1e-12)
    mode = modes(rig.load("belt_c_damped")).sliding.modes[0]
    assert mode.growth == pytest.approx(-2.0 / 10.0, rel=1e-12)
    assert mode.damping == pytest.approx(2.0 / (2.0 * math.sqrt(5.0 * 2500.0)), rel=1e-12)
    assert modes(rig.load("belt_c")).sliding.modes[0].kind == "neutral"


def test_a_growth_below_its_estimated_error_is_undecided():
    kinds = [Mode(0.1, 800.0, -2e-5, {}, {}, error).kind for error in (None, 1e-6, 1e-4)]
    assert kinds == ["flutter", "flutter", "undecided"]


def test_what_stays_is_no_divergence():
    """An open shunt keeps its charge and its current: two eigenvalues that are zero, not small."""
    kinds = {mode.kind: mode for mode in modes(rig.load("brake_shunt")).sliding.modes}
    assert kinds.keys() == {"flutter", "stays", "decays"}
    assert kinds["stays"].growth == kinds["stays"].frequency == 0.0


def test_no_analysis_accepts_an_equilibrium_beyond_a_limit_of_the_scene(tmp_path):
    """The mass of the belt would slide 2.2 mm from its unloaded place."""
    scene = rig.load("belt", {"limits.displacement": "2 mm"})
    why = "displacement is 0.002211 m, beyond limits.displacement = 0.002 m"
    assert why in modes(scene).text()
    with pytest.raises(SceneError, match=why):
        rig.state_space(scene)
    assert [gap.why for gap in rig.sweep(scene, "body.damping", [1.0, 2.0]).gaps] == [
        f"where all forces balance, {why}"
    ]
    speeds, dampings = (Axis.parse(text, scene) for text in ("drive.speed=0.05:0.07 m/s:2", "body.damping=1:2:2"))
    assert "beyond limits.displacement = 0.002 m" in regions(scene, speeds, dampings).text()
    found = rig.map(scene, "drive.speed=0.05:0.07:2", runs=("near",), folder=tmp_path, workers=1)
    assert np.isnan(found.growth).all()
    assert not rig.limit_cycle(scene).found


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


SLOW = {"dither.enable": "true", "dither.frequency": 1.5915494, "dither.amplitude": 1.0}


def variational(rates, slopes, states, period):
    """Exponents of the periodic motion of x' = rates(t, x), with slopes d rates / d x, by direct integration."""

    def both(t, y):
        x, P = y[:states], y[states:].reshape(states, states)
        return np.concatenate([rates(t, x), (slopes(t, x) @ P).ravel()])

    x = np.zeros(states)
    for _ in range(12):
        begin = np.concatenate([x, np.eye(states).ravel()])
        end = solve_ivp(both, (0.0, period), begin, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        P = end[states:].reshape(states, states)
        x = x + np.linalg.solve(np.eye(states) - P, end[:states] - x)
    return np.log(np.linalg.eigvals(P).astype(complex)) / period


def test_dither_at_the_natural_frequency_is_not_averaged_but_forces_a_motion():
    """The closed contact of two_dof: its equations typed here, integrated with their variational equation."""
    found = modes(rig.load("two_dof_dither", SLOW))
    turn, mu, k3, F0 = 2.0 * math.pi * 1.5915494, 0.5, 50.0, 1.0
    K, D = np.zeros((2, 2)), np.zeros((2, 2))
    for k, d, degrees in ((100.0, 0.2, 150.0), (50.0, 0.2, 45.0)):
        lean = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
        K, D = K + k * np.outer(lean, lean), D + d * np.outer(lean, lean)
    K[1, 1] += k3
    K[0, 1] += mu * k3  # friction mu N on x, N = -k3 y
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -D]])
    exponents = variational(
        lambda t, x: A @ x + [0.0, 0.0, math.sin(turn * t), -F0], lambda t, x: A, 4, 2.0 * math.pi / turn
    )
    assert exponents.real.max() == pytest.approx(0.4534, abs=5e-5)
    assert found.dithered.growth == pytest.approx(exponents.real.max(), rel=1e-7)
    assert found.dithered.coefficient["contact"] == pytest.approx(mu, rel=1e-9)
    assert found.dithered.modes[0].frequency == pytest.approx(found.sliding.modes[0].frequency, rel=1e-6)
    assert not found.dithered.exists  # the contact would have to pull
    assert "not averaged: 1.59155 Hz is not far above" in found.text()


def test_the_exponents_of_a_slow_dither_with_falling_friction_are_those_of_its_variational_equation():
    scene = rig.load("belt_dither", {"dither.frequency": 5.0, "dither.amplitude": 0.02})
    body, law = scene.parameters.body, scene.parameters.friction
    N, turn, drop = scene.parameters.load.force, 10.0 * math.pi, law.mu_static - law.mu_dynamic

    def w(t, x):
        return scene.parameters.drive.speed + 0.02 * math.sin(turn * t) - x[1]

    def rates(t, x):
        mu = law.mu_dynamic + drop * math.exp(-w(t, x) / law.speed_scale)
        return np.array([x[1], (mu * N - body.stiffness * x[0] - body.damping * x[1]) / body.mass])

    def slopes(t, x):
        by_speed = drop / law.speed_scale * math.exp(-w(t, x) / law.speed_scale) * N
        return np.array([[0.0, 1.0], [-body.stiffness / body.mass, (by_speed - body.damping) / body.mass]])

    found = modes(scene).dithered
    assert found.exists
    assert found.growth == pytest.approx(variational(rates, slopes, 2, 0.2).real.max(), rel=1e-6)


def test_a_slow_dither_that_reverses_the_slip_has_the_exponents_of_its_simulation():
    """Two simulated motions, displaced by little, approach each other with the largest exponent."""
    scene = rig.load("two_dof_dither", {"dither.enable": "true", "dither.frequency": 5.0, "dither.amplitude": 14.0})
    found = modes(scene).dithered
    assert found.exists
    flow = FreeRig(scene, tolerance=TIGHT)
    x = flow.carried(flow.system.start, 40.0).x
    y, apart = x.copy(), []
    y[:2] += 1e-6
    for _ in range(2):
        x, y = (flow.carried(z, 20.0).x for z in (x, y))
        energy = 100.0 * np.sum((x - y)[:2] ** 2) + np.sum((x - y)[2:4] ** 2)
        apart.append(0.5 * math.log(energy))
    assert (apart[1] - apart[0]) / 20.0 == pytest.approx(found.growth, abs=0.02)
    assert found.growth < 0.0


def test_a_disturbance_that_ends_in_stick_is_no_mode_of_a_slow_dither():
    """The contact sticks in every period: of two multipliers one is zero."""
    found = modes(rig.load("belt_dither", {"dither.frequency": 8.0, "drive.speed": 0.08})).dithered
    assert len(found.modes) == 1
    assert found.stable
    assert found.modes[0].frequency == pytest.approx(4.0, rel=1e-9)


def test_a_multiplier_below_minus_one_is_growth_at_half_the_frequency():
    found = modes(rig.load("belt_dither", {"dither.frequency": 5.0})).dithered
    assert found.growth > 0.0
    assert [mode.frequency for mode in found.modes] == pytest.approx([2.5], rel=1e-9)  # stick ends the other


def test_a_lag_is_no_mode_of_a_forced_motion():
    """The pendulum of this scene is the mass on the belt at its contact, with a lag of its load."""
    dither = {"frequency": 5.0, "amplitude": 0.02}
    on_belt = modes(rig.load("belt_dither", {f"dither.{key}": value for key, value in dither.items()})).dithered
    found = modes(rig.load("pendulum", {"dither": {**dither, "on": "belt"}})).dithered
    assert [mode.growth for mode in found.modes] == pytest.approx([on_belt.growth], rel=1e-6)


def test_a_dither_slower_than_many_oscillations_is_refused_at_once():
    found = modes(rig.load("belt_dither", {"dither.frequency": 0.001, "dither.amplitude": 0.02})).dithered
    assert not found.modes
    assert "the rig oscillates 3511 times, and at most 30 are computed" in found.why


def test_a_sweep_over_slow_dither_is_a_gap_with_the_reason():
    scene = rig.load("two_dof_dither", {"dither.enable": "true"})
    found = rig.sweep(scene, "dither.frequency", [2.5, 30.0, 31.0])
    assert [bool(note) for note in found.notes] == [True, False, False]
    assert "not far above the natural frequencies" in found.text()
    chart = regions(scene, *axes(scene, {"--x": "dither.frequency=2.5:31:2", "--y": "friction.mu=0.4:0.5:2"}))
    assert np.isnan(chart.growth[:, 0]).all()
    assert np.isfinite(chart.growth[:, 1]).all()
    assert "not far above the natural frequencies" in chart.text()


def test_a_shape_is_told_by_energy_which_weighs_metres_and_radians_alike():
    """north: kinetic energy m |x'|^2 + J |tilt'|^2, whatever the unit of the tilt."""
    first = modes(rig.load("north")).sliding.modes[0]
    x, tilt = 0.5 * abs(first.shape["x"]) ** 2, 7.2e-5 * abs(first.shape["tilt"]) ** 2
    assert first.energy == pytest.approx({"x": x / (x + tilt), "tilt": tilt / (x + tilt)}, rel=1e-12)
    assert first.shape["x"] == 1.0
    assert abs(first.shape["tilt"]) > 30.0  # rad/m: far larger as a number, a sixth of the energy
    assert sum(first.energy.values()) == pytest.approx(1.0)
    assert "x 83.4 % at 0 deg, tilt 16.6 % at 100 deg" in modes(rig.load("north")).text()


def test_a_resonance_of_the_network_is_no_motion_of_the_structure():
    slow, fast = modes(rig.load("belt_shunt")).sliding.modes
    assert slow.energy["x"] == pytest.approx(1.0, abs=1e-5)
    assert fast.energy["shunt.voltage"] == pytest.approx(0.5, abs=1e-3)
    assert fast.energy["shunt.current"] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "changes", "why", "counts"),
    [
        ("belt", {"drive.speed": 0.0}, "the surface at contact does not move", False),
        ("north", {"load.force": 0.0}, "nothing presses contact", True),
        ("north_divergence", {"friction.mu": 1.2}, "contact would have to pull (normal force -", True),
        ("pin", {"friction.mu": 2.2}, "contact would have to pull (normal force -", False),  # jams: nothing moves so
        ("pin", {"friction.mu": 1.2, "load.force": 0.0}, "friction takes up all of the inertia", False),
    ],
)
def test_what_keeps_a_rig_from_sliding_is_told(name, changes, why, counts):
    found = modes(rig.load(name, changes))
    assert not found.sliding.exists
    assert why in found.sliding.why
    assert found.sliding.counts is counts
    assert ("growth 1/s" in found.text()) is counts


def test_equilibrium_tells_the_film() -> None:
    """The pressure centre stands mu h off the middle, 4.08 mm, which is what friction tilts the slider by."""
    found = rig.modes("plate")
    at = found.sliding.equilibrium
    assert found.sliding.exists
    assert at["normal_force"] == pytest.approx(108.79, rel=1e-9)
    assert at["friction_force"] == pytest.approx(0.3 * 108.79, rel=1e-9)
    assert at["pressure_centre_x"] == pytest.approx(0.3 * 0.0136, rel=1e-6)
    assert at["pressure_centre_y"] == pytest.approx(0.0, abs=1e-9)
    assert at["contact_fraction"] == 1.0
    pressures = [v for name, v in at.items() if name.startswith("pressure_") and name[-1].isdigit()]
    assert len(pressures) == 40
    assert sum(pressures) / 40 == pytest.approx(1e5, rel=1e-4)
    assert "pressure of 40 points: " in found.text()
    assert len(found.sliding.modes) == 43


def test_a_slider_that_travels_back_is_one_that_travels_on_from_the_other_end() -> None:
    """The plate is alike from both ends: growth rates and frequencies are the same, forces and places mirrored."""
    on = rig.modes(rig.load("plate", {"slider.position": 0.004})).sliding
    back = rig.modes(rig.load("plate", {"slider.position": 0.0437 - 0.004, "drive.speed": -0.01})).sliding
    largest = [max(found.modes, key=lambda mode: mode.growth) for found in (on, back)]
    assert largest[0].growth > 100.0
    assert largest[1].growth == pytest.approx(largest[0].growth, rel=1e-2)
    assert largest[1].frequency == pytest.approx(largest[0].frequency, rel=1e-5)
    for name in ("friction_force", "pressure_centre_x", "pitch_displacement"):  # rows lie between other places there
        assert back.equilibrium[name] == pytest.approx(-on.equilibrium[name], rel=1e-3)


def test_flutter_by_position() -> None:
    """Sliding is stable at the end and in the middle of the plate, and flutters between them; a run is not refused."""
    there = [rig.modes(rig.load("plate", {"slider.position": place})) for place in ("0 mm", "4 mm", "20 mm")]
    assert [found.sliding.growth > 0.0 for found in there] == [False, True, False]
    assert {finding.level for finding in there[1].findings} <= {"info", "warning"}


@pytest.mark.parametrize("study", [rig.limit_cycle, lambda scene: maps.job(scene, "drive.speed=0.001:0.01:3")])
def test_studies_of_single_motions_are_refused(study) -> None:
    with pytest.raises(UsageError, match=r"plate: .* film of points: after the first opening motion is chaotic"):
        study(rig.load("plate"))


def test_points_that_would_have_to_pull_are_told() -> None:
    found = rig.modes(rig.load("plate", {"friction.mu": 1.0}))
    assert found.sliding.pulls == 8
    assert "8 points would have to pull" in found.text()


def test_a_map_of_a_rig_without_a_contact_that_slides_is_refused() -> None:
    with pytest.raises(UsageError, match=r"plate_free: the rig has no contact that can slide"):
        maps.job(rig.load("plate_free"), "plate.young=2e11:2.3e11:3")


def test_a_free_plate_has_the_lines_of_the_paper() -> None:
    """Twist and two bendings; 5.7, 8.0 and 10.8 kHz in the paper."""
    found = sorted(mode.frequency for mode in rig.modes("plate_free").sliding.modes if mode.frequency)
    assert found[:3] == pytest.approx([5701.3, 8032.2, 10838.9], rel=3e-3)
