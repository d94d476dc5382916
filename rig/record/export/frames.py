"""Tables as frames of pandas and as a tree of xarray's datasets; both libraries are optional."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from rig.extras import needed
from rig.record.export.tables import TIME, Column, Table

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import DataTree


def frames(tables: Iterable[Table]) -> dict[str, DataFrame]:
    """Return each table by name as a frame over the time [s], with the units in `attrs["units"]`.

    Raises rig.errors.UsageError if pandas is not installed.
    """
    pandas = needed("pandas", "data")
    found: dict[str, DataFrame] = {}
    for table in tables:
        columns = {column.name: column.values for column in table.columns}
        frame = pandas.DataFrame(columns, index=pandas.Index(table.time, name=TIME))
        frame.attrs["units"] = {column.name: column.unit for column in table.columns}
        found[table.name] = frame
    return found


def tree(tables: Iterable[Table], facts: Mapping[str, str]) -> DataTree:
    """Return a tree with one dataset for each table over `time` [s].

    `facts` are scalar variables of its root, not attributes: HDF5 limits those to 64 KiB, and a scene may be longer.
    Raises rig.errors.UsageError if xarray is not installed.
    """
    xarray = needed("xarray", "data")
    parts = {"/": xarray.Dataset({name: ((), text) for name, text in facts.items()})}
    for table in tables:
        variables = {one.name: ((TIME,), one.values, _attributes(one)) for one in table.columns}
        whole = {"_FillValue": None}  # CF allows no missing values in a coordinate
        parts[table.name] = xarray.Dataset(variables, {TIME: ((TIME,), table.time, {"units": "s"}, whole)})
    found: DataTree = xarray.DataTree.from_dict(parts)
    return found


def _attributes(column: Column) -> dict[str, str]:
    attributes = {"units": column.unit, "description": column.about}
    return {name: text for name, text in attributes.items() if text}
