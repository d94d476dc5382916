"""The commands of controllers as channels: one for each actuator, held from frame to frame as the plant held them."""

from __future__ import annotations

import numpy as np

from rig.controllers import controller_drives
from rig.record.film_points import read
from rig.record.run_data import Integers, Reals, RunData, Samples
from rig.scenes.rooms import assembled

_ENDS = ("disconnected", "dismissed")


def commanded(run: RunData) -> tuple[str, ...]:
    """Return the actuators that controllers of `run` commanded."""
    return tuple(dict.fromkeys(actuator for name in run.commands for actuator in actuators(run).get(name, ())))


def unit_of(run: RunData, actuator: str) -> str:
    """Return the unit of an actuator of the run's scene; "" if the scene has no such actuator."""
    scene = read(run.scene)
    inputs = assembled(scene.parameters, scene.frame_ns, random=False).inputs if scene else {}
    return inputs[actuator].unit if actuator in inputs else ""


def held(run: RunData, actuator: str) -> Samples:
    """Return the commands to `actuator` in force at every frame (zero-order hold), from the first one on.

    A frame in which no controller commands it is NaN: after the controller was disconnected, up to its next command.
    """
    parts: list[tuple[Integers, Reals]] = []
    for name, driven in actuators(run).items():
        if actuator not in driven:
            continue
        found = run.commands[name]
        parts.append((found.tick, found.values[:, driven.index(actuator)]))
        ends = [e["tick"] for e in run.plant_events if e["kind"] in _ENDS and e["data"].get("controller") == name]
        parts.append((np.array(ends, np.int64), np.full(len(ends), np.nan)))
    tick, values = (np.concatenate(part) for part in zip(*parts))
    order = np.argsort(tick, kind="stable")
    tick, values = tick[order], values[order]
    end = round(float(run.time[-1]) * 1e9) // run.frame_ns if run.time.size else int(tick[-1])
    frames = np.arange(tick[0], max(end, int(tick[-1])) + 1)
    return Samples(frames * run.frame_ns, values[np.searchsorted(tick, frames, side="right") - 1])


def actuators(run: RunData) -> dict[str, tuple[str, ...]]:
    """Return the actuators of each controller with commands, of the scene or admitted while it ran.

    None if the recording lost its scene, or its code is not trusted.
    """
    scene = read(run.scene)
    if scene is None:
        return {}
    found = {name: controller_drives(section) for name, section in scene.controllers.items()}
    guests = [e["data"] for e in run.plant_events if e["kind"] == "admitted"]
    found |= {data["controller"]: tuple(data["drives"]) for data in guests}
    return {name: driven for name, driven in found.items() if name in run.commands and run.commands[name].tick.size
            and run.commands[name].values.shape[1] == len(driven)}  # fmt: skip
