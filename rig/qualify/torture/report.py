"""The results of the matrix as files: JSON for programs, JUnit for a build server."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from rig.machine.files import write_file
from rig.qualify.torture.cells import Cell
from rig.qualify.torture.picture import draw
from rig.record.provenance import provenance


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
