"""The trials of a cost measurement, each the measures of one setting, as a work of worker processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from rig.analysis.motion_measures.measures import Seen, observe
from rig.analysis.motion_measures.problem import Problem
from rig.analysis.motion_measures.settings import Setting
from rig.analysis.pool import Arrays, Work, carry_out, packed, temporary, unpacked


def trials(
    problem: Problem, settings: Sequence[Setting], workers: int | None = None, step: Callable[[], object] = lambda: None
) -> list[Seen]:
    """Return the measures of each setting; `step` is called as each is done. One process for each core by default."""
    work = Work(partial(_trial, problem), settings, problem.scene.name, problem.digest, failed=_failed)
    reported = 0

    def progress(done: int, total: int) -> None:
        nonlocal reported
        for _ in range(reported, done):
            step()
        reported = max(reported, done)

    with temporary(work) as store:
        found = carry_out(work, store, workers, progress)
    return [Seen.from_json(unpacked(found[unit])) for unit in range(work.total)]


def _trial(problem: Problem, setting: Setting) -> Arrays:
    return packed(observe(problem, setting).to_json())


def _failed(_: Setting, why: str) -> Arrays:
    """Measures that say why there are none."""
    return packed(Seen({}, fault=why).to_json())
