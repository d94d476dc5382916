"""The results of the matrix as files: JSON for programs, JUnit for a build server.

The matrix as a picture: a row for each case, a column for each method and step, colour and reason.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from rig.machine.files import write_file
from rig.qualify.torture.cells import METHODS, Cell
from rig.record.provenance import provenance
from rig.view.palette import page, put

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def keep(cells: Sequence[Cell], folder: Path, quick: bool) -> None:
    """Write matrix.json, matrix.png, matrix.svg and junit.xml into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    machine = provenance(0, ())
    matrix = {"quick": quick, "machine": machine, "cells": [cell.to_json() for cell in cells]}
    write_file(folder / "matrix.json", json.dumps(matrix, indent=1, ensure_ascii=False, default=str).encode())
    junit(cells, folder / "junit.xml")
    line = f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}, numba {machine['numba']}"
    for ending in ("png", "svg"):
        draw(cells, folder / f"matrix.{ending}", line)


def junit(cells: Sequence[Cell], path: Path) -> None:
    """Write a test for each cell. Only the default can fail; other methods that are not green are skipped with the
    reason.
    """
    suite = ElementTree.Element("testsuite", name="rig tool torture")
    failures = skipped = 0
    for cell in cells:
        element = ElementTree.SubElement(
            suite,
            "testcase",
            classname=cell.case,
            name=f"{cell.method} {cell.step:g} s",
            time=f"{cell.seconds:.3f}",
        )
        result = cell.result
        verdict = f"{result.colour}: {result.reason}"
        if not cell.good:
            failures += 1
            ElementTree.SubElement(element, "failure", message=verdict).text = result.detail
        elif result.colour != "green":
            skipped += 1
            ElementTree.SubElement(element, "skipped", message=f"{verdict}: {result.detail}")
    suite.attrib |= {"tests": str(len(cells)), "failures": str(failures), "skipped": str(skipped)}
    write_file(path, ElementTree.tostring(suite, encoding="utf-8", xml_declaration=True))


COLOURS = {"green": "#bfe0cb", "amber": "#f6dfae", "red": "#e59c90"}
SPEED = "real time"
"""Heading of the column with the real-time factors of the default, which are no test results and have no colour."""
NOTE = "Steps are side by side, the coarsest first. Blank: not run. Real time: real-time factor of the default."
_STYLE: dict[str, Any] = {"font.size": 8.5, "axes.titlelocation": "left"}
_ROW, _COLUMN, _NAMES, _ABOVE, _BELOW, _LEAST = 0.19, 0.76, 2.35, 1.05, 0.45, 6.5  # inches
Rows = list[tuple[str, str]]


def draw(cells: Sequence[Cell], path: Path, machine: str) -> None:
    """Draw the matrix (PNG, SVG, or as `path` ends), so that it fits a page across: hard cases on the left, on the
    right the cases of every scene, if there are some.
    """
    blocks = [(rows, _methods(cells, rows)) for rows in _blocks(cells)]
    width = max(sum(_NAMES + _COLUMN * len(methods) for _, methods in blocks) + 0.2, _LEAST)
    height = _ROW * max(len(rows) for rows, _ in blocks) + _ABOVE + _BELOW
    with page(width, height, style=_STYLE) as figure:
        left = 0.0
        for rows, methods in blocks:
            size = _COLUMN * len(methods) / width, _ROW * len(rows) / height
            left += _NAMES
            axes = figure.add_axes((left / width, 1.0 - _ABOVE / height - size[1], *size))
            left += _COLUMN * len(methods)
            _block(axes, cells, rows, methods)
        bad = sum(not cell.good for cell in cells)
        few = "one cell of the default is" if bad == 1 else f"{bad} cells of the default are"
        counted = f"{few} not green" if bad else "the default is green everywhere"
        figure.text(0.01, 1.0 - 0.28 / height, f"Hard cases by methods: {counted}", fontsize=13, fontweight="bold")
        figure.text(0.01, 1.0 - 0.50 / height, NOTE, fontsize=8, color="0.3")
        figure.text(0.01, 0.15 / height, machine, fontsize=7.5, color="0.4")
        put(figure, path)


def _blocks(cells: Sequence[Cell]) -> list[Rows]:
    """Cases in order, each with the name of its row, and apart from them those of every scene, under their heading,
    which has no case.
    """
    cases = list(dict.fromkeys(cell.case for cell in cells))
    alone = [(case, case.replace("_", " ")) for case in cases if ":" not in case]
    scenes: Rows = []
    for group in dict.fromkeys(case.split(":")[0] for case in cases if ":" in case):
        scenes.append(("", group.replace("_", " ")))
        scenes += [(case, case.split(":")[1].replace("_", " ")) for case in cases if case.startswith(f"{group}:")]
    return [rows for rows in (alone, scenes) if rows]


def _methods(cells: Sequence[Cell], rows: Rows) -> list[str]:
    """The columns of a block: methods that one of its cases was run with."""
    cases = {case for case, _ in rows}
    own = [cell for cell in cells if cell.case in cases]
    methods = [m for m in ("default", "processes", *METHODS) if any(m in _columns(cell) for cell in own)]
    return [*methods, *([SPEED] if any(_timed(cell) for cell in own) else [])]


def _timed(cell: Cell) -> bool:
    """Whether the column of real-time factors shows this cell."""
    return cell.default and cell.speed is not None


def _block(axes: Axes, cells: Sequence[Cell], rows: Rows, methods: list[str]) -> None:
    for row, (case, _) in enumerate(rows):
        for column, method in enumerate(methods):
            own = [cell for cell in cells if cell.case == case and method in _columns(cell)]
            for at, cell in enumerate(own):
                _box(axes, column + at / len(own), row, 1.0 / len(own), cell)
        if SPEED in methods:
            speeds = [f"{cell.speed:.2g}" for cell in cells if cell.case == case and _timed(cell)]
            axes.text(methods.index(SPEED) + 0.5, row + 0.52, "  ".join(speeds), ha="center", va="center", fontsize=5.0)
    axes.set(xlim=(0, len(methods)), ylim=(len(rows), 0))
    axes.set_yticks([row + 0.5 for row in range(len(rows))], [name for _, name in rows])
    for (case, _), label in zip(rows, axes.get_yticklabels()):
        label.set_fontweight("normal" if case else "bold")
    axes.set_xticks([column + 0.5 for column in range(len(methods))], methods)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _columns(cell: Cell) -> tuple[str, ...]:
    """The columns of a cell: the default has one column, and processes have one."""
    return ("default",) if cell.default and cell.method != "processes" else (cell.method,)


def _box(axes: Axes, x: float, y: int, width: float, cell: Cell) -> None:
    from matplotlib.patches import Rectangle

    colour = COLOURS[cell.result.colour]
    axes.add_patch(Rectangle((x + 0.015, y + 0.06), width - 0.03, 0.88, facecolor=colour, edgecolor="none"))
    text = cell.result.reason or (cell.method if "default" in _columns(cell) else "")
    if text:
        narrow = width < 0.6
        axes.text(
            x + 0.5 * width,
            y + 0.52,
            text.replace(" ", "\n") if narrow else text,
            ha="center",
            va="center",
            fontsize=6.5 if width > 0.3 and not (narrow and " " in text) else 5.0,
            linespacing=0.85,
        )
