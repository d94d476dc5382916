"""Files of HDF5 and netCDF, which nest groups, tables and references, and pack values; MATLAB 7.3 is HDF5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rig.extras import needed
from rig.record.imports.columns import WORDS, ArrayColumns, MeasurementFile, no_shape, stated_unit, word

_LARGEST = 1 << 31  # bytes of a data set that are read. chosen
_NO_FACTOR = "its scale_factor is 0, which leaves nothing of it"
_FACTORS = "it has several factors or offsets; save its values with one of them, or without"
_PACKED = ("_FillValue", "missing_value", "scale_factor", "add_offset", "_Unsigned")


def read_hdf5(path: Path) -> MeasurementFile:
    """The columns of a file of HDF5: data sets, fields of tables, and what references of MATLAB lead to."""
    h5py = needed("h5py", "data")
    arrays = ArrayColumns(path)
    with h5py.File(path, "r") as file:
        _of_group(arrays, file, "")
    return arrays.file()


def _of_group(arrays: ArrayColumns, group: Any, label: str, within: tuple[Any, ...] = ()) -> None:
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


def _of_item(arrays: ArrayColumns, item: Any, label: str, within: tuple[Any, ...] = ()) -> None:
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
    unit = _without_epoch(stated_unit(item.attrs))
    if "MATLAB_empty" in item.attrs or item.shape is None:
        arrays.leave_out(label, "it is empty")
    elif "MATLAB_object_decode" in item.attrs:
        kind = word(item.attrs.get("MATLAB_class", ""))
        arrays.leave_out(label, f"it is an object of MATLAB ({kind}); save its columns as vectors")
    elif word(item.attrs.get("MATLAB_class", "")) == "char":
        arrays.leave_out(label, WORDS)
    elif item.dtype.names == ("real", "imag"):  # of MATLAB
        arrays.add(label, np.empty(1, complex))
    elif h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        _of_references(arrays, item, label)
    elif why := no_shape(item.shape) or _too_large(item):
        arrays.leave_out(label, WORDS if item.dtype.kind in "SO" and not item.shape else why)
    elif item.dtype.names:
        for number, name in enumerate(item.dtype.names):
            of_field = word(item.attrs.get(f"FIELD_{number}_UNITS")) or unit
            arrays.add(f"{label}.{name}", item.fields(name)[()], of_field)
    elif why := _no_packing(item.attrs):
        arrays.leave_out(label, why)
    else:
        arrays.add(label, _unpacked(item[()], item.attrs), unit)


def _too_large(item: Any) -> str:
    """Why a data set of HDF5 is not read into the memory; "" if it is."""
    size = max(item.dtype.itemsize, 8) * item.size
    if size <= _LARGEST:
        return ""
    return f"its {item.size} values take {size / 2**30:.3g} GiB, more than {_LARGEST >> 30}; save a part of it"


def _of_references(arrays: ArrayColumns, item: Any, label: str) -> None:
    """Add what references of MATLAB lead to: cells, CELL.NUMBER, or fields of many structs, STRUCT.NUMBER.FIELD."""
    whole, _, key = label.rpartition(".")
    for number, reference in enumerate(item[()].ravel("F"), 1):
        of_struct = bool(whole) and word(item.attrs.get("MATLAB_class", "")) != "cell"
        inner = f"{whole}.{number}.{key}" if of_struct else f"{label}.{number}"
        if reference:
            _of_item(arrays, item.file[reference], inner)
        else:
            arrays.leave_out(inner, "it is empty")


def _without_epoch(unit: str) -> str:
    """The unit of a time as netCDF states it: "seconds since 1970-01-01" is in seconds."""
    return unit.partition(" since ")[0]


def _unpacked(values: Any, about: Mapping[str, Any]) -> Any:
    """Values that are packed as the conventions of netCDF say: fill value, scale factor and offset."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        return values
    if array.dtype.kind == "i" and word(about.get("_Unsigned")).lower() == "true":
        array = array.view(array.dtype.str.replace("i", "u"))
    fills = [np.ravel(about[key])[0] for key in ("_FillValue", "missing_value") if key in about]
    factor = _factor(about)
    offset = float(np.ravel(about.get("add_offset", 0.0))[0])
    missing = np.isin(array, fills)
    if (factor, offset) != (1.0, 0.0) or missing.any():
        array = np.where(missing, np.nan, array * factor + offset)
    return array


def _no_packing(about: Mapping[str, Any]) -> str:
    """Why values cannot be unpacked; "" if they can."""
    if any(np.size(about.get(key, 1.0)) != 1 for key in ("scale_factor", "add_offset")):
        return _FACTORS
    return "" if _factor(about) else _NO_FACTOR


def _factor(about: Mapping[str, Any]) -> float:
    return float(np.ravel(about.get("scale_factor", 1.0))[0])


def read_netcdf(path: Path) -> MeasurementFile:
    """The columns of a file of netCDF, of which the newer ones are HDF5."""
    with path.open("rb") as file:
        if file.read(3) != b"CDF":
            return read_hdf5(path)
    from scipy.io import netcdf_file

    arrays = ArrayColumns(path)
    with netcdf_file(path, "r", mmap=False) as file:
        for name, variable in file.variables.items():
            about = {key: getattr(variable, key) for key in ("units", *_PACKED) if hasattr(variable, key)}
            if why := _no_packing(about):
                arrays.leave_out(name, why)
                continue
            arrays.add(name, _unpacked(variable[:].copy(), about), _without_epoch(word(about.get("units"))))
    return arrays.file()
