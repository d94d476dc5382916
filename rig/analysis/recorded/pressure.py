"""Maps of the pressure of a film at chosen instants of a recording.

Pressures belong to the samples nearest to the given times: a simulated run has one at every sample step, a live
recording 200 per second. The vibration is faster, so that a map shows one instant, not a mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.series import scene_name
from rig.errors import UsageError
from rig.printable import columns
from rig.record.film_points import Points, points_of
from rig.record.run import Reals, Run
from rig.record.statistics import Instant, characteristic
from rig.results import Result, csv_text

MOST = 20
"""Largest number of maps in a figure."""


class Map(NamedTuple):
    """The film at `time` [s]: `pressures` [along, across] in Pa, `centre` (x, y) [m] on the slider, `force` [N].

    `fraction`: share of the points in contact. `why` this instant was chosen, "" if the user named it.
    """

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
    """The result of `pressure`: the points of the film, and a map for each instant."""

    FIGURE: ClassVar = "rig.analysis.recorded.figures:pressure_figure"

    scene: str
    points: Points
    maps: tuple[Map, ...]
    spacing: float
    """Interval between samples of the recording [s]."""

    def text(self) -> str:
        """Return the report as text."""
        p = self.points
        lines = [
            f"{self.scene}: pressure of the film, {p.along} x {p.across} points on {1e3 * p.length:g} x "
            f"{1e3 * p.width:g} mm, recorded every {1e3 * self.spacing:.3g} ms",
            "  x along the travel and y across it count from the slider's middle; a map is one instant, not a mean",
            "",
        ]
        head = ("time s", "in contact", "centre x mm", "y mm", "force N", "largest MPa", "at x mm", "y mm", "")
        rows: list[tuple[str, ...]] = [head]
        for shown in self.maps:
            i, j = np.unravel_index(int(np.nanargmax(shown.pressures)), shown.pressures.shape)
            pressed = shown.largest > 0.0
            places = [1e3 * shown.centre[0], 1e3 * shown.centre[1]], [1e3 * float(p.x[i]), 1e3 * float(p.y[j])]
            centre, at = ([f"{round(v, 1) + 0.0:.1f}" if pressed else "-" for v in place] for place in places)
            rows.append((f"{shown.time:.5f}", f"{100 * shown.fraction:.0f} %", *centre, f"{shown.force:.1f}",
                         f"{1e-6 * shown.largest:.3f}", *at, shown.why))  # fmt: skip
        return "\n".join([*lines, *columns(rows, ">>>>>>>><")])

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values in SI; pressures by lines across, from the rear."""
        maps = [
            {**shown._asdict(), "pressures": shown.pressures.tolist(), "largest": shown.largest} for shown in self.maps
        ]
        p = self.points
        size = {"length": p.length, "width": p.width, "x": p.x.tolist(), "y": p.y.tolist()}
        return {"scene": self.scene, **size, "spacing": self.spacing, "maps": maps}

    def csv(self) -> str:
        """Return a line for each point of each map: time [s], x, y [m], pressure [Pa]."""
        places = [(x, y) for x in self.points.x.tolist() for y in self.points.y.tolist()]
        rows = ((m.time, x, y, p) for m in self.maps for (x, y), p in zip(places, m.pressures.ravel().tolist()))
        return csv_text(("time [s]", "x [m]", "y [m]", "pressure [Pa]"), rows)


def pressure(run: Run, at: Sequence[float] = ()) -> Pressure:
    """Return maps of the film's pressure in `run` at the times `at` [s], by default at characteristic instants.

    These are: before the first opening, at it, with the pressure most at the rear and at the front edge, with the
    fewest points in contact, at the end. Raises UsageError for a recording without pressures, for times outside of it
    or in a gap, and for more than 20 times.
    """
    points = points_of(run.scene)
    if points is None or run.signals.keys().isdisjoint(points.names):
        raise UsageError(f"{scene_name(run)}: this recording has no film whose points open; rig pressure reads runs of "
                         f"the plant plate with a slider and film.opens = true, as of the scene plate")  # fmt: skip
    instants = _asked(run, at) if at else characteristic(run)
    rows = [instant.sample for instant in instants]
    names = (*points.names, "contact_fraction", "pressure_centre_x", "pressure_centre_y", "normal_force")
    picked = {name: run.output(name)[rows] for name in names}
    pressures = points.maps(picked)
    lost = [float(run.time[row]) for row, pressed in zip(rows, pressures) if np.isnan(pressed).any()]
    if lost:
        raise UsageError(f"the recording has lost the pressures at {', '.join(f'{t:g} s' for t in lost)}; name others")
    fraction, x, y, force = (picked[name].tolist() for name in names[-4:])
    maps = tuple(
        Map(float(run.time[instant.sample]), instant.why, fraction[k], (x[k], y[k]), force[k], pressures[k])
        for k, instant in enumerate(instants)
    )
    gaps = np.diff(run.time)
    return Pressure(scene_name(run), points, maps, float(np.median(gaps)) if gaps.size else 0.0)


def _asked(run: Run, at: Sequence[float]) -> list[Instant]:
    if len(at) > MOST:
        raise UsageError(f"--at names {len(at)} times: at most {MOST} maps")
    begin, end = float(run.time[0]), float(run.time[-1])
    outside = [t for t in at if not begin <= t <= end]
    if outside:
        raise UsageError(f"--at {', '.join(f'{t:g} s' for t in outside)}: the recording has {begin:g} to {end:g} s")
    return [Instant(int(np.abs(run.time - t).argmin()), "") for t in at]
