"""Active control of the brake through the voltage of its stack (Kroeger, Neubauer, Popp 2008, figure 21)."""

import numpy as np
import pytest

import rig
from rig import design


@pytest.fixture(scope="module")
def run():
    return rig.simulate(rig.load("brake_active"), duration=0.15)


def peak(run, name, begin, end):
    inside = (run.time >= begin) & (run.time < end)
    return np.abs(run.signals[name][inside]).max()


def test_before_it_is_enabled_the_squeal_grows_at_its_own_rate(run):
    grown = peak(run, "velocity", 0.095, 0.1) / peak(run, "velocity", 0.085, 0.09)
    assert np.log(grown) / 0.01 == pytest.approx(54.04, rel=0.05)
    assert peak(run, "stack_voltage", 0.0, 0.107) == 0.0


def test_ten_millimetres_per_second_become_one_within_thirty_milliseconds(run):
    assert peak(run, "velocity", 0.1, 0.107) >= 0.01
    assert peak(run, "velocity", 0.137, 0.15) <= 0.001
    assert peak(run, "stack_voltage", 0.107, 0.15) <= 50.0


def test_no_mode_of_the_whole_brake_grows_with_it(run):
    after = [peak(run, "velocity", t, t + 0.005) for t in (0.135, 0.145)]
    assert after[1] < after[0] < 3e-4


def test_an_effort_that_drives_another_mode_up_is_refused_with_its_growth():
    with pytest.raises(rig.errors.SceneError, match=r"controllers.nb.effort: .* a mode at \d+ Hz grows with .* 1/s"):
        design.numbers(rig.load("brake_active", {"controllers.nb.effort": "1e6 V*s/m", "controllers.nb.noise": 1e-5}))


def test_a_band_without_a_mode_names_those_that_there_are():
    with pytest.raises(rig.errors.SceneError, match="no mode is in the band about 4000 Hz; there are 512, 661"):
        design.numbers(
            rig.load("brake_active", {"controllers.nb.frequency": 4000.0, "controllers.nb.bandwidth": 500.0})
        )
