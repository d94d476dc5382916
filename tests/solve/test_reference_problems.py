"""Every event of the reference problems is found, at its time: tests/reference/num.json says where the times are from.

`exact` at any step: 1e-12 of a period. `dopri5` at tolerance 1e-7 and `rk4` at 1 ms: 1e-6 of a period.
"""

import math

import numpy as np
import pytest

STEPS = [0.05, 1.0, 20.0]  # ms
SYSTEMS = {"P1": "p1", "P2": "p2", "P3": "p3", "P4": "p4"}


def worst(found, case):
    """Largest error of an event time, as a share of the period; every event must be there."""
    assert len(found.times) == len(case["events"])
    return np.abs(found.times - case["events"]).max() / case["period"]


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("name", ["P1", "P3", "P4"])
def test_exact_finds_every_event_at_any_step(rigs, run, num, name, step):
    found = run(getattr(rigs, SYSTEMS[name])(), step, num[name]["duration"])
    assert worst(found, num[name]) < 1e-12


@pytest.mark.parametrize(
    ("method", "tolerance", "bound"), [("dopri5", 1e-7, 1e-6), ("dop853", 1e-10, 1e-9), ("dop853", 1e-11, 1e-10)]
)
@pytest.mark.parametrize("step", [0.05, 20.0])
def test_adaptive_methods_find_every_event_under_a_falling_law(rigs, run, num, step, method, tolerance, bound):
    found = run(rigs.p2(), step, num["P2"]["duration"], method, tolerance=tolerance)
    assert worst(found, num["P2"]) < bound


@pytest.mark.parametrize("name", ["P1", "P2"])
def test_rk4_finds_every_event_of_an_ordinary_run(rigs, run, num, name):
    found = run(getattr(rigs, SYSTEMS[name])(), 1.0, num[name]["duration"], "rk4")
    assert worst(found, num[name]) < 1e-6


def test_modes_follow_one_another(rigs, run, num):
    found = run(rigs.p3(), 0.1, num["P3"]["duration"])
    assert {"load opens", "load closes", "contact slip ends", "contact releases +"} <= set(found.what)
    assert run(rigs.p1(), 1.0, 4.0).what == ["contact releases +", "contact slip ends"] * 19


def test_period_and_stick_share_are_those_of_the_reference(rigs, run, num):
    for name, method, bound in (("P1", "exact", 1e-12), ("P2", "dopri5", 1e-9), ("P4", "exact", 1e-11)):
        found = run(getattr(rigs, SYSTEMS[name])(), 1.0, num[name]["duration"], method, tolerance=1e-11).times
        period = found[-1 if len(found) % 2 else -2] - found[-3 if len(found) % 2 else -4]
        landing = found[-2 if len(found) % 2 else -3]
        release = found[-1 if len(found) % 2 else -2]
        assert period == pytest.approx(num[name]["period"], rel=bound)
        assert (release - landing) / period == pytest.approx(num[name]["stick_share"], rel=1e3 * bound)


@pytest.mark.parametrize("step", STEPS)
def test_sticks_shorter_than_a_step_are_found(rigs, run, num, step):
    """HC2. Releases to 1e-12 of a period; a landing at w' = a is known to rounding of w over a, and is as good."""
    p = num["P1"]["params"]
    w = math.sqrt(p["k"] / p["m"])
    for margin in num["HC2"]["margins"]:
        mus = p["mud"] + margin
        a, b = (mus - p["mud"]) * p["N"] / p["k"], p["vb"] / w
        slip, stick = (2.0 * math.pi - 2.0 * math.atan2(a, b)) / w, 2.0 * a / p["vb"]
        found = run(rigs.p1(c=0.0, mus=mus), step, 4.0)
        assert len(found.times) == num["HC2"]["events"]
        check_cycles(found.times, mus * p["N"] / p["k"] / p["vb"], slip, stick, p["k"] * a / p["m"])


@pytest.mark.parametrize("step", STEPS)
def test_grazing_is_told_from_sticking(rigs, run, num, step):
    """HC2b. Above the limit every period sticks, down to a margin of 1e-9; below it the first release is the last."""
    p, case = num["P1"]["params"], num["HC2b"]
    c = 2e-4 * math.sqrt(p["m"] * p["k"])
    for cycle in case["cycles"]:
        mus = p["mud"] + case["limit"] * (1.0 + cycle["margin"])
        found = run(rigs.p1(c=c, mus=mus), step, 4.0)
        assert len(found.times) == case["events"]
        x = (mus * p["N"] - c * p["vb"]) / p["k"]  # of the release
        pull = p["mud"] * p["N"] - c * p["vb"] - p["k"] * (x - cycle["stick"] * p["vb"])
        check_cycles(found.times, x / p["vb"], cycle["slip"], cycle["stick"], pull / p["m"])
    for margin in (1e-9, 1e-6, 1e-2):
        mus = p["mud"] + case["limit"] * (1.0 - margin)
        assert len(run(rigs.p1(c=c, mus=mus), step, 4.0).times) == case["below"]


def check_cycles(times, first, slip, stick, acceleration):
    period = slip + stick
    n = np.arange(len(times))
    error = np.abs(times - (first + (n // 2) * period + (n % 2) * slip))
    assert error[::2].max() < 1e-12 * period
    assert error[1::2].max() < 1e-12 * period + 3e-15 / acceleration


def test_events_on_a_belt_that_turns_round(rigs, run, num, chain):
    """HC1: 26 events whatever the step, against a chain of scipy's DOP853; nothing is divided by the belt's speed."""
    p, case = num["P1"]["params"], num["HC1"]

    def belt(t):
        return case["amplitude"] * math.sin(case["omega"] * t)

    def need(t, y):
        slope = case["amplitude"] * case["omega"] * math.cos(case["omega"] * t)
        return p["m"] * slope + p["c"] * belt(t) + p["k"] * y[0]

    def rate(side, t, y):
        if side == 0:
            return [belt(t), 0.0]
        return [y[1], (side * p["mud"] * p["N"] - p["c"] * y[1] - p["k"] * y[0]) / p["m"]]

    def guards(side):
        if side == 0:
            return [lambda t, y: p["mus"] * p["N"] - need(t, y), lambda t, y: p["mus"] * p["N"] + need(t, y)]
        return [lambda t, y: side * (belt(t) - y[1])]

    def follow(side, guard, t, y):
        return (0 if side else (1, -1)[guard]), [y[0], belt(t)]

    times = chain(rate, guards, follow, 0, [0.0, 0.0], 4.0)
    assert len(times) == case["events"]
    for step in STEPS:
        assert run(rigs.hc1(), step, 4.0).times == pytest.approx(times, abs=1e-11)
