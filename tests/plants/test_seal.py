"""The axial seal: its measured friction force as a law, and where sliding and stick-slip end (equations 3.1 to 3.4).

Kroeger, Neubauer, Popp (2008), section 3a. Numbers: tests/reference/kroger_rigs.json, by independent code.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import rig
from rig.laws.seal import Seal

MM = 1e-3  # m/s per mm/s
CURVES = {"V1": (9.7, 0.7, 1.2), "V1c": (9.7, 0.62, 1.1)}
SCENES = {"V1": "seal_p", "V1c": "seal_l"}
MOVED = {"drive.speed": "ramped"}


def law_of(curve, load=10.0):
    mixed, decay, film = CURVES[curve]
    numbers = {"mixed_force": mixed, "decay": decay * 1e3, "film": f"{film} N/(mm/s)^0.5", "offset": 1e-5}
    return Seal(law="seal", load=load, **numbers).friction()


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("load", [10.0, 37.0])
def test_force_is_that_of_the_curve_whatever_the_load_it_is_told_for(rigs, curve, load):
    law, shipped = law_of(curve, load), rig.load(SCENES[curve]).parameters
    for v, force in rigs["seal"][curve]["F"].items():
        assert load * law.mu(float(v) * MM) == pytest.approx(force, rel=1e-12)
        assert shipped.load.force * shipped.friction.friction().mu(float(v) * MM) == pytest.approx(force, rel=1e-12)
    assert load * law.static == pytest.approx(rigs["seal"][curve]["F"]["0"], rel=1e-12)


def test_slope_and_the_speed_of_least_friction_are_those_of_the_curve(rigs):
    law = law_of("V1")
    for v, slope in rigs["seal"]["V1"]["dF_Ns_per_mm"].items():
        assert 10.0 * law.slope(float(v) * MM) * MM == pytest.approx(slope, rel=1e-9)
        h = 1e-8
        v = float(v) * MM
        assert law.slope(v) == pytest.approx((law.mu(v + h) - law.mu(v - h)) / (2.0 * h), rel=1e-5)
    for curve in CURVES:
        least = brentq(law_of(curve).slope, 1.0 * MM, 20.0 * MM, xtol=1e-14)
        assert least / MM == pytest.approx(rigs["seal"][curve]["v_min"], rel=1e-9)


def test_below_zero_speed_the_law_goes_on_straight():
    """Its own formula would have a branch point at -0.01 mm/s and a pole at -1.43 mm/s, within a trial step's reach."""
    law = law_of("V1")
    for v in (-1e-7, -1e-5, -2e-3, -0.1):
        assert law.mu(v) == pytest.approx(law.static + v * law.slope(0.0), rel=1e-12)
        assert law.slope(v) == law.slope(0.0)


def growth(scene, speed, damping):
    return rig.modes(rig.load(scene, {"drive.speed": speed, "body.damping": damping})).sliding.growth


def test_critical_speed_falls_with_damping(rigs):
    for d, speed in rigs["seal"]["V1_vcrit_of_d"].items():
        below, above = (growth("seal_p", speed * f * MM, float(d) / MM) for f in (1.0 - 1e-6, 1.0 + 1e-6))
        assert below > 0.0 > above


def test_linear_limits_of_both_readings(rigs):
    assert growth("seal_p", 6.025 * MM, 5.0) > 0.0 > growth("seal_p", 6.035 * MM, 5.0)
    exact = rigs["seal"]["V1c"]["d_for_vcrit7_Ns_per_mm"] / MM
    assert growth("seal_l", 7.0 * MM * (1.0 - 1e-9), exact) > 0.0 > growth("seal_l", 7.0 * MM * (1.0 + 1e-9), exact)
    assert rig.load("seal_l").parameters.body.damping == pytest.approx(exact, rel=1e-4)


def force(v):
    """Equation 3.1 [N], v in m/s."""
    return 9.7 / (0.7 * v / MM + 1.0) + 1.2 * np.sqrt(v / MM + 0.01)


def slipping(speed, m, c, d):
    """The equation of slip for scipy."""
    return lambda _, y: [y[1], (force(max(speed - y[1], 0.0)) - d * y[1] - c * y[0]) / m]


def test_stick_slip_that_is_run_up_lives_to_seven_millimetres_a_second(move, rigs):
    """6.998 mm/s, beyond the linear limit of 6.03: the speed is stepped, the state carried on."""
    expected = rigs["seal"]["V1_global_restick_limit"][3]
    assert (expected["m"], expected["c"], expected["d"]) == (0.2, 20000.0, 5.0)
    run = move("seal_p", moved=MOVED, duration=0.5, tolerance=1e-9)
    low, high = expected["v_glob"] - 4e-6, expected["v_glob"] + 4e-6
    run.run_up(3.0 * MM, 6.9 * MM, 1.0 * MM)
    run.run_up(6.9 * MM, low, 0.02 * MM)
    assert run.sticks(2000, 1000)
    run.run_up(low, high, 2e-4 * MM)
    assert not run.sticks(2000, 1000)


def test_stick_slip_events_are_those_of_scipy(move):
    """The first slip from rest: when it is let go in closed form, when it sticks again by DOP853."""
    m, c, d, speed = 0.2, 2e4, 5.0, 3.0 * MM
    run = move("seal_p", duration=0.4, tolerance=1e-10)
    release = (force(0.0) - d * speed) / (c * speed)
    assert run.times("contact releases +")[0] == pytest.approx(release, rel=1e-12)

    def stuck(t, y):
        return 1.0 if t < 1e-3 else speed - y[1]

    stuck.terminal, stuck.direction = True, -1.0
    slip = solve_ivp(
        slipping(speed, m, c, d), (0.0, 0.1), [speed * release, speed], "DOP853", rtol=1e-12, atol=1e-16, events=stuck
    )
    found = run.times("contact slip ends")
    assert slip.t_events[0].size
    assert found[0] - release == pytest.approx(slip.t_events[0][0], rel=1e-6)
    cycle = rig.limit_cycle("seal_p")
    assert cycle.period == pytest.approx(np.diff(run.times("contact releases +"))[-1], rel=1e-8)
    assert abs(cycle.energy["error"]) < 1e-9
