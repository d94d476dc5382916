"""The velocity feedbacks against the closed-loop tables of Kroeger et al. (2008), on the hand-written belt."""

import math
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from rig import controllers
from rig.controllers.belt_velocity import BeltVelocity
from rig.controllers.normal_force import NormalForce
from rig.errors import UsageError


def normal_force(**given):
    section = NormalForce(**{"kind": "normal_force", "sensor": "v", "nominal": 20.0, "highest": 1e3} | given)
    return controllers.build(section, {})


def belt_velocity(**given):
    section = BeltVelocity(**{"kind": "belt_velocity", "sensor": "v", "nominal": 0.06} | given)
    return controllers.build(section, {})


def velocity_of(controller):
    """The velocity that a feedback follows, in place of its command: (state, t_ns, (sample,)) -> state, (velocity,)."""
    bare = {"enable_ns": 0, "nominal": 0.0, "slope": 1.0, "low": -math.inf, "high": math.inf}
    return partial(controller.law, controller.constants._replace(**bare))


@pytest.mark.parametrize(
    ("gain", "delay", "amplitude"), [(100, 0, 0.064), (150, 20, 0.058), (200, 50, 0.063), (400, 100, 0.074)]
)
def test_weak_or_late_normal_force_keeps_the_cycle(twin, gain, delay, amplitude):
    v, _ = twin.closed_loop(normal_force(gain=gain, enable_at=4.0), "force", delay=delay)
    assert twin.residual(v) == pytest.approx(amplitude, abs=1.5e-3)


@pytest.mark.parametrize(
    ("gain", "delay", "rate"), [(200, 0, -1.88), (400, 0, -7.49), (200, 20, -1.45), (400, 5, -8.37)]
)
def test_normal_force_breaks_the_cycle_down(twin, gain, delay, rate):
    v, _ = twin.closed_loop(normal_force(gain=gain, enable_at=4.0), "force", delay=delay)
    assert twin.residual(v) < 1e-6
    assert twin.decay(v, 4.0) == pytest.approx(rate, rel=0.02)


def test_compensation_wins_back_what_a_delay_of_the_loop_has_lost(twin):
    late, _ = twin.closed_loop(normal_force(gain=300.0, enable_at=4.0), "force", delay=50)
    ahead, _ = twin.closed_loop(
        normal_force(gain=300.0, enable_at=4.0, compensation=0.05, frequency=3.559), "force", delay=50
    )
    assert twin.residual(late) > 0.05
    assert twin.residual(ahead) < 1e-3


@pytest.mark.parametrize(("delay", "rate"), [(0, -7.57), (5, -7.85), (10, -7.26)])
def test_belt_feedback_decays_where_the_table_says(twin, delay, rate):
    v, u = twin.closed_loop(belt_velocity(gain=2.66, enable_at=4.0), "speed", delay=delay, lag=0.01)
    assert twin.decay(v, 4.0) == pytest.approx(rate, rel=0.02)
    assert u.max() == 0.25  # the belt runs away with the sticking body and is stopped by the limit
    assert u.min() == 0.0


def test_belt_feedback_below_one_makes_the_cycle_larger(twin):
    v, _ = twin.closed_loop(belt_velocity(gain=0.5, enable_at=4.0), "speed", lag=0.01)
    assert twin.residual(v) == pytest.approx(0.137, abs=1.5e-3)


def test_before_its_time_the_command_is_the_nominal_one():
    controller = normal_force(gain=300.0, enable_at=1.0)
    state, before = controller.update(controller.start(), 999_000_000, (0.05,))
    _, after = controller.update(state, 1_000_000_000, (0.05,))
    assert before == (20.0,)
    assert after == (5.0,)


@given(
    gain=st.floats(-1e6, 1e6),
    low=st.floats(0.0, 30.0),
    span=st.floats(0.1, 1e3),
    filter=st.none() | st.floats(1.0, 1e4),
    ahead=st.floats(0.0, 0.2),
    values=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20),
)
def test_no_velocity_leads_out_of_the_limits(gain, low, span, filter, ahead, values):
    controller = normal_force(
        gain=gain, nominal=low, lowest=low, highest=low + span, filter=filter, compensation=ahead, frequency=3.5
    )
    state = controller.start()
    for k, value in enumerate(values):
        state, (force,) = controller.update(state, k * controller.period_ns, (value,))
        assert low <= force <= low + span


def test_the_drive_of_a_pendulum_is_told_in_its_own_unit():
    section = BeltVelocity(kind="belt_velocity", sensor="v", nominal=0.06, gain=2.0)
    controller = controllers.build(section, {"drive_scale": 5.0, "read_scale": 0.2})
    _, (speed,) = controller.update(controller.start(), 0, (0.1,))
    assert speed == pytest.approx((0.06 + 2.0 * 0.02) * 5.0)
    _, (most,) = controller.update(controller.start(), 0, (100.0,))
    assert most == 0.25 * 5.0


@pytest.mark.parametrize("ahead", [0.005, 0.06])
def test_the_prediction_is_exact_for_an_oscillation_of_its_frequency(ahead):
    controller = normal_force(compensation=ahead, frequency=3.5)
    state, w, velocity = controller.start(), 2.0 * math.pi * 3.5, velocity_of(controller)
    for k in range(3000):
        state, (v,) = velocity(state, k * 1_000_000, (math.sin(w * k * 1e-3),))
    assert v == pytest.approx(math.sin(w * (2.999 + ahead)), abs=1e-9)


def test_the_filter_is_three_decibels_down_at_its_corner():
    controller = normal_force(filter=20.0)
    state, out, velocity = controller.start(), [], velocity_of(controller)
    for k in range(2000):
        state, (v,) = velocity(state, k * 1_000_000, (math.sin(2.0 * math.pi * 20.0 * k * 1e-3),))
        out.append(v)
    assert max(out[1000:]) == pytest.approx(math.sqrt(0.5), rel=0.02)


def test_prediction_without_a_frequency_is_refused():
    with pytest.raises(UsageError, match="frequency"):
        normal_force(compensation=0.01)


def test_limits_and_nominal_value_must_fit_each_other():
    with pytest.raises(ValidationError, match="highest = 5 is not above lowest = 10"):
        normal_force(lowest=10.0, highest=5.0)
    with pytest.raises(ValidationError, match="nominal = 20 is outside 0 to 10"):
        normal_force(highest=10.0)
    with pytest.raises(ValidationError, match="lowest"):
        normal_force(lowest=-1.0)
