"""Any rate: sample k is at round(k / rate), in one process, over the bus, in a file and back."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rig
from rig.bus import messages
from rig.record.reader import open as read
from rig.record.rebuilt_traffic import RebuiltTraffic
from rig.record.save_run import save
from rig.sensors import KINDS
from rig.sensors.chain.instants import Instants

ODD = [300.0, 400.0, 777.0, 44100.0, 1024.0, 333.3, 65.5, 1.7]


def instant(rate, k):
    return round(Fraction(k * 10**9) / Fraction(str(rate)))


@given(rate=st.sampled_from(ODD), numbers=st.lists(st.integers(0, 10**10), min_size=1))
def test_sample_k_is_at_k_over_the_rate(rate, numbers):
    assert Instants.of(rate).at(np.array(numbers)).tolist() == [instant(rate, k) for k in numbers]


@pytest.mark.parametrize("frame_ns", [1_000_000, 5_000_000])
@pytest.mark.parametrize(("rate", "delay"), [*zip(ODD, ["0 s", "0.7 ms"] * 4)])
def test_an_ideal_sensor_reads_the_value_at_these_instants(play, rate, frame_ns, delay):
    sensor = KINDS["accelerometer"](ideal=True, rate=rate, delay=delay)
    t, y = play({"s": sensor}, {"acceleration": lambda t: 3.0 + np.sin(40.0 * t)}, 0.2, frame_ns, parts=5).only()
    expected = np.array([instant(rate, k) for k in range(len(t))]) * 1e-9
    np.testing.assert_array_equal(t, expected)
    assert instant(rate, len(t)) > 0.2e9 >= instant(rate, len(t) - 1)
    taken = np.maximum(t - sensor.delay * 1e-9, 0.0)
    np.testing.assert_allclose(y, 3.0 + np.sin(40.0 * taken), rtol=1e-11)


@pytest.mark.parametrize("rate", [300.0, 777.0, 9000.0])
def test_a_mean_over_uneven_intervals_is_that_of_each(play, clean, rate):
    sensor = KINDS["displacement_laser"](**clean["displacement_laser"], rate=rate, processing=0)
    t, y = play({"s": sensor}, {"displacement": lambda t: 2.0 + t}, 0.1).only()
    np.testing.assert_allclose(y[1:], 2.0 + 0.5 * (t[1:] + t[:-1]), rtol=1e-13)
    assert y[0] == pytest.approx(2.0, rel=1e-13)


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"displacement_laser", "microphone", "stream"}))
def test_filters_do_not_depend_on_the_rate(play, clean, kind):
    """Those without a mean or echoes, which go by the sample."""
    sensors = {f"{rate:g}": KINDS[kind](**clean[kind], rate=rate) for rate in (400.0, 2000.0)}
    run = play(sensors, {sensors["400"].reads: lambda t: np.sin(90.0 * t + 0.4)}, 0.1, parts=4)
    common, at, among = np.intersect1d(np.rint(run.t["400"] * 1e9), np.rint(run.t["2000"] * 1e9), return_indices=True)
    assert len(common) == 41
    np.testing.assert_allclose(run.y["400"][at], run.y["2000"][among], rtol=1e-10, atol=1e-13)


def test_times_of_a_recording_are_exact(tmp_path):
    changes = {"sensors.vibrometer.rate": "777 Hz", "sensors.laser.rate": "300 Hz"}
    run = rig.simulate(rig.load("belt", changes), 0.6)
    save(run, tmp_path / "a.mcap")
    again = read(tmp_path / "a.mcap")
    for name, rate in (("vibrometer", 777), ("laser", 300)):
        t_ns, v = run.measurements[name]
        assert t_ns.tolist() == [instant(rate, k) for k in range(len(t_ns))]
        np.testing.assert_array_equal(again.measurements[name].t_ns, t_ns)
        np.testing.assert_array_equal(again.measurements[name].v, v)
    told = [r for r in RebuiltTraffic(again, list(again.signals), frozenset()) if r.topic == "meas/vibrometer"]
    remade = [messages.times(messages.decode(r.topic, r.payload)) for r in told]
    np.testing.assert_array_equal(np.concatenate(remade), run.measurements["vibrometer"].t_ns)


def test_a_delay_as_long_as_the_run_is_told_where_its_length_is_unknown_at_its_end():
    run = rig.simulate(rig.load("belt", {"sensors.vibrometer.delay": "3 s"}), 0.5)
    [told] = [event["text"] for event in run.events if event["kind"] == "warning"]
    assert told.startswith("sensors.vibrometer: its delay of 3 s is as long as the run of 0.5 s")
    assert np.ptp(run.measurements["vibrometer"].v) < 1e-3
    assert not [e for e in rig.simulate("belt", 0.5).events if e["kind"] == "warning"]
    scene, asked = rig.load("belt", {"sensors.vibrometer.delay": "0.3 s"}), []
    run = rig.simulate(scene, stop=lambda: asked.append(1) or ("enough" if len(asked) == 2 else ""))
    [told] = [event["text"] for event in run.events if event["kind"] == "warning"]
    assert told.startswith("sensors.vibrometer: its delay of 0.3 s is as long as the run of 0.2 s")
