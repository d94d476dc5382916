"""One scene with many seeds: how far what is measured spreads where chance has a part in it.

random   what of a scene is random
measure  the numbers of one run
crew     the processes that simulate
spread   the numbers of all runs: median and range
figure   the same as a picture
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from rig.analysis.repeat import workers as crew
from rig.analysis.repeat.random import REMEDY, sources
from rig.analysis.repeat.spread import Repeats
from rig.errors import UsageError
from rig.scenes.scene import Scene

__all__ = ["Repeats", "repeat"]


def repeat(
    scene: Scene,
    count: int,
    duration: float | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], object] = lambda done, total: None,
    stop: Callable[[], str] = lambda: "",
) -> Repeats:
    """Simulate `scene` with `count` seeds, its own and those that follow it, and tell how its numbers spread.

    `duration` [s]: by default as long as the protocol takes. `workers`: processes, one for each core by default.
    `stop`: asked ten times a second and more whether to end, and why; what is done by then is told. Raises UsageError
    for fewer than two runs, and for a scene in which nothing is random; SceneError as a run does.
    """
    if count < 2:
        raise UsageError(f"{count} runs have no spread: at least 2")
    found = sources(scene)
    if not found:
        raise UsageError(f"{scene.name}: nothing in it is random, so that all {count} runs are the same. {REMEDY}")
    if duration is None and scene.duration_ns is None:
        raise UsageError(f"{scene.name} has no protocol that ends; say how long: --duration 10")
    with tempfile.TemporaryDirectory(prefix="rig-repeat-") as folder:
        job = crew.Job(scene, tuple(range(scene.seed, scene.seed + count)), duration)
        seen, ended = crew.work(job, Path(folder), workers, progress, stop)
    return Repeats(scene.name, found, job.seeds, tuple(seen), ended)
