"""Scenes: a plant with its effects, sensors, controllers and a protocol, as TOML; each value with its origin.

    load(name_or_path, overrides) -> Scene      checked as a whole, or a SceneError with every fault
    names() -> shipped scenes                   path(name) -> its file

loader    tables of a scene, checked        checks    what must hold between its sections
merged    tables of files merged            inherit   files based on one another
source    TOML, changes, origins            places    line of each key in a file
faults    messages
scene     the checked scene, and as JSON    sections  values by key, wiring of controllers
network   impaired links                    protocol  the clock and the steps of an experiment
rooms     the parts that a scene names      variants  scenes with one effect less or more
explain   a scene for a reader              part_faults   faults of sensors and actuators
shipped   the shipped scenes                draft     the text of a new scene file
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rig.scenes.shipped import names, path

if TYPE_CHECKING:
    from rig.scenes.loader import load
    from rig.scenes.places import Origin
    from rig.scenes.protocol import Clock
    from rig.scenes.scene import Scene

__all__ = ["Clock", "Origin", "Scene", "load", "names", "path"]


def __getattr__(name: str) -> Any:
    """Import a name that needs pydantic at its first use: a list of scenes does without (0.2 s)."""
    module = {"Clock": "protocol", "Origin": "places", "Scene": "scene", "load": "loader"}.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{module}"), name)
