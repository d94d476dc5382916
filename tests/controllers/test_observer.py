"""The observer's arithmetic with numbers made by scipy for one oscillator, m = 5, d = 2, c = 2500."""

import math
from functools import partial

import numpy as np
import pytest
import scipy.linalg

from rig import controllers
from rig.controllers.blocks.observer import advanced3, at_rest, observer, propagated
from rig.controllers.normal_force import NormalForce

A = np.array([[0.0, 1.0, 0.0], [-500.0, -0.4, 0.2], [0.0, 0.0, 0.0]])


def numbers(poles=(-300.0, -320.0, -340.0), size=3, period=1e-3):
    """Displacement measured; the filter gain puts the poles of the error where they are wanted."""
    from scipy.signal import place_poles

    F = scipy.linalg.expm(A * period)
    C = np.array([[1.0, 0.0, 0.0]])
    drive = place_poles(F.T, C.T, np.exp(np.array(poles) * period)).gain_matrix.ravel()
    given = {
        "transition": F,
        "output": C[0],
        "gain": np.linalg.solve(F, drive),
        "model": A,
        "velocity": np.array([0.0, 1.0, 0.0]),
        "rest": np.array([1.0, 0.0, 2500.0]),
    }
    # the same with states that nothing sees
    given = {k: np.pad(v, [(0, size - 3)] * v.ndim) for k, v in given.items()}
    return {key: value.tolist() for key, value in given.items()}


def swing(t, w=22.0, a=3e-3):
    return a * math.sin(w * t), a * w * math.cos(w * t)


def test_the_estimate_converges_to_the_velocity():
    o = observer(numbers())
    z = at_rest(o, 0.0)  # wrong: the rig moves
    errors = []
    for k in range(400):
        x, v = swing(k * 1e-3)
        z, estimate = advanced3(o, z, x)
        errors.append(abs(estimate - v))
    assert errors[0] > 0.05
    assert max(errors[100:]) < 2e-3  # of 0.066; what is left is the force that swings unknown


def test_the_estimate_is_exact_for_a_free_oscillation_from_the_right_state():
    o = observer(numbers())
    x = np.array([2e-3, 0.03, 4.0])
    z, step = tuple(x), scipy.linalg.expm(A * 1e-3)
    for _ in range(200):
        z, estimate = advanced3(o, z, x[0])
        assert estimate == pytest.approx(x[1], abs=1e-12)
        x = step @ x


def test_the_prediction_follows_the_model():
    x = np.array([2e-3, 0.03, 4.0])
    o = observer(numbers(), ahead=0.03)
    _, v = advanced3(o, tuple(x), x[0])
    assert v == pytest.approx((scipy.linalg.expm(A * 0.03) @ x)[1], abs=1e-12)


@pytest.mark.parametrize("time", [1e-6, 1.0])
def test_propagated_rows_agree_with_scipy(time):
    for matrix in (A, np.array([[-1e6, 2.0], [3.0, -5.0]])):
        row = np.arange(1.0, len(matrix) + 1.0)
        expected = row @ scipy.linalg.expm(matrix * time)
        assert propagated(row, matrix, time) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def velocity_of(controller):
    """The velocity that a feedback follows, in place of its command: (state, t_ns, (sample,)) -> state, (velocity,)."""
    bare = {"enable_ns": 0, "nominal": 0.0, "slope": 1.0, "low": -math.inf, "high": math.inf}
    return partial(controller.law, controller.constants._replace(**bare))


def observing():
    """A feedback of an observed velocity."""
    section = NormalForce(kind="normal_force", sensor="x", nominal=20.0, velocity="observed")
    return controllers.build(section, {"observer": numbers()})


def test_missing_samples_are_bridged_by_the_model():
    controller = observing()
    state, velocity = controller.start(), velocity_of(controller)
    for k in range(600):
        if 300 <= k < 310:  # ten samples are lost
            continue
        x, v = swing(k * 1e-3)
        state, (estimate,) = velocity(state, k * 1_000_000, (x,))
        if k > 300:
            assert estimate == pytest.approx(v, abs=8e-3)


def test_after_a_long_silence_the_observer_starts_anew():
    controller = observing()
    velocity = velocity_of(controller)
    state, _ = velocity(controller.start(), 0, (5e-3,))
    _, (estimate,) = velocity(state, 10_000_000_000, (1e-3,))
    assert abs(estimate) < 1e-12
