"""Modes as coordinates: a run keeps those that it began with.

A coordinate q of a mode is the displacement (shape) q, with a shape of mass one. When a rig changes in a run, q keeps
its value. Another shape, or the same one of another mass, would make it another displacement: the structure would jump.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from rig.quantities import Section


def refuse_others(now: Mapping[str, Any], begun: Mapping[str, Any]) -> None:
    """Raise ValueError if the values that the shapes depend on are not those with which the run began, by dotted key.

    A value that changes the frequencies alone does not belong to them.
    """
    changed = []
    for key in sorted(now.keys() | begun.keys()):
        if now.get(key) != begun.get(key):
            changed.append(key)
    if changed:
        raise ValueError(
            f"the modes, whose coordinates are the state of the run, depend on {', '.join(changed)}: with others the "
            "displacements would jump; make a new run with this value"
        )


def keyed(prefix: str, section: Section | None, but: Collection[str] = ()) -> dict[str, Any]:
    """The values of a table by dotted key, without those named by `but`; none of a table that is not there."""
    if section is None:
        return {}
    values = section.model_dump(exclude=set(but))
    return {f"{prefix}.{key}": value for key, value in values.items()}
