"""RMS over a speed that rises and falls: against closed forms, and against the events of a run."""

import json
import math

import numpy as np
import pytest

import rig as lab
from rig.analysis.recorded import hysteresis, series, spectrum
from rig.analysis.recorded.moving_windows import moving_rms, slowest
from rig.errors import UsageError
from rig.record.run import Run, Samples
from rig.record.save_run import save

RATE = 1000
T = np.arange(20 * RATE) / RATE
SPEED = np.interp(T, [0.0, 1.0, 9.0, 11.0, 19.0, 20.0], [0.0, 0.0, 0.8, 0.8, 0.0, 0.0])
UP, DOWN = 0.6, 0.2
"""Speeds at which the made vibration ends and begins."""


def run_of(v, speed=SPEED, unit="m/s^2", kept=slice(None), **changes):
    """A recording of a sensor with values `v`, of which samples `kept` are there."""
    t_ns = np.arange(v.size, dtype=np.int64) * 1_000_000
    made = {
        "scene": lab.load("belt").to_json(),
        "step_ns": 1_000_000,
        "frame_ns": 1_000_000,
        "time": T,
        "signals": {"surface_speed": speed, "velocity": 0.0 * T},
        "units": {"surface_speed": "m/s", "velocity": "m/s", "meas/accelerometer": unit},
        "measurements": {"accelerometer": Samples(t_ns[kept], v[kept])},
    }
    return Run(**(made | changes))


def shaken():
    """Whether it vibrates: as the speed rises up to UP, as it falls below DOWN."""
    return np.where(T < 10.0, SPEED < UP, SPEED < DOWN)


def loop(size=3.0, **how):
    return run_of(size * shaken() * np.sin(2.0 * math.pi * 50.0 * T), **how)


def test_rms_of_a_sine_is_its_amplitude_over_root_two():
    found = series(run_of(1e3 + 3.0 * np.sin(2.0 * math.pi * 50.0 * T)), "accelerometer")  # a mean counts nothing
    for asked in (0.02, 0.16, 2.0):  # whole periods
        t, rms, window = moving_rms(found, asked)
        assert window == asked
        assert rms == pytest.approx(3.0 / math.sqrt(2.0), rel=1e-12)
        assert t[0] == pytest.approx(0.5 * window - 0.5 / RATE)
    assert moving_rms(found, 0.503)[2] == pytest.approx(0.503, abs=1.5 / RATE)  # a prime number of samples


def test_quiet_after_loud_is_told_to_its_last_digit():
    """Windows are added up each by itself: a running sum would leave 1e-6 of the loud part."""
    v = np.where(T < 10.0, 1e6, 1e-6) * np.sin(2.0 * math.pi * 50.0 * T)
    t, rms, _ = moving_rms(series(run_of(v), "accelerometer"), 0.16)
    assert rms[t > 10.1] == pytest.approx(1e-6 / math.sqrt(2.0), rel=1e-3)


def test_the_window_is_centred():
    """Where the vibration ends in the middle of a window, half of the mean square is left."""
    t, rms, _ = moving_rms(series(run_of((T < 10.0) * np.sin(2.0 * math.pi * 50.0 * T)), "accelerometer"), 0.16)
    assert np.interp(10.0, t, rms**2) == pytest.approx(0.25, rel=0.02)


def test_up_and_down_are_told_apart():
    found = hysteresis(loop(), window=0.16)
    assert (found.name, found.over, found.unit, found.over_unit) == ("accelerometer", "surface_speed", "m/s^2", "m/s")
    full = 3.0 / math.sqrt(2.0)
    near = found.smear + 0.04  # a row is that wide
    for row in found.rows():
        if abs(row.speed - UP) > near:
            assert row.up == pytest.approx(full if row.speed < UP else 0.0, rel=0.02, abs=1e-9)
        if abs(row.speed - DOWN) > near:
            assert row.down == pytest.approx(full if row.speed < DOWN else 0.0, rel=0.02, abs=1e-9)
    assert found.smear == pytest.approx(0.1 * 0.16, rel=0.02)
    assert found.frequency == pytest.approx(50.0, abs=0.5)  # it comes and goes
    assert "centred window of 0.16 s (7.98 periods of 49.85 Hz)" in found.text()


def test_the_usual_window_holds_some_periods_and_little_of_the_ramp():
    found = hysteresis(loop())
    assert found.window * found.frequency == pytest.approx(5.0, rel=0.1)
    slow = hysteresis(run_of(np.sin(2.0 * math.pi * 3.0 * T)))
    assert slow.window == pytest.approx(0.05 * 8.0, rel=0.1)
    slower = hysteresis(run_of(np.sin(2.0 * math.pi * 1.0 * T)))
    assert slower.window * slower.frequency == pytest.approx(1.0, rel=0.02)
    assert "shorter than a period" in hysteresis(run_of(np.sin(2.0 * math.pi * 1.0 * T)), window=0.5).text()
    assert "shorter than a period" not in slow.text()


def test_outputs_of_a_live_run_are_told_to_be_thinned_out():
    """Every fifth step of the plant, not filtered; a speed of the drive and a sensor need no such word."""
    run = loop(time=T[::5], signals={"surface_speed": SPEED[::5], "velocity": np.sin(2.0 * math.pi * 20.0 * T[::5])})
    told = hysteresis(run, "velocity").text()
    assert "velocity is an output of the plant, recorded at 200 Hz and not filtered: vibration above 100 Hz" in told
    assert "not filtered" not in hysteresis(run).text()
    assert "not filtered" in spectrum(run, "velocity").text()
    assert "bridged" not in spectrum(run, "velocity").text()


def test_samples_that_dropped_out_are_told_and_left_out():
    """One in ten, as NaN and as nothing at all, and a hole of 2 s."""
    rng = np.random.default_rng(5)
    v = 3.0 * np.sin(2.0 * math.pi * 50.0 * T)
    v[rng.random(T.size) < 0.1] = np.nan
    kept = (rng.random(T.size) > 0.1) & ~((T > 4.0) & (T < 6.0))
    kept[[0, -1]] = True
    found = hysteresis(run_of(v, kept=kept), window=0.16)
    lost = np.count_nonzero(~(kept & np.isfinite(v)))
    assert f"{lost} of {T.size} samples of accelerometer are missing" in found.text()
    assert "the longest takes 2" in found.text()
    assert found.lost == pytest.approx(2.0 / 0.01, abs=5)
    assert f"{found.lost} windows left out" in found.text()
    rows = [row.up for row in found.rows() if not math.isnan(row.up)]
    assert rows == pytest.approx([3.0 / math.sqrt(2.0)] * len(rows), rel=0.03)  # 1 % of scatter for a fifth lost
    assert len(rows) < len(found.rows())


def test_a_run_of_the_rig_agrees_with_its_events():
    """belt_hysteresis: the last stick of its run-up and the first of its run-down, by the events of the solver."""
    run = lab.simulate("belt_hysteresis")
    found = hysteresis(run)
    begins = np.array([e["t_ns"] * 1e-9 for e in run.events if e["text"] == "contact slip ends"])
    speeds = np.interp(begins, run.time, run.signals["surface_speed"])
    assert found.up == pytest.approx(speeds[begins < 60.0][-1], abs=2e-5)  # its end, a millisecond after its begin
    assert found.down == pytest.approx(speeds[begins > 62.0][0], abs=1e-9)
    assert "may be missed" not in found.text()
    quiet = [row for row in found.rows() if found.down + 0.05 < row.speed < found.up - 0.05]
    assert all(row.up > 10.0 * row.down for row in quiet)


def test_what_cannot_be_is_told_all_at_once():
    with pytest.raises(UsageError) as told:
        hysteresis(loop(), "acelerometer", "speed")
    first, second = str(told.value).splitlines()
    assert first.startswith("signal: no 'acelerometer' in this recording: did you mean accelerometer?")
    assert second.startswith("over: no 'speed' in this recording")
    assert "known: accelerometer [m/s^2], surface_speed [m/s], velocity [m/s]" in second
    with pytest.raises(
        UsageError, match=r"does not rise or fall: it stays at 0.3 to 0.3 m/s.*two ramps of drive.speed"
    ):
        hysteresis(loop(speed=0.0 * T + 0.3))
    with pytest.raises(UsageError, match=r"must be 0.004 s \(4 samples of accelerometer at 1000 Hz\) to 1.96"):
        hysteresis(loop(), window=10.0)


def test_periods_are_those_of_the_slowest_strong_vibration():
    """Not of a faster and stronger one, nor of a drift, nor of what is weak."""
    v = sum(size * np.sin(2.0 * math.pi * hertz * T) for size, hertz in ((1.0, 50.0), (2.0, 300.0), (0.3, 9.0)))
    assert slowest(series(run_of(v + 0.1 * T), "accelerometer")) == pytest.approx(50.0, abs=0.1)
    assert slowest(series(run_of(0.0 * T + 2.0), "accelerometer")) == 0.0


def test_the_command(tmp_path, rig):
    log, png, table = tmp_path / "run.mcap", tmp_path / "loop.png", tmp_path / "loop.csv"
    save(loop(), log)
    code, out, _ = rig("analyse", "hysteresis", log, "--window", "160 ms", "--figure", png, "--csv", table, "--json")
    told = json.loads(out)
    assert (code, told["window"], told["unit"], told["over"]) == (0, 0.16, "m/s^2", "surface_speed")
    assert [branch["rises"] for branch in told["branches"]] == [True, False]
    assert png.read_bytes().startswith(b"\x89PNG")
    lines = table.read_text().splitlines()
    assert lines[0] == "branch,direction,time [s],surface_speed [m/s],rms of accelerometer [m/s^2]"
    assert len(lines) > 1000
    code, out, err = rig("analyse", "hysteresis", log, "--window", "1 kg", "--from", "5", "--to", "2", "--signal", "x")
    assert (code, out, len(err.splitlines())) == (2, "", 3)
