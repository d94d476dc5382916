"""The integrator setting of a run, chosen from the cost table of this machine, which is measured first if necessary."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rig.errors import UsageError
from rig.qualify.cost.measuring import FOLDER, Report, cost, folder_of
from rig.qualify.cost.pareto import recommended
from rig.qualify.cost.table import WORST, Table
from rig.record.provenance import provenance
from rig.scenes.scene import Scene

_MACHINE = ("host", "processor", "cores", "python", "numba")


def chosen(
    scene: Scene,
    accuracy: float | None,
    budget: float | None,
    say: Callable[[str], object],
    root: Path = FOLDER,
    report: Report | None = None,
) -> Scene:
    """Return `scene` with the recommended method and step; `say` gets a line about any compromise.

    `accuracy`: largest relative error of any measure; `budget`: largest share of a frame at p99. Raises UsageError if
    no setting meets both.
    """
    pick = recommended(table(scene, say, root, report).rows, WORST, accuracy, budget)
    say(pick.text(WORST))
    return pick.setting.applied(scene)


def table(scene: Scene, say: Callable[[str], object], root: Path = FOLDER, report: Report | None = None) -> Table:
    """Return the cost table of `scene` on this machine, read or measured."""
    folder = folder_of(scene, root)
    here = provenance(scene.seed)
    try:
        found = Table.read(folder)
        if all(found.machine[name] == here[name] for name in _MACHINE) and all(row.timed for row in found.rows):
            return found
    except UsageError:
        pass
    say(f"{scene.name}: this machine has no cost table of it yet; measuring one, as rig cost does, into {folder}")
    return cost(scene, root, report)
