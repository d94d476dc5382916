"""Controllers of the brake's shunt: squeal is heard and silenced, the coil finds its tuning."""

import math

import numpy as np
import pytest

import rig

pytestmark = pytest.mark.timeout(300)
TUNED = 0.5 / (30e-9 * (2 * math.pi * 3402.10) ** 2)  # H, at the squeal of the open stack


def loudest(run, begin, end):
    t, v = run.measurements["vibrometer"]
    return np.abs(v[(t >= begin * 1e9) & (t < end * 1e9)]).max()


def test_the_shunt_is_connected_within_twenty_milliseconds_of_the_onset_and_silences_the_brake():
    run = rig.simulate(rig.load("brake_shunt_listener"), duration=0.5)
    t, v = run.measurements["vibrometer"]
    onset = 1e-9 * t[np.argmax(np.abs(v) > 0.02)]
    told = run.commands["listener"]
    connected = 1e-3 * told.tick[np.argmax(told.values[:, 0] > 0.5)]
    assert onset < connected < onset + 0.02
    assert loudest(run, connected + 0.1, connected + 0.2) < 0.1 * loudest(run, connected - 0.01, connected + 0.01)


def test_ten_seconds_of_noisy_sliding_connect_nothing():
    scene = rig.load(
        "brake_shunt_listener",
        {
            "friction.mu": 0.6,
            "sensors.vibrometer.noise": "1e-4 m/s/Hz^0.5",
            "sensors.vibrometer.dropout_rate": "50 1/s",
        },
    )
    run = rig.simulate(scene, duration=10.0)
    assert loudest(run, 9.0, 10.0) > 0.02  # the noise alone passes the threshold, sample by sample
    assert run.commands["listener"].values.max() == 0.0


def test_the_coil_is_tuned_to_the_squeal_and_silences_it():
    run = rig.simulate(rig.load("brake_shunt_tuned"), duration=0.8)
    inductance = run.commands["tuner"].values[:, 0]
    assert inductance[0] == pytest.approx(0.7 * TUNED, rel=1e-4)
    assert inductance[-1] == pytest.approx(TUNED, rel=0.05)
    assert loudest(run, 0.7, 0.8) < 0.05 * loudest(run, 0.2, 0.3)
