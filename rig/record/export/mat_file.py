"""Tables as one file of MATLAB (MAT-file, version 5): a struct of column vectors for each table.

MATLAB's names are letters, digits and underscores, at most 63. A name that is not valid is changed: `load.force`
becomes `load_force`. The struct `names` has the original name of each field, `units` its unit, `run` the facts about
the run.

    load run.mat
    plot(outputs.time, outputs.velocity); ylabel(units.outputs.velocity)
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import count
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.record.export.tables import Column, Table

LONGEST = 63  # characters of a name
_LARGEST = 1 << 31  # bytes of a variable
_WORDS = frozenset(
    "break case catch classdef continue else elseif end for function global if otherwise parfor persistent return spmd "
    "switch try while".split()
)


def write(tables: Iterable[Table], path: Path, facts: Mapping[str, str]) -> None:
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
        if (size := sum(one.values.nbytes for one in columns)) >= _LARGEST:
            raise UsageError(
                f"{table.name}: {size / 2**30:.1f} GiB; a variable of a MAT-file of version 5 has less than 2 GiB. "
                "Choose outputs and sensors with --only, a lower --rate, or --to hdf5, which MATLAB reads too"
            )
        variable = valid(table.name, taken)
        taken.add(variable)
        fields: dict[str, Column] = {}
        for one in columns:
            fields[valid(one.name, fields)] = one
        data[variable] = {name: one.values[:, None] for name, one in fields.items()}
        names[variable] = {name: one.name for name, one in fields.items()}
        units[variable] = {name: one.unit for name, one in fields.items()}
    with path.open("wb") as file:
        savemat(file, {**data, "names": names, "units": units, "run": dict(facts)}, long_field_names=True)


def valid(name: str, taken: Iterable[str]) -> str:
    """Return `name` as MATLAB takes it: other characters become "_", "x" is put in front where needed.

    A name among `taken` gets a number.
    """
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not re.match(r"[A-Za-z]", plain) or plain in _WORDS:
        plain = f"x{plain}"
    plain, others = plain[:LONGEST], set(taken)
    if plain not in others:
        return plain
    return next(one for n in count(2) if (one := f"{plain[: LONGEST - 1 - len(str(n))]}_{n}") not in others)
