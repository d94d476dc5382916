"""Rigs of many points: what studies cannot tell of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.errors import UsageError

if TYPE_CHECKING:
    from rig.scenes.scene import Scene


def refuse(scene: Scene, study: str) -> None:
    """Refuse a study of single motions for a film of points. Raises UsageError."""
    if scene.assemble().film is not None:
        raise UsageError(
            f"{scene.name}: {study} cannot be told of a film of points: once one has opened the motion is chaotic, "
            f"and two runs part. Take statistics of runs: rig simulate {scene.name} --repeat 8, "
            "with -p noise.force=1e-6 where nothing is random. "
            f"For sliding with all points closed: rig modes {scene.name} --sweep KEY=A:B:N"
        )
