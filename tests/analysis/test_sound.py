"""What a microphone heard, of sounds whose level, frequency and rates are known in closed form."""

import json
import math
import wave
from dataclasses import replace

import numpy as np
import pytest

from rig.analysis.recorded.sound import HOP, WINDOW, hear
from rig.errors import UsageError
from rig.record.run import Run, Samples
from rig.record.save_run import save

RATE = 50_000
T = np.arange(2 * RATE) / RATE


def run_of(v, name="microphone", unit="Pa", times=None):
    t_ns = np.arange(v.size, dtype=np.int64) * (1_000_000_000 // RATE) if times is None else times
    return Run(
        scene='{"name": "whistle", "plant": "belt"}',
        step_ns=20_000,
        frame_ns=1_000_000,
        time=T[:2],
        signals={"velocity": np.zeros(2)},
        units={"velocity": "m/s", f"meas/{name}": unit},
        measurements={name: Samples(t_ns, v)},
    )


def whistle(growth=40.0, decay=25.0, swing=17.0):
    """2 Pa at 3400 Hz +- swing, full from 0.6 to 1.2 s, in a noise of 30 mPa."""
    size = 2.0 * np.exp(np.minimum(growth * (T - 0.6), 0.0) + np.minimum(decay * (1.2 - T), 0.0))
    phase = 2.0 * math.pi * 3400.0 * T - swing * np.cos(2.0 * math.pi * T)
    return size * np.sin(phase) + 0.03 * np.random.default_rng(7).standard_normal(T.size)


@pytest.fixture(scope="module")
def heard():
    return hear(run_of(whistle()))


def test_a_steady_tone_has_its_level_and_its_frequency():
    found = hear(run_of(0.2 * np.sin(2.0 * math.pi * 2140.3 * T)))
    expected = 20.0 * math.log10(0.2 / math.sqrt(2.0) / 20e-6)
    assert found.overall == pytest.approx(expected, abs=1e-3)
    assert found.level == pytest.approx(expected, abs=1e-2)
    assert found.tone == pytest.approx(expected, abs=1e-2)
    assert found.frequency == pytest.approx(2140.3, abs=0.05)
    [squeal] = found.squeals
    assert (squeal.begin, squeal.end) == (found.times[0], found.times[-1])
    assert math.isnan(squeal.growth)
    assert math.isnan(squeal.decay)


def test_a_squeal_that_comes_and_goes(heard):
    [squeal] = heard.squeals
    full = 20.0 * math.log10(2.0 / math.sqrt(2.0) / 20e-6)
    assert squeal.level == pytest.approx(full, abs=0.05)
    begins = 0.6 - (full - 60.0) / (20.0 / math.log(10.0)) / 40.0
    ends = 1.2 + (full - 57.0) / (20.0 / math.log(10.0)) / 25.0
    assert squeal.begin == pytest.approx(begins, abs=0.5 * WINDOW)
    assert squeal.end == pytest.approx(ends, abs=0.5 * WINDOW)
    assert squeal.growth == pytest.approx(40.0, rel=0.05)
    assert squeal.decay == pytest.approx(25.0, rel=0.05)


def test_the_frequency_is_followed_as_the_disc_turns(heard):
    loud = heard.tone > 90.0
    expected = 3400.0 + 17.0 * np.sin(2.0 * math.pi * heard.times[loud])
    assert heard.frequency[loud] == pytest.approx(expected, abs=1.0)
    [squeal] = heard.squeals
    assert (squeal.lowest, squeal.highest) == (pytest.approx(3383.0, abs=1.0), pytest.approx(3417.0, abs=1.0))


def test_noise_is_no_squeal():
    quiet = hear(run_of(0.03 * np.random.default_rng(7).standard_normal(T.size)))
    assert quiet.squeals == ()
    assert quiet.overall == pytest.approx(20.0 * math.log10(0.03 / 20e-6), abs=0.1)
    assert "no squeal" in quiet.text()


def test_samples_that_were_lost_are_silence():
    v = whistle()
    kept = (T < 0.8) | (T > 0.9)
    kept[5] = False
    times = (np.flatnonzero(kept) * 20_000).astype(np.int64)
    found = hear(run_of(v[kept], times=times))
    assert found.v.size == v.size
    assert found.missing == np.count_nonzero(~kept)
    assert len(found.squeals) == 2


def test_a_vibrometer_is_listened_to_by_name():
    run = run_of(1e-2 * whistle(), "vibrometer", "m/s")
    with pytest.raises(UsageError, match=r"sound pressure \[Pa\].*vibrometer \[m/s\].*--signal vibrometer"):
        hear(run)
    with pytest.raises(UsageError, match=r"no sensor 'laser'.*known: vibrometer"):
        hear(run, "laser")
    found = hear(run, "vibrometer")
    assert found.threshold == pytest.approx(found.tone.max() - 20.0)
    assert len(found.squeals) == 1
    assert "dB re 1 nm/s" in found.text()


def test_what_cannot_be_heard():
    with pytest.raises(UsageError, match=r"samples at 1000 Hz.*4000 Hz or more"):
        hear(run_of(np.zeros(900), times=np.arange(900, dtype=np.int64) * 1_000_000))
    with pytest.raises(UsageError, match=r"recorded 0\.02 s; at least 0\.04 s"):
        hear(run_of(np.zeros(1000)))
    with pytest.raises(UsageError, match="neither sound pressure nor a vibration"):
        hear(run_of(np.zeros(9000), "gauge", "N"), "gauge")


def test_the_command(tmp_path, rig):
    log = tmp_path / "run.mcap"
    save(run_of(whistle()), log)
    wav, png = tmp_path / "squeal.wav", tmp_path / "squeal.png"
    code, out, _ = rig("analyse", "sound", log, "--out", wav, "--figure", png, "--json")
    told = json.loads(out)
    assert (code, told["squeals"][0]["level"]) == (0, pytest.approx(97.0, abs=0.1))
    assert np.diff(told["windows"]["times"]) == pytest.approx(HOP)
    assert png.read_bytes().startswith(b"\x89PNG")
    with wave.open(str(wav)) as file:
        assert (file.getnchannels(), file.getsampwidth(), file.getframerate()) == (1, 3, RATE)
        raw = np.frombuffer(file.readframes(file.getnframes()), np.uint8).reshape(-1, 3)
    v = np.pad(raw, ((0, 0), (1, 0))).view("<i4")[:, 0] / 2.0**31
    assert v == pytest.approx(0.9 * whistle() / np.abs(whistle()).max(), abs=2.0**-22)
    save(replace(run_of(whistle()), units={"velocity": "m/s", "meas/microphone": "V"}), log)
    code, _, err = rig("analyse", "sound", log)
    assert (code, "Give the scene a microphone" in err) == (2, True)
