"""Limit cycles of set PEND, characteristics A, B, C and C with damping: tests/reference/kroger.json, two integrators.

Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 2025, section 2. Read from the events of a run and from its
record, by the default method and by rk4: 1e-6 of each number.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

STEP = 0.1  # ms


@pytest.fixture(scope="module")
def cycle(move, scenes, read):
    """(characteristic, method) -> numbers of the cycle, by the names of the reference."""
    kept = {}

    def measure(name, method):
        run = move(scenes[name], step_ms=STEP, duration=4.0, method=method, tolerance=1e-10)
        releases, landings = run.times("contact releases +"), run.times("contact slip ends")
        assert len(releases) > 8
        period = np.diff(releases[2:])
        assert np.ptp(period) < 1e-9
        last = releases[-1]
        within = (run.time > releases[-2]) & (run.time <= last)
        landing = landings[landings < last][-1]
        x, v, belt = run["displacement"], run["velocity"], 0.06

        def stuck(t):
            """X at an instant of the stick phase, from the next sample of it."""
            i = np.searchsorted(run.time, t + 1e-12)
            if t == last:
                i -= 1
            return x[i] - belt * (run.time[i] - t)

        return {
            "T": period[-1],
            "T_stick": last - landing,
            "T_slip": landing - releases[-2],
            "v_max": v[within].max(),
            "v_min": read.extreme(v[within], -1.0),
            "x_max": read.extreme(x[within], 1.0),
            "x_min": read.extreme(x[within], -1.0),
            "x_stick_start": stuck(landing),
            "x_stick_end": stuck(last),
        }

    def get(name, method):
        if (name, method) not in kept:
            kept[name, method] = measure(name, method)
        return kept[name, method]

    return get


@pytest.mark.parametrize("method", [None, "rk4"], ids=["default", "rk4"])
@pytest.mark.parametrize("name", ["A", "B", "C", "C_d2"])
def test_cycle_is_that_of_the_reference(cycle, kroger, name, method):
    expected = kroger["cycles"][name]
    found = cycle(name, method)
    for key, value in found.items():
        assert value == pytest.approx(expected[key], rel=1e-6), key


def test_the_belt_never_goes_faster_than_the_mass_while_it_sticks(move):
    run = move("belt", step_ms=1.0, duration=5.0)
    stuck = np.abs(run["slip_speed"]) < 1e-12
    assert 0.25 < stuck.mean() < 0.4
    assert np.all(run["velocity"][stuck] == 0.06)
    assert run["velocity"].max() == pytest.approx(0.06, abs=1e-12)
    assert np.all(np.abs(run["friction_force"]) <= 0.5 * 20.0 * (1.0 + 1e-12))


@pytest.mark.parametrize("name", ["A", "B", "C", "C_d2"])
def test_energy_of_a_cycle_closes(move, scenes, name):
    assert abs(move(scenes[name], step_ms=1.0, duration=10.0, tolerance=1e-9).motion.energy()["error"]) < 1e-8


@given(radius=st.floats(0.02, 2.0))
@settings(max_examples=6)
def test_a_pendulum_of_any_radius_is_the_mass_on_the_belt(move, radius):
    """J = m r^2, c r^2, d r^2, v0 / r: the same motion at the contact."""
    m, c, d = 5.0, 2500.0, 2.0
    pendulum = {
        "body.radius": radius,
        "body.inertia": m * radius**2,
        "body.stiffness": c * radius**2,
        "body.damping": d * radius**2,
        "drive.speed": 0.06 / radius,
        "start.velocity": 0.06,
    }
    coulomb = {"friction.law": "coulomb", "friction.mu_static": 0.4, "friction.mu_kinetic": 0.25}
    a = move("pendulum", pendulum | coulomb, duration=3.0)
    b = move("belt_c_damped", duration=3.0)
    for output in ("displacement", "velocity", "acceleration", "friction_force", "normal_force", "slip_speed"):
        assert a[output] == pytest.approx(b[output], abs=1e-9 * np.abs(b[output]).max()), output
    assert a.times("contact releases +") == pytest.approx(b.times("contact releases +"), abs=1e-12)
    assert a["angle"] == pytest.approx(b["displacement"] / radius, abs=1e-11 / radius)
    assert a["disc_speed"] == pytest.approx(0.06 / radius, rel=1e-12)
