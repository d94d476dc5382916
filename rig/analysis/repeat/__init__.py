"""One scene simulated with many seeds: the spread of its numbers where randomness matters.

random   the random parts of a scene
measure  the numbers of one run
runs     the runs, as a work of worker processes
spread   the numbers of all runs: median and range
figure   the same as a picture
"""

from __future__ import annotations

from collections.abc import Callable

from rig.analysis.pool import carry_out, temporary, unpacked
from rig.analysis.repeat.measure import Seen
from rig.analysis.repeat.random import REMEDY, sources
from rig.analysis.repeat.runs import seed_runs
from rig.analysis.repeat.spread import Repeats
from rig.errors import UsageError
from rig.quantities import run_length_ns, whole
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
    """Simulate `scene` with `count` seeds, its own and the following ones, and return the spread of its numbers.

    `duration` [s]: by default the length of the protocol. `workers`: processes, one for each core by default. `stop`:
    called at least ten times a second; a text from it ends the work and is the reason. Finished runs are reported.
    Raises UsageError for fewer than two runs, and for a scene in which nothing is random; SceneError as a run does.
    """
    if whole("count", count, 0, 10**6) < 2:
        raise UsageError(f"{count} runs have no spread: at least 2 are needed")
    found = sources(scene)
    if not found:
        raise UsageError(f"{scene.name}: nothing in it is random, so that all {count} runs are the same. {REMEDY}")
    if run_length_ns(duration) is None and scene.duration_ns is None:
        raise UsageError(f"{scene.name} has no protocol that ends; state a duration: --duration 10")
    work, ended = seed_runs(scene, range(scene.seed, scene.seed + count), duration), ""

    def watch(done: int, total: int) -> None:
        progress(done, total)
        if why := stop():
            raise _Stopped(why)

    with temporary(work) as store:
        try:
            runs = carry_out(work, store, workers, watch, apart=True)
        except _Stopped as stopped:
            runs, ended = store.load(), str(stopped)
    seen = tuple(Seen.from_json(unpacked(runs[unit])) for unit in sorted(runs))
    return Repeats(scene.name, found, tuple(work.items), seen, ended)


class _Stopped(Exception):
    """The work ends early, for the stated reason."""
