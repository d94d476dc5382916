"""The values of a scene that belong to no part: its texts, its seed, its limits. Faults are reported to its tables."""

from __future__ import annotations

from typing import Any

from annotated_types import Gt

from rig.quantities import finite
from rig.scenes import faults
from rig.scenes.merged import Merged


def text(tables: Merged, key: str, default: str) -> str:
    """The title, or the description."""
    found = tables.raw.get(key, default)
    if not isinstance(found, str):
        _fault(tables, key, f"{key} = {faults.shown(found)}: expected a text")
        return ""
    return found


def seed(tables: Merged) -> int:
    """The seed of noise; 0 by default."""
    found = tables.raw.get("seed", 0)
    if isinstance(found, bool) or not isinstance(found, int) or found < 0:
        _fault(tables, "seed", f"seed = {faults.shown(found)}: expected a whole number, at least 0")
        return 0
    return found


def limits(tables: Merged, assembly: Any) -> dict[str, float]:
    """The limits of outputs beyond which a run goes to its safe state: name -> largest absolute value [SI]."""
    raw = tables.raw.get("limits", {})
    if not isinstance(raw, dict):
        _fault(tables, "limits", f"limits = {faults.shown(raw)}: expected a table of outputs")
        return {}
    if assembly is None:
        return {}
    limits = {}
    for name, given in raw.items():
        key = f"limits.{name}"
        if name not in assembly.outputs:
            _fault(tables, key, f"{key}: this rig has no such output; {faults.near(name, assembly.outputs)}")
            continue
        unit = assembly.outputs[name].unit
        try:
            limits[name] = finite(given, unit, Gt(0.0))
        except ValueError as error:
            _fault(tables, key, f"{key} = {faults.shown(given)}: {faults.reworded(str(error), given)}")
    return limits


def _fault(tables: Merged, key: str, line: str) -> None:
    tables.report([(key, line)])
