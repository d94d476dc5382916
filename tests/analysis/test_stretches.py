"""A measurement of two stretches, a day apart: each analysis works on each stretch, in the memory of its samples."""

import tracemalloc

import numpy as np
import pytest
from scipy.io import wavfile

import rig as lab
from rig.analysis.recorded.amplitude import amplitudes
from rig.analysis.recorded.sound import hear
from rig.analysis.recorded.spectrum import spectrum
from rig.analysis.recorded.stick_slip import stick_slip

RATE = 20_000.0
DAY = 86_400.0
T = np.arange(40_000) / RATE
MOST = 300e6
"""Bytes: an even grid over the day has 1.7e9 samples."""


def squeal():
    """A tone of 1800 Hz that grows with 60 1/s, lasts, and decays with 40 1/s, in noise."""
    size = np.interp(T, [0.5, 0.7, 1.5], [np.exp(-12.0), 1.0, 1.0]) * (T > 0.5)
    size[(T > 0.5) & (T < 0.7)] = np.exp(60.0 * (T[(T > 0.5) & (T < 0.7)] - 0.7))
    size[T > 1.5] = np.exp(-40.0 * (T[T > 1.5] - 1.5))
    return size * np.sin(3600.0 * np.pi * T) + 0.003 * np.random.default_rng(0).normal(size=T.size)


def slips():
    """Slip speed of 20 slips a second, and a force that drops in each of them."""
    phase = (20.0 * T) % 1.0
    moving = phase > 0.8
    speed = np.where(moving, np.sin(np.pi * np.clip((phase - 0.8) / 0.2, 0.0, 1.0)), 0.0)
    return speed, np.where(moving, 5.0, 5.0 + 2.0 * phase)


def recorded(folder, starts):
    """The recording of the same signals at each of `starts` [s]."""
    path = folder / f"{len(starts)}.csv"
    v = squeal()
    speed, force = slips()
    table = np.concatenate([np.column_stack([start + T, v, speed, force]) for start in starts])
    np.savetxt(path, table, "%.7f", ",", header="t [s],v [m/s],slip [m/s],force [N]", comments="")
    out = path.with_suffix(".mcap")
    lab.import_(path, out, {"v": "vibrometer", "slip": "slip", "force": "friction"}, time="t")
    return out


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stretches")
    return recorded(folder, [0.0]), recorded(folder, [0.0, DAY])


@pytest.fixture
def runs(files):
    """The recording of one stretch, and of two; an analysis may not need the memory of the day between them."""
    opened = [lab.open(path) for path in files]
    tracemalloc.start()
    yield opened
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < MOST


def test_the_spectrum_is_the_mean_over_the_windows_of_both(runs):
    one, two = (spectrum(run, "vibrometer") for run in runs)
    assert two.density.windows == 2 * one.density.windows
    assert np.allclose(two.density.s, one.density.s, rtol=1e-12)
    assert "each window lies in one of 2 stretches: 0 to 2 s, 86400 to 86402 s" in two.text()


def test_the_events_of_both_are_found(runs):
    one, two = (lab.events(run, "vibrometer", at=["friction"]) for run in runs)
    (event,) = one.events
    assert len(two.events) == 2
    for shift, again in zip((0.0, DAY), two.events):
        assert again.begin - shift == pytest.approx(event.begin, abs=1e-6)
        assert again.growth == pytest.approx(event.growth, rel=1e-3)
        assert again.at["friction"] == pytest.approx(event.at["friction"], rel=1e-6)
        assert again.growth == pytest.approx(60.0, rel=0.01)


def test_the_slips_of_both_are_found_and_none_lies_in_the_gap(runs):
    one, two = (stick_slip(run, velocity="slip", friction="friction") for run in runs)
    assert len(two.slips) == 2 * len(one.slips)
    for again, slip in zip(two.slips[len(one.slips) :], one.slips):
        assert again.begin - DAY == pytest.approx(slip.begin, abs=1e-6)
        assert again.breakaway == slip.breakaway
        assert again.stick == pytest.approx(slip.stick, abs=1e-6, nan_ok=True)
    assert two.missing == one.missing


def test_the_smoothing_of_a_force_knows_nothing_of_the_other_day(runs):
    one, two = (stick_slip(run, velocity="slip", friction="friction", smooth=0.1) for run in runs)
    assert np.array_equal(two.force[-T.size :], one.force)


def test_the_sound_of_both_is_heard_and_written_without_the_gap(files, runs, rig, tmp_path):
    one, two = (hear(run, "vibrometer") for run in runs)
    assert np.array_equal(two.v, np.concatenate([one.v, one.v]))
    assert [squeal.begin for squeal in two.squeals] == pytest.approx([one.squeals[0].begin + t for t in (0.0, DAY)])
    assert two.t(np.array([0, T.size, T.size + 1])) == pytest.approx([0.0, DAY, DAY + 1.0 / RATE])
    code, _, err = rig("analyse", "sound", files[1], "--signal", "vibrometer", "--out", tmp_path / "x.wav")
    assert (code, "stretches that begin at 0 s, 86400 s" in err) == (0, True)


def test_each_stretch_becomes_a_wav_file(files, rig, tmp_path):
    for path, folder in zip(files, "ab"):
        assert rig("export", path, "--to", "wav", "--only", "vibrometer", "--out", tmp_path / folder)[0] == 0
    (one,) = (tmp_path / "a").glob("*.wav")
    names = sorted(path.name for path in (tmp_path / "b").glob("*.wav"))
    assert names == [one.name.replace(".wav", f"_{i}.wav") for i in (1, 2)]
    for name in names:
        again = lab.open(files[0]).measurements["vibrometer"].v
        full = np.abs(again).max() / 0.9
        assert wavfile.read(tmp_path / "b" / name)[1] / 2.0**31 * full == pytest.approx(again, abs=1e-6 * full)


def test_the_amplitudes_of_both_are_stages_of_their_own(runs):
    one, two = (amplitudes(run).rows for run in runs)
    assert [row.stage for row in two[:2]] == ["whole, 0 to 1.99995 s", "whole, 86400 to 86402 s"]
    assert [row.found.frequency for row in two[:2]] == pytest.approx([one[0].found.frequency] * 2, rel=1e-6)


@pytest.mark.parametrize(
    "command",
    [
        ("portrait", "--x", "slip", "--y", "friction"),
        ("hysteresis", "--over", "slip", "--signal", "vibrometer"),
        ("response", "--input", "friction", "--output", "vibrometer"),
    ],
)
def test_other_analyses_name_the_stretches_and_work_on_the_one_that_is_chosen(files, rig, command):
    code, _, err = rig("analyse", command[0], files[1], *command[1:])
    assert (code, "it lies in 2 stretches, 0 to 1.99995 s and 86400 to 86402 s" in err) == (2, True)
    assert rig("analyse", command[0], files[1], *command[1:], "--from", f"{DAY} s")[0] == 0
