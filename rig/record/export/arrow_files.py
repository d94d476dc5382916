"""Tables as files of Apache Arrow's formats, one for each table: CSV and Parquet.

CSV (RFC 4180, UTF-8): the first line has the names with their units, `"time [s]","velocity [m/s]"`. Numbers have a
decimal point and the fewest digits from which the same floating-point number is read again. A missing number is an
empty cell.

Parquet: the metadata of a column's field have its unit, and a description where it needs one. The metadata of the file
describe the run. A missing number is null.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.record.export.tables import Column, Table

if TYPE_CHECKING:
    import pyarrow as pa

_ROWS = 1 << 16


def write_csv(table: Table, path: Path) -> None:
    """Write `table` to `path`. Raises OSError."""
    from pyarrow import csv

    schema = _schema(table, {}, [head(one) for one in table.with_time])
    with path.open("wb") as file, csv.CSVWriter(file, schema) as writer:
        for batch in _batches(table, schema):
            writer.write_batch(batch)


def write_parquet(table: Table, path: Path, facts: Mapping[str, str]) -> None:
    """Write `table` to `path`, with `facts` about the run. Raises OSError."""
    from pyarrow import parquet

    schema = _schema(table, facts, [one.name for one in table.with_time])
    with path.open("wb") as file, parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        for batch in _batches(table, schema):
            writer.write_batch(batch)


def head(one: Column) -> str:
    """Return the name of a column with its unit."""
    return f"{one.name} [{one.unit}]" if one.unit else one.name


def _schema(table: Table, facts: Mapping[str, str], names: list[str]) -> pa.Schema:
    import pyarrow as pa

    fields = []
    for one, name in zip(table.with_time, names):
        kind = pa.string() if one.values.dtype == object else pa.from_numpy_dtype(one.values.dtype)
        metadata = {"unit": one.unit, "description": one.about}
        fields.append(pa.field(name, kind, metadata={key: text for key, text in metadata.items() if text}))
    return pa.schema(fields, metadata=dict(facts))


def _batches(table: Table, schema: pa.Schema) -> Iterator[Any]:
    import pyarrow as pa

    columns = table.with_time
    for begin in range(0, table.t_ns.size, _ROWS):
        rows = [one.values[begin : begin + _ROWS] for one in columns]
        arrays = [pa.array(v, kind, from_pandas=True) for v, kind in zip(rows, schema.types)]  # NaN becomes null
        yield pa.record_batch(arrays, schema=schema)
