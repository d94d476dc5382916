"""The description of a folder of exported files, `datapackage.json`: its files, their columns and units, the run.

It follows the Frictionless Data Package (https://specs.frictionlessdata.io/data-package), with the unit of a column as
`unit`, and `run` for the facts about the run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rig.user_files import DATA, contents

FILE = "datapackage.json"
_FORMATS = {"csv": ".csv", "parquet": ".parquet", "wav": ".wav"}


def write(folder: Path, name: str, resources: Iterable[Mapping[str, Any]], facts: Mapping[str, str]) -> None:
    """Write the description of the files in `folder`. Raises OSError."""
    description = {"name": name, "resources": [*resources], "run": dict(facts)}
    (folder / FILE).write_text(json.dumps(description, indent=1), "utf-8")


def files(folder: Path) -> set[str]:
    """Return the names of the files that an earlier export to `folder` describes; none without such a description."""
    try:
        found = json.loads(contents(folder / FILE, DATA))["resources"]
        return {
            one["path"]
            for one in found
            if Path(one["path"]).name == one["path"] and one["path"].endswith(_FORMATS[one["format"]])
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return set()
