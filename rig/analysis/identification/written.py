"""The scene that an identification writes, and the covariance beside it, from which a study draws.

The scene is based on the old one and contains the identified keys only. The covariance is that of the coordinates:
logarithms of the parameters, or the parameters over their unit where the range contains 0.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
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
    runs = counted(len(identified.best.runs), "run")
    about = [
        f"Parameters that rig identify found in {identified.task.where} on {today}: {runs}.",
        "Keys that it could not identify keep the values of the scene that this one is based on.",
    ]
    lines = {}
    for key, unit, value in _law_keys(identified):
        lines[key] = value if unit is None else stated(value, unit, "chosen", "of the law, not identified")
    where = Path(identified.task.where).name
    for p in identified.told:
        note = f"{where}, {today}, {runs}, 90 % {p.low:.6g} to {p.high:.6g}"
        lines[p.key] = stated(f"{p.value:.9g}", p.unit, "identified", note)
    return text_of(about, based_on, f"{identified.task.scene.title}, identified", lines)


def text_of(about: Iterable[str], based_on: str, title: str, values: Mapping[str, str]) -> str:
    """Return the text of a scene: what it says of itself, the scene that it is based on, values (TOML) by key."""
    lines = [
        *(f"# {line}" for line in about),
        f"format = {FORMAT}",
        f"based_on = {json.dumps(based_on)}",
        f"title = {json.dumps(title, ensure_ascii=False)}",
    ]
    tables: dict[str, list[str]] = {}
    for key, value in values.items():
        table, _, field = key.rpartition(".")
        tables.setdefault(table, []).append(f"{field} = {value}")
    for table, rows in tables.items():
        lines += ["", f"[{table}]", *rows]
    return "\n".join([*lines, ""])


def stated(value: str, unit: str, origin: str, note: str) -> str:
    """Return a value of a scene file with its origin and a note."""
    text = json.dumps(value if unit == "1" else f"{value} {unit}")
    return f"[{text}, {json.dumps(origin)}, {json.dumps(note)}]"


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
