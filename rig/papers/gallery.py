"""The gallery: several figures at once, the file of their numbers, and the page.

The file of numbers of a folder of figures: a figure can be made again while the page keeps the others.

Several figures at once, as a work of worker processes: each unit is one figure with its numbers.

The gallery as a page: every figure with its numbers, in Markdown.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

from rig.analysis.pool import Arrays, Progress, Work, carry_out, packed, temporary, unpacked
from rig.machine.files import DATA, contents, write_file
from rig.papers.entry import PAPERS, Comparison, Entry, Result, entries, make

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


def page(results: Sequence[Result], machine: str) -> str:
    """Return a page of pictures and tables, for the folder of the pictures."""
    lines = [
        "# Figures of the papers, reproduced",
        "",
        f"Made by `make docs` (`rig reproduce all`), the last of them on {machine}.",
        "",
        "A number agrees when it lies within the bound beside it. *Not reproduced*: it is known to lie outside.",
        "Sources: *paper*, printed there; *reference*, an independent computation of the same equations with the same",
        "parameters; *theory*, a closed form.",
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
