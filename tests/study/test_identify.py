"""Identification experiments give back the scene's own parameters from noisy sensors; how vibration is measured."""

from dataclasses import replace

import numpy as np
import pytest

import rig
from rig.errors import UsageError
from rig.study import amplitude
from rig.study.identify import identify, vibration

EXPERIMENTS = {
    "lever_free_cylinder": {"cylinder.inertia": 0.035, "cylinder.damping": 0.12},
    "lever_free_lever": {"lever.inertia": 0.0025, "lever.damping": 0.01},
    "lever_static_friction": {"friction.mu_static": 0.42},
    "lever_kinetic_friction": {"friction.mu_static": 0.42, "friction.mu_kinetic": 0.3, "friction.decay": 220.0},
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_an_experiment_gives_back_the_parameters_of_its_scene(name):
    for seed in (1, 2, 3):
        found = identify(replace(rig.load(name), seed=seed))
        assert {one.key: one.stated for one in found.parameters} == EXPERIMENTS[name]
        for one in found.parameters:
            assert one.found == pytest.approx(EXPERIMENTS[name][one.key], rel=0.01), one.key
            assert one.found != one.stated


def test_another_rig_is_told_apart():
    """What is identified is the rig's, not the shipped numbers."""
    stiff = {"cylinder.inertia": 0.05, "cylinder.damping": 0.3}
    found = identify(rig.load("lever_free_cylinder", stiff))
    assert [one.found for one in found.parameters] == pytest.approx([0.05, 0.3], rel=0.01)


def test_a_whole_rig_is_no_experiment():
    with pytest.raises(UsageError, match="take the rig apart"):
        identify(rig.load("lever"))
    with pytest.raises(UsageError, match="known: of a lever"):
        identify(rig.load("belt"))
    coulomb = {"friction.law": "coulomb", "friction.mu_static": 0.4, "friction.mu_kinetic": 0.3}
    with pytest.raises(UsageError, match="the law that is fitted is the exponential"):
        identify(rig.load("lever_kinetic_friction", coulomb))


@pytest.mark.parametrize(("w", "b"), [(20.0, 1.0), (62.0, 2.0), (5.0, 0.01)])
def test_frequency_and_decay_of_a_free_vibration(w, b):
    t = np.arange(500) * 0.01
    x = 0.3 + np.exp(-b * t) * np.cos(w * t + 0.4)
    assert vibration(t, x) == pytest.approx((w, b), rel=1e-6)
    noisy = x + 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    assert vibration(t, noisy) == pytest.approx((w, b), rel=0.02)


def test_amplitude_index_of_a_known_signal():
    t = np.arange(2000) * 0.005  # 17 periods; the first begins in the middle, the last is cut off
    found = amplitude.index(t, 2.0 + 0.5 * np.sin(2.0 * np.pi * 1.7 * t))
    assert found.half == pytest.approx(0.5, rel=2e-3)
    assert found.full == 2.0 * found.half
    assert found.cycles == 15
    assert found.frequency == pytest.approx(1.7, rel=2e-3)
    noisy = amplitude.index(t, np.sin(2.0 * np.pi * 1.7 * t) + 0.01 * np.random.default_rng(2).standard_normal(t.size))
    assert noisy.cycles == 15
    assert amplitude.index(t, np.full(t.size, 3.0)).cycles == 0


def test_amplitude_index_of_the_lever_as_its_lasers_see_it():
    """Against the limit cycle; the lasers take the mean over 10 ms, of a motion with 2.87 cycles a second."""
    run = rig.simulate("lever", 12.0)
    cycle = rig.limit_cycle("lever")
    for sensor, output in (("arm_laser", "arm_displacement"), ("lever_laser", "lever_displacement")):
        samples = run.measurements[sensor]
        late = samples.t_ns > 4e9
        found = amplitude.index(samples.t_ns[late] * 1e-9, samples.v[late])
        low, high = cycle.extremes[output]
        assert found.half == pytest.approx(0.5 * (high - low), rel=0.02)
        assert found.frequency == pytest.approx(cycle.frequency, rel=0.005)
