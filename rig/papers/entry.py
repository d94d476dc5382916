"""One figure or table of a paper: its drawing, its scenes, and its comparison with published numbers.

Beside it what the figures share (scenes with changes, runs without a protocol, tables), and the gallery: several
figures at once in worker processes, the file of their numbers, from which a figure that is made again leaves the others
on the page, and the page itself in Markdown.
"""

from __future__ import annotations

import difflib
import importlib
import io
import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

import rig
from rig.analysis.axis import Axis
from rig.analysis.map.dither import boundary
from rig.analysis.map.job import Job, Settings
from rig.analysis.pool import Arrays, Progress, Work, carry_out, packed, temporary, unpacked
from rig.analysis.stick_speeds import Stages, stages
from rig.errors import UsageError
from rig.machine.files import DATA, contents, write_file
from rig.model.friction_law import Law
from rig.record.run import Reals, Run
from rig.scenes.scene import Scene
from rig.view.palette import BARE, encoded, page, put


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
    return leading / (fast * rate), averaged / (fast * rate), simulated / (fast * rate)


ROOMS = ("kroeger", "kroeger_brake", "kroeger_loops", "liu_dither", "liu_lever", "detachment", "bistable")
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
_MOST_POINTS = 1500  # of a curve in an SVG file
_PLAIN: dict[str, Any] = {"colors": 96}  # colours of a picture: reduces it to a third of the bytes
_MAPPED: dict[str, Any] = {"colors": 256, "method": 2}  # octree: few colours would make steps in a colour bar
Source = Literal["paper", "reference", "theory", "coarser"]


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
        parts = [f"{self.relative:.2g} relative"] if self.relative else []
        return " + ".join(parts + ([f"{self.absolute:.2g} {self.unit}".strip()] if self.absolute else [])) or "equal"

    @property
    def result(self) -> str:
        """What the comparison shows, in words."""
        if not self.compared:
            return "no number in the paper"
        return "agrees" if self.agrees else "not reproduced" if self.missed else "DIFFERS"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values, with `agrees`; what is no number is null."""
        finite = {name: value if math.isfinite(value) else None for name, value in
                  (("ours", self.ours), ("expected", self.expected))}  # fmt: skip
        return vars(self) | {"agrees": self.agrees} | finite


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


TOLD = "Controllers are designed for the scene of each run; they know the rig."
"""The note of a figure with control loops: which rig its controllers believe in (rig.scenes.belief)."""


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


@cache
def entries() -> dict[str, Entry]:
    """Return every entry by name, in the order of the papers."""
    by_name: dict[str, Entry] = {}
    for room in ROOMS:
        by_name |= {entry.name: entry for entry in importlib.import_module(f"rig.papers.{room}").ENTRIES}
    return by_name


def pick(wanted: str) -> list[Entry]:
    """Return the entry of that name, all of a paper, or "all". Raises UsageError with similar names."""
    known = entries()
    if wanted == "all":
        return list(known.values())
    of_paper = [entry for entry in known.values() if entry.paper == wanted]
    if of_paper:
        return of_paper
    if wanted not in known:
        near = difflib.get_close_matches(wanted, known, 3, 0.4)
        hint = f"did you mean {', '.join(near)}? " if near else ""
        raise UsageError(
            f"no figure {wanted!r}: {hint}known: {', '.join(known)}; or a paper ({', '.join(PAPERS)}), or all"
        )
    return [known[wanted]]


def make(entry: Entry, folder: Path) -> Result:
    """Draw an entry into `folder` (PNG and SVG) and compare its numbers."""
    begin = time.perf_counter()
    path = folder / f"{entry.name}.png"
    with page(*entry.size, style=BARE, dpi=110, layout="constrained") as figure:
        comparisons = tuple(entry.draw(figure))
        figure.align_ylabels()
        figure.suptitle(f"{entry.number}: {entry.title}", x=0.01, ha="left", fontsize=12.5, fontweight="bold")
        folder.mkdir(parents=True, exist_ok=True)
        drawn = Image.open(io.BytesIO(encoded(figure, "png")))
        how = _MAPPED if any(hasattr(axes, "_colorbar") for axes in figure.axes) else _PLAIN
        drawn.convert("RGB").quantize(**how, dither=Image.Dither.NONE).save(path, optimize=True)
        _as_pixels(figure)
        put(figure, path.with_suffix(".svg"))
    return Result(entry, comparisons, path, time.perf_counter() - begin)


def _as_pixels(figure: Figure) -> None:
    """Let an SVG file contain curves of very many points as pixels: as lines they would be megabytes."""
    for axes in figure.get_axes():
        for line in axes.get_lines():
            line.set_rasterized(len(line.get_xdata()) > _MOST_POINTS)  # type: ignore[arg-type]
        for mesh in axes.collections:
            many = sum(len(np.asarray(path.vertices)) for path in mesh.get_paths()) > _MOST_POINTS
            if many or mesh.get_array() is not None:  # the latter is a coloured map
                mesh.set_rasterized(True)


_FILE = "numbers.json"


def keep(results: Iterable[Result], folder: Path) -> list[Result]:
    """Write `results` into `folder`, replacing older ones of the same figures; return all, in the order of the
    papers.
    """
    by_name = {result.entry.name: result for result in (*_kept(folder), *results)}
    held = [by_name[name] for name in entries() if name in by_name]
    text = json.dumps([stored(result) for result in held], indent=1, allow_nan=False)
    write_file(folder / _FILE, f"{text}\n".encode())
    return held


def stored(result: Result) -> dict[str, Any]:
    """Return a result as JSON values, its picture without the folder."""
    return {**result.to_json(), "picture": result.picture.name}


def restored(raw: dict[str, Any], folder: Path) -> Result:
    """Return the result of `stored`, whose picture is in `folder`."""
    compared = tuple(map(_compared, raw["comparisons"]))
    return Result(entries()[raw["name"]], compared, folder / raw["picture"], raw["seconds"])


def _kept(folder: Path) -> list[Result]:
    """The results of earlier calls, for figures that still exist."""
    try:
        read = json.loads(contents(folder / _FILE, DATA))
    except (OSError, ValueError):
        return []
    return [restored(saved, folder) for saved in read if saved["name"] in entries()]


def _compared(raw: dict[str, Any]) -> Comparison:
    values = {field.name: raw[field.name] for field in fields(Comparison) if field.name in raw}
    return Comparison(**values | {name: math.nan for name in ("ours", "expected") if raw[name] is None})


def make_all(
    wanted: Sequence[Entry], folder: Path, progress: Progress | None = None, workers: int | None = None
) -> list[Result]:
    """Draw entries into `folder` (PNG, SVG) and compare numbers, in `workers` processes, by default one for each core.

    Raises WorkerError if a figure cannot be made.
    """
    work = Work(partial(_figure, folder), [entry.name for entry in wanted])
    with temporary(work) as store:
        by_unit = carry_out(work, store, workers, progress)
    return [restored(unpacked(by_unit[unit]), folder) for unit in sorted(by_unit)]


def _figure(folder: Path, name: str) -> Arrays:
    """Draw a figure and compare its numbers."""
    return packed(stored(make(entries()[name], folder)))


def gallery_page(results: Sequence[Result], machine: str) -> str:
    """Return a page of pictures and tables, for the folder of the pictures."""
    lines = [
        "# Figures of the papers, reproduced",
        "",
        f"Made by `make docs` (`rig tool reproduce all`), the last of them on {machine}.",
        "",
        "A number agrees when it lies within the bound beside it. *Not reproduced*: it is known to lie outside.",
        "Sources: *paper*, printed there; *reference*, an independent computation of the same equations with the same",
        "parameters; *theory*, a closed form; *coarser*, ours with a coarser resolution.",
        "",
        "| figure | what | scenes | numbers | agree |",
        "|---|---|---|---|---|",
    ]
    for result in results:
        scenes = ", ".join(f"`{scene}`" for scene in result.entry.scenes)
        lines.append(
            f"| [{result.entry.paper} {result.entry.number}](#{result.entry.name}) | {result.entry.title} | {scenes} "
            f"| {len(result.comparisons)} | {result.counted} |"
        )
    for paper, title in PAPERS.items():
        mine = [result for result in results if result.entry.paper == paper]
        if not mine:
            continue
        lines += ["", f"## {title}"]
        for result in mine:
            lines += [
                "",
                f"### {result.entry.name}",
                "",
                f"{result.entry.number}: {result.entry.title}. {result.entry.note}".strip(),
            ]
            lines += ["", f"![{result.entry.title}]({result.picture.name})", ""]
            lines += [f"The figure as [SVG]({result.picture.with_suffix('.svg').name}).", ""]
            lines += ["| number | ours | expected | source | bound | |", "|---|---|---|---|---|---|"]
            lines += [
                f"| {c.what} | {c.ours:.7g} {c.unit} | {f'{c.expected:.7g} {c.unit}' if c.compared else ''} "
                f"| {c.source} | {c.bound} | {c.result} |"
                for c in result.comparisons
            ]
    return "\n".join(lines) + "\n"
