"""One figure or table of a paper: its drawing, its scenes, and its comparison with published numbers.

Beside it what the figures share: scenes with changes, runs without a protocol, tables.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import rig
from rig.analysis.map.dither import boundary
from rig.analysis.map.job import Job, Settings
from rig.analysis.recorded.stick_speeds import Stages, stages
from rig.model.friction_law import Law
from rig.record.run import Reals, Run
from rig.scenes.axis import Axis
from rig.scenes.scene import Scene

PAPERS = {
    "kroeger": "Kroeger, Neubauer, Popp: Experimental investigation on the avoidance of self-excited vibrations. "
    "Phil. Trans. R. Soc. A 366 (2008) 785-810",
    "liu000": "Liu, Ouyang: Suppression of friction-induced-vibration in MDoF systems using tangential harmonic "
    "excitation. Meccanica 55 (2020) 1525-1542",
    "liu003": "Liu, Ouyang: Friction-induced vibration of a slider-on-rotating-disc system considering uniform and "
    "non-uniform friction characteristics with bi-stability. Mech. Syst. Signal Process. 164 (2022) 108222",
    "detachment": "A new mechanism for friction-induced vibration and noise: detachment and reattachment",
    "bistable": "Tonazzi, Passafiume, Papangelo, Hoffmann, Massi: Numerical and experimental analysis of the bi-stable "
    "state for frictional continuous system. Nonlinear Dyn. 102 (2020) 1361-1374",
}
Source = Literal["paper", "reference", "theory", "coarser"]
TOLD = "Controllers are designed for the scene of each run; they know the rig."
"""The note of a figure with control loops: which rig its controllers believe in (rig.scenes.belief)."""


def load(name: str, **changes: Any) -> Scene:
    """Return a scene with changes; two underscores replace the dot: body__damping=2.0, in SI."""
    return rig.load(name, {key.replace("__", "."): value for key, value in changes.items()})


def quiet(scene: Scene) -> Scene:
    """Return the scene without protocol, controllers and limits, held at its initial values."""
    return replace(scene, protocol=(), controllers={}, limits={})


def value(scene: Scene, key: str) -> float:
    """Return a value of a scene in SI."""
    return float(scene.values()[key][0])


def law_of(scene: Scene) -> Law:
    """Return the friction law of the scene's first contact."""
    return scene.assemble().system().patches[0].law  # type: ignore[no-any-return]


def thresholds(ran: Run) -> Stages:
    """Return the speeds of the last stick of the way up and of the first one of the way down [m/s or rad/s]."""
    speeds = stages(ran)
    assert speeds is not None
    return speeds


def tops(v: Reals) -> NDArray[np.int64]:
    """Return the rows of the maxima of v."""
    return np.flatnonzero((v[1:-1] > v[:-2]) & (v[1:-1] >= v[2:])) + 1


def log_slope(t: Reals, v: Reals) -> float:
    """Return the growth rate of v(t) [1/s], fitted to its logarithm."""
    return float(np.polyfit(t, np.log(v), 1)[0])


def table(
    axis: Axes, rows: Sequence[Sequence[str]], heads: Sequence[str], size: float, high: float, **look: Any
) -> None:
    """Draw a table with letters of `size` [pt] and rows `high` times as high as usual."""
    axis.axis("off")
    drawn = axis.table(rows, colLabels=heads, loc="upper center", cellLoc="center", edges="horizontal", **look)
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(size)
    drawn.scale(1.0, high)


def dither_boundary(scene: Scene, rate: float, fast: float, shares: Reals) -> tuple[float, float, float]:
    """Return the largest dither that loses sliding, relative to the one that gives the slider of mass one the speed
    `fast` [m/s].

    To leading order, averaged, simulated. `rate` of the dither [rad/s]; `shares`: amplitudes to try, in the same
    measure.
    """
    frequencies = Axis.of("dither.frequency", [rate / (2.0 * math.pi), rate], scene)
    amplitudes = Axis.of("dither.amplitude", shares * fast * rate, scene)
    boundaries = boundary(Job(scene, frequencies, amplitudes, Settings("displacement")), 0)
    leading, averaged, simulated = (float(boundaries[name].mean()) for name in ("leading", "averaged", "simulated"))
    unit = fast * rate
    return leading / unit, averaged / unit, simulated / unit


@dataclass(frozen=True)
class Comparison:
    """One published number beside ours. `source`: printed in the paper, an independent computation, or a closed form;
    or ours with a coarser resolution.

    Ours agrees within `absolute` + `relative` times the expected number; a `floor` must be reached and may be exceeded.
    `missed`: known to lie outside this bound, not reproduced. Without an expected number (NaN) ours is only shown.
    """

    what: str
    unit: str
    ours: float
    expected: float
    source: Source
    relative: float = 0.0
    absolute: float = 0.0
    floor: bool = False
    missed: bool = False

    @property
    def compared(self) -> bool:
        """Whether there is a number to compare ours with."""
        return not math.isnan(self.expected)

    @property
    def agrees(self) -> bool:
        """Whether our number lies within the bound."""
        if self.floor:
            return bool(self.ours >= self.expected)
        return bool(abs(self.ours - self.expected) <= self.absolute + self.relative * abs(self.expected))

    @property
    def bound(self) -> str:
        """The bound in words."""
        if self.floor:
            return "at least"
        if not self.compared:
            return ""
        parts = []
        if self.relative:
            parts.append(f"{self.relative:.2g} relative")
        if self.absolute:
            parts.append(f"{self.absolute:.2g} {self.unit}".strip())
        return " + ".join(parts) or "equal"

    @property
    def result(self) -> str:
        """What the comparison shows, in words."""
        if not self.compared:
            return "no number in the paper"
        if self.agrees:
            return "agrees"
        return "not reproduced" if self.missed else "DIFFERS"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values, with `agrees`; what is no number is null."""
        ours = self.ours if math.isfinite(self.ours) else None
        expected = self.expected if math.isfinite(self.expected) else None
        return vars(self) | {"agrees": self.agrees, "ours": ours, "expected": expected}


Compared = Iterator[Comparison]


def compared(rows: Iterable[tuple[str, float, float]], unit: str, source: Source, **bound: Any) -> Compared:
    """Compare rows (what, ours, expected) with one unit, source and bound."""
    return (Comparison(what, unit, float(ours), expected, source, **bound) for what, ours, expected in rows)


def numbered(
    what: str, ours: Iterable[float], expected: Iterable[float], unit: str, source: Source, **bound: Any
) -> Compared:
    """Compare values one after the other; `what` contains the place of their number as {}."""
    rows = ((what.format(number), *pair) for number, pair in enumerate(zip(ours, expected), 1))
    return compared(rows, unit, source, **bound)


@dataclass(frozen=True)
class Entry:
    """A figure or table: `name` in the commands, its paper, number and title, and its scenes."""

    name: str
    paper: str
    number: str
    title: str
    scenes: tuple[str, ...]
    draw: Callable[[Figure], Iterable[Comparison]]
    note: str = ""
    size: tuple[float, float] = (9.6, 5.4)


@dataclass(frozen=True)
class Result:
    """The result of an entry. `seconds`: compute time; `picture`: the PNG file, which has an SVG file beside it."""

    entry: Entry
    comparisons: tuple[Comparison, ...]
    picture: Path
    seconds: float

    @property
    def agrees(self) -> bool:
        """Whether every number agrees, except those that are known to differ."""
        return all(comparison.agrees or comparison.missed or not comparison.compared for comparison in self.comparisons)

    @property
    def counted(self) -> str:
        """How many of the compared numbers agree, in words."""
        compared = [comparison for comparison in self.comparisons if comparison.compared]
        agree = sum(comparison.agrees for comparison in compared)
        return "all" if agree == len(compared) else f"{agree} of {len(compared)}"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "name": self.entry.name,
            "paper": PAPERS[self.entry.paper],
            "number": self.entry.number,
            "title": self.entry.title,
            "scenes": list(self.entry.scenes),
            "picture": str(self.picture),
            "seconds": self.seconds,
            "agrees": self.agrees,
            "comparisons": [comparison.to_json() for comparison in self.comparisons],
        }
