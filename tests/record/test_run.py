"""A run as an object: its text, its figure, its recording."""

import dataclasses

import numpy as np
import pytest

import rig
from rig.record import reader
from rig.record.run import Run
from rig.record.save_run import save


def test_a_run_prints_as_one_screen(run):
    many = {f"p_{i}": np.zeros(7001) for i in range(100)}
    text = str(dataclasses.replace(run, signals=run.signals | many, damage="it breaks off", fault="it breaks off"))
    assert repr(run) == str(run)
    assert len(text.splitlines()) < 40
    assert max(map(len, text.splitlines())) <= 120
    v = run.signals["velocity"]
    lines = text.splitlines()
    assert lines[0] == "run         scene belt, 0.7 s, step 0.1 ms"
    assert lines[1] == "timing      VALID"
    assert f"  velocity                 {v.min():.6g} .. {v.max():.6g} m/s" in lines
    assert "  and 90 more" in lines
    gauge = run.measurements["gauge"].v
    low, high = np.nanmin(gauge), np.nanmax(gauge)
    assert f"  gauge                    {low:.6g} .. {high:.6g} N, 701 rows at 1000 Hz" in lines
    assert "controllers feedback: 700 commands" in lines
    assert "events      mark 2" in lines
    assert lines[-1] == "damage      it breaks off"
    assert "array" not in text


def test_a_run_without_anything_prints_too():
    run = Run(scene="", step_ns=1, frame_ns=1, time=np.empty(0), signals={"x": np.full(0, np.nan)}, units={})
    assert "unknown scene" in str(run)
    assert "  x                        no value" in str(run)


def test_an_unknown_channel_names_those_that_are_like_it(run):
    name = next(iter(run.signals))
    for channels, asked in ((run.signals, name[:-2]), (run.units, name[:-2])):
        with pytest.raises(KeyError, match=f"is not in this run; did you mean {name}"):
            channels[asked]


def test_save_writes_the_recording(run, tmp_path):
    run.save(str(tmp_path / "a.mcap"))
    save(run, tmp_path / "b.mcap")
    assert list(reader.Scan(tmp_path / "a.mcap")) == list(reader.Scan(tmp_path / "b.mcap"))


def test_a_run_saved_from_python_has_its_provenance(tmp_path):
    made = rig.simulate(rig.load("belt", {"seed": "7"}), 0.05)
    made.save(tmp_path / "run.mcap")
    read = reader.open(tmp_path / "run.mcap").provenance
    assert read == made.provenance
    assert read["seed"] == "7"
    assert read["numpy"] == np.__version__
    assert read["kernel"]
    assert read["date"]
