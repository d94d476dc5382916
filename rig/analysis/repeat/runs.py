"""The runs of one scene with many seeds, as a work (rig.analysis.pool): each unit is the run of one seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from rig.analysis.kernel_shapes import prepare
from rig.analysis.pool import Arrays, Work, packed
from rig.analysis.repeat.measure import Seen, measure
from rig.bench.simulate import simulate
from rig.quantities import run_length_ns
from rig.scenes.scene import Scene


def seed_runs(scene: Scene, seeds: Sequence[int], duration: float | None) -> Work:
    """Return the runs of `scene` with each of `seeds`, for `duration` [s] or the length of its protocol."""
    return Work(partial(_run, scene, duration), seeds, scene.name, scene.digest, partial(_prepare, scene), _failed)


def _prepare(scene: Scene) -> None:
    """Compile the kernels. Raises SceneError as a run does."""
    prepare([scene])
    simulate(scene, duration_ns=scene.frame_ns)


def _run(scene: Scene, duration: float | None, seed: int) -> Arrays:
    run = simulate(replace(scene, seed=seed), duration_ns=run_length_ns(duration), audited=False)
    return packed(measure(run, seed).to_json())


def _failed(seed: int, why: str) -> Arrays:
    """A run without numbers."""
    return packed(Seen(seed, 0.0, {}, fault=why).to_json())
