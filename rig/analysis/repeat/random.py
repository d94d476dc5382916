"""The parts of a scene that depend on its seed: process noise, sensor noise, drop-outs."""

from __future__ import annotations

from rig.scenes.effects import optional
from rig.scenes.scene import Scene

REMEDY = (
    "Add process noise, a random force at the place of a knock: -p noise.force=1e-6 (N/Hz^0.5); or add sensor "
    "noise: -p sensors.NAME.noise=..."
)


def sources(scene: Scene) -> tuple[str, ...]:
    """Return the random parts of `scene`; empty if two seeds give the same run."""
    effects = [one for one in optional(scene.parameters) if one.given and one.about.random]
    found = [f"{one.key}.{one.about.random}" for one in effects]
    found = [key for key in found if scene.values()[key][0] > 0.0]
    for name, section in scene.sensors.items():
        end = section.front_end()
        found += [f"sensors.{name}.noise"] if end.noise > 0.0 else []
        found += [f"sensors.{name}.dropout_rate"] if end.dropout_rate > 0.0 else []
    return tuple(found)
