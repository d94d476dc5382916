"""Maps of the contact pressure at chosen instants of a recording: of a film, or of the contacts of a structure.

Pressures belong to the samples nearest to the given times: a simulated run has one at every sample step, a live
recording 200 per second. The vibration is faster, so that a map shows one instant, not a mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.series import scene_name
from rig.errors import UsageError
from rig.record.film_points import Points, points_of
from rig.record.run import Reals, Run
from rig.record.statistics import Instant, characteristic
from rig.results import Column, Result, Table

MOST = 20
"""Largest number of instants in a figure."""
WHERE = "x along the travel and y across it count from the slider's middle"


class Map(NamedTuple):
    """A contact at `time` [s]: `pressures` in Pa in the shape of its points, `centre` (x, y) [m], `force` [N].

    `fraction`: share of the points in contact. `why` this instant was chosen, "" if the user named it.
    """

    contact: str
    time: float
    why: str
    fraction: float
    centre: tuple[float, float]
    force: float
    pressures: Reals

    @property
    def largest(self) -> float:
        """The largest pressure [Pa]."""
        return float(np.nanmax(self.pressures))


@dataclass(frozen=True)
class Pressure(Result):
    """The result of `pressure`: the points, and for each instant a map of each contact."""

    FIGURE: ClassVar = "rig.analysis.recorded.figures:pressure_figure"

    scene: str
    points: Points
    maps: tuple[Map, ...]
    spacing: float
    """Interval between samples of the recording [s]."""

    def shown(self) -> Iterator[str | Table]:
        """Yield the sizes of the contacts, and a row for each map."""
        surfaces = {surface.name: surface for surface in self.points.surfaces}
        sizes = []
        for name, s in surfaces.items():
            low_x, low_y = s.corners.min(axis=(0, 1))
            high_x, high_y = s.corners.max(axis=(0, 1))
            points = " x ".join(map(str, s.shape))
            size = f"{points} points on {1e3 * (high_x - low_x):.4g} x {1e3 * (high_y - low_y):.4g} mm"
            sizes.append(f"{size} ({name})" if len(surfaces) > 1 else size)
        yield f"{self.scene}: contact pressure, {', '.join(sizes)}, recorded every {1e3 * self.spacing:.3g} ms"
        yield f"  {WHERE if 'film' in surfaces else 'coordinates of the mesh'}; a map is one instant, not a mean\n"
        axes = self.points.surfaces[0].axes
        columns = (
            Column("contact"),
            Column("time", "s", ".5f"),
            Column("fraction", "1", ".0f", "%", 0.01),
            *(Column(f"centre {axis}", "m", "z.1f", "mm", 1e-3) for axis in axes),
            Column("force", "N", ".1f"),
            Column("largest", "Pa", ".3f", "MPa", 1e6),
            *(Column(f"largest at {axis}", "m", "z.1f", "mm", 1e-3) for axis in axes),
            Column("why"),
        )
        rows: list[tuple[Any, ...]] = []
        for shown in self.maps:
            place = surfaces[shown.contact].places[int(np.nanargmax(shown.pressures))]
            centre, at = (shown.centre, map(float, place)) if shown.largest > 0.0 else ((None,) * 2, (None,) * 2)
            pressure = (shown.force, shown.largest)
            rows.append((shown.contact, shown.time, shown.fraction, *centre, *pressure, *at, shown.why))
        yield Table("maps", columns, rows)

    def facts(self) -> dict[str, Any]:
        """Return points and maps in SI; pressures of a film by lines across, from the rear."""
        maps = [
            {**shown._asdict(), "pressures": shown.pressures.tolist(), "largest": shown.largest} for shown in self.maps
        ]
        contacts = {}
        for surface in self.points.surfaces:
            lines = {axis: v.tolist() for axis, v in zip(surface.axes, (surface.x, surface.y))}
            contacts[surface.name] = lines | {"area": surface.area.reshape(surface.shape).tolist()}
        return {"scene": self.scene, "contacts": contacts, "spacing": self.spacing, "maps": maps}

    def listed(self) -> Table:
        """Return a row for each point of each map: time [s], coordinates [m], pressure [Pa], contact."""
        places = {surface.name: surface.places.tolist() for surface in self.points.surfaces}
        rows = [
            (m.time, x, y, p, m.contact)
            for m in self.maps
            for (x, y), p in zip(places[m.contact], m.pressures.ravel().tolist())
        ]
        units = {"time": "s", **dict.fromkeys(self.points.surfaces[0].axes, "m"), "pressure": "Pa", "contact": ""}
        return Table("points", [*map(Column, units, units.values())], rows)


def pressure(run: Run, at: Sequence[float] = ()) -> Pressure:
    """Return maps of the contact pressure in `run` at the times `at` [s], by default at characteristic instants.

    These are: before the first opening, at it, with the pressure most at the rear and at the front edge (or with the
    largest pressure), with the fewest points in contact, at the end. Raises UsageError for a recording without
    pressures, for times outside of it or in a gap, and for more than 20 times.
    """
    points = points_of(run.scene)
    if points is None or run.signals.keys().isdisjoint(points.names):
        raise UsageError(
            f"{scene_name(run)}: this recording has no contact points with places; rig analyse pressure reads "
            f"runs of the plant plate with a slider and film.opens = true, and of the plant structure "
            f"with contacts of a mesh"
        )
    instants = _asked(run, at) if at else characteristic(run, points)
    rows = [instant.sample for instant in instants]
    picked = {name: run.output(name)[rows] for name in points.names}
    pressures = {surface.name: surface.maps(picked) for surface in points.surfaces}
    lost: list[float] = []
    for k, row in enumerate(rows):
        if any(np.isnan(pressed[k]).any() for pressed in pressures.values()):
            lost.append(float(run.time[row]))
    if lost:
        raise UsageError(f"the recording has lost the pressures at {_seconds(lost)}; name others")
    maps = []
    for k, instant in enumerate(instants):
        for surface in points.surfaces:
            pressed = pressures[surface.name][k]
            fraction = float((pressed > 0.0).mean())
            centre = surface.centre(pressed)
            force = float(pressed.ravel() @ surface.area)
            time = float(run.time[instant.sample])
            maps.append(Map(surface.name, time, instant.why, fraction, centre, force, pressed))
    steps = np.diff(run.time)
    return Pressure(scene_name(run), points, tuple(maps), float(np.median(steps)) if steps.size else 0.0)


def _asked(run: Run, at: Sequence[float]) -> list[Instant]:
    if len(at) > MOST:
        raise UsageError(f"--at names {len(at)} times: at most {MOST} maps")
    begin = float(run.time[0])
    end = float(run.time[-1])
    outside = [t for t in at if not begin <= t <= end]
    if outside:
        raise UsageError(f"--at {_seconds(outside)}: the recording has {begin:g} to {end:g} s")
    return [Instant(int(np.abs(run.time - t).argmin()), "") for t in at]


def _seconds(times: list[float]) -> str:
    """Times [s] as a list in words."""
    return ", ".join(f"{t:g} s" for t in times)
