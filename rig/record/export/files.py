"""The formats of an export, and its files, which are written beside their place and moved there when complete."""

from __future__ import annotations

import errno
import math
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rig.errors import OutputError, UsageError
from rig.extras import needed
from rig.record import wav
from rig.record.even_times import grid
from rig.record.export import arrow_files, mat_file, package
from rig.record.export.frames import tree
from rig.record.export.hdf5_disk import hdf5_disk
from rig.record.export.tables import MODE, Column, Table, Tables
from rig.record.run_data import Samples
from rig.user_files import regular

Report = Callable[[str], object]
Facts = Mapping[str, str]


@dataclass(frozen=True)
class Written:
    """One table, or for wav one signal, in a file: rows, columns beside the time, rate [Hz] (0: not even).

    `full_scale`: the value of the largest number of a WAV file in `unit`; NaN for other formats.
    """

    file: str
    table: str
    rows: int
    columns: int
    rate: float
    full_scale: float = float("nan")
    unit: str = ""

    def __str__(self) -> str:
        rate = f" at {self.rate:.6g} Hz" if self.rate else ""
        if not math.isnan(self.full_scale):
            return f"{self.file}: {_count(self.rows, 'sample')}{rate}, full scale {self.full_scale:.4g} {self.unit}"
        return f"{self.table}: {_count(self.rows, 'row')}{rate}, {_count(self.columns, 'column')} and the time"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


@dataclass(frozen=True)
class Format:
    """A format: the suffix of a file, whether it needs a folder of several files, and the function that writes."""

    suffix: str
    folder: bool
    write: Callable[[Tables, Path, Facts, Report], list[Written]]
    needs: tuple[str, ...] = ()
    """Optional libraries."""


def export(tables: Tables, to: str, path: Path, facts: Facts, report: Report = lambda _: None) -> list[Written]:
    """Write `tables` in format `to` to the file or folder `path`, with `facts` about the run; `report` takes progress.

    Files that exist are replaced. Files of an earlier export to the same folder go, all others in it stay. If writing
    fails, what existed stays. Raises rig.errors.OutputError if the files cannot be written, UsageError if the format
    cannot hold the tables.
    """
    chosen = FORMATS[to]
    if not tables.tables:
        raise UsageError("the recording has nothing to export")
    facts = {**facts, "signals": "; ".join(tables.notes)} if tables.notes else facts
    for library in chosen.needs:
        needed(library, "data")
    try:
        with _draft(path) as draft:
            written = chosen.write(tables, draft, facts, report)
            _place(draft, path, chosen.folder)
    except OSError as fault:
        raise OutputError(f"{path} cannot be written: {fault.strerror or fault}") from None
    return written


def files(tables: Tables, to: str) -> list[str]:
    """Return the names of the files that `export` writes into a folder."""
    suffix = FORMATS[to].suffix
    names = [name for name, *_ in _signals(tables)] if to == "wav" else [table.name for table in tables]
    return [*(f"{name}{suffix}" for name in names), package.FILE]


@contextmanager
def _draft(path: Path) -> Iterator[Path]:
    """A path of the same name in a new folder beside `path`; the folder is removed in the end."""
    target = Path(os.path.realpath(path))  # a link stays a link; its destination is written
    if target.exists() and not target.is_dir():
        regular(target)  # otherwise the file would replace a device or a pipe
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR)) from None
    folder = Path(tempfile.mkdtemp(prefix=".export-", dir=target.parent))
    try:
        yield folder / target.name
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _place(draft: Path, path: Path, folder: bool) -> None:
    """Move what is complete to its place: a new folder at once, files one by one."""
    target = Path(os.path.realpath(path))
    drafts = sorted(draft.iterdir()) if folder else [draft]
    for one in drafts:
        _sync(one)
    if folder and not target.exists():
        draft.rename(target)
        return
    former = package.files(target) - {one.name for one in drafts} if folder else set()
    for one in drafts:
        there = target / one.name if folder else target
        if there.exists():
            one.chmod(there.stat().st_mode)
        one.replace(there)
    for name in former:  # a table of another recording beside these would be taken for one of them
        (target / name).unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Make the system write a file to the disk: some systems report a full disk only then."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def _each(to: str, tables: Tables, folder: Path, facts: Facts, report: Report) -> list[Written]:
    """One file for each table."""
    folder.mkdir()
    written, resources = [], []
    for number, table in enumerate(tables, 1):
        file = f"{table.name}{FORMATS[to].suffix}"
        report(f"writing {file}, {number} of {len(tables.tables)}")
        if to == "csv":
            arrow_files.write_csv(table, folder / file)
        else:
            arrow_files.write_parquet(table, folder / file, facts)
        written.append(_written(table, file))
        fields = [_field(one, arrow_files.head(one) if to == "csv" else one.name) for one in table.with_time]
        resources.append({"name": table.name.lower(), "path": file, "format": to, "schema": {"fields": fields}})
    package.write(folder, folder.name, resources, facts)
    return written


def _written(table: Table, file: str) -> Written:
    return Written(file, table.name, table.t_ns.size, len(table.columns), table.rate)


def _field(one: Column, name: str) -> dict[str, str]:
    kind = {"f": "number", "i": "integer"}.get(one.values.dtype.kind, "string")
    attributes = {"name": name, "type": kind, "unit": one.unit, "description": one.about}
    return {key: text for key, text in attributes.items() if text}


def _mat(tables: Tables, path: Path, facts: Facts, report: Report) -> list[Written]:
    report(f"writing {path.name}")
    mat_file.write(tables, path, facts)
    return [_written(table, path.name) for table in tables]


def _netcdf(tables: Tables, path: Path, facts: Facts, report: Report) -> list[Written]:
    """A netCDF-4 file is an HDF5 file: a group for each table, an attribute `units` for each variable."""
    report(f"writing {path.name}")
    with hdf5_disk(path) as disk:
        tree(tables, facts).to_netcdf(disk, engine="h5netcdf")
    return [_written(table, path.name) for table in tables]


def _wav(tables: Tables, folder: Path, facts: Facts, report: Report) -> list[Written]:
    """One file for each output and sensor."""
    signals = [*_signals(tables)]
    if not signals:
        raise UsageError(
            "--to wav: only outputs and sensors can be written; choose another format for commands and events"
        )
    folder.mkdir()
    written, resources = [], []
    for number, (name, table, one) in enumerate(signals, 1):
        file = f"{name}.wav"
        report(f"writing {file}, {number} of {len(signals)}")
        even = grid(one.name, Samples(table.t_ns, one.values))
        full = wav.write(even.v, even.rate, folder / file)
        written.append(Written(file, table.name, even.v.size, 1, even.rate, full, one.unit))
        resources.append({"name": name.lower(), "path": file, "format": "wav", "unit": one.unit,
                          "full_scale": full, "rate": even.rate, "start": float(table.time[0])})  # fmt: skip
    package.write(folder, folder.name, resources, facts)
    return written


def _signals(tables: Tables) -> Iterator[tuple[str, Table, Column]]:
    """Name of its file, table and column of each signal of an output or a sensor."""
    for table in tables:
        for one in table.columns:
            if table.channels and one.name != MODE:
                yield re.sub(r"\W", "_", f"{table.name}_{one.name}"), table, one


FORMATS: dict[str, Format] = {
    "csv": Format(".csv", True, partial(_each, "csv")),
    "hdf5": Format(".h5", False, _netcdf, ("xarray", "h5netcdf")),
    "mat": Format(".mat", False, _mat),
    "netcdf": Format(".nc", False, _netcdf, ("xarray", "h5netcdf")),
    "parquet": Format(".parquet", True, partial(_each, "parquet")),
    "wav": Format(".wav", True, _wav),
}
"""Formats by name."""
