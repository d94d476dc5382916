"""The outputs of a run by their roles, as the parts of its scene declare them: the drives, the phase portrait.

Nothing is known for a run whose scene is lost. Both functions raise Untrusted if the scene needs code that is not
trusted, and PartError if that code is damaged.
"""

from __future__ import annotations

from rig.errors import SceneError
from rig.model.assembly import Output, portrait
from rig.record.run import Run
from rig.scenes.scene import Scene


def drives(run: Run) -> list[str]:
    """Return the outputs of `run` that are the speed of a drive, those in rad/s first."""
    found = [name for name, output in _outputs(run).items() if output.role == "drive"]
    return sorted(found, key=lambda name: run.units.get(name) != "rad/s")


def portrait_pair(run: Run) -> tuple[str, str] | None:
    """Return displacement and velocity of the phase portrait among the outputs of `run`; None without such a pair."""
    return portrait(_outputs(run))


def _outputs(run: Run) -> dict[str, Output]:
    """The declared outputs that the run holds."""
    try:
        rows = Scene.from_json(run.scene).assemble().outputs
    except SceneError:
        return {}
    return {name: output for name, output in rows.items() if name in run.signals}
