"""Curves and log that a recording contains for programs that know nothing of this project."""

import struct

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from rig.record import reader
from rig.record.curves import WINDOW_NS, derived, topic_of
from rig.record.run import Run, Samples
from rig.record.save_run import save

BEGAN = 1_800_000_000_000_000_000


def value_of(payload):
    """The number of a std_msgs/Float64MultiArray in CDR, little endian, with neither dimension nor offset."""
    header, dimensions, offset, count, value = struct.unpack("<4sIII4xd", payload)
    assert (header, dimensions, offset, count) == (b"\0\1\0\0", 0, 0, 1)
    return value


@pytest.fixture
def run():
    """0.3 s of a slow output and of a sensor that samples a fast vibration, with an event."""
    t_ns = np.arange(3001) * 100_000
    return Run(
        scene="{}",
        step_ns=1_000_000,
        frame_ns=1_000_000,
        time=np.arange(301) * 1e-3,
        signals={"velocity": np.linspace(0.0, 3.0, 301)},
        units={"velocity": "m/s", "meas/microphone": "Pa"},
        measurements={"microphone": Samples(t_ns, np.sin(2.0 * np.pi * 1000.0 * t_ns * 1e-9))},
        events=[
            {"t_ns": 5, "tick": 0, "source": "plant", "kind": "step", "text": "hold", "data": {}},
            {"t_ns": 6, "tick": 0, "source": "plant", "kind": "contact", "text": "stick", "data": {}},
        ],
        began_ns=BEGAN,
    )


@pytest.fixture
def messages(run, tmp_path):
    """Topic -> messages of the saved run, as any reader of MCAP files finds them."""
    save(run, tmp_path / "run.mcap")
    found = {}
    with (tmp_path / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append((schema, channel, message))
    return found


def test_each_output_and_sensor_has_a_curve_in_its_unit(messages):
    for topic, unit in (("curve/velocity_in_m_per_s", "m/s"), ("measured/microphone_in_Pa", "Pa")):
        schema, channel, _ = messages[topic][0]
        assert (schema.name, schema.encoding) == ("std_msgs/msg/Float64MultiArray", "ros2msg")
        assert (channel.message_encoding, channel.metadata) == ("cdr", {"unit": unit})
    topics = {"m/s^2": "curve/x_in_m_per_s2", "N*s/m": "curve/x_in_N_s_per_m", "1": "curve/x"}
    assert {unit: topic_of("curve", "x", unit) for unit in topics} == topics
    assert all(map(derived, ("plot", "curve/a_in_m", "measured/b", "log/plant")))
    assert not any(map(derived, ("state", "meas/curve")))


def test_a_curve_has_the_extremes_of_each_window_at_their_own_times(run, messages):
    t_ns, v = run.measurements["microphone"]
    points = [(m.log_time, value_of(m.data)) for _, _, m in messages["measured/microphone_in_Pa"]]
    assert all(v[np.searchsorted(t_ns, now)] == value for now, value in points)
    for begin in range(0, int(t_ns[-1]) + 1, WINDOW_NS):
        inside = v[(t_ns >= begin) & (t_ns < begin + WINDOW_NS)]
        mine = [value for now, value in points if begin <= now < begin + WINDOW_NS]
        assert (min(mine), max(mine)) == (inside.min(), inside.max())
        assert len(mine) <= 2
    assert [now for now, _ in points] == sorted(now for now, _ in points)
    values = [value_of(m.data) for _, _, m in messages["curve/velocity_in_m_per_s"]]
    assert (values, values[-1]) == (sorted(values), 3.0)  # a slow output stays monotone


def test_events_are_log_messages_that_foxglove_knows(run, tmp_path):
    save(run, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        log = make_reader(file, decoder_factories=[DecoderFactory()])
        said = [found for *_, found in log.iter_decoded_messages(topics=["log/plant"])]
    again = reader.open(tmp_path / "run.mcap")  # a run has no trace of them
    assert (list(again.signals), list(again.measurements), again.damage) == (["velocity"], ["microphone"], "")
    assert [(one.message, one.level, one.name) for one in said] == [("t = 0.000 s, step: hold", 2, "plant")]
    assert said[0].timestamp.seconds * 10**9 + said[0].timestamp.nanos == 5
