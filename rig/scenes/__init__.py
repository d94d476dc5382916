"""Scenes: a plant, the effects that are on, sensors, controllers and a protocol, as TOML; each value with its origin.

    load(name_or_path, overrides) -> Scene      checked as a whole, or a SceneError with every fault
    names() -> shipped scenes                   path(name) -> its file

loader    one pass over a scene file        checks    what holds between its parts
source    TOML, changes, origins            faults    messages
scene     the checked scene, and as JSON    protocol  the steps of an experiment
shelf     the shipped scenes
"""

from __future__ import annotations

from rig.scenes.loader import load
from rig.scenes.scene import Clock, Origin, Scene
from rig.scenes.shelf import names, path

__all__ = ["Clock", "Origin", "Scene", "load", "names", "path"]
