"""The description of a live run for the page: outputs, plots, colours, contact states, picture, values to change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rig.bus.run_setup import Setup
from rig.controllers import controller_drives
from rig.model.assembly import Assembly
from rig.scenes.scene import Scene
from rig.view import contact
from rig.view.channels import Channels
from rig.web.form import protocol
from rig.web.sound import audible


def description(
    setup: Setup,
    scene: Scene,
    assembly: Assembly,
    channels: Channels,
    contacts: Sequence[str],
    still: dict[str, Any] | None,
) -> dict[str, Any]:
    """Everything that a page needs in order to read the frames of a run (`rig.web.frames`).

    `contacts`: their names; `still`: the picture without what moves (`rig.web.picture`).
    """
    return {
        "run": setup.run,
        "scene": scene.name,
        "title": scene.title,
        "frame_s": setup.frame_ns * 1e-9,
        "paced": setup.paced,
        "outputs": [
            {"name": name, "unit": unit, "colour": channels.colours.get(name, "")}
            for name, unit in setup.outputs.items()
        ],
        "sensors": {
            name: {
                "unit": unit,
                "period_s": period * 1e-9,
                "colour": channels.colour_of(name),
                "factor": channels.measured[name].factor if name in channels.measured else 1.0,
                "reads": channels.measured[name].reads if name in channels.measured else "",
            }
            for name, (unit, period) in setup.sensors.items()
        },
        "plots": [
            {"title": one.title, "outputs": list(one.outputs), "sensors": list(one.sensors), "place": one.place}
            for one in channels.panels
        ],
        "portrait": list(channels.portrait) if channels.portrait else None,
        "modes": [{"name": name, "colour": colour} for name, colour in zip(contact.NAMES, contact.COLOURS)],
        "contacts": list(contacts),
        "controllers": {
            name: {"drives": list(controller_drives(one)), "in_plant": name in scene.in_plant}
            for name, one in scene.controllers.items()
        },
        "protocol": protocol(scene, assembly),
        "limits": scene.limits,
        "sound": audible(setup),
        "picture": still,
    }
