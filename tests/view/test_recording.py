"""A recording in rerun by our view and in rerun without our tools."""

import dataclasses
import subprocess
from pathlib import Path

import pytest

import rig
from rig.errors import OutputError
from rig.record import reader
from rig.view import recording
from rig.view.recording import view_run
from rig.view.viewer import binary, start

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden" / "pendulum.mcap"


def run_rerun(*arguments):
    done = subprocess.run([binary(), *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def run():
    return reader.open(GOLDEN)


def test_everything_of_a_recording_is_in_the_rerun_file(run, tmp_path):
    view_run(run, "pendulum", save=tmp_path / "run.rrd")
    printed = run_rerun("rrd", "print", tmp_path / "run.rrd")
    for name in run.signals:
        assert f"/plant/{name} " in printed
    for name in run.measurements:
        assert f"/sensor/{name} " in printed
    for path in ("/command/nf", "/strip/protocol", "/strip/contact", "/event/plant", "/rig/", "/portrait"):
        assert path in printed, path


def test_outputs_of_a_live_run_that_show_no_squeal_are_hidden_points_and_no_portrait(contents, tmp_path):
    whole = rig.simulate("brake_shunt_listener", 0.15)
    rows = slice(None, None, 250)  # as a live run is recorded
    signals = {name: v[rows] for name, v in whole.signals.items()}
    run = dataclasses.replace(whole, time=whole.time[rows], mode=whole.mode[rows], signals=signals)
    view_run(run, "live", save=tmp_path / "run.rrd")
    moving, static = contents(tmp_path / "run.rrd")
    [row] = static["/plant/velocity"]
    assert row["SeriesPoints:names"] == ["velocity (200 samples/s)"]
    assert row["SeriesPoints:visible_series"] == [False]
    assert not [path for path in moving if path.startswith("/portrait")]
    view_run(whole, "simulated", save=tmp_path / "whole.rrd")
    moving, static = contents(tmp_path / "whole.rrd")
    assert static["/plant/velocity"][0]["SeriesLines:names"] == ["velocity"]
    assert "/portrait/curve" in moving


def test_rerun_makes_a_curve_of_each_output_and_sensor_without_our_tools(run, tmp_path):
    run_rerun("mcap", "convert", GOLDEN, "-o", tmp_path / "plain.rrd")
    printed = run_rerun("rrd", "print", tmp_path / "plain.rrd")
    curves = {line.split(" - ")[1] for line in printed.splitlines() if "Scalars:scalars" in line}
    logged = {line.split(" - ")[1] for line in printed.splitlines() if "TextLog:text" in line}
    roots = [curve.removeprefix("/").partition("_in_")[0] for curve in curves]
    assert sorted(roots) == sorted(
        [f"curve/{name}" for name in run.signals] + [f"measured/{n}" for n in run.measurements]
    )
    assert "/log/plant" in logged


def test_a_viewer_that_is_closed_before_the_end_is_reported(run, monkeypatch):
    import rerun

    whole = rerun.RecordingStream.flush
    monkeypatch.setattr(rerun.RecordingStream, "flush", lambda rec, timeout_sec: whole(rec, timeout_sec=0.5))
    started, write = [], recording.write

    def close_first(*given):
        started[0].stop()
        write(*given)

    monkeypatch.setattr("rig.view.viewer.start", lambda web: started.append(start(web)) or started[0])
    monkeypatch.setattr("rig.view.recording.write", close_first)
    with pytest.raises(OutputError, match="the viewer was closed, or hangs"):
        view_run(run, "pendulum", web=True)
