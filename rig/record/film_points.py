"""Outputs of contact points in a run: the scale of their pressures, and how they are listed.

A film or a structure has many points, and an output for the pressure or the normal force of each. They form a group:
lists and figures of single outputs replace them by one entry, or show them as one map.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from rig.errors import PartError, SceneError
from rig.structure import model_store

if TYPE_CHECKING:
    from rig.plants.structures.contact_map import Surface
    from rig.scenes.scene import Scene

_OF_POINT = ("state_of", "slip_speed_of", "relative_speed_of", "normal_force_of")
_PLACE = re.compile("|".join([r"_\d+_\d+$", *(f"(?<=^{kind})_.+" for kind in _OF_POINT)]))
"""What differs among the outputs of points: the indices along and across, or the name of the point."""
_ABOVE_MEAN = 5.0
"""Upper end of the pressure scale over the mean pressure; during detachment of the shipped scene 99.8 % are below."""


@dataclass(frozen=True)
class Points:
    """The contact points of a scene that a map shows, by contact. `load` [N]: the largest load of the scene."""

    surfaces: tuple[Surface, ...]
    load: float

    @classmethod
    def of(cls, scene: Scene) -> Self | None:
        """Return the points of a scene; None if it has none with places, or a bonded film."""
        try:
            with model_store.using(scene.models):
                surfaces = tuple(getattr(scene.parameters, "contact_surfaces", ()))
        except SceneError:  # the files of the structure are gone
            return None
        return cls(surfaces, largest_load(scene)) if surfaces else None

    @property
    def names(self) -> tuple[str, ...]:
        """The outputs of all points."""
        return tuple(name for surface in self.surfaces for name in surface.outputs)

    @property
    def scale(self) -> float:
        """Upper end of a scale for their pressures [Pa]: five times the mean of the load on a contact, rounded."""
        mean = (self.load or 100.0) / max(float(surface.area.sum()) for surface in self.surfaces)
        return float(f"{_ABOVE_MEAN * mean:.1g}")


def read(scene: str) -> Scene | None:
    """Return a scene from its JSON text; None if the text is not a scene, or needs code that cannot be run."""
    from rig.scenes.scene import Scene  # loads numba, which the recorder does not need

    try:
        return Scene.from_json(scene)
    except (SceneError, PartError):
        return None


def points_of(scene: str) -> Points | None:
    """Return the points of a scene given as JSON text; None if it has none, or the text is not a scene."""
    described = read(scene)
    return Points.of(described) if described else None


def largest_load(scene: Scene) -> float:
    """Return the largest load that a scene or its protocol sets [N]."""
    from rig.scenes.protocol import Follow, extremes, flat, recorded, targets

    steps = [step for step in flat(scene.protocol) if "load.force" in targets(step)]
    loads = [extremes(step, "load.force")[1] for step in steps if recorded(step) or not isinstance(step, Follow)]
    largest: float = max([float(getattr(getattr(scene.parameters, "load", None), "force", 0.0)), *loads])
    return largest


def grouped(names: Iterable[str]) -> dict[str, list[str]]:
    """Group names: those of one quantity at many points (`pressure_3_2`) under their common part (`pressure`)."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(_PLACE.sub("", name), []).append(name)
    return groups


def numbered(names: Iterable[str]) -> dict[str, list[str]]:
    """Return the groups with more than one name."""
    return {quantity: members for quantity, members in grouped(names).items() if len(members) > 1}


def listed(names: Mapping[str, str]) -> list[str]:
    """List names with their units [name -> unit] as text; one quantity at many points is one entry."""
    crowds = {member: members for members in numbered(names).values() for member in members}
    entries = []
    for name, unit in names.items():
        members = crowds.get(name, [name])
        if name == members[0]:
            through = f" to {members[-1]}" if len(members) > 1 else ""
            entries.append(f"{name}{through} [{unit}]" if unit else name + through)
    return entries
