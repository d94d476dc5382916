"""The scene that a design writes: based on the old one, with the designed values only, and the origin "designed"."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

from rig.analysis.identification.written import base_of, value_line
from rig.analysis.robust.certificate import PROVED
from rig.analysis.robust.result import DESIGNED, RobustResult
from rig.errors import UsageError
from rig.machine.files import write_file
from rig.scenes.source import FORMAT


def write(result: RobustResult, out: Path, based_on: str) -> Path:
    """Write the designed scene `out`, based on the scene with this name or file, and return its path.

    Raises UsageError if nothing is designed, OutputError if the file cannot be written.
    """
    if not result.job.box.free:
        raise UsageError(f"{out} is not written: no value is free, so that nothing is designed")
    write_file(out, scene_text(result, base_of(based_on, out)).encode())
    return out


def scene_text(result: RobustResult, based_on: str) -> str:
    """Return the text of the designed scene."""
    job = result.job
    today = datetime.now(UTC).date().isoformat()
    against = ", ".join(f"{value.key} {result.tolerance(value)}" for value in job.box.uncertain)
    lines = [
        f"# Values that rig optimise designed on {today} against {against or 'nothing'}.",
        f"# {job.measure}: the worst rig found grows with {result.worst:.6g} 1/s, of {result.found.assembled} rigs.",
        f"format = {FORMAT}",
        f"based_on = {json.dumps(based_on)}",
        f"title = {json.dumps(f'{job.scene.title}, designed', ensure_ascii=False)}",
    ]
    tables: dict[str, list[str]] = {}
    for key, (value, unit) in job.scene.values().items():  # what -p has changed belongs to the scene that was designed
        if key in job.scene.origins and job.scene.origins[key].origin == "user" and key not in result.values:
            table, _, field = key.rpartition(".")
            text = value if isinstance(value, bool) or unit in ("", "1") else f"{value} {unit}"
            tables.setdefault(table, []).append(f'{field} = [{json.dumps(text)}, "user"]')
    tolerances = {value.key: result.tolerance(value) for value in job.box.uncertain}
    margins = _margins(result)
    for axis in job.box.free:
        table, _, field = axis.key.rpartition(".")
        tolerance = f", tolerance {tolerances[axis.key]}" if axis.key in tolerances else ""
        note = f"rig optimise, {today}{tolerance}; {margins}"
        line = value_line(field, repr(result.values[axis.key]), axis.unit, DESIGNED, note)
        tables.setdefault(table, []).append(line)
    for table, rows in tables.items():
        lines += ["", f"[{table}]", *rows]
    return "\n".join([*lines, ""])


def _margins(result: RobustResult) -> str:
    """The growth of nominal and worst rig and the share of random rigs that grow, which rig explain shows."""
    growths = result.found.audit.growth
    nominal = result.found.entries[0].nominal[0]
    grow = int((growths > 0.0).sum())
    margins = f"growth of the nominal rig {nominal:.5g} 1/s, of the worst one {result.worst:.5g} 1/s"
    proof = result.certificate
    known = "; no rig of the box grows (proved)" if proof is not None and proof.verdict == PROVED else ""
    return f"{margins}; {grow} of {len(growths)} random rigs grow{known}"
