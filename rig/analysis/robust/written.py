"""The scene that a design writes: based on the old one, with the designed values only, and the origin "designed"."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

from rig.analysis.identification.written import base_of, stated, text_of
from rig.analysis.robust.proof import PROVED
from rig.analysis.robust.result import DESIGNED, RobustResult
from rig.errors import UsageError
from rig.machine.files import write_file


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
    against = ", ".join(f"{key} {tolerance}" for key, tolerance in result.tolerances.items())
    about = [
        f"Values that rig optimise designed on {today} against {against or 'nothing'}.",
        f"{job.measure}: the worst rig found grows with {result.worst:.6g} 1/s, of {result.found.assembled} rigs.",
    ]
    lines: dict[str, str] = {}
    for key, (value, unit) in job.scene.values().items():  # what -p has changed belongs to the scene that was designed
        if key in job.scene.origins and job.scene.origins[key].origin == "user" and key not in result.values:
            text = value if isinstance(value, bool) or unit in ("", "1") else f"{value} {unit}"
            lines[key] = f'[{json.dumps(text)}, "user"]'
    margins = _margins(result)
    for axis in job.box.free:
        tolerance = f", tolerance {result.tolerances[axis.key]}" if axis.key in result.tolerances else ""
        note = f"rig optimise, {today}{tolerance}; {margins}"
        lines[axis.key] = stated(repr(result.values[axis.key]), axis.unit, DESIGNED, note)
    return text_of(about, based_on, f"{job.scene.title}, designed", lines)


def _margins(result: RobustResult) -> str:
    """The growth of nominal and worst rig and the share of random rigs that grow, which rig explain shows."""
    count = len(result.found.audit.growth)
    nominal = result.found.entries[0].nominal[0]
    margins = f"growth of the nominal rig {nominal:.5g} 1/s, of the worst one {result.worst:.5g} 1/s"
    proof = result.certificate
    known = "; no rig of the box grows (proved)" if proof is not None and proof.verdict == PROVED else ""
    return f"{margins}; {result.growing} of {count} random rigs grow{known}"
