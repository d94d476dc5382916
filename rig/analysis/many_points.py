"""Refusal of analyses that a film of many contact points does not allow."""

from __future__ import annotations

from rig.errors import UsageError
from rig.scenes.scene import Scene


def refuse(scene: Scene, study: str) -> None:
    """Raise UsageError if `scene` has a film of points, whose motion is chaotic; `study` names the analysis."""
    if scene.assemble().film is not None:
        raise UsageError(
            f"{scene.name}: {study} is not defined for a film of points: after the first opening motion is chaotic, "
            f"and two runs diverge. Compute statistics of several runs: rig simulate {scene.name} --repeat 8, "
            "with -p noise.force=1e-6 if nothing in the scene is random. "
            f"For sliding with all points closed: rig modes {scene.name} --sweep KEY=A:B:N"
        )
