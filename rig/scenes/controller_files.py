"""Controllers in files, added to a scene by its user: the changes of the scene that name them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rig.controllers import kind_of_file
from rig.errors import UsageError
from rig.parts import is_file


def changes(files: Mapping[str, str | Path]) -> dict[str, object]:
    """The changes (dotted key -> value) that add controllers to a scene; `files`: name -> file.

    A Python file is a kind of its own; the suffix of any other file selects the kind that reads it. A controller of the
    scene with the same name is replaced. Raises UsageError for a file that is not there or that no kind reads.
    """
    found: dict[str, object] = {}
    for name, file in files.items():
        if not Path(file).is_file():
            raise UsageError(f"controller {name}: there is no file {file}")
        if is_file(str(file)):
            found[f"controllers.{name}.kind"] = str(file)
        else:
            found |= {f"controllers.{name}.kind": kind_of_file(Path(file)), f"controllers.{name}.file": str(file)}
    return found
