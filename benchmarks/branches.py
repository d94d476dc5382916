"""How long branches take: 100 points of the cycles of a belt, 20 points of a boundary of the lever, on one core."""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path
from typing import Any

from rig.analysis.branches import begin, curves, job
from rig.analysis.branches.compute import Job
from rig.analysis.branches.trace import follow
from rig.analysis.cycles.return_map import Family
from rig.scenes import load
from rig.scenes.axis import Axis

BELT, LEVER = 100, 20
_STEP = 0.02  # along the branch: as many points as are measured


def belt_s() -> float:
    """Return the processor time [s] for 100 points of the belt's branch from its Hopf point, past the grazing fold."""
    scene = load("belt", {"limits": "none"})
    family = Family(scene, [Axis.of("drive.speed", [0.05, 0.8], scene)])
    hopf = 0.05 * math.log(20.0 * (0.5 - 0.18) / (2.0 * 0.05))
    begun, count = time.process_time(), 0
    first = begin.from_hopf(family, hopf)
    for segment in follow(first, 0.05, 0.8, BELT, longest=_STEP):
        count += len(segment.places)
    return (time.process_time() - begun) * BELT / count


def lever_s(points: int) -> float:
    """Return the processor time [s] for 20 points of the lever's boundary of sliding over the load."""
    scene = load("lever", {"limits": "none"})
    work: Job = job(scene, "drive.speed=0.5:12 rpm:24")
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as folder:  # results that are kept would not be computed
        curves(work, Axis.parse(f"load.force=12:30 N:{points}", scene), Path(folder))
    return time.process_time() - begun


def measured(quick: bool) -> dict[str, Any]:
    """Return both times; `quick`: without the boundary."""
    belt_s()  # compiles
    return {"belt_s": belt_s()} | ({} if quick else {"lever_s": lever_s(LEVER)})
