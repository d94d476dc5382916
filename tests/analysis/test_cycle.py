"""Limit cycles of set PEND against two independent integrators, and against the closed form of characteristic C.

Numbers: Kroeger, Neubauer, Popp (2008), section 2, with calibrated parameters; C without damping in closed form:
a = (mu_s - mu_k) F0 / c, b = v0 / w: T = 2 a / v0 + (2 pi - 2 atan2(a, b)) / w.
"""

import cmath
import json
import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import rig
from rig.analysis.cycle import limit_cycle
from rig.analysis.orbit import repeating
from rig.motion.motion import Event

ORACLE = {  # period, time in stick, lowest velocity, highest and lowest displacement, displacement where stick starts
    "belt": (0.32160366413722946, 0.10286728739274346, -0.10129890351933808, 0.006212858222975551,
             -0.0028512005379839915, -0.0022200372435646075),
    "belt_b": (0.2908260916234226, 0.04712730256525028, -0.07307059536727642, 0.005765545150626973,
               -0.0007760836703160775, 0.00032436184608498317),
    "belt_c_damped": (0.28244236395822964, 0.032130909046963446, -0.06393297265193866, 0.004899392899985426,
                      -0.0008190529276451587, 0.001224145457182193),
}  # fmt: skip


@pytest.mark.parametrize("name", ORACLE)
def test_cycles_are_those_of_independent_integrators(name):
    found = limit_cycle(rig.load(name))
    (x_min, x_max), (v_min, v_max) = found.extremes["displacement"], found.extremes["velocity"]
    got = (found.period, found.stick_time["contact"], v_min, x_max, x_min, found.stick_start["displacement"])
    assert got == pytest.approx(ORACLE[name], rel=1e-8)
    assert v_max == pytest.approx(0.06, rel=1e-9)


def test_the_cycle_without_damping_is_the_closed_form():
    a, b, w = 0.15 * 20.0 / 2500.0, 0.06 / math.sqrt(500.0), math.sqrt(500.0)
    found = limit_cycle(rig.load("belt_c"))
    assert found.method == "exact"
    assert found.period == pytest.approx(2.0 * a / 0.06 + (2.0 * math.pi - 2.0 * math.atan2(a, b)) / w, rel=1e-12)
    assert found.period == pytest.approx(0.28337885481892366, rel=1e-12)
    assert found.extremes["velocity"][0] == pytest.approx(-w * math.hypot(a, b), rel=1e-9)
    assert found.extremes["displacement"][1] == pytest.approx(0.25 * 20.0 / 2500.0 + math.hypot(a, b), rel=1e-9)


def test_the_contact_lets_go_where_the_limit_is_reached():
    found = limit_cycle(rig.load("belt_c_damped"))
    assert found.stick_end["friction_force"] == pytest.approx(0.4 * 20.0, rel=1e-9)
    assert found.stick_end["displacement"] == pytest.approx((0.4 * 20.0 - 2.0 * 0.06) / 2500.0, rel=1e-9)


def test_many_events_in_a_frame_are_not_too_many_for_a_block_of_frames(tmp_path):
    """31 events in a frame; an analysis advances by many frames at once."""
    scene = rig.load("belt_c", {"body.mass": "1 g", "body.stiffness": 1e7})
    a, b, w = 0.15 * 20.0 / 1e7, 0.06 / 1e5, 1e5
    period = 2.0 * a / 0.06 + (2.0 * math.pi - 2.0 * math.atan2(a, b)) / w
    assert limit_cycle(scene).period == pytest.approx(period, rel=1e-9)
    chart = rig.map(scene, "drive.speed=0.05:0.07:2", runs=("near",), longest=0.01, folder=tmp_path, workers=1)
    assert not chart.why.any()


@pytest.mark.parametrize("name", ["belt", "belt_c_damped"])
def test_what_the_belt_supplies_in_a_cycle_goes_into_friction_and_damper(name):
    energy = limit_cycle(rig.load(name)).energy
    assert energy["drive"] == pytest.approx(energy["friction"] + energy["damper"], rel=1e-8)
    assert abs(energy["stored"]) < 1e-8 * energy["drive"]
    assert abs(energy["error"]) < 1e-9


@pytest.mark.parametrize(
    ("name", "speed", "cycles"),
    [("belt", 0.67, True), ("belt", 0.68, False), ("belt_c_damped", 0.0775, True), ("belt_c_damped", 0.0782, False)],
)
def test_stick_slip_lives_beside_stable_sliding_up_to_a_speed(name, speed, cycles):
    found = limit_cycle(rig.load(name, {"drive.speed": speed}))
    assert found.found is cycles
    assert cycles or found.why.startswith("no limit cycle found from a standing start: sliding is stable")
    assert found.decided


def test_a_belt_at_rest_has_no_cycle():
    assert "nothing slides" in limit_cycle(rig.load("belt", {"drive.speed": 0.0})).why


def _events(times, names):
    return [Event(int(t // 1.0), t % 1.0, what, 0) for t, what in zip(times, names)]


def test_a_cycle_repeats_when_three_of_them_agree():
    names = ["a", "b", "c"] * 3
    even = _events([0.1, 0.2, 0.7, 1.1, 1.2, 1.7, 2.1, 2.2, 2.7], names)
    count, drift = repeating(even, 1.0)
    assert count == 3
    assert drift < 1e-12
    late = _events([0.1, 0.2, 0.7, 1.1, 1.2, 1.7, 2.1, 2.3, 2.7], names)
    assert repeating(late, 1.0)[1] == pytest.approx(0.1)
    assert repeating(even[:6], 1.0) == (0, math.inf)
    swapped = _events([t + e for t in (0.2, 0.7, 1.2, 1.7, 2.2, 2.7, 3.2) for e in (0.0, 1e-14)], "abcdbadcabdcab")
    for begin, end in ((0, 14), (1, 13), (1, 14)):
        count, drift = repeating(swapped[begin:end], 1.0)
        assert (count, drift < 1e-12) == (4, True), (begin, end)


def test_a_report_is_plain():
    found = limit_cycle(rig.load("belt_c_damped"))
    told = json.loads(json.dumps(found.to_json()))
    assert told["frequency"] == pytest.approx(1.0 / found.period)
    assert told["stick_share"]["contact"] == pytest.approx(0.11376, rel=1e-3)
    assert "limit cycle" in found.text()


def test_a_belt_that_runs_backwards_mirrors_the_cycle():
    forth, back = limit_cycle(rig.load("belt")), limit_cycle(rig.load("belt", {"drive.speed": -0.06}))
    assert back.period == pytest.approx(forth.period, rel=1e-10)
    low, high = forth.extremes["displacement"]
    assert back.extremes["displacement"] == pytest.approx((-high, -low), rel=1e-8)


def test_a_squeal_that_lift_off_bounds_is_a_cycle_that_attracts():
    """Its slowest disturbance dies away with 1.6 1/s, 2000 times in a period: the search has to wait for it."""
    told = []
    found = limit_cycle(rig.load("brake_3400"), watch=lambda now, drift: told.append((now, drift)))
    assert found.found
    assert found.frequency == pytest.approx(3398.58, abs=0.01)
    assert found.amplitude["velocity"] == pytest.approx(0.17576, rel=1e-4)
    assert found.stick_time == {"inner_pad": 0.0, "outer_pad": 0.0}
    assert abs(found.extremes["normal_force_inner_left"][0]) < 1e-6  # it lifts off there, and only there
    assert found.extremes["normal_force_inner_right"][0] > 200.0
    assert math.log(found.multiplier) / found.period == pytest.approx(-1.6, abs=0.1)
    assert "more of size" in found.floquet.text()
    times, drifts = zip(*told)
    assert list(times) == sorted(times)
    assert drifts[-1] <= 1e-9 < drifts[len(drifts) // 2]


@pytest.mark.slow
def test_the_charge_of_an_open_stack_is_free():
    found = limit_cycle(rig.load("brake_shunt"))
    assert found.frequency == pytest.approx(3399.62, abs=0.01)
    assert found.amplitude["velocity"] == pytest.approx(0.17768, rel=1e-3)
    charge, slowest = found.floquet.multipliers[:2]
    assert charge == pytest.approx(1.0, abs=1e-5)  # by differences of a motion with 2 events in a period
    assert math.log(abs(slowest)) / found.period == pytest.approx(-0.34, abs=0.05)


def test_a_disc_that_is_not_alike_all_round_has_no_cycle_and_says_so_at_once():
    found = limit_cycle(rig.load("brake_shunt_sound"))
    assert not found.found
    assert "the surface is uneven, and one turn of 2.609 s" in found.why
    assert "-p inhomogeneity=none" in found.why
    assert found.after < 5.3


def test_a_cycle_that_a_standing_start_misses_is_not_denied():
    """At 5.2 rpm the lever vibrates from it; carried from there it vibrates up to 5.6 rpm."""
    assert limit_cycle(rig.load("lever", {"drive.speed": "5.2 rpm"})).found
    found = limit_cycle(rig.load("lever", {"drive.speed": "5.5 rpm"}))
    assert not found.found
    assert "found from a standing start" in found.why
    assert "Another start may reach one: rig map" in found.why


@pytest.mark.slow
def test_a_cycle_within_one_sector_is_none_of_the_whole_turn():
    """Stick-slip lives up to the sandblasted eighth, which ends it after 11.7 s; a turn at 4.5 rpm takes 13.3 s."""
    found = limit_cycle(rig.load("lever_sector"))
    assert not found.found
    assert found.decided
    assert found.why.startswith("no limit cycle found from a standing start: sliding is stable")
    assert found.after > 11.7 + 2.0 * 60.0 / 4.5 - 0.5


@pytest.mark.parametrize("name", ["lever_free_cylinder", "lever_free_lever"])
def test_a_rig_without_a_contact_has_no_cycle(name):
    found = limit_cycle(rig.load(name))
    assert found.decided
    assert found.why == "no limit cycle: the rig has no contact that could slide"


def test_what_does_not_repeat_ends_after_so_many_mode_changes(monkeypatch):
    monkeypatch.setattr("rig.analysis.cycle.CHANGES", 1000)
    found = limit_cycle(rig.load("brake"))
    assert not found.found
    assert not found.decided
    assert found.why.startswith("undecided: the motion does not repeat within 0.19")
    assert "s and 10" in found.why
    assert "--longest 0.7" in found.why


def test_a_motion_that_leaves_the_limits_of_its_scene_is_no_cycle():
    """Stuck to the belt from the unloaded spring on, which takes it 1 mm in 17 ms."""
    found = limit_cycle(rig.load("belt", {"limits.displacement": "1 mm"}))
    assert not found.found
    assert found.why.startswith("no limit cycle: displacement exceeds its limit of 0.001 m at 0.01")


SEALS = [(name, speed) for name in ("seal_p", "seal_l") for speed in np.linspace(9.5, 40.0, 9)]


@pytest.mark.parametrize(("name", "speed"), [*SEALS, ("seal_p", 17.5)])
def test_a_seal_that_slides_stably_is_at_rest(name, speed):
    """Decay of m x'' + d x' + c x = T(v0 - x'), T = 10 mu: the roots of m s^2 + (d + T') s + c."""
    v, (decay, film) = 1e-3 * speed, ((700.0, 37.94733192202055) if name == "seal_p" else (620.0, 34.785054261852174))
    slope = -9.7 * decay / (decay * v + 1.0) ** 2 + 0.5 * film / math.sqrt(v + 1e-5)
    damping = (5.0 if name == "seal_p" else 3.17) + slope
    found = limit_cycle(rig.load(name, {"drive.speed": v}))
    assert not found.found
    assert found.decided
    told = re.search(r"sliding is stable, its least stable mode decays with (\S+) 1/s", found.why)
    assert float(told[1]) == pytest.approx(-np.roots([0.2, damping, 2e4]).real.max(), rel=1e-4)


def test_a_cycle_that_attracts_slowly_is_found_by_newton_and_is_that_of_the_simulation():
    scene = rig.load("two_dof", {"friction.mu": 0.58})
    found = limit_cycle(scene)
    assert found.found
    assert found.newton > 0
    assert found.after < 60.0
    assert 0.9 < found.multiplier < 0.96
    run = rig.simulate(rig.load("two_dof", {"friction.mu": 0.58, "sensors.vibrometer.ideal": True}), 300.0)
    x = run.signals["displacement"][run.time > 250.0]
    assert found.extremes["displacement"] == pytest.approx((x.min(), x.max()), rel=1e-4)
    opens = [e["t_ns"] * 1e-9 for e in run.events if "opens" in str(e) and e["t_ns"] > 250e9]
    assert found.period == pytest.approx((opens[-1] - opens[0]) / (len(opens) - 1), rel=1e-6)


def test_a_start_that_still_sticks_is_undecided_and_not_sliding():
    """mu_s F0 / c / v0 = 32 s until the belt has stretched the spring so far that it lets go.

    Then it slips about mu_k F0 / c, damped by d / (2 m) = 0.2 1/s, until it has the speed of the belt again.
    """
    speed = 1e-4
    scene = rig.load("belt_c_damped", {"drive.speed": speed})
    found = limit_cycle(scene, longest=12.0)
    assert not found.found
    assert not found.decided
    assert found.why.startswith("undecided: the start still sticks within 12 s")
    pole, begin = complex(-0.2, math.sqrt(500.0 - 0.04)), 0.15 * 20.0 / 2500.0 - 2.0 * speed / 2500.0
    turn = complex(begin, -(speed + 0.2 * begin) / pole.imag)

    def velocity(t):
        return (pole * turn * cmath.exp(pole * t)).real

    half = math.pi / pole.imag
    end = brentq(lambda t: velocity(t) - speed, 0.5 * half, 1.5 * half, xtol=1e-15)
    stuck = (begin - (turn * cmath.exp(pole * end)).real) / speed
    assert limit_cycle(scene, longest=150.0).stick_time["contact"] == pytest.approx(stuck, rel=1e-8)


def test_the_command_takes_the_longest_time_and_fails_where_nothing_is_decided(rig):
    slow = ("cycle", "belt_c_damped", "-p", "drive.speed=1e-5")
    code, out, _ = rig(*slow, "--longest", "20 s")
    assert code == 1
    assert "undecided: the start still sticks within 20" in out
    code, out, _ = rig(*slow, "--longest", "20 s", "--json")
    assert code == 1
    assert json.loads(out)["decided"] is False
    assert rig("cycle", "seal_p", "-p", "drive.speed=17.5 mm/s")[0] == 0
    code, _, err = rig("cycle", "belt", "--longest", "-1 s")
    assert code == 2
    assert "--longest" in err


def test_the_command_says_that_controllers_and_sensors_are_left_out(rig):
    line = "  plant alone: without controller nf and sensor"
    assert line in rig("cycle", "belt_normal_force")[1]
    bare = ("-p", "sensors.vibrometer=none", "-p", "sensors.laser=none")
    assert "plant alone" not in rig("cycle", "belt_c", *bare)[1]


def test_the_speed_up_to_which_stick_slip_lives_is_the_closed_form_that_the_scene_tells():
    """From release, x = (mu_s F0 - d v0) / c at v0, a free decaying oscillation must come up to v0 again.

    Set PEND, m = 5, c = 2500, d = 2, F0 = 20, mu 0.4 and 0.25.
    """

    def spare(v0):
        rest = 0.25 * 20.0 / 2500.0
        start = [(0.4 * 20.0 - 2.0 * v0) / 2500.0 - rest, v0]
        A = np.array([[0.0, 1.0], [-500.0, -0.4]])
        fast = solve_ivp(lambda t, y: A @ y, (0.0, 0.4), start, rtol=1e-12, atol=1e-15, dense_output=True,
                         events=lambda t, y: A[1] @ y)  # fmt: skip
        return max(y[1] for y in fast.y_events[0][1:]) - v0

    limit = brentq(spare, 0.05, 0.1, xtol=1e-13)
    assert limit == pytest.approx(0.07795346, abs=5e-9)
    about = rig.load("belt_c_damped").about
    assert float(re.search(r"up to a belt speed of (\S+) m/s", about)[1]) == pytest.approx(limit, abs=5e-6)
    assert limit_cycle(rig.load("belt_c_damped", {"drive.speed": 0.9999 * limit})).found
    assert not limit_cycle(rig.load("belt_c_damped", {"drive.speed": 1.0001 * limit})).found
