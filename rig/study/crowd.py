"""Rigs of many points: what studies cannot tell of them, and names of many places as one."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

from rig.errors import UsageError

if TYPE_CHECKING:
    from rig.scenes.scene import Scene

_PLACE = re.compile(r"_\d+_\d+$")  # of a point of contact, along and across


def refuse(scene: Scene, study: str) -> None:
    """Refuse a study of single motions for a film of points. Raises UsageError."""
    if scene.assemble().film is not None:
        raise UsageError(
            f"{scene.name}: {study} cannot be told of a film of points: once one has opened the motion is chaotic, "
            f"and two runs part. Take statistics of runs: rig simulate {scene.name} --out FILE; rig spectrum FILE. "
            f"For sliding with all points closed: rig modes {scene.name} --sweep KEY=A:B:N"
        )


def grouped(names: Iterable[str]) -> dict[str, list[str]]:
    """Names; those of a row of places (`pressure_3_2`) together under what they have in common (`pressure`)."""
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(_PLACE.sub("", name), []).append(name)
    return found
