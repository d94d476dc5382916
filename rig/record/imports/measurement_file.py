"""Files of data acquisition systems: their columns with units and time bases, read block by block.

CSV is read in blocks, so a file may be larger than the memory. The other formats are read as a whole.
A unit or a rate is only what the file states: nothing is guessed.
"""

from __future__ import annotations

import io
import json
import logging
import struct
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import UsageError
from rig.extras import needed
from rig.machine import files
from rig.printable import counted, distinct
from rig.record.imports.columns import (
    UNIT_KEYS,
    ArrayColumns,
    Block,
    Column,
    MeasurementFile,
    exact,
    name_and_unit,
    stated_unit,
)
from rig.record.imports.hdf5_file import read_hdf5, read_netcdf
from rig.record.imports.instrument_units import is_time, meaning
from rig.record.imports.text_table import TextTable
from rig.record.run_data import Reals

_LARGEST = 1 << 31  # bytes of a MATLAB file, unpacked

_OF_CODE = (ArithmeticError, AttributeError, LookupError, NameError, TypeError, struct.error)
"""Errors that a library raises where it does not expect what it reads, such as "list index out of range"."""


def opened(path: Path) -> MeasurementFile:
    """The columns of a file. Raises UsageError for one that cannot be read, is damaged or of an unknown format."""
    if path.exists() and not path.is_file():
        raise UsageError(f"{path}: is no file, but a directory, a pipe or a device; copy its contents to a file")
    read = _FORMATS.get(path.suffix.lower())
    if read is None:
        known = " ".join(sorted(_FORMATS))
        raise UsageError(f"{path}: no measurement file has the ending {path.suffix!r}; known: {known}")
    with _refusals(path):
        file = read(path)
    if not file.columns:
        why = "".join(f"\n{path}: column {name} is not read: {reason}" for name, reason in file.left_out.items())
        raise UsageError(f"{path}: it has no column of numbers{why}")
    return replace(file, blocks=partial(_guarded, path, file.blocks))


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """What the libraries raise for a file becomes UsageError with its name."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a file that ends too early is no more than a warning for some libraries
            yield
    except UsageError:
        raise
    except OSError as fault:
        why = fault.strerror or f"is cut off or damaged: {_line(fault)}"
        raise UsageError(f"{path}: {why}") from None
    except MemoryError:
        raise UsageError(f"{path}: is too large for the memory; save parts of it as files of their own") from None
    except _OF_CODE:  # says something about the library and nothing about the file
        ending = path.suffix.lower()
        raise UsageError(f"{path}: is cut off, damaged or of another format; expected a {ending} file") from None
    except Exception as fault:  # of many libraries
        raise UsageError(f"{path}: is cut off, damaged or of another format: {_line(fault)}") from None


def _line(fault: Exception) -> str:
    return str(fault).partition("\n")[0] or type(fault).__name__


def _guarded(
    path: Path, blocks: Callable[[Collection[str]], Iterator[Block]], names: Collection[str]
) -> Iterator[Block]:
    """The blocks of a file, whose damage may lie behind its first ones."""
    source = blocks(names)
    while True:
        with _refusals(path):
            block = next(source, None)
        if block is None:
            return
        yield block


def _text(path: Path) -> MeasurementFile:
    table = TextTable.read(path)
    named = [name_and_unit(label) for label in table.labels]
    names = distinct((name for name, _ in named), "{} ({})")
    rates, starts = (stated or (0.0,) * len(names) for stated in (table.about.rates, table.about.starts))
    units = [unit or stated for (_, unit), stated in zip(named, table.units, strict=True)]
    columns = [Column(*about) for about in zip(names, units, rates, starts, strict=True)]
    left_out = {name: why for name, why in zip(names, table.left_out, strict=True) if why}
    unread = {}
    if table.form.unread:
        unread["above the rows"] = f"{counted(table.form.unread, 'line')} with a number first, but not as many cells"
    if table.form.beside:
        unread["beside the rows"] = f"remarks behind the values of the first {counted(table.form.beside, 'row')}"
    if table.unnamed[0]:
        row, cells = table.unnamed
        unread[f"row {row}"] = f"it has {cells} cells, the rows have {table.form.width}: they get no names from it"
    left_out |= unread
    return MeasurementFile(
        path,
        tuple(column for column in columns if column.name not in left_out),
        partial(table.blocks, names),
        table.began_ns,
        table.skip + 1,
        partial(table.rows, names),
        left_out,
        tuple(f"{place}: {why}" for place, why in unread.items()),
        lambda name: table.midnights.get(names.index(name), 0),
    )


def _parquet(path: Path) -> MeasurementFile:
    from pyarrow import parquet, types

    with parquet.ParquetFile(path) as file:
        fields = list(file.schema_arrow)
        of_table = _units_of_table(file.schema_arrow.metadata or {})
        length = file.metadata.num_rows
    if not length:
        raise UsageError(f"{path}: its table has no rows")
    columns = []
    places: dict[str, int] = {}
    left_out: dict[str, str] = {}
    numbers = (types.is_floating, types.is_integer, types.is_decimal, types.is_boolean, types.is_temporal)
    for place, about in enumerate(fields):
        if not any(fits(about.type) for fits in numbers):
            left_out[about.name] = f"it has the type {about.type}"
            continue
        of_field = {key.decode(): value.decode(errors="replace") for key, value in (about.metadata or {}).items()}
        name, unit = name_and_unit(about.name)
        name = distinct((*places, name), "{} ({})")[-1] if name in places else name
        unit = unit or stated_unit(of_field) or of_table.get(about.name, "")
        unit = "s" if types.is_temporal(about.type) else unit
        columns.append(Column(name, unit, length=length))
        places[name] = place

    def blocks(names: Collection[str]) -> Iterator[Block]:
        begins: dict[str, int] = {}
        read = {name: fields[places[name]].name for name in names}
        before = {name: [about.name for about in fields[: places[name]]].count(read[name]) for name in names}
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            for batch in file.iter_batches(columns=list(dict.fromkeys(read.values()))):
                alike = {name: batch.schema.get_all_field_indices(read[name]) for name in names}
                columns = {name: batch.column(alike[name][before[name]]) for name in names}  # two may have one label
                yield {name: _seconds(column, begins, name) for name, column in columns.items()}

    return MeasurementFile(path, tuple(columns), blocks, left_out=left_out)


def _units_of_table(about: Mapping[bytes, bytes]) -> dict[str, str]:
    """Column -> unit, as the metadata of a whole table have it in JSON: {"units": {"v": "m/s"}}."""
    for key, text in about.items():
        if key.decode(errors="replace").lower() in UNIT_KEYS:
            try:
                stated = json.loads(text)
            except ValueError:
                continue
            if isinstance(stated, dict):
                return {name: unit for name, unit in stated.items() if isinstance(unit, str)}
    return {}


def _seconds(column: Any, begins: dict[str, int], name: str) -> Reals:
    """Numbers; times of day as seconds since the first one. NaN for those that are not there."""
    from pyarrow import compute, duration, int64, time64, timestamp, types

    if not types.is_temporal(column.type):
        return exact(np.asarray(column.to_numpy(zero_copy_only=False)))
    kind = duration("ns") if types.is_duration(column.type) else timestamp("ns")
    kind = time64("ns") if types.is_time(column.type) else kind
    ns = column.cast(kind).cast(int64())
    if len(known := ns.drop_null()):
        begins.setdefault(name, known[0].as_py())
    apart = compute.subtract(ns, begins.get(name, 0)).to_numpy(zero_copy_only=False)  # whole numbers, if all are there
    return np.asarray(apart * 1e-9, np.float64)


def _mat(path: Path) -> MeasurementFile:
    from scipy.io import loadmat

    data = path.read_bytes()
    if b"MATLAB 7.3" in data[:128]:
        return read_hdf5(path)
    files.matlab_checked(data, _LARGEST)
    arrays = ArrayColumns(path)
    for name, value in loadmat(io.BytesIO(data), simplify_cells=True).items():
        if not name.startswith("__"):
            _of_struct(arrays, name, value)
    return arrays.file()


def _of_struct(arrays: ArrayColumns, name: str, value: Any) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            _of_struct(arrays, f"{name}.{key}", inner)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):  # cells, several structs
        for number, inner in enumerate(np.asarray(value, object).flat, 1):
            _of_struct(arrays, f"{name}.{number}", inner)
    else:
        arrays.add(name, value)


def _wav(path: Path) -> MeasurementFile:
    from scipy.io import wavfile

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Chunk .* not understood")  # remarks beside the samples
        rate, samples = wavfile.read(path)
    arrays = ArrayColumns(path)
    if samples.dtype.kind in "iu":  # full scale is 1
        zero = 128 if samples.dtype == np.uint8 else 0
        samples = (samples.astype(np.float64) - zero) / (
            128.0 if zero else float(2 ** (8 * samples.dtype.itemsize - 1))
        )
    for i, channel in enumerate(samples.reshape(len(samples), -1).T):
        arrays.add(f"ch{i + 1}", channel, "1", float(rate))
    return arrays.file()


def _uff(path: Path) -> MeasurementFile:
    pyuff = needed("pyuff", "measurements")
    arrays = ArrayColumns(path)
    if not path.read_bytes().rstrip().endswith(b"    -1"):  # the end of a data set
        raise UsageError(f"{path}: is cut off: its last data set has no end")
    file = pyuff.UFF(str(path))
    for number, kind in enumerate(file.get_set_types()):
        if kind not in (58, 55):
            arrays.leave_out(f"set {number + 1}", f"data set {kind} is no function over time")
            continue
        data = file.read_sets(number)
        label = str(data.get("id1", "")).strip()
        name = label if label not in ("", "NONE") else f"set {number + 1}"
        if kind == 55:
            arrays.leave_out(name, "it is a shape (data set 55), no measurement over time")
            continue
        unit = str(data.get("ordinate_axis_units_lab", "")).strip()
        step = float(data.get("abscissa_inc", 0.0)) if data.get("abscissa_spacing", 1) == 1 else 0.0
        if int(data.get("abscissa_spec_data_type", 17)) not in (0, 17):
            arrays.leave_out(name, "its abscissa is not time")
            continue
        of_time = str(data.get("abscissa_axis_units_lab", "")).strip()
        of_time = "s" if of_time in ("", "NONE") else of_time
        if data["data"].size < int(data.get("num_pts", 0)):
            raise UsageError(f"{path}: is cut off: {name} has {data['data'].size} values of {data['num_pts']}")
        if int(data.get("abscissa_spacing", 1)) == 0:
            arrays.add(f"{name} time", data["x"], of_time)
        arrays.add_sampled(
            name,
            data["data"],
            "" if unit == "NONE" else unit,
            step,
            float(data.get("abscissa_min", 0.0)),
            of_time,
        )
    return arrays.file()


def _tdms(path: Path) -> MeasurementFile:
    nptdms = needed("nptdms", "measurements")
    nptdms.log.log_manager.set_level(logging.CRITICAL)  # its warnings become the fault of the file
    with path.open("rb") as beginning:
        if beginning.read(4) != b"TDSm":
            raise UsageError(f"{path}: is no TDMS file: it does not begin with TDSm")
    arrays = ArrayColumns(path)
    began = None
    with nptdms.TdmsFile.open(path) as file:
        if file.file_status.incomplete_final_segment:
            raise UsageError(f"{path}: is cut off: its last segment is not complete")
        for group in file.groups():
            for channel in group.channels():
                about = channel.properties
                step = float(about.get("wf_increment", 0.0))
                start = float(about.get("wf_start_offset", 0.0))
                of_time = str(about.get("wf_xunit_string", "")).strip() or "s"
                unit = stated_unit(about)
                stamp = about.get("wf_start_time")
                if step and stamp is not None:
                    stamp_ns = int(np.datetime64(stamp, "ns").astype(np.int64))
                    began = stamp_ns if began is None else began
                    if is_time(of_time):  # channels may start one after the other
                        start += (stamp_ns - began) * 1e-9 / meaning(of_time, "s").factor
                arrays.add_sampled(f"{group.name}.{channel.name}", channel[:], unit, step, start, of_time)
    return arrays.file(began)


_FORMATS: dict[str, Callable[[Path], MeasurementFile]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm"), _text),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), read_hdf5),
    **dict.fromkeys((".uff", ".unv", ".58"), _uff),
    ".parquet": _parquet,
    ".mat": _mat,
    ".nc": read_netcdf,
    ".wav": _wav,
    ".tdms": _tdms,
}
