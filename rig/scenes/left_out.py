"""What an analysis leaves out of a scene, in words: results of all analyses of the plant alone say it in one way."""

from __future__ import annotations

from rig.scenes.scene import Scene


def left_out(scene: Scene, closed: str = "") -> str:
    """Return which controllers of `scene` do not act; "" if there is none.

    `closed`: the controller whose loop the analysis closes; "" for an analysis of the plant alone.
    """
    names = ", ".join(name for name in scene.controllers if name != closed)
    if not names:
        return ""
    if closed:
        return f"left open: {names}"
    return f"plant alone: without controller{'s' * (len(scene.controllers) > 1)} {names}"
