"""Files of data acquisition systems: their columns with units and time bases, read block by block.

CSV is read in blocks, so a file may be larger than the memory. The other formats are read as a whole.
A unit or a rate is only what the file states: nothing is guessed.
"""

from __future__ import annotations

import io
import json
import logging
import math
import re
import struct
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.extras import needed
from rig.machine import files
from rig.printable import counted, distinct
from rig.record.imports.instrument_units import is_time, meaning
from rig.record.imports.text_table import TextTable
from rig.record.run_data import Reals

_WHOLE = 2.0**53  # below, a double holds each whole number
_LARGEST = 1 << 31  # bytes of a MATLAB file, unpacked, and of a data set of HDF5. chosen
Block = Mapping[str, Reals]
"""Column -> its next values; columns of one length have equally many. Large whole numbers are integers."""

_OF_CODE = (ArithmeticError, AttributeError, LookupError, NameError, TypeError, struct.error)
"""Errors that a library raises where it does not expect what it reads, such as "list index out of range"."""

_BRACKETS = re.compile(r"(?P<name>.*?)(?:\s*/)?\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))\s*")

_WORDS = "it has words, no numbers"
_NO_FACTOR = "its scale_factor is 0, which leaves nothing of it"
_UNIT_KEYS = ("units", "unit", "unit_string", "unit_label", "ni_unitdescription", "einheit")
"""Attributes that state a unit, in small letters."""
_PACKED = ("_FillValue", "missing_value", "scale_factor", "add_offset", "_Unsigned")


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
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Columns that are not read -> why."""
    unread: tuple[str, ...] = ()
    """Lines of a text that are not read, with the reason."""
    midnights: Callable[[str], int] = lambda _: 0
    """How often the times of day of a column without dates passed midnight in what was read last."""

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
    if path.exists() and not path.is_file():
        raise UsageError(f"{path}: is no file, but a directory, a pipe or a device; copy its contents to a file")
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


def name_and_unit(label: str) -> tuple[str, str]:
    """Name and unit of a label, "velocity [mm/s]" or "velocity / (mm/s)"; the unit is "" without brackets."""
    match = _BRACKETS.fullmatch(label.strip())
    if match is None or not match["name"]:
        return label.strip(), ""
    return match["name"], (match["square"] if match["square"] is not None else match["round"]).strip()


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


class _Arrays:
    """Collects the arrays of a file that is read as a whole."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.columns: list[Column] = []
        self.values: dict[str, Reals] = {}
        self.left_out: dict[str, str] = {}

    def add(self, label: str, values: Any, unit: str = "", rate: float = 0.0, start: float = 0.0) -> None:
        """Add an array: a vector is a column, of a matrix each column, of a table each field.

        What has no numbers is left out.
        """
        array = np.asarray(values)
        if array.dtype.names:
            for name in array.dtype.names:
                self.add(f"{label}.{name}", array[name], unit, rate, start)
            return
        if array.dtype.kind == "M":
            ns = array.astype("datetime64[ns]").astype(np.int64)
            array = (ns - ns.flat[0]) * 1e-9 if ns.size else array
            unit = "s"
        if why := _no_column(array):
            self.leave_out(label, why)
            return
        array = np.squeeze(array)
        if array.ndim == 2:
            array = array if array.shape[0] >= array.shape[1] else array.T
            for i in range(array.shape[1]):
                self.add(f"{label}.{i + 1}", array[:, i], unit, rate, start)
            return
        name, own = name_and_unit(label)
        if name in self.values:
            name = distinct((*self.values, name), "{} ({})")[-1]
        self.columns.append(Column(name, own or unit, rate, start, array.size))
        self.values[name] = _exact(array)

    def add_sampled(self, label: str, values: Any, unit: str, step: float, begin: float, of_time: str) -> None:
        """Add an array of samples every `step`, from `begin` on, both in the unit `of_time`.

        A step that is not above 0 states no rate.
        """
        if not 0.0 < step < math.inf:
            self.add(label, values, unit)
        elif not is_time(of_time):
            self.leave_out(label, f"its abscissa is in {of_time!r:.20}, which is no unit of time")
        else:
            second = meaning(of_time, "s").factor
            self.add(label, values, unit, 1.0 / (step * second), begin * second)

    def leave_out(self, label: str, why: str) -> None:
        """Note a column that is not read."""
        self.left_out[distinct((*self.left_out, label), "{} ({})")[-1] if label in self.left_out else label] = why

    def file(self, began_ns: int | None = None) -> MeasurementFile:
        """The file."""

        def blocks(names: Collection[str]) -> Iterator[Block]:
            yield {name: self.values[name] for name in names}

        return MeasurementFile(self.path, tuple(self.columns), blocks, began_ns, left_out=self.left_out)


def _exact(array: NDArray[Any]) -> Reals:
    """Doubles; whole numbers that a double does not hold, such as ns since 1970, stay as they are."""
    if array.dtype.kind in "iu" and array.size and _WHOLE <= float(array.max()) < 2.0**63:
        return np.asarray(array, np.int64)
    return np.asarray(array, np.float64)


def _no_column(array: NDArray[Any]) -> str:
    """Why an array is no column of numbers over time; "" if it is one."""
    if array.dtype.kind == "c":
        return "it is complex: a spectrum or a transfer function, no measurement over time"
    if array.dtype.kind in "SU" or (array.dtype.kind == "O" and array.size and isinstance(array.flat[0], str | bytes)):
        return _WORDS
    if array.dtype.kind not in "fiub":
        return "it is no array of numbers" if array.dtype.kind == "O" else f"it has the type {array.dtype}"
    return _no_shape(array.shape)


def _no_shape(shape: tuple[int, ...]) -> str:
    """Why an array of this shape is no column over time; "" if it is one."""
    if math.prod(shape) < 2:
        return "it is a single value" if math.prod(shape) else "it is empty"
    dimensions = sum(size > 1 for size in shape)
    return f"it has {dimensions} dimensions; expected a vector or a matrix" if dimensions > 2 else ""


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
        unit = unit or _stated_unit(of_field) or of_table.get(about.name, "")
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
        if key.decode(errors="replace").lower() in _UNIT_KEYS:
            try:
                stated = json.loads(text)
            except ValueError:
                continue
            if isinstance(stated, dict):
                return {name: unit for name, unit in stated.items() if isinstance(unit, str)}
    return {}


def _stated_unit(about: Mapping[str, Any]) -> str:
    """The unit that attributes state, however their name is written; "" if none does."""
    by_key = {key.lower(): _word(value) for key, value in about.items() if key.lower() in _UNIT_KEYS}
    return next(filter(None, (by_key.get(key, "") for key in _UNIT_KEYS)), "")


def _seconds(column: Any, begins: dict[str, int], name: str) -> Reals:
    """Numbers; times of day as seconds since the first one. NaN for those that are not there."""
    from pyarrow import compute, duration, int64, time64, timestamp, types

    if not types.is_temporal(column.type):
        return _exact(np.asarray(column.to_numpy(zero_copy_only=False)))
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
    with h5py.File(path, "r") as file:
        _of_group(arrays, file, "")
    return arrays.file()


def _of_group(arrays: _Arrays, group: Any, label: str, within: tuple[Any, ...] = ()) -> None:
    """Add what a group of HDF5 contains; `within`: the groups that it lies in, and itself."""
    import h5py

    for name in group:
        inner = f"{label}.{name}" if label else str(name)
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            arrays.leave_out(inner, f"it lies in another file, {link.filename}; import that one")
        elif isinstance(link, h5py.SoftLink):
            arrays.leave_out(inner, f"it is a link to {link.path}")
        elif not inner.startswith("#"):  # of MATLAB: what references lead to
            _of_item(arrays, group[name], inner, within)


def _of_item(arrays: _Arrays, item: Any, label: str, within: tuple[Any, ...] = ()) -> None:
    """Add a group or a data set of HDF5: a table, an array, or references to others."""
    import h5py

    if isinstance(item, h5py.Group):
        if any(item == above for above in within):
            arrays.leave_out(label, f"it contains itself ({item.name})")
        else:
            _of_group(arrays, item, label, (*within, item))
        return
    if not isinstance(item, h5py.Dataset):
        return
    if item.external or item.is_virtual:
        arrays.leave_out(label, "its values lie in another file (external storage); import that one")
        return
    unit = _without_epoch(_stated_unit(item.attrs))
    if "MATLAB_empty" in item.attrs or item.shape is None:
        arrays.leave_out(label, "it is empty")
    elif "MATLAB_object_decode" in item.attrs:
        kind = _word(item.attrs.get("MATLAB_class", ""))
        arrays.leave_out(label, f"it is an object of MATLAB ({kind}); save its columns as vectors")
    elif _word(item.attrs.get("MATLAB_class", "")) == "char":
        arrays.leave_out(label, _WORDS)
    elif item.dtype.names == ("real", "imag"):  # of MATLAB
        arrays.add(label, np.empty(1, complex))
    elif h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        _of_references(arrays, item, label)
    elif why := _no_shape(item.shape) or _too_large(item):
        arrays.leave_out(label, _WORDS if item.dtype.kind in "SO" and not item.shape else why)
    elif item.dtype.names:
        for number, name in enumerate(item.dtype.names):
            of_field = _word(item.attrs.get(f"FIELD_{number}_UNITS")) or unit
            arrays.add(f"{label}.{name}", item.fields(name)[()], of_field)
    elif _factor(item.attrs) == 0.0:
        arrays.leave_out(label, _NO_FACTOR)
    else:
        arrays.add(label, _unpacked(item[()], item.attrs), unit)


def _too_large(item: Any) -> str:
    """Why a data set of HDF5 is not read into the memory; "" if it is."""
    size = max(item.dtype.itemsize, 8) * item.size
    if size <= _LARGEST:
        return ""
    return f"its {item.size} values take {size / 2**30:.3g} GiB, more than {_LARGEST >> 30}; save a part of it"


def _of_references(arrays: _Arrays, item: Any, label: str) -> None:
    """Add what references of MATLAB lead to: cells, CELL.NUMBER, or fields of many structs, STRUCT.NUMBER.FIELD."""
    whole, _, key = label.rpartition(".")
    for number, reference in enumerate(item[()].ravel("F"), 1):
        of_struct = bool(whole) and _word(item.attrs.get("MATLAB_class", "")) != "cell"
        inner = f"{whole}.{number}.{key}" if of_struct else f"{label}.{number}"
        if reference:
            _of_item(arrays, item.file[reference], inner)
        else:
            arrays.leave_out(inner, "it is empty")


def _word(given: Any) -> str:
    """A text attribute, which some programs store as an array of one text."""
    values = np.asarray("" if given is None else given).ravel()
    value = values[0] if values.size == 1 else ""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return str(value) if isinstance(value, str) else ""


def _without_epoch(unit: str) -> str:
    """The unit of a time as netCDF states it: "seconds since 1970-01-01" is in seconds."""
    return unit.partition(" since ")[0]


def _unpacked(values: Any, about: Mapping[str, Any]) -> Any:
    """Values that are packed as the conventions of netCDF say: fill value, scale factor and offset."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        return values
    if array.dtype.kind == "i" and _word(about.get("_Unsigned")).lower() == "true":
        array = array.view(array.dtype.str.replace("i", "u"))
    fills = [np.ravel(about[key])[0] for key in ("_FillValue", "missing_value") if key in about]
    factor = _factor(about)
    offset = float(np.ravel(about.get("add_offset", 0.0))[0])
    missing = np.isin(array, fills)
    if (factor, offset) != (1.0, 0.0) or missing.any():
        array = np.where(missing, np.nan, array * factor + offset)
    return array


def _factor(about: Mapping[str, Any]) -> float:
    return float(np.ravel(about.get("scale_factor", 1.0))[0])


def _netcdf(path: Path) -> MeasurementFile:
    with path.open("rb") as file:
        if file.read(3) != b"CDF":
            return _hdf5(path)
    from scipy.io import netcdf_file

    arrays = _Arrays(path)
    with netcdf_file(path, "r", mmap=False) as file:
        for name, variable in file.variables.items():
            about = {key: getattr(variable, key) for key in ("units", *_PACKED) if hasattr(variable, key)}
            if _factor(about) == 0.0:
                arrays.leave_out(name, _NO_FACTOR)
                continue
            arrays.add(name, _unpacked(variable[:].copy(), about), _without_epoch(_word(about.get("units"))))
    return arrays.file()


def _wav(path: Path) -> MeasurementFile:
    from scipy.io import wavfile

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Chunk .* not understood")  # remarks beside the samples
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
    logging.getLogger("nptdms").setLevel(logging.CRITICAL)  # its warnings become the fault of the file
    with path.open("rb") as beginning:
        if beginning.read(4) != b"TDSm":
            raise UsageError(f"{path}: is no TDMS file: it does not begin with TDSm")
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
                of_time = str(about.get("wf_xunit_string", "")).strip() or "s"
                unit = _stated_unit(about)
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
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), _hdf5),
    **dict.fromkeys((".uff", ".unv", ".58"), _uff),
    ".parquet": _parquet,
    ".mat": _mat,
    ".nc": _netcdf,
    ".wav": _wav,
    ".tdms": _tdms,
}
