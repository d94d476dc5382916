"""What a sample is: exact, on its instant, and the same however the run is cut."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from rig.sensors import KINDS
from rig.sensors.chain.bank import Bank
from rig.solve.segment_output import Segments

SIGNALS = {
    "velocity": lambda t: 0.3 * np.sin(120.0 * t + 0.2) + 0.1,
    "displacement": lambda t: 2e-3 * np.cos(90.0 * t) + 1e-3,
    "friction_force": lambda t: 10.0 + 3.0 * np.sin(200.0 * t),
    "acceleration": lambda t: 5.0 * np.cos(150.0 * t) + 2.0,
    "normal_force": lambda t: 20.0 + np.sin(70.0 * t),
    "disc_speed": lambda t: 0.3 + 0.1 * np.sin(30.0 * t),
    "stack_voltage": lambda t: 7.0 * np.sin(110.0 * t) + 1.0,
}


def instruments(clean=None, **numbers):
    simulated = {kind: cls for kind, cls in KINDS.items() if not cls.given}
    sensors = {kind: cls(**({} if clean is None else clean[kind]), **numbers) for kind, cls in simulated.items()}
    fast = {"rate": 10e3} | ({} if clean is None else clean["laser_vibrometer"])
    return sensors | {"fast": KINDS["laser_vibrometer"](**fast)}


@settings(max_examples=12)
@given(seed=st.integers(0, 10**6), delay=st.sampled_from([0, 0.3e-3, 1.7e-3]), frame_ms=st.sampled_from([1, 2, 5]))
def test_samples_do_not_depend_on_how_the_run_is_cut(play, clean, seed, delay, frame_ms):
    rng = np.random.default_rng(seed)
    sensors = instruments(clean, delay=delay)
    plain = play(sensors, SIGNALS, 0.02, parts=10)
    frame = 1e-3 * frame_ms
    cut = play(
        sensors,
        SIGNALS,
        0.02,
        frame_ns=frame_ms * 1_000_000,
        cuts=lambda k: np.concatenate([np.arange(1, 10 * frame_ms) * 1e-4, rng.uniform(0.0, frame, 7)]),
    )
    for name in sensors:
        np.testing.assert_array_equal(cut.t[name], plain.t[name])
        scale = np.max(np.abs(plain.y[name]))
        np.testing.assert_allclose(cut.y[name], plain.y[name], rtol=0, atol=1e-12 * scale, err_msg=name)


def test_random_numbers_do_not_depend_on_the_frame(play):
    sensors = {
        "v": KINDS["laser_vibrometer"](rate=10e3, resolution=0.0, dropout_rate=2000.0, dropout="zero"),
        "n": KINDS["normal_force"](resolution=0.0, delay="1.3 ms"),
    }
    still = {"velocity": np.zeros_like, "normal_force": np.zeros_like}
    runs = [play(sensors, still, 1.2, frame_ns=ms * 1_000_000) for ms in (1, 4, 20)]
    for run in runs[1:]:
        for name in sensors:
            np.testing.assert_array_equal(run.y[name], runs[0].y[name])
        assert run.counters == runs[0].counters
    assert runs[0].counters["v"]["dropped_out"] > 500


def test_same_seed_same_bits_other_seed_other_noise_and_start_begins_anew(play):
    sensors = instruments()
    bank = Bank(sensors, list(SIGNALS), 1_000_000, 7)
    one, again, anew = (play(sensors, SIGNALS, 0.3, seed=7, bank=own) for own in (None, bank, bank))
    other = play(sensors, SIGNALS, 0.3, seed=8)
    for name in sensors:
        np.testing.assert_array_equal(one.y[name], again.y[name])
        np.testing.assert_array_equal(one.y[name], anew.y[name])
        assert np.any(one.y[name] != other.y[name]), name
    assert one.counters == anew.counters


def test_noise_of_an_instrument_is_its_own_whatever_its_neighbours(play):
    sensors = instruments()
    alone = play({"accelerometer": sensors["accelerometer"]}, SIGNALS, 0.1, parts=10)
    among = play(sensors, SIGNALS, 0.1, parts=10)
    np.testing.assert_array_equal(alone.y["accelerometer"], among.y["accelerometer"])
    sensors = {side: KINDS["normal_force"](resolution=0.0, drift=0.0) for side in ("left", "right")}
    run = play(sensors, {"normal_force": np.zeros_like}, 2.0)
    assert abs(np.corrcoef(run.y["left"], run.y["right"])[0, 1]) < 0.08


def test_at_a_jump_the_value_before_it_is_read():
    sensors = {"a": KINDS["accelerometer"](ideal=True), "fast": KINDS["accelerometer"](ideal=True, rate=2000.0)}
    bank = Bank(sensors, ["acceleration"], 1_000_000, 1)
    bank.start(np.array([1.0]))
    coef = np.zeros((2, 1, 9))
    coef[:, 0, 0] = 2.0, 3.0
    bank.advance(Segments(np.array([2]), np.array([0.0, 5e-4]), np.array([5e-4, 5e-4]), coef))
    np.testing.assert_array_equal(bank.samples(1), [2.0, 3.0])
    assert bank.latest[0] == 3.0


@pytest.mark.parametrize(
    ("kind", "system"),
    [
        ("laser_vibrometer", signal.bessel(3, 2e4, analog=True, norm="mag")),
        ("strain_gauge", signal.butter(2, 2e3, analog=True)),
        ("disc_speed", ([2e3], [1.0, 2e3])),
    ],
)
def test_step_response(play, clean, kind, system):
    corner = 2e4 if kind == "laser_vibrometer" else 2e3
    sensor = KINDS[kind](**clean[kind], bandwidth=corner / (2.0 * np.pi), rate=50e3)
    t, y = play({"s": sensor}, {sensor.reads: lambda t: np.where(t > 0.0, 1.0, 0.0)}, 5e-3).only()
    _, expected, _ = signal.lsim(signal.lti(*system), np.ones_like(t), t)  # exact for a constant input
    np.testing.assert_allclose(y / sensor.sensitivity, expected, atol=1e-10)


def test_accelerometer_resonance_is_exact_over_segments_of_a_millisecond(play, clean):
    # 250 rad per segment: the same signal in segments of a millisecond and of 10 us, and the ringing after a jump.
    sensor = KINDS["accelerometer"](**clean["accelerometer"], rate=100e3, quality=200.0)
    coarse = play({"s": sensor}, {"acceleration": lambda t: 1.0 + 3.0 * np.minimum(t, 9.0)}, 0.01).only()[1]
    fine = play({"s": sensor}, {"acceleration": lambda t: 1.0 + 3.0 * t}, 0.01, parts=100).only()[1]
    np.testing.assert_allclose(coarse, fine, atol=1e-13)
    t, y = play({"s": sensor}, {"acceleration": lambda t: np.where(t > 0.0, 1.0, 0.0)}, 5e-3).only()
    w, zeta, low = 2.0 * np.pi * 40e3, 0.5 / 200.0, 0.2 * np.pi
    poles = np.array([-low, w * (-zeta + 1j * np.sqrt(1 - zeta**2))])
    c0 = w**2 / (low**2 - 2 * zeta * w * low + w**2)
    c1 = w**2 / ((poles[1] + low) * 2j * poles[1].imag)  # s cancels in H/s
    closed = c0 * np.exp(poles[0] * t) + 2.0 * (c1 * np.exp(poles[1] * t)).real
    np.testing.assert_allclose(y[1:], closed[1:], atol=1e-9)
    assert np.max(y) > 1.75


def test_long_runs_do_not_drift(play, clean):
    sensor = KINDS["displacement_laser"](**clean["displacement_laser"])
    bank = Bank({"s": sensor}, ["displacement"], 1_000_000, 1)
    bank.start(np.array([1.0]))
    coef = np.zeros((1, 1, 9))
    coef[0, 0, 0] = 1.0
    frame = Segments(np.array([1]), np.zeros(1), np.full(1, 1e-3), coef)
    for _ in range(8_000):
        bank.advance(frame)
    assert bank.latest[0] == pytest.approx(1.0, abs=1e-15)
    assert bank.counts() == [8_001]
