"""The gallery of the figures of the papers.

Several figures are made at once in worker processes. The file of their numbers keeps the results of earlier calls, so
that a figure that is made again leaves the others on the page, which is written in Markdown.
"""

from __future__ import annotations

import difflib
import importlib
import io
import json
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import fields
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from rig.analysis.pool import Arrays, Progress, Work, carry_out, packed, temporary, unpacked
from rig.errors import UsageError
from rig.machine.files import DATA, contents, write_file
from rig.papers.entry import PAPERS, Comparison, Entry, Result
from rig.view.palette import BARE, encoded, page, put

ROOMS = (
    "kroeger",
    "kroeger_brake",
    "kroeger_squeal",
    "kroeger_shunt",
    "kroeger_loops",
    "liu_dither_belt",
    "liu_dither_disc",
    "liu_lever",
    "liu_regions",
    "detachment_four_dof",
    "detachment_modes",
    "detachment_time",
    "bistable",
)
"""The modules of the figures, in the order of the papers."""
_MOST_POINTS = 1500  # of a curve in an SVG file
_PLAIN: dict[str, Any] = {"colors": 96}  # colours of a picture: reduces it to a third of the bytes
_MAPPED: dict[str, Any] = {"colors": 256, "method": 2}  # octree: few colours would make steps in a colour bar
_FILE = "numbers.json"


@cache
def entries() -> dict[str, Entry]:
    """Return every entry by name, in the order of the papers."""
    by_name: dict[str, Entry] = {}
    for room in ROOMS:
        module = importlib.import_module(f"rig.papers.{room}")
        by_name |= {entry.name: entry for entry in module.ENTRIES}
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


def keep(results: Iterable[Result], folder: Path) -> list[Result]:
    """Write `results` into `folder`, replacing older ones of the same figures; return all, in the order of the
    papers.
    """
    by_name = {result.entry.name: result for result in (*kept(folder), *results)}
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


def kept(folder: Path) -> list[Result]:
    """The results of earlier calls, for figures that still exist."""
    try:
        read = json.loads(contents(folder / _FILE, DATA))
    except (OSError, ValueError):
        return []
    return [restored(saved, folder) for saved in read if saved["name"] in entries()]


def _compared(raw: dict[str, Any]) -> Comparison:
    values = {field.name: raw[field.name] for field in fields(Comparison) if field.name in raw}
    for name in ("ours", "expected"):
        if raw[name] is None:
            values[name] = math.nan
    return Comparison(**values)


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
    head = (
        "# Figures of the papers, reproduced",
        "",
        f"Made by `rig tool reproduce`, the last of them on {machine}.",
        "",
    )
    return "\n".join((*head, *gallery_tables(results))) + "\n"


def gallery_tables(results: Sequence[Result]) -> list[str]:
    """Return the lines of the page below its head: a table of the figures, then each figure with its numbers."""
    lines = [
        "A number agrees when it lies within the bound beside it. *Not reproduced*: it is known to lie outside.",
        "Sources: *paper*, printed there; *reference*, an independent computation of the same equations with the same",
        "parameters; *theory*, a closed form; *coarser*, ours with a coarser resolution.",
        "",
        "| figure | what | scenes | numbers | agree |",
        "|---|---|---|---|---|",
    ]
    for result in results:
        entry = result.entry
        scenes = ", ".join(f"`{scene}`" for scene in entry.scenes)
        lines.append(
            f"| [{entry.paper} {entry.number}](#{entry.name}) | {entry.title} | {scenes} "
            f"| {len(result.comparisons)} | {result.counted} |"
        )
    for paper, title in PAPERS.items():
        of_paper = [result for result in results if result.entry.paper == paper]
        if of_paper:
            lines += ["", f"## {title}"]
        for result in of_paper:
            lines += _section(result)
    return lines


def _section(result: Result) -> list[str]:
    """The lines of a figure on the page: its note, its picture, and the table of its numbers."""
    entry = result.entry
    lines = [
        "",
        f"### {entry.name}",
        "",
        f"{entry.number}: {entry.title}. {entry.note}".strip(),
        "",
        f"![{entry.title}]({result.picture.name})",
        "",
        f"The figure as [SVG]({result.picture.with_suffix('.svg').name}).",
        "",
        "| number | ours | expected | source | bound | |",
        "|---|---|---|---|---|---|",
    ]
    for comparison in result.comparisons:
        unit = comparison.unit
        expected = f"{comparison.expected:.7g} {unit}" if comparison.compared else ""
        lines.append(
            f"| {comparison.what} | {comparison.ours:.7g} {unit} | {expected} "
            f"| {comparison.source} | {comparison.bound} | {comparison.result} |"
        )
    return lines
