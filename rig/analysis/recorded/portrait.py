"""Phase portrait of two channels of a recording, and its Poincare section.

The section holds the points at which a channel crosses a value upwards. A crossing is located on the cubic through the
four samples about it, and so are the two channels there: the error is of fourth order in the distance of the samples
where the motion is smooth, of second order if the contact sticks or slips within these three intervals. A motion that
repeats after n crossings has n points. Source: F. C. Moon, Chaotic Vibrations, 1987, chapter 2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.common_grid import aligned
from rig.analysis.recorded.series import Series, channels, same, scene_name
from rig.errors import Faults, UsageError
from rig.printable import counted
from rig.record.run import Reals, Run
from rig.record.run_data import TRUE
from rig.record.run_list import portrait_pair
from rig.results import Column, Result, Table

SAME = 1e-3
"""Share of the range of a channel: points of a section that are this close count as one."""
_MOST = 64  # points in a section of a motion that repeats
_HALVINGS = 60  # of a sample interval: beyond the digits of a double


class Section(NamedTuple):
    """Where channel `name` crosses `value` [unit] upwards: times `t` [s] and the values `x`, `y` there, [n] each.

    `lost`: crossings that could not be located, beside a missing sample or an end. `returns`: the motion repeats after
    so many crossings; 0 if it does not, or if the section has less than two points for each of them. `period` [s] is
    the mean time of a return and `deviation` [s] its standard deviation; `spread`: largest distance between a point
    and its return, as a share of the range of the channels. All are NaN without a return.
    """

    name: str
    unit: str
    value: float
    t: Reals
    x: Reals
    y: Reals
    lost: int
    returns: int
    period: float
    deviation: float
    spread: float


@dataclass(frozen=True)
class Portrait(Result):
    """The result of `portrait`: samples `x` and `y` [n] at times `t` [s]; NaN where one is missing."""

    FIGURE: ClassVar = "rig.analysis.recorded.channel_figures:portrait_figure"

    scene: str
    x_name: str
    x_unit: str
    y_name: str
    y_unit: str
    t: Reals
    x: Reals
    y: Reals
    section: Section | None
    gaps: tuple[str, ...]

    def shown(self) -> Iterator[str]:
        """Yield the ranges and the section."""
        axes = f"{self.y_name} [{self.y_unit}] over {self.x_name} [{self.x_unit}]"
        span = f"{self.t[0]:.5g} to {self.t[-1]:.5g} s"
        yield f"{self.scene}: {axes}, {span}, {counted(self.t.size, 'sample')}"
        yield from (f"  {gap}" for gap in self.gaps)
        for name, unit, v in ((self.x_name, self.x_unit, self.x), (self.y_name, self.y_unit, self.y)):
            yield f"  {name}: {np.nanmin(v):.6g} to {np.nanmax(v):.6g} {unit}"
        yield from self._section()

    def _section(self) -> Iterator[str]:
        s = self.section
        if s is None:
            return
        times = counted(s.t.size, "time")
        yield f"  section: {s.name} crosses {s.value:.6g} {s.unit} upwards {times}, located on cubics"
        if s.lost:
            yield f"  {s.lost} crossings beside a missing sample or an end could not be located"
        if s.returns:
            after = "every crossing" if s.returns == 1 else f"{s.returns} crossings"
            yield (
                f"  the motion repeats after {after}: period {s.period:.9g} s (standard deviation {s.deviation:.2g} "
                f"s), {1.0 / s.period:.6g} Hz; a point returns to {s.spread:.2g} of the range"
            )
        elif s.t.size > 2:
            within = counted(min(_MOST, s.t.size // 2), "crossing")
            yield (
                f"  no repetition to {SAME:g} of the range within {within}: a "
                "transient (choose a later --from), a section where the contact begins to stick (choose another "
                "value), or a motion that is not periodic"
            )
        else:
            yield "  at least three crossings are needed to find a repetition"

    def facts(self) -> dict[str, Any]:
        """Return the ranges, and the section with its points."""
        sides = {"x": self.x, "y": self.y}
        values = {f"{side}_range": [float(np.nanmin(v)), float(np.nanmax(v))] for side, v in sides.items()}
        names = ("scene", "x_name", "x_unit", "y_name", "y_unit")
        section = None
        if self.section is not None:
            section = self.section._asdict() | {side: getattr(self.section, side).tolist() for side in ("t", "x", "y")}
        return {
            **{name: getattr(self, name) for name in names},
            "start": float(self.t[0]),
            "end": float(self.t[-1]),
            "samples": self.t.size,
            **values,
            "gaps": list(self.gaps),
            "section": section,
        }

    def listed(self) -> Table:
        """Return a row for each point of the section, or without one for each sample: time [s], x, y."""
        points = self.section or self
        columns = (Column("time", "s"), Column(self.x_name, self.x_unit), Column(self.y_name, self.y_unit))
        return Table("points", columns, [*zip(points.t.tolist(), points.x.tolist(), points.y.tolist())])


def portrait(
    run: Run,
    x: str = "",
    y: str = "",
    section: tuple[str, float] | None = None,
    first: float = 0.0,
    last: float = math.inf,
) -> Portrait:
    """Draw channel `y` over `x` of `run`, from `first` to `last` [s], and find its Poincare section.

    By default the displacement and the velocity that the parts of the scene declare. `section`: channel and value that
    it crosses upwards [in its unit]. Channels of different rates are filtered and brought to the lowest rate. Raises
    UsageError with every fault: unknown names, one channel twice, a value that the channel never crosses. Raises
    Untrusted if it has to ask parts that are not trusted.
    """
    names = {"x": x, "y": y}
    if not (x and y):
        usual = portrait_pair(run)
        if usual is None:
            raise UsageError("this recording has no displacement with a velocity; name both channels (--x, --y)")
        names = {"x": x or TRUE + usual[0], "y": y or TRUE + usual[1]}
    if section is not None:
        names["section"] = section[0]
    faults = Faults()
    known = [*channels(run, names, first, last, faults).values()]
    if not faults.found and same(run, names["x"], names["y"]):
        faults.found.append(f"x and y are both {known[0].name}; name two channels (--x, --y)")
    if section is not None and not faults.found:
        crossing = known[2]
        low = np.nanmin(crossing.v)
        high = np.nanmax(crossing.v)
        if not low < section[1] <= high:
            faults.found.append(
                f"section: {crossing.name} never crosses {section[1]:g} {crossing.unit}; it stays from {low:.6g} to "
                f"{high:.6g} {crossing.unit}"
            )
    faults.raise_found()
    (horizontal, other, *across), _ = aligned(known)
    crossed = None if section is None else _crossed(horizontal, other, across[0], section[1])
    gaps = tuple(dict.fromkeys(filter(None, (channel.notes() for channel in known))))
    return Portrait(
        scene_name(run),
        horizontal.name,
        horizontal.unit,
        other.name,
        other.unit,
        horizontal.t,
        horizontal.v,
        other.v,
        crossed,
        gaps,
    )


def _crossed(x: Series, y: Series, over: Series, value: float) -> Section:
    """The section of the portrait of `x` and `y`."""
    v = over.v
    with np.errstate(invalid="ignore"):
        before = np.flatnonzero((v[:-1] < value) & (v[1:] >= value))
    inside = before[(before >= 1) & (before + 2 < v.size)]
    index = inside[:, None] + np.arange(-1, 3)
    whole = np.isfinite(v[index] + x.v[index] + y.v[index]).all(axis=1)
    index = index[whole]
    low = np.zeros(len(index))
    high = np.ones(len(index))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = _cubic(v[index], middle) < value
        low = np.where(below, middle, low)
        high = np.where(below, high, middle)
    place = 0.5 * (low + high)
    t = over.start + (index[:, 1] + place) / over.rate
    points = np.stack([_cubic(side.v[index], place) for side in (x, y)])
    ranges = [max(float(np.nanmax(side.v) - np.nanmin(side.v)), 1e-300) for side in (x, y)]
    returns, spread = _returns(points / np.array(ranges)[:, None])
    times = t[returns:] - t[:-returns] if returns else np.full(1, np.nan)
    return Section(
        over.name,
        over.unit,
        value,
        t,
        points[0],
        points[1],
        before.size - len(index),
        returns,
        float(times.mean()),
        float(times.std()),
        spread,
    )


def _cubic(v: Reals, place: Reals) -> Reals:
    """The cubic through samples `v` [n, 4] at -1, 0, 1, 2, at `place` [n] (Lagrange)."""
    p = place
    weights = (
        -p * (p - 1) * (p - 2) / 6,
        (p + 1) * (p - 1) * (p - 2) / 2,
        -(p + 1) * p * (p - 2) / 2,
        (p + 1) * p * (p - 1) / 6,
    )
    return np.asarray((v * np.stack(weights, axis=1)).sum(axis=1))


def _returns(points: Reals) -> tuple[int, float]:
    """After how many of the points [2, n] they repeat (0: they do not), and the largest distance from a repetition."""
    count = points.shape[1]
    for n in range(1, min(_MOST, count // 2) + 1) if count > 2 else ():
        apart = float(np.abs(points[:, n:] - points[:, :-n]).max())
        if apart <= SAME:
            return n, apart
    return 0, math.nan
