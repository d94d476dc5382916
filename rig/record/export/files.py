"""The formats of an export, and its files, which are written beside their place and moved there when complete.

A folder of exported files has a description, `datapackage.json`: its files, their columns and units, the run. It
follows the Frictionless Data Package (https://specs.frictionlessdata.io/data-package), with the unit of a column as
`unit`, and `run` for the facts about the run: scene, provenance, timing verdict, damage.

CSV and Parquet have one file for each table, written by Apache Arrow. CSV (RFC 4180, UTF-8): the first line has the
names with their units, `"time [s]","velocity [m/s]"`. Numbers have a decimal point and the fewest digits from which the
same floating-point number is read again. A missing number is an empty cell.

Parquet: the metadata of a column's field have its unit, and a description where it needs one. The metadata of the file
describe the run. A missing number is null.

MATLAB (MAT-file, version 5): one file with a struct of column vectors for each table. MATLAB's names are letters,
digits and underscores, at most 63. A name that is not valid is changed: `load.force` becomes `load_force`. The struct
`names` has the original name of each field, `units` its unit, `run` the facts about the run.

    load run.mat
    plot(outputs.time, outputs.velocity); ylabel(units.outputs.velocity)
"""

from __future__ import annotations

import errno
import io
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.errors import OutputError, UsageError
from rig.extras import needed
from rig.machine.files import DATA, contents, regular
from rig.printable import counted
from rig.record import wav
from rig.record.export.tables import MODE, Column, Table, Tables, tree
from rig.record.run_data import RunData, Samples, grid, stretches

if TYPE_CHECKING:
    import pyarrow as pa


FILE = "datapackage.json"
_FORMATS = {"csv": ".csv", "parquet": ".parquet", "wav": ".wav"}

_ROWS = 1 << 16  # that are written at a time, so that text takes little memory. chosen

LONGEST = 63  # characters of a name
_LARGEST = 1 << 31  # bytes of a variable
_WORDS = frozenset(
    "break case catch classdef continue else elseif end for function global if otherwise parfor persistent return spmd "
    "switch try while".split()
)

Report = Callable[[str], object]
Facts = Mapping[str, str]


def write_package(folder: Path, name: str, resources: Iterable[Mapping[str, Any]], facts: Mapping[str, str]) -> None:
    """Write the description of the files in `folder`. Raises OSError."""
    description = {"name": name, "resources": [*resources], "run": dict(facts)}
    (folder / FILE).write_text(json.dumps(description, indent=1), "utf-8")


def package_files(folder: Path) -> set[str]:
    """Return the names of the files that an earlier export to `folder` describes; none without such a description."""
    try:
        resources = json.loads(contents(folder / FILE, DATA))["resources"]
        return {
            resource["path"]
            for resource in resources
            if Path(resource["path"]).name == resource["path"]
            and resource["path"].endswith(_FORMATS[resource["format"]])
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return set()


def description(run: RunData) -> dict[str, str]:
    """Return facts about a run by name, as text; those with structure are JSON. Empty ones are left out.

    `scene` is the resolved scene, `provenance` has versions, machine, seed and command. `damage` and `recovered` say
    what a damaged recording has lost, `restarted` which processes restarted so that losses are unknown, `fault` why a
    run is not complete.
    """
    facts: dict[str, Any] = {
        "scene": run.scene,
        "provenance": run.provenance,
        "verdict": run.summary.get("verdict", ""),
        "damage": run.damage,
        "recovered": run.recovered,
        "restarted": run.untold,
        "fault": run.fault,
        "energy": run.energy,
        "summary": run.summary,
        "step_ns": run.step_ns,
        "frame_ns": run.frame_ns,
    }
    return {name: value if isinstance(value, str) else json.dumps(value) for name, value in facts.items() if value}


def write_csv(table: Table, path: Path) -> None:
    """Write `table` to `path`. Raises OSError."""
    from pyarrow import csv

    schema = _schema(table, {}, [head(column) for column in table.with_time])
    with path.open("wb") as file, csv.CSVWriter(file, schema) as writer:
        for batch in _batches(table, schema):
            writer.write_batch(batch)


def write_parquet(table: Table, path: Path, facts: Mapping[str, str]) -> None:
    """Write `table` to `path`, with `facts` about the run. Raises OSError."""
    from pyarrow import parquet

    schema = _schema(table, facts, [column.name for column in table.with_time])
    with path.open("wb") as file, parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        for batch in _batches(table, schema):
            writer.write_batch(batch)


def head(column: Column) -> str:
    """Return the name of a column with its unit."""
    return f"{column.name} [{column.unit}]" if column.unit else column.name


def _schema(table: Table, facts: Mapping[str, str], names: list[str]) -> pa.Schema:
    import pyarrow as pa

    fields = []
    for column, name in zip(table.with_time, names):
        kind = pa.string() if column.values.dtype == object else pa.from_numpy_dtype(column.values.dtype)
        metadata = {"unit": column.unit, "description": column.about}
        fields.append(pa.field(name, kind, metadata={key: text for key, text in metadata.items() if text}))
    return pa.schema(fields, metadata=dict(facts))


def _batches(table: Table, schema: pa.Schema) -> Iterator[Any]:
    import pyarrow as pa

    columns = table.with_time
    for begin in range(0, table.t_ns.size, _ROWS):
        rows = [column.values[begin : begin + _ROWS] for column in columns]
        arrays = [pa.array(v, kind, from_pandas=True) for v, kind in zip(rows, schema.types)]  # NaN becomes null
        yield pa.record_batch(arrays, schema=schema)


def write_mat(tables: Iterable[Table], path: Path, facts: Mapping[str, str]) -> None:
    """Write `tables` to `path`, with `facts` about the run.

    Raises OSError, and UsageError for a table that is larger than a variable of the format can be (2 GiB).
    """
    from scipy.io import savemat

    data: dict[str, Any] = {}
    names: dict[str, Any] = {}
    units: dict[str, Any] = {}
    taken = {"names", "units", "run"}
    for table in tables:
        columns = table.with_time
        if (size := sum(column.values.nbytes for column in columns)) >= _LARGEST:
            raise UsageError(
                f"{table.name}: {size / 2**30:.1f} GiB; a variable of a MAT-file of version 5 has less than 2 GiB. "
                "Choose outputs and sensors with --only, a lower --rate, or --to hdf5, which MATLAB reads too"
            )
        variable = valid(table.name, taken)
        taken.add(variable)
        fields: dict[str, Column] = {}
        for column in columns:
            fields[valid(column.name, fields)] = column
        data[variable] = {name: column.values[:, None] for name, column in fields.items()}
        names[variable] = {name: column.name for name, column in fields.items()}
        units[variable] = {name: column.unit for name, column in fields.items()}
    with path.open("wb") as file:
        savemat(file, {**data, "names": names, "units": units, "run": dict(facts)}, long_field_names=True)


def valid(name: str, taken: Iterable[str]) -> str:
    """Return `name` as MATLAB takes it: other characters become "_", "x" is put in front where needed.

    A name among `taken` gets a number.
    """
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not re.match(r"[A-Za-z]", plain) or plain in _WORDS:
        plain = f"x{plain}"
    plain = plain[:LONGEST]
    others = set(taken)
    candidate = plain
    number = 1
    while candidate in others:
        number += 1
        ending = f"_{number}"
        candidate = plain[: LONGEST - len(ending)] + ending
    return candidate


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
            return f"{self.file}: {counted(self.rows, 'sample')}{rate}, full scale {self.full_scale:.4g} {self.unit}"
        return f"{self.table}: {counted(self.rows, 'row')}{rate}, {counted(self.columns, 'column')} and the time"


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
    return [*(f"{name}{suffix}" for name in names), FILE]


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
    for complete in drafts:
        with complete.open("rb") as file:
            os.fsync(file.fileno())  # some systems report a full disk only then
    if folder and not target.exists():
        draft.rename(target)
        return
    former = package_files(target) - {complete.name for complete in drafts} if folder else set()
    for complete in drafts:
        place = target / complete.name if folder else target
        if place.exists():
            complete.chmod(place.stat().st_mode)
        complete.replace(place)
    for name in former:  # a table of another recording beside these would be taken for one of them
        (target / name).unlink(missing_ok=True)


def _file_per_table(to: str, tables: Tables, folder: Path, facts: Facts, report: Report) -> list[Written]:
    """One file for each table."""
    folder.mkdir()
    written = []
    resources = []
    for number, table in enumerate(tables, 1):
        file = f"{table.name}{FORMATS[to].suffix}"
        report(f"writing {file}, {number} of {len(tables.tables)}")
        if to == "csv":
            write_csv(table, folder / file)
        else:
            write_parquet(table, folder / file, facts)
        written.append(_written(table, file))
        fields = [_field(column, head(column) if to == "csv" else column.name) for column in table.with_time]
        resources.append({"name": table.name.lower(), "path": file, "format": to, "schema": {"fields": fields}})
    write_package(folder, folder.name, resources, facts)
    return written


def _written(table: Table, file: str) -> Written:
    return Written(file, table.name, table.t_ns.size, len(table.columns), table.rate)


def _field(column: Column, name: str) -> dict[str, str]:
    kind = {"f": "number", "i": "integer"}.get(column.values.dtype.kind, "string")
    attributes = {"name": name, "type": kind, "unit": column.unit, "description": column.about}
    return {key: text for key, text in attributes.items() if text}


def _mat(tables: Tables, path: Path, facts: Facts, report: Report) -> list[Written]:
    report(f"writing {path.name}")
    write_mat(tables, path, facts)
    return [_written(table, path.name) for table in tables]


def _netcdf(tables: Tables, path: Path, facts: Facts, report: Report) -> list[Written]:
    """A netCDF-4 file is an HDF5 file: a group for each table, an attribute `units` for each variable.

    It is made in memory: the HDF5 library ends the process if a file cannot be written or closed.
    """
    report(f"writing {path.name}")
    content = io.BytesIO()
    tree(tables, facts).to_netcdf(content, engine="h5netcdf")
    path.write_bytes(content.getbuffer())
    return [_written(table, path.name) for table in tables]


def _wav(tables: Tables, folder: Path, facts: Facts, report: Report) -> list[Written]:
    """One file for each output and sensor."""
    signals = [*_signals(tables)]
    if not signals:
        raise UsageError(
            "--to wav: only outputs and sensors can be written; choose another format for commands and events"
        )
    folder.mkdir()
    written = []
    resources = []
    for number, (name, table, column, part) in enumerate(signals, 1):
        file = f"{name}.wav"
        report(f"writing {file}, {number} of {len(signals)}")
        even = grid(column.name, Samples(table.t_ns[part], column.values[part]))
        full = wav.write(even.v, even.rate, folder / file)
        written.append(Written(file, table.name, even.v.size, 1, even.rate, full, column.unit))
        resources.append(
            {
                "name": name.lower(),
                "path": file,
                "format": "wav",
                "unit": column.unit,
                "full_scale": full,
                "rate": even.rate,
                "start": float(table.time[part][0]),
            }
        )
    write_package(folder, folder.name, resources, facts)
    return written


def _signals(tables: Tables) -> Iterator[tuple[str, Table, Column, slice]]:
    """Name of its file, table, column and rows of each signal of an output or a sensor.

    Stretches that lie far apart are signals of their own.
    """
    for table in tables:
        parts = stretches(table.t_ns) if table.channels else []
        for column in table.columns:
            name = re.sub(r"\W", "_", f"{table.name}_{column.name}")
            if table.channels and column.name != MODE:
                numbered = [name] if len(parts) == 1 else [f"{name}_{i}" for i in range(1, len(parts) + 1)]
                yield from ((file, table, column, part) for file, part in zip(numbered, parts, strict=True))


FORMATS: dict[str, Format] = {
    "csv": Format(".csv", True, partial(_file_per_table, "csv")),
    "hdf5": Format(".h5", False, _netcdf, ("xarray", "h5netcdf")),
    "mat": Format(".mat", False, _mat),
    "netcdf": Format(".nc", False, _netcdf, ("xarray", "h5netcdf")),
    "parquet": Format(".parquet", True, partial(_file_per_table, "parquet")),
    "wav": Format(".wav", True, _wav),
}
"""Formats by name."""
