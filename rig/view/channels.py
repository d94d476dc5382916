"""Assigns outputs and sensors of a run to plots, as their parts declare it: plots, colours, the phase portrait.

A measurement is in the plot of the output that it measures, in its unit and colour. Colours are those of Okabe and Ito,
by the place of an output in its plot; the first four have a contrast of 3 or more on the white of a figure and on the
dark of the viewer. Source: M. Okabe, K. Ito, Color universal design (2008), https://jfly.uni-koeln.de/color/.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from rig.model.assembly import Assembly, portrait
from rig.picture import Plot, plot_of
from rig.record.film_points import numbered
from rig.scenes.scene import Scene
from rig.view.palette import LINES


class Channel(NamedTuple):
    """A sensor: the plant output that it reads, and the factor that converts its measurement to that output."""

    reads: str
    factor: float


class Panel(NamedTuple):
    """One plot: its title with the unit, its plant outputs and sensors, and its place (`rig.picture.Plot`)."""

    title: str
    outputs: tuple[str, ...]
    sensors: tuple[str, ...]
    place: int


class Channels:
    """Outputs and sensors (name -> unit) of a run, and where its rig draws them.

    `found`: scene and rig, which declare it. Without them the outputs are arranged by their units.
    """

    def __init__(
        self, scene_and_rig: tuple[Scene, Assembly] | None, outputs: Mapping[str, str], sensors: Mapping[str, str]
    ) -> None:
        scene, rows = (scene_and_rig[0].sensors, scene_and_rig[1].outputs) if scene_and_rig else ({}, {})
        declared = [name for name in rows if name in outputs]
        others = [name for name in outputs if name not in rows]
        self.outputs = {name: outputs[name] for name in (*declared, *others)}
        """Outputs in the order of the rig, so that every view gives them the same colours."""
        self.sensors = dict(sensors)
        self.at_points = frozenset(name for members in numbered(outputs).values() for name in members)
        """Outputs of one quantity at many points. They have no plot: a map shows them."""
        self._declared = {name: rows[name] for name in declared}
        self.measured: dict[str, Channel] = {}
        """What each sensor measures. Omits sensors whose measurement no factor converts to the output."""
        for name, section in scene.items():
            if name not in sensors or section.reads not in outputs:
                continue
            factor = section.conversion
            if factor is not None:
                self.measured[name] = Channel(section.reads, factor)
        self.panels = self._panels()
        """The plots, in order."""
        self.colours = {
            name: LINES[place % len(LINES)] for panel in self.panels for place, name in enumerate(panel.outputs)
        }
        """Colour of each output as "#rrggbb"."""
        self.portrait = portrait(self._declared)
        """Names of displacement and velocity of the phase portrait; None if the rig has no such pair."""
        self.drives = frozenset(name for name, output in self._declared.items() if output.role == "drive")
        """Outputs that are the speed of a drive."""

    def colour_of(self, sensor: str) -> str:
        """Colour of the output that a sensor measures; of another sensor the first colour."""
        channel = self.measured.get(sensor)
        return self.colours.get(channel.reads, LINES[0]) if channel else LINES[0]

    def panel_of(self, output: str) -> Panel | None:
        """The plot of an output; None for one at many points, and for an unknown one."""
        return next((panel for panel in self.panels if output in panel.outputs), None)

    def _panels(self) -> list[Panel]:
        """Plots of outputs by their places, then those of sensors that measure none of these."""
        members: dict[tuple[str, str], list[str]] = {}
        places: dict[tuple[str, str], int] = {}
        for name, unit in self.outputs.items():
            if name in self.at_points:
                continue
            plot = getattr(self._declared.get(name), "plot", None) or plot_of(unit)
            key = plot.title or name.replace("_", " "), unit
            members.setdefault(key, []).append(name)
            places[key] = min(plot.place, places.get(key, plot.place))
        panels = []
        shown = set()
        for key in sorted(members, key=lambda key: places[key]):
            title, unit = key
            outputs = members[key]
            sensors = [sensor for sensor, channel in self.measured.items() if channel.reads in outputs]
            panels.append(Panel(f"{title} [{unit}]", tuple(outputs), tuple(sensors), places[key]))
            shown.update(sensors)
        alone = Plot().place
        for sensor, unit in self.sensors.items():
            if sensor not in shown:
                panels.append(Panel(f"{sensor} [{unit}]", (), (sensor,), alone))
        return panels
