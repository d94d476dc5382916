"""Scenes: a plant, the effects that are on, sensors, controllers and a protocol, as TOML; each value with its origin.

    load(name_or_path, overrides) -> Scene      checked as a whole, or a SceneError with every fault
    names() -> shipped scenes                   path(name) -> its file

loader    one pass over a scene file        checks    what holds between its parts
source    TOML, changes, origins            faults    messages
inherit   files based on one another        places    line of each key in a file
migration formats of scene files            draft     the text of a new scene file
scene     the checked scene, and as JSON    protocol  the steps of an experiment
shelf     the shipped scenes
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rig.scenes.shipped import names, path

if TYPE_CHECKING:
    from rig.scenes.loader import load
    from rig.scenes.places import Origin
    from rig.scenes.scene import Clock, Scene

__all__ = ["Clock", "Origin", "Scene", "load", "names", "path"]


def __getattr__(name: str) -> Any:
    """What reads a scene as a whole, imported when it is asked for: a list of scenes does without (0.2 s)."""
    if name == "load":
        from rig.scenes import loader as module
    elif name in __all__:
        from rig.scenes import scene as module  # type: ignore[no-redef]
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(module, name)
