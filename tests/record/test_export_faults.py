"""Exports that fail: what is told, and what is left."""

import dataclasses
import errno
import io
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from exported import written

from rig.errors import OutputError, UsageError
from rig.record.export import FORMATS, export, tables
from rig.record.run import Run


@pytest.mark.parametrize("to", sorted(FORMATS))
def test_nothing_is_left_of_an_export_that_fails(run, tmp_path, monkeypatch, to):
    path = written(run, to, tmp_path)
    before = {one: one.read_bytes() for one in tmp_path.rglob("*") if one.is_file()}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    changed = dataclasses.replace(run, signals={"velocity": run.signals["velocity"] + 1.0})
    with pytest.raises(OutputError, match=r"export\..* cannot be written: No space left on device"):
        export(tables(changed), to, path, {})
    assert {one: one.read_bytes() for one in tmp_path.rglob("*") if one.is_file()} == before
    assert [one.name for one in tmp_path.iterdir()] == [path.name]

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        export(tables(changed), to, path, {})
    assert [one.name for one in tmp_path.iterdir()] == [path.name]
    monkeypatch.undo()
    export(tables(changed), to, path, {})
    assert {one: one.read_bytes() for one in tmp_path.rglob("*") if one.is_file()} != before


@pytest.mark.parametrize(("library", "to"), [("xarray", "netcdf"), ("h5netcdf", "hdf5")])
def test_a_library_that_is_missing_is_named(run, tmp_path, monkeypatch, library, to):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(UsageError, match=rf"{library} cannot be loaded \(.*\); to install it: .*'\.\[data\]'"):
        export(tables(run), to, tmp_path / "export", {})
    assert not [*tmp_path.iterdir()]
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UsageError, match="pandas cannot be loaded"):
        run.to_pandas()


@pytest.mark.parametrize("fault", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_fault_anywhere_in_an_hdf5_file_is_raised_and_leaves_nothing(run, tmp_path, monkeypatch, fault, share):
    left = round(share * written(run, "hdf5", tmp_path / "whole").stat().st_size)
    opens = Path.open

    class Filling(io.FileIO):
        def write(self, content):
            nonlocal left
            left -= len(content)
            if left < 0:
                raise fault
            return super().write(content)

    monkeypatch.setattr(
        Path, "open", lambda path, mode="r", **more: Filling(path, mode) if mode == "w+b" else opens(path, mode, **more)
    )
    path = tmp_path / "part"
    path.mkdir()
    with pytest.raises((OutputError, KeyboardInterrupt)) as found:
        written(run, "hdf5", path)
    assert isinstance(found.value, KeyboardInterrupt) or "No space left on device" in str(found.value)
    assert not [*path.iterdir()]


def test_an_hdf5_file_is_not_kept_in_memory(tmp_path):
    time = np.arange(100_000) * 1e-3
    long = Run(scene="{}", step_ns=1_000_000, frame_ns=1_000_000, time=time, units={},
               signals={f"x{k}": time + k for k in range(20)})  # fmt: skip
    whole = tables(long)
    export(whole, "hdf5", tmp_path / "first.h5", {})  # imports
    tracemalloc.start()
    export(whole, "hdf5", tmp_path / "long.h5", {})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (tmp_path / "long.h5").stat().st_size > 16e6
    assert peak < 5e6


@pytest.mark.parametrize(
    "told",
    [
        b"no JSON",
        b"[]",
        b'{"resources": [{"path": "../kept.csv", "format": "csv"}, {"path": "kept.toml", "format": "csv"}, 1]}',
        b'{"resources": [{"path": "kept.toml", "format": "toml"}]}',
    ],
)
def test_only_tables_of_an_earlier_export_go(run, tmp_path, told):
    folder = tmp_path / "tables"
    folder.mkdir()
    for name in ("../kept.csv", "kept.toml"):
        (folder / name).write_text("kept")
    (folder / "datapackage.json").write_bytes(told)
    export(tables(run, ["displacement"]), "csv", folder, {})
    assert sorted(one.name for one in folder.iterdir()) == ["datapackage.json", "kept.toml", "outputs.csv"]
    assert (tmp_path / "kept.csv").read_text() == "kept"
