"""The scene that an identification writes, and the covariance beside it, from which a study draws.

The scene is based on the old one and contains the identified keys only. The covariance is that of the coordinates:
logarithms of the parameters, or the parameters over their unit where the range contains 0.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from rig.analysis.identification.answer import Identified, Parameter
from rig.analysis.identification.runs import Free
from rig.errors import UsageError
from rig.machine.files import write_file
from rig.printable import counted
from rig.scenes.scene import Scene
from rig.scenes.source import FORMAT

ENDING = ".covariance.json"


def write(identified: Identified, out: Path, based_on: str) -> tuple[Path, Path]:
    """Write the scene `out` and its covariance; return both paths. `based_on`: name or file of the old scene.

    Raises UsageError if nothing is identified, OutputError if a file cannot be written.
    """
    if not identified.told:
        raise UsageError(f"{out} is not written: no parameter is identified")
    beside = out.with_name(f"{out.stem}{ENDING}")
    write_file(out, scene_text(identified, base_of(based_on, out)).encode())
    write_file(beside, (json.dumps(covariance(identified), indent=1) + "\n").encode())
    return out, beside


def base_of(based_on: str, out: Path) -> str:
    """Return how the scene file `out` names the scene that it is based on: one beside it, or below, by its file."""
    if not based_on.endswith(".toml"):
        return based_on
    folder = out.parent.resolve()
    base = Path(based_on).resolve()
    if base.is_relative_to(folder):
        base = base.relative_to(folder)
    return base.as_posix()


def scene_text(identified: Identified, based_on: str) -> str:
    """The text of the scene."""
    today = datetime.now(UTC).date().isoformat()
    scene = identified.task.scene
    runs = len(identified.best.runs)
    lines = [
        f"# Parameters that rig identify found in {identified.task.where} on {today}: {counted(runs, 'run')}.",
        "# Keys that it could not identify keep the values of the scene that this one is based on.",
        f"format = {FORMAT}",
        f"based_on = {json.dumps(based_on)}",
        f"title = {json.dumps(f'{scene.title}, identified', ensure_ascii=False)}",
    ]
    tables: dict[str, list[str]] = {}
    for key, unit, value in _law_keys(identified):
        table, _, field = key.rpartition(".")
        line = f"{field} = {value}"
        if unit is not None:
            line = value_line(field, value, unit, "chosen", "of the law, not identified")
        tables.setdefault(table, []).append(line)
    where = Path(identified.task.where).name
    for p in identified.told:
        table, _, field = p.key.rpartition(".")
        note = f"{where}, {today}, {counted(runs, 'run')}, 90 % {p.low:.6g} to {p.high:.6g}"
        tables.setdefault(table, []).append(value_line(field, f"{p.value:.9g}", p.unit, "identified", note))
    for table, rows in tables.items():
        lines += ["", f"[{table}]", *rows]
    return "\n".join([*lines, ""])


def covariance(identified: Identified) -> dict[str, Any]:
    """The covariance of the identified parameters as JSON values, with what it is of."""
    best = identified.best
    told = {p.key: p for p in identified.told}
    index = [i for i, free in enumerate(best.law.free) if free.key in told]
    return {
        "scene": identified.task.scene.name,
        "law": best.law.name,
        "runs": [run.name for run in best.runs],
        "parameters": [_as_json(best.law.free[i], told) for i in index],
        "covariance": np.asarray(best.covariance)[np.ix_(index, index)].tolist(),
    }


def value_line(field: str, value: str, unit: str, origin: str, note: str) -> str:
    """Return the line of a scene file with a value, its origin and a note."""
    text = json.dumps(value if unit == "1" else f"{value} {unit}")
    return f"{field} = [{text}, {json.dumps(origin)}, {json.dumps(note)}]"


def _law_keys(identified: Identified) -> list[tuple[str, str | None, str]]:
    """Keys of another law than that of the scene: its name, what it needs, and "none" for those that it lacks."""
    old = _friction(identified.task.scene)
    new = _friction(identified.best.law.scene)
    if old.get("law") == new.get("law"):
        return []
    told = {p.key for p in identified.told}
    keys: list[tuple[str, str | None, str]] = [("friction.law", None, json.dumps(identified.best.law.name))]
    keys += [(f"friction.{key}", None, '"none"') for key in old if key not in new]
    fitted = {p.key: p for p in identified.parameters}
    for field, value in new.items():
        key = f"friction.{field}"
        if field == "law" or key in told or not isinstance(value, float):
            continue
        p = fitted.get(key)
        keys.append((key, "1", f"{value:.9g}") if p is None else (key, p.unit, f"{p.value:.9g}"))
    return keys


def _friction(scene: Scene) -> dict[str, Any]:
    friction = getattr(scene.parameters, "friction", None)
    return dict(friction.model_dump(exclude_none=True)) if friction is not None else {}


def _as_json(free: Free, told: Mapping[str, Parameter]) -> dict[str, Any]:
    """A parameter with its coordinate: logarithm, or value over `size`."""
    return {
        "key": free.key,
        "unit": free.unit,
        "value": told[free.key].value,
        "log": free.log,
        "size": free.size,
        "from": free.low,
        "to": free.high,
    }
