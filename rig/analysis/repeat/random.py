"""What of a scene depends on its seed: process noise, noise of sensors, drop-outs."""

from __future__ import annotations

from rig.scenes.effects import optional
from rig.scenes.scene import Scene

REMEDY = (
    "Process noise disturbs the rig where a knock would strike: -p noise.force=1e-6 (N/Hz^0.5); or give a sensor "
    "noise: -p sensors.NAME.noise=..."
)


def sources(scene: Scene) -> tuple[str, ...]:
    """The random parts of `scene`; empty where runs with two seeds are the same."""
    effects = [one for one in optional(scene.parameters) if one.given and one.about.random]
    found = [f"{one.key}.{one.about.random}" for one in effects]
    found = [key for key in found if scene.values()[key][0] > 0.0]
    for name, section in scene.sensors.items():
        end = section.front_end()
        found += [f"sensors.{name}.noise"] if end.noise > 0.0 else []
        found += [f"sensors.{name}.dropout_rate"] if end.dropout_rate > 0.0 else []
    return tuple(found)
