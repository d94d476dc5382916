"""Assigns outputs and sensors to plots: a measurement is in the plot of the output that it measures, in its unit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import NamedTuple

from rig.record.film_points import numbered


class Channel(NamedTuple):
    """A sensor: the plant output that it reads, and the factor that converts its measurement to that output."""

    reads: str
    factor: float


class Plot(NamedTuple):
    """One plot: its title with the unit, and its plant outputs and sensors."""

    title: str
    outputs: tuple[str, ...]
    sensors: tuple[str, ...]


_GROUPS = (
    ("acceleration", ("slider_acceleration", "plate_acceleration")),
    ("contact fraction", ("contact_fraction",)),
    ("pressure centre", ("pressure_centre_x", "pressure_centre_y")),
    ("velocity", ("velocity", "surface_speed")),
    ("forces", ("friction_force", "normal_force")),
    ("displacement", ("displacement",)),
    ("acceleration", ("acceleration",)),
    ("angle", ("angle",)),
    ("angular speed", ("angular_velocity", "disc_speed")),
    ("pitch and roll acceleration", ("pitch_acceleration", "roll_acceleration")),
    ("displacement of slider and plate", ("slider_displacement", "plate_displacement")),
    ("pitch and roll", ("pitch_displacement", "roll_displacement")),
    ("velocity of slider and plate", ("slider_velocity", "plate_velocity")),
    ("pitch and roll velocity", ("pitch_velocity", "roll_velocity")),
)

_DRIVEN = ("surface_speed",)
"""Outputs that say little alone: without the rest of their group they get one of the last plots."""


def channels(scene: str, outputs: Mapping[str, str], sensors: Mapping[str, str]) -> dict[str, Channel]:
    """What each sensor (name -> unit) of a scene (JSON text) measures; a strain is converted to the force.

    Omits sensors whose unit differs from that of the output without a known factor: one plot cannot show both.
    """
    try:
        sections = json.loads(scene).get("sensors", {})
    except ValueError:
        sections = {}
    found = {}
    for name, unit in sensors.items():
        section = sections.get(name, {})
        reads, strain = section.get("reads"), section.get("strain_per_newton")
        if reads in outputs and (strain or outputs[reads] == unit):
            found[name] = Channel(reads, 1.0 / strain if strain else 1.0)
    return found


def plots(scene: str, outputs: Mapping[str, str], sensors: Mapping[str, str]) -> list[Plot]:
    """The plots of a rig. An output or sensor that belongs to no group gets its own plot.

    Outputs of one quantity at many points have no plot: a map shows them.
    """
    placed = channels(scene, outputs, sensors)
    found = []
    at_points = {name for members in numbered(outputs).values() for name in members}
    rest = [name for name in outputs if name not in at_points]
    for title, members in _GROUPS:
        inside = tuple(name for name in members if name in rest)
        if inside and inside != _DRIVEN:
            rest = [name for name in rest if name not in inside]
            measured = tuple(name for name, channel in placed.items() if channel.reads in inside)
            found.append(Plot(f"{title} [{outputs[inside[0]]}]", inside, measured))
    found += [Plot(f"{name.replace('_', ' ')} [{outputs[name]}]", (name,), ()) for name in rest]
    found += [Plot(f"{name} [{unit}]", (), (name,)) for name, unit in sensors.items() if name not in placed]
    return found
