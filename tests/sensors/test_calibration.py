"""Each instrument on the calibration bench: gain, phase, -3 dB point, noise density."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rig.sensors import KINDS


def second_order(f, corner, quality):
    r = f / corner
    return 1.0 / (1.0 - r**2 + 1j * r / quality)


def bessel(f, corner):
    zpk = signal.bessel(3, 2.0 * np.pi * corner, analog=True, output="zpk", norm="mag")
    return signal.freqs_zpk(*zpk, 2.0 * np.pi * np.atleast_1d(f))[1][0]


def room(f):
    """Microphone at 0.5 m with its echoes, which come whole samples of 1 ms late."""
    later = [round((path - 0.5) / 343.0 * RATE) / RATE for path in (1.4, 2.6, 4.1)]
    heard = 1.0 + sum(0.25 / path * np.exp(-2j * np.pi * f * s) for path, s in zip((1.4, 2.6, 4.1), later))
    way = np.exp(-2j * np.pi * f * round(0.5e9 / 343.0) * 1e-9)
    return 11.0 * way * heard * 1j * f / (0.1 + 1j * f) * second_order(f, 23e3, 0.7)


RATE = 1000.0

# kind, numbers of the specimen, analytic H(f), three frequencies within and beyond the band [Hz], duration [s]
BENCH = {
    "laser_vibrometer": ({}, lambda f: bessel(f, 5000.0), (37.0, 2013.0, 9120.0), 0.1),
    "displacement_laser": ({}, lambda f: np.sinc(f * 1e-3) * np.exp(-3j * np.pi * f * 1e-3), (3.7, 120.0, 730.0), 0.3),
    "strain_gauge": ({}, lambda f: 20e-6 * second_order(f, 1600.0, np.sqrt(0.5)), (13.0, 810.0, 3220.0), 0.1),
    "accelerometer": (
        {"highpass": 1.0},
        lambda f: 1j * f / (1.0 + 1j * f) * second_order(f, 40e3, 30.0),
        (1.7, 4130.0, 40e3 + 70.0),
        0.6,
    ),
    "normal_force": ({}, lambda f: second_order(f, 2000.0, np.sqrt(0.5)), (17.0, 1030.0, 4180.0), 0.1),
    "disc_speed": ({}, lambda f: 1.0 / (1.0 + 1j * f / 50.0), (5.3, 47.0, 133.0), 0.2),
    "microphone": ({}, room, (17.0, 3407.0, 20e3 + 70.0), 0.3),
    "voltmeter": ({}, lambda f: second_order(f, 100e3, np.sqrt(0.5)), (49.0, 3407.0, 20e3 + 70.0), 0.1),
}
CASES = [(kind, f) for kind, (_, _, frequencies, _) in BENCH.items() for f in frequencies]


def gain_and_phase(play, clean, kind, f, duration=None, **numbers):
    """Complex gain at f [Hz]: fit of sine and cosine, and of what start transient is left, to the samples."""
    specimen, _, _, usual = BENCH[kind]
    sensor = KINDS[kind](**clean[kind], **specimen, **numbers)
    w = 2.0 * np.pi * f
    parts = max(1, int(np.ceil(1e-3 * w / 0.8)))
    if f > 1e4:
        usual = 0.04
    run = play({"s": sensor}, {sensor.reads: lambda t: np.sin(w * t)}, duration or usual, parts=parts)
    t, y = run.only()
    late = t > 0.4 * t[-1]
    columns = [np.sin(w * t), np.cos(w * t)]
    if slow := {"accelerometer": 1.0, "microphone": 0.1, "disc_speed": 50.0}.get(kind):
        columns.append(np.exp(-2.0 * np.pi * slow * t))
    (a, b, *_), *_ = np.linalg.lstsq(np.column_stack(columns)[late], y[late])
    return a + 1j * b


@pytest.mark.parametrize(("kind", "f"), CASES)
def test_gain_and_phase(play, clean, kind, f):
    got = gain_and_phase(play, clean, kind, f)
    expected = BENCH[kind][1](f)
    assert abs(got) == pytest.approx(abs(expected), rel=1e-6)
    assert np.degrees(np.angle(got / expected)) == pytest.approx(0.0, abs=1e-4)


DENSITY = {
    "laser_vibrometer": 1e-6,
    "strain_gauge": 1.5e-9,
    "accelerometer": 7e-5,
    "normal_force": 2e-4,
    "disc_speed": 1e-4,
    "microphone": 7.8e-7,
    "voltmeter": 1e-6,
}


@pytest.mark.parametrize("rate", [1000.0, 10e3])
def test_noise_density_in_band_is_the_stated_one(play, clean, rate):
    sensors = {kind: KINDS[kind](**(clean[kind] | {"noise": noise}), rate=rate) for kind, noise in DENSITY.items()}
    zero = {s.reads: np.zeros_like for s in sensors.values()}
    run = play(sensors, zero, 20480.0 / rate, frame_ns=10_000_000)
    for kind, density in DENSITY.items():
        f, power = signal.welch(run.y[kind], fs=rate, nperseg=512)
        for low, high in ((0.02, 0.1), (0.1, 0.3), (0.3, 0.49)):
            band = (f > low * rate) & (f < high * rate)
            assert np.sqrt(np.mean(power[band])) == pytest.approx(density, rel=0.1), (kind, low)


def test_displacement_noise_is_white_with_the_stated_deviation_per_sample(play, clean):
    sensor = KINDS["displacement_laser"](**(clean["displacement_laser"] | {"noise": 1.5e-6}))
    _, y = play({"s": sensor}, {"displacement": np.zeros_like}, 20.0, frame_ns=10_000_000).only()
    assert np.std(y) == pytest.approx(1.5e-6, rel=0.03)
    f, power = signal.welch(y, fs=RATE, nperseg=256)
    halves = [np.mean(power[(f > 20) & (f < 250)]), np.mean(power[(f > 250) & (f < 480)])]
    assert halves[0] == pytest.approx(halves[1], rel=0.1)
