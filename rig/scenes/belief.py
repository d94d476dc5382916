"""What the controllers of a scene believe of the rig: they are designed for the scene, not for what it is varied to.

    a scene file, -p, overrides of rig.load           the scene: its controllers are designed for it
    what is varied afterwards, `--untold KEY=VALUE`   the rig has the new value, controllers keep the one of the scene
    set-points (speed of the drive, load) varied      an operator sets them and tells the controllers
    `--redesign`                                      controllers are told of all that is varied

`Scene.believed` holds the values that differ, and `rig.design` designs controllers for `Scene.designed_for`. A changed
value of a controller is its own: it is designed anew with it, for what it believes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from rig.errors import SceneError, UsageError
from rig.scenes import sections
from rig.scenes.faults import lookup, near, shortened
from rig.scenes.scene import Scene


class Belief(NamedTuple):
    """One value of the rig (SI, in `unit`) of which its controllers believe another one."""

    key: str
    unit: str
    rig: Any
    believed: Any


def varied(scene: Scene, values: Mapping[str, Any], seed: int | None = None, by_operator: bool = True) -> Scene:
    """Return `scene` with varied values (SI) of dotted keys, and a seed; see the head of this file for what is told.

    `by_operator`: whether an operator sets set-points; else they are errors of the rig that nobody knows of.

    Raises SceneError if it refuses a value.
    """
    made = scene.with_values(values, seed)
    if not scene.controllers:
        return made
    believed = dict(scene.believed)
    for key in values:
        if scene.redesign or (by_operator and _is_set_point(scene, key)):
            believed.pop(key, None)
        elif not key.startswith("controllers."):
            believed.setdefault(key, _value(scene, key))
    return replace(made, believed=believed) if believed != scene.believed else made


def untold(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Return `scene` with a rig that its controllers do not know: `values` (SI, or texts with units) by dotted key.

    Raises UsageError for a scene without controllers and for keys of anything but the rig and its sensors, SceneError
    if the scene refuses a value.
    """
    if not values:
        return scene
    if not scene.controllers:
        raise UsageError(
            f"untold {', '.join(values)}: {scene.name} has no controller that could not know of it; -p gives the rig "
            "this value"
        )
    known = [key for key in scene.values() if _of_rig(scene, key)]
    faults = [f"untold {shortened(key)}: {_why_not(scene, key, known)}" for key in values if not _exists(scene, key)]
    if faults:
        raise UsageError("\n".join(faults))
    believed = {key: _value(scene, key) for key in values}
    try:
        made = scene.with_values(values)
    except SceneError as fault:
        raise SceneError(scene.name, [f"untold {line}" for line in fault.faults]) from None
    return replace(made, believed=believed | scene.believed)


def believing(scene: Scene, values: Mapping[str, Any], redesign: bool) -> Scene:
    """Return `scene` with the `untold` values; with `redesign` its controllers are told of all that is varied.

    Raises as `untold`, and UsageError for a redesign of a scene without controllers.
    """
    if redesign and not scene.controllers:
        raise UsageError(f"redesign: {scene.name} has no controllers that could be designed anew")
    made = untold(scene, values)
    return replace(made, redesign=True) if redesign else made


def beliefs(scene: Scene) -> Iterator[Belief]:
    """Yield each value of which the controllers of `scene` believe another one."""
    if not scene.believed:
        return
    values = scene.values()
    believed = scene.designed_for.values()
    nothing = (None, "")
    for key in scene.believed:
        value, unit = values.get(key, nothing)
        told, own = believed.get(key, nothing)
        if value != told:
            yield Belief(key, unit or own, value, told)


def lines(scene: Scene) -> list[str]:
    """Return one line for each of the `beliefs`, and one if controllers are told of what is varied."""
    told = []
    for belief in beliefs(scene):
        believed = _text(belief.believed, belief.unit)
        told.append(f"controllers believe {belief.key} = {believed}; the rig has {_text(belief.rig, belief.unit)}")
    if scene.redesign:
        told.append("controllers are designed anew for each rig (redesign)")
    return told


def of_varied(scene: Scene, keys: list[str]) -> list[str]:
    """Return the lines of a result over `keys` on what its controllers are told. Empty for a scene without any."""
    if not scene.controllers or scene.redesign:
        return lines(scene)
    rig = [key for key in keys if not key.startswith("controllers.")]
    told = [key for key in rig if _is_set_point(scene, key)]
    rest = [key for key in rig if key not in told]
    out = lines(scene)
    if told:
        out.append(f"controllers are told {', '.join(told)}: an operator sets it")
    if rest:
        what = ", ".join(rest)
        out.append(f"controllers are not told {what}: they are designed for the scene (--redesign tells them)")
    return out


def _text(value: Any, unit: str) -> str:
    if isinstance(value, float):
        number = f"{value:.9g}"
    else:
        number = "none" if value is None else str(value)
    return f"{number} {unit}" if unit not in ("", "1") else number


def _section(scene: Scene, key: str) -> tuple[Any, str]:
    """The section that has a value, and its key there."""
    room, name, inner = sections.parted(key)
    return (getattr(scene, room)[name], inner) if room else (scene.parameters, inner)


def _is_set_point(scene: Scene, key: str) -> bool:
    return sections.is_set_point(*_section(scene, key))


def _value(scene: Scene, key: str) -> Any:
    section, inner = _section(scene, key)
    return lookup(section.model_dump(), inner.split("."))


def _of_rig(scene: Scene, key: str) -> bool:
    """Whether a value belongs to the rig or to one of its sensors."""
    room = sections.parted(key)[0]
    return room == "sensors" or (not room and key.partition(".")[0] in type(scene.parameters).model_fields)


def _exists(scene: Scene, key: str) -> bool:
    """Whether a key names a value of the rig or of a sensor, even one that the scene leaves out."""
    room, name, _ = sections.parted(key)
    if not _of_rig(scene, key) or (room and name not in scene.sensors):
        return False
    return sections.field_of(*_section(scene, key)) is not None


def _why_not(scene: Scene, key: str, known: list[str]) -> str:
    if key.partition(".")[0] == "controllers":
        return "is a value of a controller, which knows it; -p changes it"
    if not _of_rig(scene, key) and key in scene.values():
        return "is no value of the rig or of a sensor, so that no controller is designed for it; -p changes it"
    return f"is no value of this rig; {near(key, known)}"
