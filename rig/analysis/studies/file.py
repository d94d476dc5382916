"""A study as a TOML file.

scene = "belt"                              a shipped scene, or a file beside this one
measure = ["cycle.amplitude", "mine.py:late"]
samples = 64                                and the other arguments of rig.study

[set]                                       changed values, as with -p
"body.damping" = "2 N*s/m"

[over]
"load.force" = "10 N:30 N:5"
"friction.mu_static" = "normal(0.4, 0.02)"
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rig.errors import SceneError, UsageError
from rig.scenes import places, source
from rig.scenes.faults import near
from rig.scenes.places import Place
from rig.units import si

_KINDS: dict[str, tuple[type, ...]] = {
    "scene": (str,),
    "measure": (str, list),
    "over": (dict,),
    "set": (dict,),
    "samples": (int,),
    "sampling": (str,),
    "repeat": (int,),
    "seed": (int,),
    "duration": (str, int, float),
    "keep": (str,),
}


@dataclass(frozen=True)
class StudyFile:
    """What a file says: `scene`, `changes` of its values and their `places`, `given`: other arguments of a study."""

    scene: str
    changes: dict[str, Any]
    places: dict[str, Place]
    given: dict[str, Any] = field(default_factory=dict)


def is_study(path: Path) -> bool:
    """Return whether a file is a study: TOML with a scene, measures or varied parameters."""
    try:
        return bool(source.tree(path).keys() & {"scene", "measure", "over"})
    except SceneError:
        return False


def read(path: Path) -> StudyFile:
    """Read a study. Raises SceneError for a file that is not TOML, UsageError with every fault of a study."""
    text = source.text(path)
    raw = source.parsed(path, text)
    faults = []
    for key, value in raw.items():
        if key not in _KINDS:
            faults.append(f"{key}: unknown; {near(key, _KINDS)}")
        elif isinstance(value, bool) or not isinstance(value, _KINDS[key]):
            faults.append(f"{key} = {value!r:.60}: expected {' or '.join(kind.__name__ for kind in _KINDS[key])}")
    if "scene" not in raw:
        faults.append('scene: is missing; expected the name of a scene, such as scene = "belt"')
    duration = raw.get("duration")
    if isinstance(duration, _KINDS["duration"]) and not isinstance(duration, bool):
        try:
            duration = si(duration, "s")
        except ValueError as fault:
            faults.append(f"duration {fault}")
    tables = {name: list(source.dotted(raw[name])) for name in ("over", "set") if isinstance(raw.get(name), dict)}
    for name, entries in tables.items():
        counts = Counter(key for key, _ in entries)
        faults += [f"{name}: {key} is given {count} times" for key, count in counts.items() if count > 1]
    over, changes = (dict(tables.get(name, ())) for name in ("over", "set"))
    faults += [f"{key}: is set and varied; leave it out of [set] or of [over]" for key in over if key in changes]
    if faults:
        raise UsageError("\n".join(f"{path}: {line}" for line in faults))
    measure = raw.get("measure", [])
    measure = [measure] if isinstance(measure, str) else measure
    arguments: dict[str, Any] = {
        name: raw[name] for name in ("samples", "sampling", "repeat", "seed", "keep") if name in raw
    }
    arguments |= {"duration": duration} if duration is not None else {}
    arguments |= {"over": over, "measure": [_beside(path, name) for name in measure]}
    scene, lines = raw["scene"], places.lines(text)
    given = {key: Place(str(path), lines[f"set.{key}"]) for key in changes}
    return StudyFile(_beside(path, scene) if scene.endswith(".toml") else scene, changes, given, arguments)


def _beside(path: Path, name: Any) -> Any:
    """A file that is named in a study, relative to the study's folder."""
    if not isinstance(name, str) or not (name.endswith(".toml") or ".py:" in name) or Path(name).is_absolute():
        return name
    return str(path.parent / name)
