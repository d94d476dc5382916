"""Exports that fail: what is told, and what is left."""

import dataclasses
import sys

import pytest
from exported import written

from rig.errors import OutputError, UsageError
from rig.record.export import export, tables


@pytest.mark.parametrize("to", ["csv", "hdf5", "wav"])
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


@pytest.mark.parametrize(
    "told",
    [
        b"no JSON",
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
