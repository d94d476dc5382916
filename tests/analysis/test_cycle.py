"""Limit cycles of set PEND against two independent integrators; the closed form of C is that of test_theory.

Numbers: Kroeger, Neubauer, Popp (2008), section 2, with calibrated parameters.
"""

import cmath
import json
import math
import re
from contextlib import suppress

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.linalg import expm
from scipy.optimize import brentq

import rig
from rig.analysis.cycles.cycle import limit_cycle
from rig.bench.free_rig import FreeRig
from rig.errors import UsageError
from rig.model.formulation import assemble
from rig.scenes import names

ORACLE = {
    "belt": {
        "period": 0.32160366413722946,
        "time in stick": 0.10286728739274346,
        "lowest velocity": -0.10129890351933808,
        "highest displacement": 0.006212858222975551,
        "lowest displacement": -0.0028512005379839915,
        "displacement where stick starts": -0.0022200372435646075,
    },
    "belt_b": {
        "period": 0.2908260916234226,
        "time in stick": 0.04712730256525028,
        "lowest velocity": -0.07307059536727642,
        "highest displacement": 0.005765545150626973,
        "lowest displacement": -0.0007760836703160775,
        "displacement where stick starts": 0.00032436184608498317,
    },
    "belt_c_damped": {
        "period": 0.28244236395822964,
        "time in stick": 0.032130909046963446,
        "lowest velocity": -0.06393297265193866,
        "highest displacement": 0.004899392899985426,
        "lowest displacement": -0.0008190529276451587,
        "displacement where stick starts": 0.001224145457182193,
    },
}


@pytest.mark.parametrize("name", ORACLE)
def test_cycles_are_those_of_independent_integrators_and_their_energy_is_balanced(name):
    found = limit_cycle(rig.load(name))
    (x_min, x_max), (v_min, v_max) = found.extremes["displacement"], found.extremes["velocity"]
    got = {
        "period": found.period,
        "time in stick": found.stick_time["contact"],
        "lowest velocity": v_min,
        "highest displacement": x_max,
        "lowest displacement": x_min,
        "displacement where stick starts": found.stick_start["displacement"],
    }
    assert got == pytest.approx(ORACLE[name], rel=1e-8)
    assert v_max == pytest.approx(0.06, rel=1e-9)
    energy = found.energy
    assert energy["drive"] == pytest.approx(energy["friction"] + energy["damper"], rel=1e-8)
    assert abs(energy["stored"]) < 1e-8 * energy["drive"]
    assert abs(energy["error"]) < 1e-9
    if name == "belt_c_damped":  # it lets go where the limit is reached
        assert found.stick_end["friction_force"] == pytest.approx(0.4 * 20.0, rel=1e-9)
        assert found.stick_end["displacement"] == pytest.approx((0.4 * 20.0 - 2.0 * 0.06) / 2500.0, rel=1e-9)


def test_many_events_in_a_frame_are_not_too_many_for_a_block_of_frames(tmp_path):
    """31 events in a frame; an analysis advances by many frames at once."""
    scene = rig.load("belt_c", {"body.mass": "1 g", "body.stiffness": 1e7})
    a, b, w = 0.15 * 20.0 / 1e7, 0.06 / 1e5, 1e5
    period = 2.0 * a / 0.06 + (2.0 * math.pi - 2.0 * math.atan2(a, b)) / w
    assert limit_cycle(scene).period == pytest.approx(period, rel=1e-9)
    chart = rig.map(scene, "drive.speed=0.05:0.07:2", runs=("near",), longest=0.01, out=tmp_path, workers=1)
    assert not chart.why.any()


def test_a_belt_that_runs_backwards_mirrors_the_cycle():
    forth, back = limit_cycle(rig.load("belt")), limit_cycle(rig.load("belt", {"drive.speed": -0.06}))
    assert back.period == pytest.approx(forth.period, rel=1e-10)
    low, high = forth.extremes["displacement"]
    assert back.extremes["displacement"] == pytest.approx((-high, -low), rel=1e-8)


def test_a_squeal_that_lift_off_bounds_is_a_cycle_that_attracts():
    """Its slowest disturbance dies away with 1.6 1/s, a 2000th in a period: simulation alone would take seconds."""
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
    assert drifts[-1] <= 1e-2  # from there Newton's method closes it
    assert found.newton > 0
    assert found.repeats <= 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_every_shipped_scene_has_a_cycle_that_repeats_or_a_reason_why_not(name):
    with suppress(UsageError):  # a film of points, or nothing that vibrates
        found = limit_cycle(rig.load(name))
        assert found.found == (not found.why)
        assert not found.found or found.repeats < 1e-6


def test_a_cycle_with_an_open_stack_has_the_charge_of_its_start():
    """q = e dx + Cps U is 0: neither extension nor voltage at the start. A free multiplier of 1 belongs to it."""
    found = limit_cycle(rig.load("brake_shunt"))
    x = found.state
    pad, calliper = (x[f"{body}.z"] - 0.0167 * x[f"{body}.phi"] for body in ("inner_pad", "calliper"))
    assert 3e-8 * x["shunt.voltage"] == pytest.approx(0.9916 * (calliper - pad), rel=1e-9)
    charge, slowest = found.floquet.multipliers[:2]
    assert charge == pytest.approx(1.0, abs=1e-5)  # by differences of a motion with 2 events in a period
    assert math.log(abs(slowest)) / found.period == pytest.approx(-0.34, abs=0.05)


@pytest.mark.slow
def test_the_cycle_of_an_open_stack_is_that_of_a_minute_of_simulation():
    """The slowest disturbance dies away with 0.34 1/s: after a minute it is a 1e-9th of itself."""
    scene = rig.load("brake_shunt")
    long = FreeRig(scene, start=scene.assemble().system().start)
    while long.motion.tick * long.step < 75.0:
        long.motion.advance(16_384)
    turn = FreeRig(scene, start=long.motion.x.copy(), dense=True).recorded(3e-4)
    found, output = limit_cycle(scene), list(scene.assemble().outputs).index("velocity")
    assert found.extremes["velocity"] == pytest.approx(turn.dense.extremes(output), rel=1e-8)


def test_a_disc_that_is_not_alike_all_round_has_no_cycle_and_says_so_at_once():
    found = limit_cycle(rig.load("lever_sector", {"drive.speed": "3 rpm"}))
    assert not found.found
    assert "the surface is uneven, and one turn of 20 s" in found.why
    assert "-p inhomogeneity=none" in found.why
    assert found.after < 40.1


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


@pytest.mark.parametrize(
    ("name", "changes", "why"),
    [
        ("lever_free_cylinder", {}, "the rig has no contact that could slide"),
        ("belt", {"drive.speed": 0.0}, "nothing slides, because no surface moves"),
        ("belt", {"load.force": 0.0}, "no contact is loaded"),
        ("belt_c_damped", {"load.force": 0.0}, "no contact is loaded"),
        ("belt", {"limits.displacement": "1 mm"}, "displacement exceeds its limit of 0.001 m at 0.01"),
    ],
)
def test_rigs_that_have_no_cycle_say_why(name, changes, why):
    """The last one is stuck to the belt from the unloaded spring on, which takes it 1 mm in 17 ms."""
    found = limit_cycle(rig.load(name, changes))
    assert not found.found
    assert found.decided
    assert found.why.startswith(f"no limit cycle: {why}")


@pytest.mark.parametrize(("name", "speed"), [(n, v) for n in ("seal_p", "seal_l") for v in (9.5, 17.5, 40.0)])
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


def test_a_decay_is_known_from_its_first_two_periods_however_many_ticks_they_have():
    """5 t on the spring: 9 s, and 2e-5 of the amplitude are lost in each of them."""
    scene = rig.load("belt_c_damped", {"limits": "none", "body.mass": "5000 kg", "drive.speed": "1 m/s"})
    found = limit_cycle(scene)
    assert not found.found
    assert found.decided
    assert found.why.startswith("no limit cycle found from a standing start: sliding is stable")
    assert found.after == pytest.approx(2.1 * 2.0 * math.pi * math.sqrt(5000.0 / 2500.0), abs=0.01)


def test_a_forced_vibration_in_sliding_is_the_resonance_of_the_mass():
    """Friction mu F(t) drives the mass in its natural frequency: amplitude mu F / d, the decay d / (2 m)."""
    found = limit_cycle(rig.load("belt_fluctuating_load"))
    assert not found.events
    assert found.period == pytest.approx(1.0 / 3.5588127, rel=1e-9)
    assert found.amplitude["velocity"] == pytest.approx(0.25 * 0.4 / 2.0, rel=1e-9)
    assert np.abs(found.floquet.multipliers) == pytest.approx(2 * [math.exp(-0.2 * found.period)], rel=1e-6)


def test_two_undamped_modes_at_once_are_no_cycle_although_each_alone_repeats():
    """Frequencies 9.60 and 10.38 rad/s: after 88 s the motion has come back to 1 %, and a single mode is close."""
    springs = {f"spring_{i}.damping": 0.0 for i in (1, 2)}
    found = limit_cycle(rig.load("two_dof", {"friction.mu": 0.3, "separation": "none", "limits": "none", **springs}))
    assert not found.found
    assert found.why == "no limit cycle: nothing damps the vibration, which keeps any amplitude"


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
    assert (code, "undecided: the start still sticks within 20" in out) == (1, True)
    code, out, _ = rig(*slow, "--longest", "20 s", "--json")
    assert (code, json.loads(out)["decided"]) == (1, False)
    assert rig("cycle", "seal_p", "-p", "drive.speed=17.5 mm/s")[0] == 0
    code, _, err = rig("cycle", "belt", "--longest", "-1 s")
    assert (code, "--longest" in err) == (2, True)


def test_the_speed_up_to_which_stick_slip_lives_is_the_closed_form_that_the_scene_tells():
    """From release, x = (mu_s F0 - d v0) / c at v0, a free decaying oscillation must come up to v0 again.

    Set PEND, m = 5, c = 2500, d = 2, F0 = 20, mu 0.4 and 0.25.
    """

    def spare(v0):
        rest = 0.25 * 20.0 / 2500.0
        start = [(0.4 * 20.0 - 2.0 * v0) / 2500.0 - rest, v0]
        A = np.array([[0.0, 1.0], [-500.0, -0.4]])
        fast = solve_ivp(
            lambda t, y: A @ y,
            (0.0, 0.4),
            start,
            rtol=1e-12,
            atol=1e-15,
            dense_output=True,
            events=lambda t, y: A[1] @ y,
        )
        return max(y[1] for y in fast.y_events[0][1:]) - v0

    limit = brentq(spare, 0.05, 0.1, xtol=1e-13)
    assert limit == pytest.approx(0.07795346, abs=5e-9)
    about = rig.load("belt_c_damped").about
    assert float(re.search(r"up to a belt speed of (\S+) m/s", about)[1]) == pytest.approx(limit, abs=5e-6)
    assert limit_cycle(rig.load("belt_c_damped", {"drive.speed": 0.9999 * limit})).found
    assert not limit_cycle(rig.load("belt_c_damped", {"drive.speed": 1.0001 * limit})).found


@pytest.fixture(scope="module", params=["belt", "pin"])
def cycle(request):
    return rig.limit_cycle(request.param)


def test_the_outputs_cover_one_period_close_and_reach_their_extremes(cycle):
    assert cycle.time[0] == 0.0
    assert cycle.time[-1] == pytest.approx(cycle.period, abs=1e-9)  # simulated to the nanosecond
    assert np.all(np.diff(cycle.time) >= -1e-9 * cycle.period)
    for name in ("displacement", "velocity"):
        assert cycle.outputs[name][-1] == pytest.approx(cycle.outputs[name][0], abs=1e-6 * np.ptp(cycle.outputs[name]))
    for name, (low, high) in cycle.extremes.items():
        v, slack = cycle.outputs[name], 1e-9 * max(abs(low), abs(high))
        assert low - slack <= v.min() <= v.max() <= high + slack
        assert np.ptp(v) >= 0.99 * (high - low) - slack
    way = np.trapezoid(cycle.outputs["velocity"], cycle.time)
    assert way == pytest.approx(0.0, abs=1e-5 * np.ptp(cycle.outputs["displacement"]))
    assert not {"time", "outputs"} & cycle.to_json().keys()  # thousands of numbers


def test_intervals_of_stick_add_up_and_the_contact_moves_with_its_surface_in_them(cycle):
    assert sum(b - a for a, b in cycle.sticking) == pytest.approx(next(iter(cycle.stick_time.values())), rel=1e-6)
    for begin, end in cycle.sticking:
        inside = (cycle.time > begin + 1e-9) & (cycle.time < end - 1e-9)
        assert inside.any()
        assert cycle.outputs["velocity"][inside] == pytest.approx(cycle.outputs["surface_speed"][inside], abs=1e-9)


M, C, LOAD = 5.0, 2500.0, 20.0
COULOMB = {"friction.law": "coulomb", "friction.mu_static": 0.45, "friction.mu_kinetic": 0.25}
TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}


def returned(rate, slope, start):
    """Period, amplitude of v, multiplier of the cycle of v' = rate(x, v) near the turn at x = start."""

    def flow(t, y):
        x, v, *phi = y
        dx, dv = slope(x, v)
        a, b, c, d = phi
        return [v, rate(x, v), c, d, dx * a + dv * c, dx * b + dv * d]

    def turn(t, y):
        return y[1]

    turn.terminal, turn.direction = True, -1.0
    x = start
    for _ in range(20):
        y = solve_ivp(flow, (0.0, 0.01), [x, 0.0, 1.0, 0.0, 0.0, 1.0], max_step=2e-3, **TIGHT).y[:, -1]
        part = solve_ivp(flow, (0.0, 1.0), y, events=[turn], max_step=2e-3, dense_output=True, **TIGHT)
        y = part.y_events[0][0]
        multiplier = float(np.linalg.det(y[2:].reshape(2, 2)))
        step = (y[0] - x) / (1.0 - multiplier)  # Newton
        x += step
        if abs(step) < 1e-13:
            break
    phi = y[2:].reshape(2, 2)
    shift = np.array([0.0, rate(y[0], 0.0)])  # along the motion, where it turns: phi maps it onto itself
    assert phi @ shift == pytest.approx(shift, rel=1e-6, abs=1e-9)
    top = float(np.abs(part.sol(np.linspace(0.0, part.t[-1], 20_000))[1]).max())
    return 0.01 + part.t_events[0][0], top, multiplier


def test_a_falling_law_with_a_floor_has_a_smooth_cycle():
    """d = 15 N s/m between 0 and 16 = slope F0: growth while friction falls, decay where it does not any more."""
    damping, v0 = 15.0, 0.43

    def rate(x, v):
        return (LOAD * max(0.4 - 0.8 * (v0 - v), 0.05) - damping * v - C * x) / M

    def slope(x, v):
        return -C / M, ((16.0 if 0.4 - 0.8 * (v0 - v) > 0.05 else 0.0) - damping) / M

    found = limit_cycle(rig.load("belt_b", {"body.damping": damping, "drive.speed": v0}))
    period, top, multiplier = returned(rate, slope, 0.05 * LOAD / C + 4.6e-4)
    assert found.found
    assert found.stick_time == {"contact": 0.0}
    assert found.period == pytest.approx(period, rel=1e-7)
    assert max(map(abs, found.extremes["velocity"])) == pytest.approx(top, rel=1e-5)
    assert 0.5 < multiplier < 0.95
    assert [v.real for v in found.floquet.multipliers] == pytest.approx([multiplier], rel=1e-5)
    assert found.floquet.error < 1e-5
    assert "limit cycle in which nothing sticks" in found.text()


def test_a_rayleigh_law_has_the_cycle_of_a_variational_integration():
    """mu = 0.3 - a w + b w^3 about the belt speed, as a table: m v' = F0 mu - ... is Rayleigh's equation."""
    v0, a, b = 0.2, 0.25, 40.0
    speeds = np.linspace(0.0, 0.4, 81)
    values = 0.3 - a * (speeds - v0) + b * (speeds - v0) ** 3
    law = PchipInterpolator(speeds, values)
    bend = law.derivative()

    def rate(x, v):
        return (LOAD * float(law(v0 - v)) - 2.0 * v - C * x) / M

    def slope(x, v):
        return -C / M, (-LOAD * float(bend(v0 - v)) - 2.0) / M

    table = {"friction.law": "table", "friction.speeds": speeds.tolist(), "friction.values": values.tolist()}
    found = limit_cycle(rig.load("belt_b", table | {"drive.speed": v0}))
    period, top, multiplier = returned(rate, slope, LOAD * 0.3 / C + 3e-3)
    assert found.period == pytest.approx(period, rel=1e-8)
    assert max(map(abs, found.extremes["velocity"])) == pytest.approx(top, rel=1e-6)
    assert top == pytest.approx(2.0 * math.sqrt((a * LOAD - 2.0) / (3.0 * b * LOAD)), rel=0.05)
    assert [v.real for v in found.floquet.multipliers] == pytest.approx([multiplier], rel=1e-5)


@pytest.mark.parametrize("name", ["belt", "belt_b", "belt_c", "belt_c_damped"])
def test_a_contact_that_sticks_forgets(name):
    """One degree of freedom: where it lets go, all disturbance is a shift along the motion."""
    floquet = limit_cycle(rig.load(name)).floquet
    assert [abs(v) for v in floquet.multipliers] == pytest.approx([0.0], abs=1e-6)
    assert floquet.error < 1e-6


def test_the_multipliers_of_a_tuned_mass_are_those_of_propagators_and_saltations():
    scene = rig.load("belt_tuned_mass_wrong", COULOMB)
    cycle = limit_cycle(scene)
    system = scene.assemble().system()
    slip, stick = (assemble(system, system.key([mode], [0], [])) for mode in (0, 2))
    static = next(g for g, kind in zip(stick.guards, stick.kinds) if kind == 1)  # releases +
    landing = slip.guards[0]
    (lands, releases) = sorted(t for t, _ in cycle.events)
    if cycle.events[0][1] != "contact slip ends":
        lands, releases = releases, lands
    held = cycle.stick_time["contact"]
    x = stuck_again(stick, slip, static, held, cycle.period - held)
    after = expm(stick.A * held) @ x
    into_slip = np.eye(system.n) + np.outer((slip.A - stick.A) @ after, static) / (static @ stick.A @ after)
    down = expm(slip.A * (cycle.period - held)) @ after
    pi = stick.landing
    into_stick = pi + np.outer(stick.A @ pi @ down - pi @ slip.A @ down, landing) / (landing @ slip.A @ down)
    round_ = into_stick @ expm(slip.A * (cycle.period - held)) @ into_slip @ expm(stick.A * held)
    values = sorted(np.linalg.eigvals(round_[:4, :4]), key=abs)
    expected = sorted(values[:-1], key=lambda v: (-abs(v), -v.imag))
    assert values[-1] == pytest.approx(1.0, abs=1e-6)
    found = np.array(cycle.floquet.multipliers)
    assert np.abs(found) == pytest.approx(np.abs(expected), rel=1e-5, abs=1e-6)
    assert np.sort(np.abs(found.imag)) == pytest.approx(np.sort(np.abs(np.imag(expected))), abs=1e-6)


def stuck_again(stick, slip, static, held, free):
    """The state at landing of the cycle that sticks for `held` and slips for `free`: comes back to itself."""
    n = len(stick.A)
    whole = stick.landing @ expm(slip.A * free) @ expm(stick.A * held) - np.eye(n)
    values = np.linalg.svd(whole)[2][-1]
    return values / values[n - 1]
