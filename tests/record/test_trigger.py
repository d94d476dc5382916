"""Windows around the firings of a trigger: each a whole recording, with bounded disk and memory."""

import json

import numpy as np
import pytest

from rig.bus import encode
from rig.bus.run_setup import Setup
from rig.errors import UsageError
from rig.record import reader
from rig.record import windows as triggers
from rig.record.contents import contents
from rig.record.message_scan import Scan
from rig.record.run_list import runs
from rig.record.windows import Trigger, Windows

SETUP = Setup(
    "r", '{"plant": "belt"}', 1_000_000, 1_000_000, {"velocity": "m/s", "x": "m"}, {"vibrometer": ("m/s", 1_000_000)}
)
MS = 1_000_000


def feed(windows, speeds, lost=(), each=lambda k: None):
    """What a run sends whose vibrometer measures `speeds` at 1 kHz: blocks of 20 ms, states of 200 Hz, steps."""
    state = encode.StateEncoder(2)
    for k, v in enumerate(speeds):
        now = k * MS
        windows.write("step", encode.step(k, now, np.array([v]), np.ones(1, np.int64)), now, k, now + 7)
        if k % 5 == 0:
            windows.write("state", state(now, k, 0, np.array([v, 2.0 * v])), now, k // 5, now + 7)
        if k % 20 == 19 and k not in lost:
            block = encode.block(k, now - 19 * MS, MS, speeds[k - 19 : k + 1])
            windows.write("meas/vibrometer", block, now, k // 20, now + 7)
        each(k)
        windows.flush_if_due()


def watched(path, speeds, condition="vibrometer > 0.1 m/s", before=0.5, after=0.3, most=100, close=True, **more):
    said = []
    lost, replace = more.pop("lost", ()), more.pop("replace", False)
    trigger = Trigger(triggers.condition(condition), before, after, most, **more)
    windows = Windows(path, SETUP, trigger, replace, said.append)
    feed(windows, np.asarray(speeds, float), lost)
    if close:
        windows.close({"ended": "the plant left"}, {"verdict": "VALID"})
    windows.abandon()
    return windows, said


def pulses(*at, length=4000):
    v = np.zeros(length)
    v[list(at)] = 0.2
    return v


def test_a_firing_writes_a_whole_recording_of_its_window(tmp_path):
    windows, said = watched(tmp_path / "w.mcap", pulses(1234, 3000))
    assert [path.name for path in windows.paths] == ["w-001.mcap", "w-002.mcap"]
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["w-001.mcap", "w-002.mcap"]
    assert said[0].startswith("vibrometer > 0.1 m/s held at t = 1.234000 s with 0.2 m/s: ")
    (listed, _) = runs(tmp_path)
    assert (listed.fault, len(listed.contents.digest)) == ("", 64)
    assert listed.contents.seconds == pytest.approx(0.8, abs=0.25)
    assert contents(listed.path) == listed.contents
    run = reader.open(windows.paths[0])
    t_ns, v = run.measurements["vibrometer"]
    assert t_ns[0] <= (1234 - 500) * MS
    assert t_ns[-1] >= (1234 + 300) * MS
    assert t_ns[-1] - t_ns[0] <= (500 + 300 + 2 * 100 + 20) * MS
    assert np.array_equal(v, pulses(1234)[t_ns // MS])
    assert np.all(np.diff(t_ns) == MS)
    assert (run.sealed, run.damage, run.scene) == (True, "", SETUP.scene)
    assert run.window in said[0]
    assert run.begin_ns == min(round(run.time[0] * 1e9), int(t_ns[0]) + 19 * MS)
    scan = Scan(windows.paths[0])
    assert list(scan)
    about = scan.metadata["trigger"]
    assert (about["condition"], float(about["fired"]), float(about["value"])) == ("vibrometer > 0.1 m/s", 1.234, 0.2)
    assert json.loads(scan.metadata["recording"]["ended"]) == "the window of the trigger ended"


def test_a_long_vibration_gives_windows_without_gap_and_without_overlap(tmp_path):
    v = np.zeros(4000)
    v[1000:3000] = 0.2
    windows, _ = watched(tmp_path / "w.mcap", v)
    steps = [[r.seq for r in Scan(path) if r.topic == "step"] for path in windows.paths]
    assert len(steps) > 3
    together = [seq for window in steps for seq in window]
    assert together == list(range(together[0], together[-1] + 1))
    assert together[0] <= 500
    assert together[-1] >= 3000


def test_the_window_that_is_open_at_the_end_has_the_summary_and_most_bounds_the_disk(tmp_path):
    windows, said = watched(tmp_path / "w.mcap", np.full(4000, 0.2), most=2)
    assert len(list(tmp_path.iterdir())) == len(said) == 2
    watched(tmp_path / "open.mcap", pulses(3900))
    assert contents(tmp_path / "open-001.mcap").timing == "VALID"
    assert windows.text().endswith("2 recordings of vibrometer > 0.1 m/s (--most: the trigger was off from then on)")


def test_nothing_is_written_without_a_firing_and_the_closest_sample_is_told(tmp_path):
    v = np.zeros(1000)
    v[700] = 0.09
    windows, said = watched(tmp_path / "w.mcap", v)
    assert (list(tmp_path.iterdir()), said) == ([], [])
    assert windows.text() == "nothing recorded: vibrometer > 0.1 m/s never held; closest: 0.09 m/s at t = 0.700 s"
    windows, _ = watched(tmp_path / "w.mcap", [])
    assert windows.text() == "nothing recorded: vibrometer > 0.1 m/s never held; no sample of it arrived"


def test_memory_bounds_what_is_kept_before_and_the_recording_says_so(tmp_path):
    windows, said = watched(tmp_path / "w.mcap", pulses(3000), before=2.0, memory=100_000)
    t_ns = reader.open(windows.paths[0]).measurements["vibrometer"].t_ns
    assert 0.05e9 < 3000 * MS - t_ns[0] < 0.5e9
    assert "before it are kept, 2 s do not fit into 0 MiB of memory" in said[0]


@pytest.mark.parametrize(
    ("condition", "first"),
    [
        ("vibrometer < -0.1 m/s", 2000),
        ("|vibrometer| > 10 cm/s", 1000),
        ("velocity < -100 mm/s", 2000),
    ],
)
def test_conditions_on_sensors_and_outputs_in_any_unit(tmp_path, condition, first):
    v = np.zeros(3000)
    v[1000], v[2000] = 0.2, -0.3
    windows, said = watched(tmp_path / "w.mcap", v, condition)
    assert f"held at t = {first / 1000:.6f} s" in said[0]
    assert str(windows.trigger.condition).replace(" ", "") == condition.replace(" ", "")


@pytest.mark.parametrize(
    ("condition", "fault"),
    [
        ("vibrometer", "expected NAME > VALUE or NAME < VALUE with a unit"),
        ("vibrometer > 0.1 kg", "the level is '0.1 kg'; expected a unit that converts to m/s"),
        ("|vibrometer| < -1 m/s", "an absolute value is never below 0"),
    ],
)
def test_a_condition_that_does_not_fit_is_refused_in_words(tmp_path, condition, fault):
    with pytest.raises(UsageError) as refused:
        watched(tmp_path / "w.mcap", pulses(), condition)
    assert fault in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_windows_of_an_earlier_watch_are_replaced_one_by_one_with_force(tmp_path):
    base = tmp_path / "w.mcap"
    watched(base, pulses(500, 1500))
    with pytest.raises(UsageError, match=r"w-001\.mcap exists; name another file, or add --force"):
        watched(base, pulses(1000))
    watched(base, pulses(1000), replace=True)
    assert {one.name for one in tmp_path.iterdir()} == {"w-001.mcap", "w-002.mcap"}
    assert "held at t = 1.000000 s" in reader.open(tmp_path / "w-001.mcap").window
