"""The description of a map: scene, axes, settings; divided into units of work."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

from rig.analysis.pool import digest
from rig.errors import SceneError, UsageError
from rig.scenes.axis import Axis
from rig.scenes.faults import near
from rig.scenes.scene import Scene

RUNS = ("up", "down", "near", "far")
CARRIED = ("up", "down")
PERIODS = 480.0
"""Default longest time for one point, in periods of the slowest vibration mode about sliding."""
DITHER = ("dither.frequency", "dither.amplitude")
_PART = 25  # points in a unit whose runs are not carried
_FEW = 10  # points in a unit of a map with one axis, so that all cores have work


@dataclass(frozen=True)
class Settings:
    """How the points of a map are simulated and classified.

    output    plant output whose amplitude is shown
    runs      some of `RUNS`
    kick      amplitude of the slip speed at a near start, over the speed of the surface
    refine    halvings of the gap in which a vibration ends
    longest   simulated time for one point [s]; None: `PERIODS`, or more if the motion settles slowly
    section   number of local maxima of the output to keep
    eigenvalues   compute eigenvalues only, without runs
    """

    output: str
    runs: tuple[str, ...] = RUNS
    kick: float = 0.01
    refine: int = 5
    longest: float | None = None
    section: int = 0
    eigenvalues: bool = False


class Unit(NamedTuple):
    """Points `first` to `last` (excluded) of row `row`: some `runs`; with `curve` the growth rates and onsets."""

    row: int
    first: int
    last: int
    runs: tuple[str, ...] = ()
    curve: bool = True


@dataclass(frozen=True)
class Job:
    """A map to be computed."""

    scene: Scene
    x: Axis
    y: Axis | None
    settings: Settings

    @property
    def dithered(self) -> bool:
        """Whether the map is that of the boundary of dither."""
        on = (self.x.key, self.y.key) if self.y is not None else ()
        return on == DITHER and not self.settings.eigenvalues

    @cached_property
    def units(self) -> tuple[Unit, ...]:
        """The units of work, which do not depend on each other."""
        count = len(self.x.values)
        runs = self.settings.runs
        if self.dithered:
            return tuple(Unit(0, i, i + 1) for i in range(count))
        carried = tuple(run for run in runs if run in CARRIED)
        part = count if carried or self.settings.eigenvalues else _PART
        if self.y is None and not self.settings.eigenvalues:
            single = tuple(run for run in runs if run not in CARRIED)
            parts = _parts(count, _FEW) if single else []
            return (
                *(Unit(0, first, last, carried) for first, last in _parts(count, part)),
                *(Unit(0, first, last, single, curve=False) for first, last in parts),
            )
        rows = range(len(self.y.values) if self.y else 1)
        return tuple(Unit(row, first, last, runs) for row in rows for first, last in _parts(count, part))

    def at(self, row: int) -> Scene:
        """Return the scene of a row. Raises SceneError if the scene refuses its value."""
        return self.y.at(self.scene, self.y.values[row]) if self.y and not self.dithered else self.scene

    def text(self, unit: Unit) -> str:
        """Return the part of the map that a unit covers, as text."""
        x, y = self.x, self.y
        text = f"{x.key} from {x.text(x.values[unit.first])} to {x.text(x.values[unit.last - 1])}"
        if y is not None:
            text += f", {y.key} = {y.text(y.values[unit.row])}"
        return text

    @cached_property
    def digest(self) -> str:
        """Hash (12 hex digits) of everything that the numbers depend on, sources included."""
        return digest(self.scene, repr([self.x, self.y, self.settings]))

    @property
    def about(self) -> dict[str, Any]:
        """Scene, axes and settings as JSON values."""
        axes = [asdict(self.x), self.y and asdict(self.y)]
        return {"scene": json.loads(self.scene.to_json()), "axes": axes, "settings": asdict(self.settings)}


def _parts(count: int, size: int) -> list[tuple[int, int]]:
    """First and last (excluded) of each part of `count` points."""
    return [(i, min(i + size, count)) for i in range(0, count, size)]


def checked(job: Job) -> Job:
    """Return `job` with its axes in rising order. Raises SceneError, UsageError with every fault."""
    x, y = (axis and replace(axis, values=tuple(sorted(axis.values))) for axis in (job.x, job.y))
    assert x is not None
    job = replace(job, x=x, y=y)
    settings = job.settings
    outputs = job.scene.assemble().outputs
    faults = []
    if settings.output not in outputs:
        faults.append(
            f"output {settings.output}: {job.scene.plant} has no such output; {near(settings.output, outputs)}"
        )
    unknown = [run for run in settings.runs if run not in RUNS]
    faults += [f"runs: {run} is unknown; known: {', '.join(RUNS)}" for run in unknown]
    if not settings.runs:
        faults.append(f"runs: name at least one of {', '.join(RUNS)}")
    if settings.longest is not None and not settings.longest > 0.0:
        faults.append(f"longest = {settings.longest:g} s: must be greater than 0 s")
    dither = getattr(job.scene.parameters, "dither", None)
    over = [axis.key for axis in (x, y) if axis and axis.key.startswith("dither.")]
    if over and not job.dithered:
        faults.append(
            f"{' and '.join(over)}: over dither a map shows its boundary, with x {DITHER[0]} and y {DITHER[1]}; "
            f"eigenvalues over one parameter: rig modes {job.scene.name} --sweep {over[0]}=FROM:TO:COUNT"
        )
    elif dither is not None and dither.enable and dither.amplitude > 0.0 and not job.dithered:
        faults.append(
            f"{job.scene.name} has dither, so that it has no steady sliding: map its boundary with "
            f"x {DITHER[0]} and y {DITHER[1]}, or switch it off: -p dither=none"
        )
    if faults:
        raise UsageError("\n".join(faults))
    for row in {0, len(y.values) - 1} if y and not job.dithered else ():
        for value in (x.values[0], x.values[-1]):
            try:
                x.at(job.at(row), value)
            except SceneError as error:
                assert y is not None
                corner = f"{x.key} = {x.text(value)}, {y.key} = {y.text(y.values[row])}"
                raise SceneError(corner, error.faults) from None
    return job
