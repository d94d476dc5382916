"""Files of data acquisition systems: their columns with units and time bases, read block by block.

CSV is read in blocks, so a file may be larger than the memory. The other formats are read as a whole.
A unit or a rate is only what the file states: nothing is guessed.
"""

from __future__ import annotations

import io
import re
import struct
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import compress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rig.errors import UsageError
from rig.extras import needed
from rig.machine import files
from rig.printable import distinct
from rig.record.imports.text_table import TextTable
from rig.record.run_data import Reals

_LARGEST = 1 << 31  # bytes of a MATLAB file, unpacked
Block = Mapping[str, Reals]
"""Column -> its next values; columns of one length have equally many."""

_OF_CODE = (ArithmeticError, AttributeError, LookupError, NameError, TypeError, struct.error)
"""Errors that a library raises where it does not expect what it reads, such as "list index out of range"."""

_BRACKETS = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))\s*")

_PACKED = ("_FillValue", "missing_value", "scale_factor", "add_offset")


class Column(NamedTuple):
    """One column of a file."""

    name: str
    unit: str = ""
    """As the file states it; "" if it states none."""
    rate: float = 0.0
    """Samples per second, if the file states it [Hz]."""
    start: float = 0.0
    """Time of the first sample [s]."""
    length: int | None = None
    """Number of values; None if the file has to be read for it."""


@dataclass(frozen=True)
class MeasurementFile:
    """A file with its columns. `blocks(names)` yields their values; it raises UsageError, which lists all faults.

    `began_ns`: the wall clock at time 0, in ns since 1970 (UTC), if the file states it.
    """

    path: Path
    columns: tuple[Column, ...]
    blocks: Callable[[Collection[str]], Iterator[Block]]
    began_ns: int | None = None
    first_row: int = 1
    """Number of the row with the first values, as a user counts it."""
    rows: Callable[[Collection[str]], Iterator[tuple[int, dict[str, float]]]] | None = None
    """Row by row what can be read of a text whose `blocks` raise."""

    @cached_property
    def _by_name(self) -> dict[str, Column]:
        return {column.name: column for column in self.columns}

    def column(self, name: str) -> Column:
        """The column `name`. Raises KeyError."""
        return self._by_name[name]


def opened(path: Path) -> MeasurementFile:
    """The columns of a file. Raises UsageError for one that cannot be read, is damaged or of an unknown format."""
    read = _FORMATS.get(path.suffix.lower())
    if read is None:
        known = " ".join(sorted(_FORMATS))
        raise UsageError(f"{path}: no measurement file has the ending {path.suffix!r}; known: {known}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a file that ends too early is no more than a warning for some libraries
            file = read(path)
    except UsageError:
        raise
    except OSError as fault:
        why = fault.strerror or f"is cut off or damaged: {fault}"
        raise UsageError(f"{path}: {why}") from None
    except _OF_CODE:  # says something about the library and nothing about the file
        ending = path.suffix.lower()
        raise UsageError(f"{path}: is cut off, damaged or of another format; expected a {ending} file") from None
    except Exception as fault:  # of many libraries
        what = str(fault).partition("\n")[0] or type(fault).__name__
        raise UsageError(f"{path}: is cut off, damaged or of another format: {what}") from None
    if not file.columns:
        raise UsageError(f"{path}: it has no column of numbers")
    return file


def name_and_unit(label: str) -> tuple[str, str]:
    """Name and unit of a label, "velocity [mm/s]" or "velocity (mm/s)"; the unit is "" without brackets."""
    match = _BRACKETS.fullmatch(label.strip())
    if match is None or not match["name"]:
        return label.strip(), ""
    return match["name"], (match["square"] if match["square"] is not None else match["round"]).strip()


def _text(path: Path) -> MeasurementFile:
    table = TextTable.read(path)
    named = [name_and_unit(label) for label in table.labels]
    names = distinct((name for name, _ in named), "{} ({})")
    columns = [Column(name, unit or stated) for name, (_, unit), stated in zip(names, named, table.units, strict=True)]
    return MeasurementFile(
        path,
        tuple(compress(columns, table.used)),
        partial(table.blocks, names),
        table.began_ns,
        table.skip + 1,
        partial(table.rows, names),
    )


class _Arrays:
    """Collects the arrays of a file that is read as a whole."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.columns: list[Column] = []
        self.values: dict[str, Reals] = {}
        self.refused: list[str] = []

    def add(self, label: str, values: Any, unit: str = "", rate: float = 0.0, start: float = 0.0) -> None:
        """Add an array: a vector is a column, of a matrix each column; what has no numbers is left out."""
        array = np.asarray(values)
        if array.dtype.kind == "c":
            self.refused.append(
                f"{label} is complex: it is a spectrum or a transfer function, no measurement over time"
            )
            return
        if array.dtype.kind == "M":
            ns = array.astype("datetime64[ns]").astype(np.int64)
            array = (ns - ns.flat[0]) * 1e-9 if ns.size else array
            unit = "s"
        if array.dtype.kind not in "fiub" or array.size < 2 or np.squeeze(array).ndim > 2:
            return
        array = np.squeeze(array)
        if array.ndim == 2:
            array = array if array.shape[0] >= array.shape[1] else array.T
            for i in range(array.shape[1]):
                self.add(f"{label}.{i + 1}", array[:, i], unit, rate, start)
            return
        name, own = name_and_unit(label)
        name = distinct((*self.values, name), "{} ({})")[-1]
        self.columns.append(Column(name, own or unit, rate, start, array.size))
        self.values[name] = np.asarray(array, np.float64)

    def file(self, began_ns: int | None = None) -> MeasurementFile:
        """The file; raises UsageError if nothing can be read in it, and for what is complex."""
        if self.refused or not self.columns:
            faults = self.refused or ["it has no column of numbers"]
            raise UsageError("\n".join(f"{self.path}: {fault}" for fault in faults))

        def blocks(names: Collection[str]) -> Iterator[Block]:
            yield {name: self.values[name] for name in names}

        return MeasurementFile(self.path, tuple(self.columns), blocks, began_ns)


def _parquet(path: Path) -> MeasurementFile:
    from pyarrow import parquet, types

    with parquet.ParquetFile(path) as file:
        fields = [field for field in file.schema_arrow if not types.is_nested(field.type)]
        length = file.metadata.num_rows
    if not length:
        raise UsageError(f"{path}: its table has no rows")
    columns = []
    labels = {}
    for field in fields:
        if not (types.is_floating(field.type) or types.is_integer(field.type) or types.is_temporal(field.type)):
            continue
        stated = {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
        name, unit = name_and_unit(field.name)
        unit = unit or stated.get("unit", stated.get("units", "")) or ("s" if types.is_temporal(field.type) else "")
        columns.append(Column(name, unit, length=length))
        labels[name] = field.name

    def blocks(names: Collection[str]) -> Iterator[Block]:
        begins: dict[str, int] = {}
        with parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(columns=[labels[name] for name in names]):
                yield {name: _seconds(batch[labels[name]], begins, name) for name in names}

    return MeasurementFile(path, tuple(columns), blocks)


def _seconds(column: Any, begins: dict[str, int], name: str) -> Reals:
    """Numbers; times of day as seconds since the first one. NaN for those that are not there."""
    from pyarrow import compute, duration, int64, timestamp, types

    if not types.is_temporal(column.type):
        return np.asarray(column.to_numpy(zero_copy_only=False), np.float64)
    kind = duration("ns") if types.is_duration(column.type) else timestamp("ns")
    ns = column.cast(kind).cast(int64())
    if len(known := ns.drop_null()):
        begins.setdefault(name, known[0].as_py())
    apart = compute.subtract(ns, begins.get(name, 0)).to_numpy(zero_copy_only=False)  # whole numbers, if all are there
    return np.asarray(apart * 1e-9, np.float64)


def _mat(path: Path) -> MeasurementFile:
    from scipy.io import loadmat

    data = path.read_bytes()
    if b"MATLAB 7.3" in data[:128]:
        return _hdf5(path)
    files.matlab_checked(data, _LARGEST)
    arrays = _Arrays(path)
    for name, value in loadmat(io.BytesIO(data), simplify_cells=True).items():
        if not name.startswith("__"):
            _of_struct(arrays, name, value)
    return arrays.file()


def _of_struct(arrays: _Arrays, name: str, value: Any) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            _of_struct(arrays, f"{name}.{key}", inner)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):  # cells, several structs
        for number, inner in enumerate(np.asarray(value, object).flat, 1):
            _of_struct(arrays, f"{name}.{number}", inner)
    else:
        arrays.add(name, value)


def _hdf5(path: Path) -> MeasurementFile:
    h5py = needed("h5py", "data")
    arrays = _Arrays(path)

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#") or "MATLAB_empty" in item.attrs:
            return
        label = name.replace("/", ".")
        if item.dtype.names == ("real", "imag"):  # of MATLAB
            arrays.add(label, np.empty(1, complex))
        elif item.dtype.kind in "fiubc" and _word(item.attrs.get("MATLAB_class", "")) != "char":
            unit = next(
                (word for key in ("units", "unit", "Units", "Unit") if (word := _word(item.attrs.get(key)))), ""
            )
            arrays.add(label, _unpacked(item[()], item.attrs), unit)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return arrays.file()


def _word(given: Any) -> str:
    """A text attribute, which some programs store as an array of one text."""
    values = np.asarray("" if given is None else given).ravel()
    value = values[0] if values.size == 1 else ""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return str(value) if isinstance(value, str) else ""


def _unpacked(values: Any, about: Mapping[str, Any]) -> Any:
    """Values that are packed as the conventions of netCDF say: fill value, scale factor and offset."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        return values
    fills = [np.ravel(about[key])[0] for key in ("_FillValue", "missing_value") if key in about]
    factor = float(np.ravel(about.get("scale_factor", 1.0))[0])
    offset = float(np.ravel(about.get("add_offset", 0.0))[0])
    missing = np.isin(array, fills)
    if (factor, offset) != (1.0, 0.0) or missing.any():
        array = np.where(missing, np.nan, array * factor + offset)
    return array


def _netcdf(path: Path) -> MeasurementFile:
    with path.open("rb") as file:
        if file.read(3) != b"CDF":
            return _hdf5(path)
    from scipy.io import netcdf_file

    arrays = _Arrays(path)
    with netcdf_file(path, "r", mmap=False) as file:
        for name, variable in file.variables.items():
            about = {key: getattr(variable, key) for key in ("units", *_PACKED) if hasattr(variable, key)}
            arrays.add(name, _unpacked(variable[:].copy(), about), _word(about.get("units")))
    return arrays.file()


def _wav(path: Path) -> MeasurementFile:
    from scipy.io import wavfile

    rate, samples = wavfile.read(path)
    arrays = _Arrays(path)
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
    arrays = _Arrays(path)
    if not path.read_bytes().rstrip().endswith(b"    -1"):  # the end of a data set
        raise UsageError(f"{path}: is cut off: its last data set has no end")
    file = pyuff.UFF(str(path))
    for number, kind in enumerate(file.get_set_types()):
        if kind not in (58, 55):
            continue
        data = file.read_sets(number)
        label = str(data.get("id1", "")).strip()
        name = label if label not in ("", "NONE") else f"set {number + 1}"
        if kind == 55:
            if np.iscomplexobj(data.get("r1", 0.0)):
                arrays.refused.append(f"{name}: data set 55 with complex values is a shape, no measurement over time")
            continue
        unit = str(data.get("ordinate_axis_units_lab", "")).strip()
        step = float(data.get("abscissa_inc", 0.0)) if data.get("abscissa_spacing", 1) == 1 else 0.0
        if int(data.get("abscissa_spec_data_type", 17)) not in (0, 17):
            arrays.refused.append(f"{name}: its abscissa is not time")
            continue
        start = float(data.get("abscissa_min", 0.0))
        if not step:
            arrays.add(f"{name} time", data["x"], "s")
        arrays.add(name, data["data"], "" if unit == "NONE" else unit, 1.0 / step if step else 0.0, start)
    return arrays.file()


def _tdms(path: Path) -> MeasurementFile:
    nptdms = needed("nptdms", "measurements")
    arrays = _Arrays(path)
    began = None
    with nptdms.TdmsFile.open(path) as file:
        if file.file_status.incomplete_final_segment:
            raise UsageError(f"{path}: is cut off: its last segment is not complete")
        for group in file.groups():
            for channel in group.channels():
                about = channel.properties
                step = float(about.get("wf_increment", 0.0))
                start = float(about.get("wf_start_offset", 0.0))
                unit = str(about.get("unit_string", about.get("NI_UnitDescription", "")))
                stamp = about.get("wf_start_time")
                if step and stamp is not None:
                    stamp_ns = int(np.datetime64(stamp, "ns").astype(np.int64))
                    began = stamp_ns if began is None else began
                    start += (stamp_ns - began) * 1e-9  # channels may start one after the other
                arrays.add(f"{group.name}.{channel.name}", channel[:], unit, 1.0 / step if step else 0.0, start)
    return arrays.file(began)


_FORMATS: dict[str, Callable[[Path], MeasurementFile]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc"), _text),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), _hdf5),
    **dict.fromkeys((".uff", ".unv", ".58"), _uff),
    ".parquet": _parquet,
    ".mat": _mat,
    ".nc": _netcdf,
    ".wav": _wav,
    ".tdms": _tdms,
}
