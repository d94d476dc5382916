"""Controllers for a brake that squeals, on signals written down by hand: 50 kHz samples in frames of a millisecond."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import controllers
from rig.controllers.blocks.resonator import Resonator
from rig.controllers.narrow_band import NarrowBand
from rig.controllers.runtime.loop import Loop
from rig.controllers.shunt_schedule import ShuntSchedule
from rig.controllers.shunt_tuner import ShuntTuner
from rig.controllers.squeal_switch import SquealSwitch

RATE, FRAME = 50_000, 50
PERIOD = 1.0 / RATE


def played(controller, signal):
    """Commands of a controller that hears every sample, frame by frame; times [s]."""
    loop = Loop(controller)
    frames = signal[: len(signal) // FRAME * FRAME].reshape(-1, FRAME)
    commands = [loop.answer(k * 1_000_000, (tuple(frame.tolist()),)) for k, frame in enumerate(frames)]
    assert loop.refused == loop.held == 0
    return 1e-3 * np.arange(len(frames)), np.array(commands)[:, 0]


def switch(**given):
    section = SquealSwitch(**{"kind": "squeal_switch", "sensor": "v", "frequency": 3400.0} | given)
    return controllers.build(section, {"sample_period": PERIOD})


def tuner(**given):
    section = ShuntTuner(**{"kind": "shunt_tuner", "sensor": "v", "frequency": 3400.0} | given)
    return controllers.build(section, {"sample_period": PERIOD, "capacitance": 30e-9, "delta": -0.5})


def test_a_resonator_settles_on_amplitude_and_phase_at_its_centre():
    band = Resonator(3400.0, 200.0, PERIOD)
    t = PERIOD * np.arange(RATE // 10)
    z, _, turned = band.run(0j, (0.3 * np.cos(2 * math.pi * 3400.0 * t + 0.7)).tolist())
    mirror = 100.0 / (2.0 * 3400.0)  # share of the tone that the band sees at minus its frequency, turning backwards
    assert abs(z * cmath.exp(-1j * (2 * math.pi * 3400.0 * t[-1] + 0.7)) - 0.3) < 0.3 * 1.1 * mirror
    assert abs(cmath.phase(turned) / (2 * math.pi * PERIOD) - 3400.0) < mirror**2 / (2 * math.pi * PERIOD)


@pytest.mark.parametrize("frequency", [3300.0, 3500.0])
def test_half_the_power_passes_at_the_edges_of_the_band(frequency):
    band = Resonator(3400.0, 200.0, PERIOD)
    tone = np.cos(2 * math.pi * frequency * PERIOD * np.arange(RATE // 5)).tolist()
    z, _, _ = band.run(0j, tone[: RATE // 10])
    _, square, _ = band.run(z, tone[RATE // 10 :])
    assert square == pytest.approx(0.5, rel=0.01)


def test_squeal_is_silenced_within_twenty_milliseconds_of_its_onset():
    onset = 0.2  # the amplitude passes the threshold here, growing by 40 1/s as the brake does
    t = PERIOD * np.arange(int(0.3 * RATE))
    v = 0.005 * np.exp(40.0 * (t - onset)) * np.sin(2 * math.pi * 3402.0 * t)
    times, connected = played(switch(threshold=0.005), v)
    first = times[np.argmax(connected > 0.5)]
    assert onset <= first < onset + 0.02


def test_noisy_sliding_does_not_connect_the_shunt():
    noise = np.random.default_rng(0).standard_normal(10 * RATE)
    _, connected = played(switch(threshold=0.005), 0.005 * noise)  # as much as the threshold, over 25 kHz
    assert connected.max() == 0.0


def test_a_strike_is_not_squeal():
    t = PERIOD * np.arange(RATE // 2)
    v = np.where(t > 0.1, 0.2 * np.exp(-(t - 0.1) * 2000.0) * np.sin(2 * math.pi * 3400.0 * t), 0.0)
    _, connected = played(switch(confirm=0.01), v)
    assert connected.max() == 0.0


def test_after_its_time_the_shunt_is_opened_and_rests():
    v = np.sin(2 * math.pi * 3400.0 * PERIOD * np.arange(RATE))
    times, connected = played(switch(hold=0.2, rest=0.3, confirm=0.005), v)
    edges = times[1:][np.diff(connected) != 0.0]
    assert edges[1] - edges[0] == pytest.approx(0.2, abs=1e-9)
    assert edges[2] - edges[1] == pytest.approx(0.3, abs=1e-9)


@pytest.mark.parametrize("frequency", [3385.0, 3419.0])
def test_the_tuner_finds_the_inductance_of_the_squeal(frequency):
    rng = np.random.default_rng(1)
    t = PERIOD * np.arange(RATE // 2)
    v = 0.1 * np.sin(2 * math.pi * frequency * t) + 0.01 * rng.standard_normal(len(t))
    _, inductance = played(tuner(), v)
    assert inductance[-1] == pytest.approx(0.5 / (30e-9 * (2 * math.pi * frequency) ** 2), rel=0.003)


def test_the_schedule_repeats_from_its_beginning():
    section = ShuntSchedule(kind="shunt_schedule", begin=1.0, connected_for=2.0, open_for=3.0)
    clock = controllers.build(section, {})
    told = [clock.update((), t * 1_000_000_000, ())[1][0] for t in range(13)]
    assert told == [0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 1, 1]


def one_mode(frequency=2140.0, growth=54.0, period=5e-5):
    """A growing oscillator of one mode with numbers as of a design step: poles of observer and feedback by hand."""
    pole = cmath.exp(complex(growth, 2 * math.pi * frequency) * period)
    driven = 1e-6 * cmath.exp(0.5j)
    return pole, {
        "poles": [[pole.real, pole.imag]],
        "driven": [[driven.real, driven.imag]],
        "corrected": [[0.1, 0.0]],
        "fed_back": [[0.02 * (w := 1e6 * cmath.exp(0.5j)).real, 0.02 * w.imag]],
    }


def test_a_mode_that_grows_is_damped_within_the_limit():
    pole, numbers = one_mode()
    section = NarrowBand(kind="narrow_band", sensor="v", frequency=2140.0, limit=50.0, period=5e-5)
    loop = Loop(controllers.build(section, numbers))
    z, driven, told = 0.005 + 0j, complex(*numbers["driven"][0]), []
    for k in range(1200):
        (u,) = loop.answer(round(k * 5e4), (2.0 * z.real,))
        told.append(u)
        z = pole * z + driven * u
    assert abs(z) < 0.01 * 0.005
    assert max(map(abs, told)) == 50.0  # at first; the observer knows that no more was given


def test_nothing_is_driven_before_its_time():
    _, numbers = one_mode()
    section = NarrowBand(kind="narrow_band", sensor="v", frequency=2140.0, period=5e-5, enable_at=0.01)
    loop = Loop(controllers.build(section, numbers))
    told = [loop.answer(50_000 * k, (0.1 * math.sin(0.67 * k),))[0] for k in range(220)]
    assert set(told[:200]) == {0.0}
    assert all(told[201:])


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=50))
def test_the_voltage_keeps_its_limit(samples):
    section = NarrowBand(kind="narrow_band", sensor="v", frequency=2140.0, limit=50.0)
    loop = Loop(controllers.build(section, one_mode()[1]))
    assert all(abs(loop.answer(k * section.period, (v,))[0]) <= 50.0 for k, v in enumerate(samples))
