"""The scene of a case for the torture test: with its sensors, a given step, and outputs of each contact."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

from pydantic import ValidationError

from rig import scenes
from rig.errors import SceneError
from rig.model.assembly import Output
from rig.qualify.torture.case import Case
from rig.qualify.torture.rigs import RIGS
from rig.quantities import Section
from rig.scenes.clock import Clock
from rig.scenes.faults import lines
from rig.scenes.places import Place
from rig.scenes.scene import Scene


@dataclass(frozen=True)
class Watched(Scene):
    """A scene with outputs for every contact: friction (T:), slip speed (w:) and normal forces (N:).

    Without `contacts` it has its own outputs only, whose names a recording accepts.
    """

    rig: str = ""
    drives: tuple[tuple[str, str], ...] = ()
    step: int = 0
    contacts: bool = True

    @cached_property
    def step_ns(self) -> int:
        """Sample step [ns]: that of the case; sensors publish between the ticks too."""
        return self.step

    @cached_property
    def moved(self) -> dict[str, str]:
        """Actuators that the case moves, in addition to those of the scene."""
        known = {} if self.rig else super().moved
        return known | dict(self.drives)

    def assemble(self, parameters: Section | None = None) -> Any:
        """Return the rig with the outputs that the invariants need."""
        a = RIGS[self.rig][1](parameters or self.parameters, self.moved) if self.rig else super().assemble(parameters)
        if a.film is not None or not self.contacts:  # points of a film are states, which `Trial` checks
            return a
        for name, *_ in a.patches:
            a.outputs |= {f"T:{name}": Output({f"T:{name}": 1.0}, "N"), f"w:{name}": Output({f"w:{name}": 1.0}, "m/s")}
        for name, *_ in a.normals:
            a.outputs[f"N:{name}"] = Output({f"N:{name}": 1.0}, "N")
        return a


@lru_cache(maxsize=64)
def _loaded(name: str, changes: str, given: tuple[tuple[str, Place], ...]) -> Scene:
    """A scene with `changes`, as JSON, and their places; read once for all methods and steps of a case."""
    return scenes.load(name, json.loads(changes), dict(given))


def changed(case: Case) -> Scene:
    """Return the scene of a case with the values of the case."""
    return _loaded(case.scene, json.dumps(case.set), (*case.places.items(),))


def watched(case: Case, method: str, step_ns: int, tolerance: float | None = None, unstable: str = "run") -> Watched:
    """Return the scene of a case with a method and a step. Raises SceneError if the case is inconsistent."""
    clock: dict[str, Any] = {
        "frame": max((case.frame or 0) // step_ns, 1) * step_ns * 1e-9,
        "method": method,
        "rk4_step": step_ns * 1e-9,
        "unstable": unstable,
    }
    if tolerance is not None:
        clock["tolerance"] = tolerance
    drives: dict[str, str] = {}
    limits: dict[str, float] = {}
    for act in case.acts:
        if act.do in ("set", "command", "follow"):
            drives[act.target] = "ramped" if act.over else drives.get(act.target, "held")
    if case.rig:
        if case.rig not in RIGS:
            raise SceneError(case.name, [f"rig = {case.rig!r}: unknown; known: {', '.join(RIGS)}"])
        try:
            parameters = RIGS[case.rig][0].model_validate(case.set)
        except ValidationError as error:
            faults = [line for _, line in lines(error, RIGS[case.rig][0], case.set, "set")]
            raise SceneError(case.name, faults) from None
        base: dict[str, Any] = {
            "plant": case.rig,
            "parameters": parameters,
            "clock": Clock.model_validate(clock),
            "seed": 1,
            "sensors": {"ideal": RIGS[case.rig][2]},
        }
    else:
        scene = changed(case)
        if scene.assemble().film is not None:  # a tick has its own steps
            clock["rk4_step"] = min(step_ns, int(scene.clock.rk4_step)) * 1e-9
        clock = scene.clock.model_dump(mode="json") | clock
        limits = scene.limits if case.limited else {}
        calm = scene.parameters.model_copy(
            update={"noise": None}
        )  # it would be another one in frames of another length
        base = {
            "plant": scene.plant,
            "parameters": calm,
            "clock": Clock.model_validate(clock),
            "seed": 1,
            "sensors": scene.sensors,
        }
    return Watched(
        name=case.name,
        title=case.title,
        about=case.about,
        controllers={},
        protocol=(),
        limits=limits,
        rig=case.rig,
        drives=tuple(drives.items()),
        step=step_ns,
        **base,
    )
