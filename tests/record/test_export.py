"""Exported recordings: each format, read back by an independent reader, has the numbers, units and facts of the run."""

import csv
import dataclasses
import json
import sys
import wave
from fractions import Fraction

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from exported import written
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet
from scipy.io import loadmat

from rig.errors import UsageError
from rig.record.export import export, tables
from rig.record.export.files import description, files
from rig.record.run import Run, Samples

TABLES = {
    "outputs": (7001, ["displacement", "velocity", "mode"]),
    "sensors_10000_Hz": (7001, ["laser"]),
    "sensors_1000_Hz": (701, ["gauge"]),
    "sensors_25_Hz": (18, ["slow"]),
    "commands_feedback": (700, ["tick", "answered", "status", "command_1", "command_2"]),
    "events": (2, ["tick", "source", "kind", "text", "data"]),
}


def expected(run):
    """Table -> column -> values, taken from the run by hand."""
    found = {
        "outputs": run.signals | {"mode": run.mode},
        "sensors_10000_Hz": {"laser": run.measurements["laser"].v},
        "sensors_1000_Hz": {"gauge": run.measurements["gauge"].v},
        "sensors_25_Hz": {"slow": run.measurements["slow"].v},
    }
    sent = run.commands["feedback"]
    found["commands_feedback"] = {
        "tick": sent.tick,
        "answered": sent.answered,
        "status": sent.status,
        "command_1": sent.values[:, 0],
        "command_2": sent.values[:, 1],
    }
    found["events"] = {key: [event[key] for event in run.events] for key in ("tick", "source", "kind", "text")}
    found["events"]["data"] = [json.dumps(event["data"]) if event["data"] else "" for event in run.events]
    return found


TIMES = {
    "outputs": np.arange(7001) / 10_000,
    "sensors_10000_Hz": np.arange(7001) / 10_000,
    "sensors_1000_Hz": np.arange(701) / 1000,
    "sensors_25_Hz": np.arange(18) / 25,
    "commands_feedback": np.arange(1, 701) / 1000,
    "events": np.array([0.005, 0.7]),
}
"""Decimal fractions, correctly rounded."""


def same(read, run):
    """Compare tables [name -> column -> values, with "time"] with the run, number by number."""
    wanted = expected(run)
    assert [*read] == [*wanted]
    for name, columns in wanted.items():
        assert np.array_equal(read[name].pop("time"), TIMES[name]), name
        assert [*read[name]] == [*columns]
        for column, values in columns.items():
            found = list(read[name][column])
            if isinstance(values[0], str):
                assert found == list(values)
            else:
                assert np.array_equal(np.array(found, float), np.array(values, float), equal_nan=True), (name, column)


def test_csv(run, tmp_path):
    folder = written(run, "csv", tmp_path)
    read = {}
    for name in TABLES:
        frame = pd.read_csv(folder / f"{name}.csv", keep_default_na=name != "events")
        assert frame.columns[0] == "time [s]"
        read[name] = {column.partition(" [")[0]: frame[column].to_numpy() for column in frame}
    same(read, run)
    head = '"time [s]","displacement [m]","velocity [m/s]","mode"\n'
    assert (folder / "outputs.csv").read_text().startswith(head)
    assert (folder / "sensors_1000_Hz.csv").read_bytes().splitlines()[2] == b"0.001,"  # a drop-out is an empty cell
    package = json.loads((folder / "datapackage.json").read_text())
    assert [one["path"] for one in package["resources"]] == [f"{name}.csv" for name in TABLES]
    assert package["resources"][2]["schema"]["fields"] == [
        {"name": "time [s]", "type": "number", "unit": "s"},
        {"name": "gauge [N]", "type": "number", "unit": "N"},
    ]
    assert {one.name for one in folder.iterdir()} == set(files(tables(run), "csv"))
    assert package["run"]["scene"] == run.scene
    assert json.loads(package["run"]["provenance"]) == run.provenance
    assert "damage" not in package["run"]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, 10**15), st.floats()), min_size=1, max_size=30, unique_by=lambda row: row[0]))
def test_csv_keeps_any_number(tmp_path, rows):
    t_ns, v = np.array([t for t, _ in sorted(rows)]), np.array([v for _, v in sorted(rows)])
    run = Run(
        scene="", step_ns=1, frame_ns=1, time=np.empty(0), signals={}, units={}, measurements={"s": Samples(t_ns, v)}
    )
    export(tables(run, ["s"]), "csv", tmp_path / "any", {})
    (file,) = (tmp_path / "any").glob("sensors*.csv")
    read = [*csv.reader(file.read_text().splitlines())][1:]
    file.unlink()
    assert [float(time) for time, _ in read] == [float(Fraction(int(t), 10**9)) for t in t_ns]  # correctly rounded
    assert np.array([float(cell or "nan") for _, cell in read]).tobytes() == np.where(np.isnan(v), np.nan, v).tobytes()


def test_parquet(run, tmp_path):
    folder = written(run, "parquet", tmp_path)
    read = {}
    for name in TABLES:
        table = parquet.read_table(folder / f"{name}.parquet")
        read[name] = {column: table[column].to_numpy() for column in table.column_names}
        facts = {key.decode(): text.decode() for key, text in table.schema.metadata.items()}
        assert facts == description(run)
    same(read, run)
    schema = parquet.read_schema(folder / "outputs.parquet")
    assert schema.field("velocity").metadata == {b"unit": b"m/s"}
    assert b"mode set" in schema.field("mode").metadata[b"description"]
    assert np.array_equal(pd.read_parquet(folder / "outputs.parquet")["velocity"], run.signals["velocity"])


def test_matlab(run, tmp_path):
    data = loadmat(written(run, "mat", tmp_path), simplify_cells=True)
    read = {name: dict(data[name]) for name in TABLES}
    read["events"]["data"] = [str(one) if len(one) else "" for one in read["events"]["data"]]  # '' is an empty array
    same(read, run)
    units = {name: unit if len(unit) else "" for name, unit in data["units"]["outputs"].items()}
    assert units == {"time": "s", "displacement": "m", "velocity": "m/s", "mode": ""}
    assert data["names"]["outputs"]["velocity"] == "velocity"
    assert data["run"] == description(run)
    assert loadmat(tmp_path / "export.mat")["outputs"]["velocity"][0, 0].shape == (7001, 1)


def test_hdf5_and_netcdf(run, tmp_path):
    path = written(run, "hdf5", tmp_path)
    with h5py.File(path) as file:
        read = {}
        for name in TABLES:
            group = file[name]
            columns = ["time", *(column for column in TABLES[name][1])]
            assert sorted(group) == sorted(columns)
            read[name] = {
                one: group[one].asstr()[:] if group[one].dtype == object else group[one][:] for one in columns
            }
        assert file["outputs/velocity"].attrs["units"] == "m/s"
        assert file["outputs/time"].attrs["units"] == "s"
        assert not [name for name in TABLES if "_FillValue" in file[name]["time"].attrs]
        assert {name: file[name].asstr()[()] for name in description(run)} == description(run)
    same(read, run)
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        assert tree["sensors_25_Hz/slow"].attrs["units"] == "m"
        assert tree["outputs"].sizes == {"time": 7001}


def test_wav(run, tmp_path):
    path = tmp_path / "export.wav"
    found = export(tables(run, ["velocity", "gauge"]), "wav", path, description(run))
    assert [one.file for one in found] == ["outputs_velocity.wav", "sensors_1000_Hz_gauge.wav"]
    wanted = {
        "outputs_velocity": (10_000, run.signals["velocity"]),
        "sensors_1000_Hz_gauge": (1000, np.nan_to_num(run.measurements["gauge"].v)),
    }
    package = {one["path"]: one for one in json.loads((path / "datapackage.json").read_text())["resources"]}
    for one, (name, (rate, v)) in zip(found, wanted.items()):
        with wave.open(str(path / f"{name}.wav")) as file:
            assert (file.getnchannels(), file.getsampwidth(), file.getframerate()) == (1, 3, rate)
            raw = np.frombuffer(file.readframes(file.getnframes()), np.uint8).reshape(-1, 3)
        whole = np.zeros((len(raw), 4), np.uint8)
        whole[:, 1:] = raw
        assert whole.view("<i4")[:, 0] / 2**31 * one.full_scale == pytest.approx(v, abs=one.full_scale * 2.0**-22)
        assert package[f"{name}.wav"]["full_scale"] == one.full_scale
        assert package[f"{name}.wav"]["unit"] == one.unit == ("m/s" if "velocity" in name else "N")


def test_frames_and_tree(run, tmp_path):
    frames = run.to_pandas()
    same({name: {"time": frame.index, **{c: frame[c] for c in frame}} for name, frame in frames.items()}, run)
    assert frames["outputs"].attrs["units"] == {"displacement": "m", "velocity": "m/s", "mode": ""}
    found = run.to_xarray()
    same(
        {
            name: {"time": part["time"].values, **{c: part[c].values for c in part.data_vars}}
            for name, part in found.children.items()
        },
        run,
    )
    assert found["outputs/velocity"].attrs == {"units": "m/s"}
    assert found["outputs/velocity"].sel(time=0.0003).item() == run.signals["velocity"][3]
    assert found["scene"].item() == run.scene
    with xr.open_datatree(written(run, "netcdf", tmp_path), engine="h5netcdf") as read:
        assert read.identical(found)


def test_frames_have_the_names_that_the_run_prints(run):
    """Exported files have plain ones: a slash is none of NetCDF, and `time` is the name of their first column."""
    named = dataclasses.replace(
        run,
        signals={"pad/force": run.signals["velocity"], "mode": run.signals["displacement"]},
        measurements={"time": run.measurements["slow"], "laser/2": run.measurements["slow"]},
        commands={"my loop": run.commands["feedback"]},
    )
    frames = named.to_pandas()
    printed = [row[0] for part in named.shown() if not isinstance(part, str) for row in part.rows]
    assert [*frames["outputs"], *frames["sensors_25_Hz"]] == ["pad/force", "mode", "mode_2", "time", "laser/2"]
    assert printed == ["pad/force", "mode", "time", "laser/2"]
    assert [*frames] == ["outputs", "sensors_25_Hz", "commands_my loop", "events"]
    assert frames["outputs"]["pad/force"].to_numpy() == pytest.approx(run.signals["velocity"], nan_ok=True)
    plain = {table.name: [column.name for column in table.columns] for table in tables(named)}
    assert plain["sensors_25_Hz"] == ["time_2", "laser_2"]
    assert "commands_my_loop" in plain


def test_chosen_names(run):
    both = dataclasses.replace(
        run,
        signals={"laser": run.signals["velocity"], "p_0_0": run.signals["velocity"], "p_0_1": run.signals["velocity"]},
    )

    def chosen(*names):
        return {table.name: [one.name for one in table.columns] for table in tables(both, names)}

    assert chosen("laser") == chosen("meas/laser") == {"sensors_10000_Hz": ["laser"]}
    assert chosen("truth/laser") == {"outputs": ["laser"]}
    assert chosen("p", "slow") == {"outputs": ["p_0_0", "p_0_1"], "sensors_25_Hz": ["slow"]}
    assert [*chosen("feedback", "events")] == ["commands_feedback", "events"]
    assert chosen("mode") == {"outputs": ["mode"]}
    with pytest.raises(UsageError) as fault:
        tables(both, ["lasr", "slow", "nothing"])
    first, second = str(fault.value).splitlines()
    assert first.startswith(
        "no 'lasr' in this recording: did you mean laser, truth/laser? known: laser [m/s], gauge [N], slow [m], "
    )
    assert first.endswith("feedback, mode, events")
    assert second.startswith("no 'nothing' in this recording: known: laser")


def test_sensors_of_one_rate_share_a_table_where_they_share_their_instants():
    t_ns = np.arange(100, dtype=np.int64) * 1_000_000
    v = np.arange(100.0)
    sensors = {
        "whole": Samples(t_ns, v),
        "lossy": Samples(np.delete(t_ns, [3, 50]), np.delete(v, [3, 50])),
        "beside": Samples(t_ns + 500_000, v),
        "once": Samples(t_ns[:1], v[:1]),
    }
    run = Run(scene="{}", step_ns=1, frame_ns=1, time=np.empty(0), signals={}, units={}, measurements=sensors)
    found = {table.name: table for table in tables(run)}
    assert [*found] == ["sensors_1000_Hz", "sensors_1000_Hz_2", "sensors_unknown_rate", "events"]
    whole, lossy = found["sensors_1000_Hz"].columns
    assert np.array_equal(whole.values, v)
    assert np.flatnonzero(np.isnan(lossy.values)).tolist() == [3, 50]
    assert np.array_equal(np.delete(lossy.values, [3, 50]), np.delete(v, [3, 50]))
    assert [one.name for one in found["sensors_1000_Hz_2"].columns] == ["beside"]


def test_a_library_that_is_missing_is_named(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(UsageError, match=r"xarray cannot be loaded \(.*\); to install it: .*'\.\[data\]'"):
        export(tables(run), "netcdf", tmp_path / "export", {})
    assert not [*tmp_path.iterdir()]
