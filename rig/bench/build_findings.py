"""Findings about the rig of a scene before it runs, the same for every command that builds the rig."""

from __future__ import annotations

from rig.model.build_checks import Finding
from rig.model.method import chosen
from rig.model.system import System
from rig.scenes.scene import Scene
from rig.stability.report import stability_report


def findings(scene: Scene, system: System | None = None) -> list[Finding]:
    """All findings about the rig of `scene`, the most severe first. `system`: its matrices, if already assembled."""
    clock, system = scene.clock, scene.assemble().system() if system is None else system
    substeps = max(1, scene.step_ns // int(clock.rk4_step))
    return stability_report(system, chosen(clock.method, system), scene.step_ns * 1e-9, substeps, clock.tolerance)
