"""One flaw at a time: least significant bit, clipping, delay, drop-outs, slew, errors of gain and zero."""

from __future__ import annotations

import numpy as np
import pytest

from rig.sensors import KINDS

ALL = [kind for kind in sorted(KINDS) if not KINDS[kind].given]


def constant(value):
    return lambda t: np.full_like(t, value)


@pytest.mark.parametrize("kind", ALL)
def test_readings_are_whole_multiples_of_the_least_significant_bit(play, clean, kind):
    sensor = KINDS[kind](**(clean[kind] | {"resolution": 0.01, "span": 10.0}))

    def wave(t):
        return np.sin(5.0 * t) / sensor.sensitivity

    _, y = play({"s": sensor}, {sensor.reads: wave}, 0.3).only()
    steps = y / 0.01
    assert np.max(np.abs(steps - np.rint(steps))) < 1e-9
    assert np.min(np.diff(np.unique(np.rint(steps)))) == 1.0
    assert len(np.unique(np.rint(steps))) > 70
    _, smooth = play({"s": KINDS[kind](**clean[kind])}, {sensor.reads: wave}, 0.3).only()
    assert np.max(np.abs(y - smooth)) <= 0.005 * (1.0 + 1e-9)


@pytest.mark.parametrize("kind", ALL)
def test_readings_stop_at_the_span_and_are_counted(play, clean, kind):
    sensor = KINDS[kind](**(clean[kind] | {"span": 0.5}))
    signal = {sensor.reads: lambda t: np.sin(2.0 * np.pi * 5.0 * t) / sensor.sensitivity}
    run = play({"s": sensor}, signal, 0.4)
    _, y = run.only()
    _, free = play({"s": KINDS[kind](**clean[kind])}, signal, 0.4).only()
    np.testing.assert_array_equal(y, np.clip(free, -0.5, 0.5))
    clipped, on_its_way = int(np.sum(np.abs(free) > 0.5)), -(-sensor.front_end().delay_ns // sensor.period_ns)
    counted = run.counters["s"]
    assert 120 < clipped <= counted["clipped"] <= clipped + on_its_way
    assert (counted["dropped_out"], counted["slew_lost"]) == (0, 0)


@pytest.mark.parametrize("delay", ["0.3 ms", "25 ms"])
@pytest.mark.parametrize("frame_ns", [1_000_000, 5_000_000])
def test_delay_is_exact(play, clean, delay, frame_ns):
    numbers = clean["disc_speed"] | {"rate": 200.0}
    sensors = {"late": KINDS["disc_speed"](**numbers, delay=delay), "now": KINDS["disc_speed"](**numbers)}
    late = 1e-3 * float(delay.split()[0])

    def signal(t):
        return np.cos(40.0 * t) + 0.5 * t

    run = play(sensors, {"disc_speed": signal}, 0.5, frame_ns, parts=5)
    # The same instrument without delay, fed with the signal as it was `late` ago: constant before t = 0.
    a = 2.0 * np.pi * 50.0

    def closed(t):
        """a integral_0^t e^{-a (t-s)} u(s) ds + e^{-a t} with u = cos(w t) + t/2, at rest on u(0) = 1."""
        w = 40.0
        wave = (a * a * np.cos(w * t) + a * w * np.sin(w * t)) / (a * a + w * w)
        ramp = 0.5 * (t - 1.0 / a)
        rest = 1.0 - a * a / (a * a + w * w) + 0.5 / a
        return np.where(t > 0.0, wave + ramp + rest * np.exp(-a * np.maximum(t, 0.0)), 1.0)

    np.testing.assert_allclose(run.y["now"], closed(run.t["now"]), rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(run.y["late"], closed(run.t["late"] - late), rtol=1e-11, atol=1e-13)
    assert run.t["late"][0] == 0.0
    assert len(run.t["late"]) == 101


def test_displacement_laser_delays_by_its_processing(play, clean):
    sensors = {
        f"n{n}": KINDS["displacement_laser"](**clean["displacement_laser"], processing=n, rate=500.0) for n in (0, 1, 3)
    }
    run = play(sensors, {"displacement": lambda t: t}, 0.1)
    for n in (0, 1, 3):
        t = run.t[f"n{n}"]
        begin, end = np.maximum(t - 0.002 * (n + 1), 0.0), np.maximum(t - 0.002 * n, 0.0)
        np.testing.assert_allclose(run.y[f"n{n}"], (end**2 - begin**2) / 2.0 / 0.002, atol=1e-15)


@pytest.mark.parametrize("dropout", ["hold", "zero"])
def test_drop_outs_come_at_the_stated_rate_within_3_sigma(play, clean, dropout):
    numbers = clean["laser_vibrometer"] | {
        "rate": 10e3,
        "dropout_rate": 400.0,
        "dropout_shortest": "10 us",
        "dropout_longest": "100 us",
        "dropout": dropout,
    }
    sensor = KINDS["laser_vibrometer"](**numbers)
    run = play({"s": sensor}, {"velocity": lambda t: 1.0 + t}, 20.0, frame_ns=10_000_000)
    t, y = run.only()
    lost = run.counters["s"]["dropped_out"]
    # A sample is lost when a drop-out began at most its length before: probability 1 - exp(-rate mean length).
    p = 1.0 - np.exp(-400.0 * 55e-6)
    assert abs(lost - p * len(t)) < 3.0 * np.sqrt(p * (1.0 - p) * len(t))
    assert np.sum(y == 0.0 if dropout == "zero" else np.diff(y, prepend=0.0) == 0.0) == lost


def test_number_of_drop_outs_is_poisson(play, clean):
    # Drop-outs shorter than the sample period of 10 us, longer than it: each is seen exactly once or twice.
    numbers = clean["laser_vibrometer"] | {
        "rate": 100e3,
        "dropout_rate": 100.0,
        "dropout_shortest": 50e-6,
        "dropout_longest": 50e-6,
    }
    _, y = play({"s": KINDS["laser_vibrometer"](**numbers)}, {"velocity": lambda t: 1.0 + t}, 4.0, 10_000_000).only()
    held = np.diff(y) == 0.0
    begun = np.sum(held & ~np.concatenate([[False], held[:-1]]))
    expected = 4.0 * 100.0 * np.exp(-100.0 * 50e-6)  # overlapping ones are seen as one
    assert abs(begun - expected) < 3.0 * np.sqrt(expected)
    assert np.sum(held) / begun == pytest.approx(5.0, rel=0.05)


def test_slew_limit_lets_a_reading_change_by_slew_times_period_and_counts(play, clean):
    sensor = KINDS["laser_vibrometer"](**(clean["laser_vibrometer"] | {"slew": "20 m/s^2"}))
    run = play({"s": sensor}, {"velocity": lambda t: np.where(t > 0.0, 0.1, 0.0)}, 0.02)
    _, y = run.only()
    np.testing.assert_allclose(y[:6], [0.0, 0.02, 0.04, 0.06, 0.08, 0.1], atol=1e-8)
    assert run.counters["s"]["slew_lost"] == pytest.approx(5, abs=1)
    assert y[-1] == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize("kind", sorted(set(ALL) - {"accelerometer", "microphone"}))
def test_gain_error_and_offset(play, clean, kind):
    sensor = KINDS[kind](**clean[kind], gain_error=0.01, offset=0.25)
    _, y = play({"s": sensor}, {sensor.reads: constant(3.0)}, 0.01).only()
    np.testing.assert_allclose(y, 3.0 * sensor.sensitivity * 1.01 + 0.25, rtol=1e-12)


def test_a_bridge_warms_to_its_zero_drift_and_a_charge_drifts_linearly(play, clean):
    numbers = clean["strain_gauge"] | {"zero_drift": 1e-6, "warming": 3.0, "warm_up": 0.5, "rate": 100.0}
    t, y = play({"s": KINDS["strain_gauge"](**numbers)}, {"friction_force": np.zeros_like}, 4.0).only()
    np.testing.assert_allclose(y, 3e-6 * (1.0 - np.exp(-t / 0.5)), atol=1e-18)
    sensor = KINDS["normal_force"](**(clean["normal_force"] | {"drift": "5 mN/s", "rate": 25.0}))
    t, y = play({"s": sensor}, {"normal_force": constant(20.0)}, 2.0).only()
    np.testing.assert_allclose(y, 20.0 + 5e-3 * t, rtol=1e-13)


def test_warming_reaches_an_accelerometer_through_its_high_pass(play, clean):
    numbers = clean["accelerometer"] | {"temperature_sensitivity": 0.2, "warming": 2.0, "warm_up": 0.5, "rate": 100.0}
    t, y = play({"s": KINDS["accelerometer"](**numbers)}, {"acceleration": np.zeros_like}, 8.0).only()
    # High-pass of .4 (1 - e^{-2t}): solved as a state  h' = .4 * 2 e^{-2t} - w h.
    w = 2.0 * np.pi * 0.1
    np.testing.assert_allclose(y, 0.8 / (w - 2.0) * (np.exp(-2.0 * t) - np.exp(-w * t)), atol=1e-15)
    assert y[0] == 0.0
    # Continuous through the case of equal corners.
    near = KINDS["accelerometer"](warm_up=1.0 / w).front_end()
    assert near.warmth * (np.exp(-near.fade) - np.exp(-near.rise)) == pytest.approx(0.2 * w * np.exp(-w), rel=1e-5)


def test_pickup_on_a_roller_is_calibrated_in_metres_per_second(play, clean):
    numbers = clean["disc_speed"] | {"resolution": 0.01, "span": 2.0}
    sensor = KINDS["disc_speed"](**numbers, radius=0.05, reads="surface_speed")
    assert (sensor.unit, sensor.reads_unit) == ("m/s", "m/s")
    _, y = play({"s": sensor}, {"surface_speed": constant(0.0613)}, 0.01).only()
    np.testing.assert_allclose(y, 0.0615, rtol=1e-12)  # least significant bit .01 rad/s * .05 m
    run = play({"s": sensor}, {"surface_speed": constant(0.3)}, 0.01)
    assert run.y["s"][-1] == pytest.approx(0.1)
    assert run.counters["s"]["clipped"] == 11


def test_a_sound_comes_late_and_its_echoes_later(play, clean):
    numbers = clean["microphone"] | {"rate": 50e3, "paths": (1.4, 4.1), "highpass": 1e-3}
    sensor = KINDS["microphone"](**numbers)
    t, y = play({"s": sensor}, {"velocity": lambda t: np.where(t >= 2e-3 - 1e-12, 1.0, 0.0)}, 0.03).only()
    for way, level in ((0.5, 11.0), (1.4, 11.0 + 11.0 * 0.25 / 1.4), (4.1, 11.0 * (1.0 + 0.25 / 1.4 + 0.25 / 4.1))):
        arrives = 2e-3 + way / 343.0
        assert y[np.searchsorted(t, arrives + 5e-4)] == pytest.approx(level, rel=1e-3)
        assert abs(y[np.searchsorted(t, arrives - 3e-5)] - y[np.searchsorted(t, arrives - 2e-4)]) < 1e-3 * level
    with pytest.raises(ValueError, match=r"paths: 0.4 m no longer than the direct way of 0.5 m"):
        KINDS["microphone"](paths=("40 cm", "1 m"))
