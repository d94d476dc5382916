"""The dither search on the hand-written belt, shaken at 150 Hz; numbers of Kroeger et al. (2008), averaged friction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import controllers
from rig.controllers.dither import Dither
from rig.controllers.dither_sampled import SampledDither
from rig.errors import UsageError

QUICK = {"hold_off": 0.5, "window": 0.7, "step": 0.2}


def search(**given):
    return controllers.build(Dither(**{"kind": "dither", "sensor": "v", "frequency": 150.0} | given), {})


def shaken(controller, belt, seconds, speed=lambda t: 0.06):
    """Rows of time, velocity, amplitude, enable, belt speed at every ms, and the last state."""
    state, rows, noise = controller.start(), [], np.random.default_rng(3)
    for k in range(round(seconds * 1e3)):
        t, vb = k * 1e-3, speed(k * 1e-3)
        values = (belt.v + 1e-4 * noise.standard_normal(), vb)[: len(controller.reads)]
        state, (amplitude, frequency, enable) = controller.update(state, k * 1_000_000, values)
        belt.shake(vb, amplitude * enable, frequency, t)
        rows.append((t, belt.v, amplitude, enable, vb))
    return np.array(rows), state


def oscillation(rows, begin, end):
    v = rows[(rows[:, 0] >= begin) & (rows[:, 0] < end), 1]
    return 0.5 * (v.max() - v.min())


def test_the_search_ends_at_the_least_amplitude_and_the_cycle_stays_away(twin):
    rows, _ = shaken(search(speed=0.06, enable_at=2.0, **QUICK), twin.Belt(), 15.0)
    assert oscillation(rows, 1.0, 2.0) > 0.07
    assert rows[-1, 2] == pytest.approx(1.2 * 0.06)
    assert oscillation(rows, 13.0, 15.0) < 5e-3


def test_a_cycle_that_comes_back_is_quenched_and_its_amplitude_is_not_tried_again(twin):
    """Told half of the true speed, the search goes too low once."""
    rows, state = shaken(search(speed=0.03, lowest=0.03, **QUICK), twin.Belt(), 40.0)
    amplitude = rows[:, 2]
    back = np.flatnonzero(np.diff(amplitude) > 0.0)
    assert len(back) == 1
    failed = amplitude[back[0]]
    assert failed < 0.06
    assert amplitude[back[0] + 1] == 0.2
    assert amplitude[-1] == pytest.approx(1.1 * failed)
    assert state.margin * 0.03 == pytest.approx(1.1 * failed)
    assert oscillation(rows, 38.0, 40.0) < 5e-3


def test_the_amplitude_rises_with_a_measured_belt_speed_and_dither_stops_where_it_would_do_harm(twin):
    rows, _ = shaken(search(speed_sensor="disc", **QUICK), twin.Belt(), 20.0, lambda t: 0.06 + max(0.0, t - 8.0) * 0.02)
    on = rows[rows[:, 3] == 1.0]
    off = rows[rows[:, 3] == 0.0]
    assert (on[:, 2] > on[:, 4]).all()  # never at or below the belt speed
    assert off[0, 4] == pytest.approx(0.2 / 1.2, abs=0.01)
    assert (off[:, 2] == 0.0).all()


@given(
    speeds=st.lists(st.floats(0.0, 0.5), min_size=1, max_size=8),
    loud=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=8),
    lowest=st.floats(0.0, 0.15),
)
def test_amplitudes_stay_within_limits_and_above_the_belt_speed(speeds, loud, lowest):
    controller = search(
        speed_sensor="disc", lowest=lowest, hold_off=0.0, window="2 ms", frequency="40 kHz", band="20 kHz"
    )
    state = controller.start()
    for k in range(60):
        values = (loud[k % len(loud)], speeds[(k // 5) % len(speeds)])
        first = controller.update(state, k * 1_000_000, values)
        assert controller.update(state, k * 1_000_000, values) == first
        state, (amplitude, _, enable) = first
        assert enable in (0.0, 1.0)
        assert amplitude == 0.0 if enable == 0.0 else max(lowest, 1.2 * state.speed) <= amplitude <= 0.2


def test_a_search_that_cannot_know_the_belt_speed_is_refused():
    with pytest.raises(UsageError, match="speed: is neither stated nor measured"):
        search()


def test_sampled_dither_is_a_sine_held_between_samples():
    section = SampledDither(kind="dither_sampled", amplitude=0.1, frequency=150.0, nominal=0.06, enable_at="10 ms")
    controller = controllers.build(section, {"drive_scale": 5.0})
    out = [controller.update((), k * 1_000_000, ())[1][0] / 5.0 for k in range(1010)]
    assert out[:10] == pytest.approx([0.06] * 10)
    k = np.arange(1000)
    assert out[10:] == pytest.approx(0.06 + 0.1 * np.sin(2.0 * np.pi * 150.0 * k * 1e-3), abs=1e-9)
