"""Controllers that a caller gives as objects, for a run in this process.

A system of python-control becomes a table of the scene (`kind = "lti"`), so that the recording contains it. Any other
object takes part as a guest: it is admitted before the first tick, as a controller that joins a live run, and the
recording contains its commands. Both replace a controller of the same name, and keep the delay of its loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from rig.controllers.blocks.base import Controller
from rig.controllers.lti import LTI, of_python_control
from rig.controllers.runtime.file import faults_of
from rig.errors import SceneError, UsageError
from rig.scenes import checks
from rig.scenes.controller_files import changes
from rig.scenes.scene import Scene


class Guest(NamedTuple):
    """A controller that is admitted to a run; `delay_ns`: additional delay of its loop."""

    controller: Controller
    delay_ns: int = 0


def divided(given: Mapping[str, Any], by_name: bool) -> tuple[dict[str, object], dict[str, Any]]:
    """The changes that add the files among `given` to a scene, and the objects among `given`.

    `by_name`: the scene is given by its name, and not loaded yet. Raises UsageError for a file that is none.
    """
    files = {name: one for name, one in given.items() if isinstance(one, str | Path)}
    if files and not by_name:
        name, file = next(iter(files.items()))
        raise UsageError(
            f"controller {name}: {file} is a file, and the scene is loaded already; load the scene with it: "
            f'rig.load(SCENE, {{"controllers.{name}.kind": "{file}"}}), or name the scene instead'
        )
    return changes(files), {name: one for name, one in given.items() if name not in files}


def placed(scene: Scene, given: Mapping[str, Any]) -> tuple[Scene, dict[str, Guest]]:
    """The scene with the linear systems of `given` and without the controllers that guests replace; and the guests.

    Raises UsageError for objects that are no controllers, SceneError for those that do not fit the scene.
    """
    sections: dict[str, LTI] = {}
    guests: dict[str, Guest] = {}
    faults: list[str] = []
    for name, one in given.items():
        former = scene.controllers.get(name)
        if type(one).__module__.partition(".")[0] == "control":
            kept = {} if former is None else former.model_dump(include={"delay", "where"})
            try:
                sections[name] = _linear(one, kept)
            except ValidationError as error:
                lines = [one["msg"].removeprefix("Value error, ") for one in error.errors(include_url=False)]
                faults += [f"{name}: {line}" for line in lines]
            except ValueError as fault:
                faults.append(f"{name}: {fault}")
        elif isinstance(one, type):
            faults.append(f"{name}: is the class {one.__name__}; give an object of it, {one.__name__}()")
        else:
            faults += [f"{name}: {fault}" for fault in faults_of(one)]
            guests[name] = Guest(one, 0 if former is None else former.delay)
    if faults:
        raise UsageError("\n".join(faults))
    if not given:
        return scene, guests
    stay = {name: one for name, one in scene.controllers.items() if name not in guests}
    made = replace(scene, controllers=stay | sections)
    if sections:
        _check(made)
    return made, guests


def _linear(system: Any, kept: Mapping[str, Any]) -> LTI:
    import control

    linear = isinstance(system, control.StateSpace | control.TransferFunction)
    if linear and system.dt == 0 and not isinstance(system.dt, bool):
        raise ValueError(
            "is continuous; control.c2d(system, period, method) discretises it, for example at 1e-3 s by 'tustin'"
        )
    return of_python_control(system, **kept)


def _check(scene: Scene) -> None:
    """Raise SceneError if a controller does not fit the frames, sensors, actuators or protocol of its scene."""
    inputs = scene.assemble().inputs
    found = [
        *checks.periods(scene.clock, scene.controllers, {}),
        *checks.wiring(scene.controllers, scene.sensors, inputs, scene.plant),
        *checks.hands_off(scene.protocol, scene.controllers),
    ]
    if found:
        raise SceneError(scene.name, [line for _, line in found])
