"""What is told, and what is refused, before a run starts.

Belt feedback and negative capacitance: Kroeger, Neubauer, Popp (2008), equations 4.7 and 4.14 to 4.20: growth (K-1)/lag
in stick; unstable below -1/(1 + kappa/k).
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rig
from rig.bench.run.before import findings
from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.stability.linearisation import explicit_inputs, inputs, own_law, sliding_key, steady
from rig.stability.memory_steps import fastest_memory, fastest_slips
from rig.stability.report import RK4_LIMIT, mode_sets, stability_report

STEP = 1e-3
COULOMB = friction_law.coulomb(0.4, 0.25)


def belt(law=COULOMB, mass=5.0, damping=2.0, stiffness=2500.0, speed=0.06):
    a = Assembly(title="test")
    a.coordinate("x", mass, damping, stiffness)
    a.patch("contact", {"x": 1.0}, {"one": speed}, law)
    a.normal("load", "contact", {"one": 20.0})
    return a


def fed_back(gain, lag=0.01, clamped=False):
    """A belt whose drive follows the body: V' = (v0 + K x' - V) / lag."""
    a = belt()
    a.surface("contact").clear()
    a.signal("belt", {"belt": -1.0 / lag}, 0.06, "drive")
    command = {"one": 0.06, "x'": gain}
    if clamped:
        a.limit("drive", command, 0.0, 0.25, "belt", 1.0 / lag)
    else:
        a.signals["belt"] |= {name: value / lag for name, value in command.items()}
    a.surface("contact")["belt"] = 1.0
    return a


def errors(assembly, method="exact", step=STEP, substeps=1):
    return [one for one in stability_report(assembly.system(), method, step, substeps) if one.level == "error"]


LOOSE = {
    "tip.mass": 5e-3,
    "tip.tangential_stiffness": 2.8e5,
    "tip.normal_stiffness": 8e4,
    "tip.coupling": 1.5e5,
    "tip.tangential_damping": 1.0,
    "tip.normal_damping": 1.0,
    "contact.stiffness": 3e5,
    "load.force": 34.0,
    "friction.law": "stribeck",
    "friction.mu_static": 1.4,
    "friction.mu_dynamic": 0.7,
    "friction.speed_scale": 0.1,
}
"""A tread block that is statically unstable without the plate."""


def test_growth_that_falling_friction_turns_into_contact_is_information():
    """The block diverges in slip; where its law is flat it flutters, and sticks. Open, it falls back from near."""
    system = rig.load("tread", LOOSE).assemble().system()
    found = {one.what: one.level for one in stability_report(system, "dopri5", 2e-5)}
    told = [(level, what) for what, level in found.items() if "divergence" in what]
    assert [level for level, _ in told] == ["warning", "info", "info"]
    c_x, c_z, coupling, load = 2.8e5, 8e4, 1.5e5, 34.0
    farthest = load * c_x / (coupling**2 - c_x * c_z)  # where the springs of the open tip balance the preload
    assert f"load closes, unless a disturbance carries it beyond z = {farthest:.3g}" in told[0][1]
    assert all("it grows until contact slip ends" in what for _, what in told[1:])


def test_an_open_contact_that_starts_beyond_its_rest_is_not_caught():
    system = rig.load("tread", LOOSE | {"start.height": 0.2}).assemble().system()
    assert any("load open" in one.what for one in stability_report(system, "dopri5", 2e-5) if one.level == "error")


def test_jamming_is_looked_for_at_speeds_that_occur():
    """The seal's film bears ever more force: at 1e6 m/s it would jam any absorber."""
    seal = {"law": "seal", "load": 20.0, "mixed_force": 9.7, "decay": 700.0, "film": 38.0, "offset": 1e-5}
    scene = rig.load("belt_tuned_mass", {f"friction.{key}": value for key, value in seal.items()})
    assert not [one for one in stability_report(scene.assemble().system(), "dopri5", STEP) if "jam" in one.what]


def test_stick_slip_is_information():
    found = stability_report(rig.load("belt").assemble().system(), "dopri5", STEP)
    assert [one.level for one in found] == ["info"]
    assert found[0].number == pytest.approx(3.6552859, rel=1e-6)
    assert "flutter in contact slip+" in found[0].what
    assert "3.511 Hz" in found[0].what


def test_growth_without_oscillation_is_information_where_the_law_is_flat_at_speed():
    steep = belt(friction_law.stribeck(0.5, 0.18, 0.002), speed=0.001)
    growth = steady(steep.system(), 0).eigenvalues()
    assert np.all(growth.real > 0.0)
    assert np.all(growth.imag == 0.0)
    assert not errors(steep, "dopri5")


def test_a_belt_that_follows_the_body_it_carries_runs_away():
    assert not errors(fed_back(0.99))
    (found,) = errors(fed_back(5.33))
    assert found.number == pytest.approx(4.33 / 0.01, rel=1e-9)
    assert "stick" in found.what
    assert "grows without limit" in found.what
    found = stability_report(fed_back(5.33, clamped=True).system(), "exact", STEP)
    assert "error" not in [one.level for one in found]
    assert any("limits of drive" in one.what for one in found)


@pytest.mark.parametrize(("delta", "refused"), [(-0.82, False), (-0.84, True)])
def test_a_negative_capacitance_is_refused_below_its_limit(delta, refused):
    kappa, e, resistance = 0.2 * 2500.0, 5.0, 1e3
    capacitance = e * e / kappa
    a = belt(stiffness=2500.0)
    a.stiffness["x", "x"] += kappa * delta / (1.0 + delta)
    a.network["U"] = {"U": -(1.0 + delta) / (resistance * capacitance), "x'": -e / capacitance}
    a.push("x", {"U": e / (1.0 + delta)})
    assert bool(errors(a)) is refused


def test_growth_that_no_contact_sees_is_refused():
    a = belt()
    a.coordinate("y", 1.0, -0.5, 100.0)
    found = errors(a)
    assert [one.number for one in found] == pytest.approx([0.25] * len(found), rel=1e-9)
    assert found
    assert all("y grows" in one.what for one in found)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"stiffness": -100.0}, "divergence in contact slip+"),
        ({"mass": 0.0}, "positive definite"),
        ({"stiffness": float("nan")}, "not a finite number in stiffness"),
    ],
)
def test_a_structure_that_pushes_away_or_has_no_inertia_or_no_numbers_is_refused(changes, told):
    assert any(told in one.what for one in errors(belt(**changes)))


@pytest.mark.parametrize(("inertia", "level"), [(5.0, None), (19.0, "warning"), (21.0, "error")])
def test_a_load_that_grows_with_the_acceleration_jams(inertia, level):
    """N = N0 + g x'': the effective mass is m - mu g, with mu = 0.25 and m = 5."""
    a = belt()
    a.normals.clear()
    a.normal("load", "contact", {"one": 20.0}, inertia={"x": inertia})
    found = [one for one in stability_report(a.system(), "exact", STEP) if "jam" in one.what]
    assert [one.level for one in found] == ([level] if level else [])
    if found:
        assert found[0].number == pytest.approx(1.0 - 0.25 * inertia / 5.0)


def test_a_signal_that_grows_by_itself_is_refused():
    a = belt()
    a.signal("wrong", {"wrong": 3.0}, 1.0, "test")
    (found,) = errors(a)
    assert found.number == pytest.approx(3.0)
    assert "wrong" in found.what


@pytest.mark.parametrize(("step", "levels"), [(1e-3, []), (0.05, ["warning"]), (0.2, ["error"])])
def test_steps_that_rk4_cannot_take_are_named(step, levels):
    found = [one for one in stability_report(belt(damping=0.0).system(), "rk4", step) if "rk4" in one.what]
    assert [one.level for one in found] == levels
    assert not [one for one in stability_report(belt(damping=0.0).system(), "rk4", step, 500) if "rk4" in one.what]
    if levels:
        assert found[0].number == pytest.approx(np.sqrt(500.0) * step, rel=1e-9)


def test_the_limit_of_rk4_is_where_its_polynomial_leaves_one():
    z = -RK4_LIMIT
    grown = 1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0
    assert grown == pytest.approx(1.0, abs=1e-3)


def test_a_network_much_faster_than_the_step_is_told():
    a = belt()
    a.network["U"] = {"U": -1e6, "x'": 1.0}
    assert "dopri5 takes its steps there with exact propagators" in stability_report(a.system(), "dopri5", STEP)[0].what
    assert errors(a, "rk4")
    assert not errors(a, "exact")


@settings(max_examples=15)
@given(
    st.floats(0.01, 1.0),
    st.floats(0.5, 50.0),
    st.floats(0.0, 5.0),
    st.floats(1e2, 1e5),
    st.floats(0.0, 0.2),
    st.floats(0.01, 0.3),
)
def test_growth_is_the_closed_form_of_one_degree_of_freedom(speed, mass, damping, stiffness, fall, scale):
    """x'' + ((d + mu'(v0) N) / m) x' + (c / m) x = 0, x_e = mu(v0) N / c."""
    law = friction_law.stribeck(0.1 + fall, 0.1, scale)
    at = steady(belt(law, mass, damping, stiffness, speed).system(), 0)
    effective = damping + law.slope(speed) * 20.0
    wanted = np.roots([mass, effective, stiffness])
    assert at.exists
    assert at.eigenvalues().real.max() == pytest.approx(wanted.real.max(), rel=1e-6, abs=1e-9)
    assert at.x[0] == pytest.approx(law.mu(speed) * 20.0 / stiffness, rel=1e-9)


def test_sliding_goes_the_way_of_the_belt():
    back = belt(speed=-0.06).system()
    at = steady(back, sliding_key(back))
    assert at.exists
    assert at.friction[0] == pytest.approx(-5.0)
    assert not steady(back, 0).exists


def test_two_bodies_with_two_contacts_slide_apart():
    a = Assembly()
    for i, name in enumerate(("x", "y")):
        a.coordinate(name, 1.0 + i, 0.5, 100.0)
        a.patch(f"on {name}", {name: 1.0}, {"one": 0.1 * (-1.0) ** i}, replace(COULOMB))
        a.normal(f"load {name}", f"on {name}", {"one": 10.0})
    system = a.system()
    at = steady(system, sliding_key(system))
    assert at.exists
    assert at.x[:2] == pytest.approx([0.025, -0.025])


@pytest.mark.parametrize(
    ("scale", "tolerance", "warned"), [(1e-6, 1e-7, True), (1e-6, 1e-9, False), (0.05, 1e-7, False), (1e-4, 1e-2, True)]
)
def test_a_tolerance_too_coarse_for_the_friction_law_is_told(scale, tolerance, warned):
    system = belt(friction_law.stribeck(0.5, 0.18, scale)).system()
    found = [one for one in stability_report(system, "dopri5", STEP, tolerance=tolerance) if "too coarse" in one.what]
    assert bool(found) == warned
    for one in found:
        better = float(one.remedy.split()[2])
        again = stability_report(system, "dopri5", STEP, tolerance=better)
        assert not [other for other in again if "too coarse" in other.what]


@pytest.mark.parametrize(
    ("name", "step", "level"),
    [
        ("belt_lugre", "0.1 ms", "error"),  # loses its stick-slip
        ("belt_lugre", "40 us", "error"),  # the belt is driven by friction, residual 0.5
        ("belt_lugre", "20 us", "warning"),  # the displacement is that of rosenbrock to 1e-7
        ("belt_elasto_plastic", "0.1 ms", "error"),  # diverges
        ("belt_rate_state", "0.1 ms", "error"),  # diverges after 4.1 s, when the contact creeps
        ("belt_dahl", "0.1 ms", "warning"),
        ("belt_stick_time", "0.1 ms", ""),
    ],
)
def test_rk4_is_refused_where_bristles_are_faster_than_its_step(name, step, level):
    scene = rig.load(name, {"clock.method": "rk4", "clock.rk4_step": step})
    assert [found.level for found in findings(scene) if found.what.startswith("rk4 is")] == ([level] if level else [])


def test_a_creeping_contact_whose_steady_slip_is_stable_is_not_refused():
    """Behind a spring stiffer than (b - a) N / distance the contact keeps its slip speed: a N / (m w) = 80 1/s."""
    stiff = {"body.stiffness": "1e4 N/m", "start.displacement": "8e-4 m", "clock.method": "rk4"}
    assert not [found for found in findings(rig.load("belt_rate_state", stiff)) if "rk4 is" in found.what]


def test_the_rate_of_bristles_is_the_closed_form():
    """LuGre in fast slip without sigma1: the bristles relax at sigma0 w / g(w), the body is slow."""
    system = rig.load("belt_lugre", {"friction.sigma1": 0.0}).assemble().system()
    rate, speed = fastest_memory(system, mode_sets(system))
    assert rate == pytest.approx(1e5 * speed / (0.18 + 0.32 * np.exp(-speed / 0.05)), rel=1e-3)


@pytest.mark.parametrize("scene", ["disc_slider", "lever", "tip"])
def test_the_inputs_without_derivatives_are_those_with_them(scene):
    """Products of states, angles, presses, normal forces and friction, at random states."""
    system = rig.load(scene).assemble().system()
    at = steady(system, sliding_key(system))
    contact = own_law(system, at.modes)
    explicit = explicit_inputs(system, at.modes, contact)
    for shift in 1e-3 * np.random.default_rng(1).standard_normal((20, system.n)):
        T, _ = inputs(system, at.modes, at.x + shift, contact)
        assert np.allclose(explicit(at.x + shift), T, rtol=1e-14, atol=0.0)


def test_the_fastest_slip_of_a_released_mass_is_the_closed_form():
    """V + (V^2 + (mu_s N omega / c)^2)^0.5 for a mass that its belt carries and releases."""
    [speed] = fastest_slips(rig.load("belt_lugre").assemble().system())
    assert speed == pytest.approx(0.06 + np.hypot(0.06, 0.5 * 20.0 / np.sqrt(5.0 * 2500.0)), rel=1e-4)
    system = rig.load("belt_dahl").assemble().system()
    released = 0.01 * np.sqrt(500.0)
    assert fastest_slips(system) == pytest.approx(np.hypot(released, 0.4 * 20.0 / np.sqrt(5.0 * 2500.0)), rel=1e-9)


def test_a_run_that_diverges_under_rk4_says_so():
    changes = {"friction.speed_scale": 1e-5, "clock.method": "rk4", "clock.rk4_step": "1 ms"}
    run = rig.simulate(rig.load("belt", changes), 1.0)
    assert "rk4 took steps of 0.001 s" in run.fault
    assert "Set clock.rk4_step to" in run.fault
