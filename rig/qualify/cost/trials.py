"""The trials of a cost measurement, each the measures of one setting, as a work of worker processes."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rig.analysis.motion_measures.measures import Seen, observe
from rig.analysis.motion_measures.problem import Problem
from rig.analysis.motion_measures.settings import Setting
from rig.analysis.pool import Arrays, carry_out, packed, temporary, unpacked
from rig.scenes.scene import Scene

_OF_PROBLEM = ("values", "kind", "length", "window", "count", "slips", "leaves")


def trials(
    problem: Problem, settings: Sequence[Setting], workers: int | None = None, step: Callable[[], object] = lambda: None
) -> list[Seen]:
    """Return the measures of each setting; `step` is called as each is done. One process for each core by default."""
    work, reported = Trials(problem, tuple(settings)), 0

    def progress(done: int, total: int) -> None:
        nonlocal reported
        for _ in range(reported, done):
            step()
        reported = max(reported, done)

    with temporary(work) as store:
        found = carry_out(work, store, workers, progress)
    return [Seen.from_json(unpacked(found[unit])) for unit in range(work.total)]


@dataclass(frozen=True)
class Trials:
    """The measures of `problem` with each of `settings` as a work (rig.analysis.pool)."""

    problem: Problem
    settings: tuple[Setting, ...]

    @property
    def name(self) -> str:
        """The scene."""
        return self.problem.scene.name

    @property
    def digest(self) -> str:
        """Hash of the problem."""
        return self.problem.digest

    @property
    def total(self) -> int:
        """Number of settings."""
        return len(self.settings)

    def prepare(self) -> None:
        """Nothing is compiled here: the references have run before."""

    def compute(self, unit: int) -> Arrays:
        """Run with a setting and compute the measures."""
        return packed(observe(self.problem, self.settings[unit]).to_json())

    def failed(self, unit: int, why: str) -> Arrays:
        """Return measures that say why there are none."""
        return packed(Seen({}, fault=why).to_json())

    def to_json(self) -> str:
        """Return the work as JSON text."""
        problem = {name: getattr(self.problem, name) for name in _OF_PROBLEM}
        scene, start = self.problem.scene.to_json(), self.problem.system.start.tolist()
        settings = [vars(one) for one in self.settings]
        return json.dumps({"scene": scene, "start": start, "problem": problem, "settings": settings})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the work of a text by `to_json`; the problem is made from the scene and its start."""
        raw = json.loads(text)
        scene = Scene.from_json(raw["scene"])
        assembly = scene.assemble()
        system = replace(assembly.system(), start=np.array(raw["start"]))
        return cls(Problem(scene, assembly, system, **raw["problem"]), tuple(Setting(**one) for one in raw["settings"]))
