"""Floquet multipliers, and cycles in which nothing sticks: against variational integrations of our own by scipy.

A planar motion has one multiplier beside that of the shift along itself, exp(int trace J dt) (Liouville).
"""

import json
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.linalg import expm

import rig
from rig.analysis.cycle import limit_cycle
from rig.model.formulation import assemble

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


def test_a_report_is_plain():
    told = json.loads(json.dumps(limit_cycle(rig.load("belt_c_damped")).to_json()))
    assert told["floquet"]["multipliers"][0] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert "Floquet multipliers: 0 (to" in limit_cycle(rig.load("belt_c_damped")).text()
    assert told["amplitude"]["velocity"] == pytest.approx(0.5 * (0.06 + 0.063932973), rel=1e-6)
