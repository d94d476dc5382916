"""The tilted tuned mass on belt and pendulum: its eigenvalues, its motion, and where it jams.

Numbers: Kroeger, Neubauer, Popp (2008), equations 4.10 to 4.13, with calibrated parameters, by independent code
(tests/reference/tuned_mass.json).
"""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from reference import numbers

import rig
from rig.analysis.cycles.cycle import limit_cycle
from rig.analysis.linear.modes import modes
from rig.stability.linearisation import sliding_key, steady
from rig.stability.report import stability_report

ORACLE = numbers("tuned_mass")
P = ORACLE["params"]
COULOMB = {"friction.law": "coulomb", "friction.mu_static": 0.45, "friction.mu_kinetic": 0.25}


def tuned(angle, ratio, **changes):
    return rig.load("belt_tuned_mass", {"tuned_mass.angle": angle, "tuned_mass.damping_ratio": ratio} | changes)


def test_the_scene_has_the_numbers_of_the_reference():
    p = rig.load("belt_tuned_mass").parameters
    assert (p.body.mass, p.body.stiffness, p.body.damping) == (P["m1"], P["c1"], P["d1"])
    assert (p.tuned_mass.mass, p.tuned_mass.stiffness) == (P["m2"], P["c2"])
    assert (p.friction.mu_zero, p.friction.slope, p.drive.speed, p.load.force) == (P["mu0"], P["dmu"], P["v0"], P["N0"])


@pytest.mark.parametrize("point", ORACLE["points"], ids=lambda p: f"{p['alpha']:g} {p['D2']:g}")
def test_the_least_stable_motion_is_that_of_the_reference(point):
    least = modes(tuned(point["alpha"], point["D2"])).sliding.modes[0]
    assert least.growth == pytest.approx(point["re"], rel=1e-6)
    assert 2.0 * math.pi * least.frequency == pytest.approx(point["im"], rel=1e-6)


def in_order(values):
    return sorted(values, key=lambda one: (round(one.real, 6), one.imag))


@pytest.mark.parametrize("angle", ORACLE["eq413_undamped_w2"])
def test_without_damping_the_tilt_couples_the_modes_into_flutter_on_one_side(angle):
    constant = {"friction.law": "coulomb", "friction.mu_static": P["mu0"], "friction.mu_kinetic": P["mu0"]}
    scene = tuned(float(angle), 0.0, **(constant | {"body.damping": 0.0}))
    system = scene.assemble().system()
    squares = in_order(-(steady(system, sliding_key(system)).eigenvalues() ** 2))
    expected = in_order(complex(*w2) for w2 in ORACLE["eq413_undamped_w2"][angle])
    double = 1e-6 if angle == "0.0" else 1e-9  # a double root is known to the square root of rounding
    assert squares[0::2] == pytest.approx(expected, rel=double)
    assert squares[1::2] == pytest.approx(expected, rel=double)


@settings(max_examples=10)
@given(off=st.floats(0.01, 1.5), ratio=st.floats(0.0, 0.6), mu=st.floats(0.1, 0.7), slope=st.floats(0.0, 0.5))
@example(off=1.0, ratio=0.0, mu=0.5, slope=1e-300)  # a law that changes by less than rounding
def test_the_map_over_the_tilt_is_symmetric_about_minus_half_the_friction_angle(off, ratio, mu, slope):
    law = {"friction.mu_zero": mu + slope * P["v0"], "friction.slope": slope}  # mu at the belt speed
    middle = -0.5 * math.atan(mu)
    there, back = (modes(tuned(middle + d, ratio, **law)).sliding.growth for d in (off, -off))
    assert there == pytest.approx(back, abs=1e-6)


def test_tilted_one_way_the_cycle_dies_tilted_the_other_way_it_lives():
    right, wrong = limit_cycle(rig.load("belt_tuned_mass")), limit_cycle(rig.load("belt_tuned_mass_wrong"))
    assert not right.found
    assert right.why.startswith(
        "no limit cycle found from a standing start: sliding is stable, its least stable mode decays with 0.715028 1/s"
    )
    assert wrong.found
    assert wrong.stick_time["contact"] > 0.02
    assert wrong.energy["drive"] == pytest.approx(wrong.energy["friction"] + wrong.energy["damper"], rel=1e-8)


def phases(angle, ratio, law, static):
    """The rig as right-hand sides, guards and what follows: equations 4.10 to 4.12 written out, for scipy."""
    s, c = math.sin(angle), math.cos(angle)
    d2 = 2.0 * ratio * math.sqrt(P["c2"] * P["m2"])
    m1, m2 = P["m1"], P["m2"]

    def accelerations(mode, y):
        x, absorber, v, u = y
        if mode == "stick":  # x'' = 0: the absorber alone; the friction force is what that needs
            second = -(d2 * u + P["c2"] * absorber) / m2
            normal = P["N0"] + d2 * c * u + P["c2"] * c * absorber
            return 0.0, second, m2 * s * second + P["d1"] * v + P["c1"] * x, normal
        mu = law(P["v0"] - v)
        matrix = [[m1 + m2 - mu * m2 * s * c, m2 * s], [m2 * s, m2]]
        load = P["N0"] + d2 * c * u + P["c2"] * c * absorber
        right = [mu * load - P["d1"] * v - P["c1"] * x, -d2 * u - P["c2"] * absorber]
        first, second = np.linalg.solve(matrix, right)
        return first, second, mu * (load + m2 * s * c * first), load + m2 * s * c * first

    def rate(mode, t, y):
        first, second, _, _ = accelerations(mode, y)
        return [y[2], y[3], first, second]

    def guards(mode):
        if mode == "stick":
            return [lambda t, y: static * accelerations("stick", y)[3] - accelerations("stick", y)[2]]
        return [lambda t, y: P["v0"] - y[2]]

    def follow(mode, which, t, y):
        return ("slip" if mode == "stick" else "stick"), np.array(
            [y[0], y[1], P["v0"] if mode == "slip" else y[2], y[3]]
        )

    return rate, guards, follow


@pytest.mark.parametrize("angle", [0.305, -0.305])
@pytest.mark.parametrize("law", ["coulomb", "falling"])
def test_every_event_is_that_of_an_independent_integrator(move, chain, angle, law):
    constant = law == "coulomb"
    mu = (lambda w: 0.25) if constant else (lambda w: P["mu0"] - P["dmu"] * w)
    start = {"start.displacement": 0.0, "start.velocity": P["v0"], "tuned_mass.angle": angle}
    run = move("belt_tuned_mass", start | (COULOMB if constant else {}), duration=3.0, tolerance=1e-11)
    expected = chain(*phases(angle, 0.1, mu, 0.45 if constant else P["mu0"]), "stick", [0.0, 0.0, P["v0"], 0.0], 3.0)
    found = [(e.tick + e.place) * 1e-3 for e in run.motion.events()]
    assert len(expected) >= 2
    assert found == pytest.approx(list(expected), abs=3e-13 if constant else 3e-10)


def test_the_pendulum_carries_the_same_absorber():
    tables = {f"tuned_mass.{k}": v for k, v in rig.load("belt_tuned_mass").parameters.tuned_mass if v is not None}
    belt = modes(rig.load("belt", tables)).sliding
    pendulum = modes(rig.load("pendulum", tables)).sliding
    assert [m.growth for m in pendulum.modes] == pytest.approx([m.growth for m in belt.modes], rel=1e-9)
    assert [m.frequency for m in pendulum.modes] == pytest.approx([m.frequency for m in belt.modes], rel=1e-9)
    assert pendulum.equilibrium["displacement"] == pytest.approx(belt.equilibrium["displacement"], rel=1e-12)


def heavy(mu):
    """A light body under a heavy absorber: m1 + m2 cos^2 a = 0.231 kg; jams at mu = 0.6844."""
    law = {"friction.law": "coulomb", "friction.mu_static": mu, "friction.mu_kinetic": mu}
    changes = {"body.mass": 0.1, "tuned_mass.mass": 1.0} | law
    return stability_report(tuned(1.2, 0.1, **changes).assemble().system(), "exact", 1e-3)


def test_jamming_is_told_before_the_run():
    s, c = math.sin(1.2), math.cos(1.2)
    jams = (0.1 + c * c) / (s * c)
    far, near, beyond = (heavy(share * jams) for share in (0.5, 0.95, 1.01))
    assert not [one for one in far if "jam" in one.what]
    close = [one for one in near if "close to jamming" in one.what]
    assert close[0].level == "warning"
    assert close[0].number == pytest.approx((1.0 - 0.95) * (0.1 + c * c) / (1.1 - s * s), rel=1e-9)
    assert [one.level for one in beyond if "jams in contact slip+" in one.what] == ["error"]
