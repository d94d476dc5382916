"""Controllers: pure objects that see measurements and send commands, and the process that runs one of them.

normal_force     press less when the body runs with the belt
belt_velocity    let the belt follow the body
dither           the least amplitude that keeps the cycle away
dither_sampled   dither as a held signal, to show its error
narrow_band      damp the modes of a band through the voltage of a stack
shunt_schedule   a shunt connected by the clock
squeal_switch    a shunt connected when the brake squeals
shunt_tuner      a shunt's inductance after the squeal's frequency

blocks           what controllers are built from
runtime          what runs them

A controller never sees the plant: what it needs of the matrices comes as numbers from the design step.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache
from types import ModuleType
from typing import Any

from rig.controllers.blocks.base import Controller, ControllerSection, Numbers
from rig.parts import Code, Room, code_of, named, one_class
from rig.quantities import Nanoseconds, Section

if __name__ != "rig.controllers":  # found through the link at the top of a checkout
    raise ImportError("friction-rig's controllers are imported as rig.controllers")


def _section(module: ModuleType, kind: str) -> Any:
    """The section of a controller's module; one from elsewhere gets what every controller of a scene states."""
    made, own = class_of(module), parameters_of(module)
    if code_of(module) is None:
        return own
    bases: tuple[type[Section], ...] = (ControllerSection,)
    if own is not None:
        bases = (own,) if issubclass(own, ControllerSection) else (own, ControllerSection)
    period = getattr(made, "period_ns", None)
    fields = {"period": (Nanoseconds, period)} if isinstance(period, int) else {}
    return named(module, bases, "kind", kind, fields)


def _is_controller(one: type) -> bool:
    works = callable(getattr(one, "start", None)) and callable(getattr(one, "update", None))
    return one.__name__ == "Controller" or (works and not issubclass(one, Section))


@cache
def class_of(module: ModuleType) -> Any:
    """The class of the controllers of a module."""
    return one_class(module, _is_controller, "Controller", "class Controller")


@cache
def parameters_of(module: ModuleType) -> Any:
    """The section of a module; None where it has none."""
    return one_class(module, lambda one: issubclass(one, Section), "Parameters", "")


KINDS: Room[Any] = Room("controllers", __name__, __path__, _section)
"""Sections of controllers by kind: `KINDS["normal_force"]` is that of rig/controllers/normal_force.py."""


def module_of(section: Section) -> ModuleType:
    """The module that defines a section: one file holds all of a controller."""
    return sys.modules[type(section).__module__]


def made_by(section: Section) -> Any:
    """The class of the controllers that a section describes."""
    return class_of(module_of(section))


def wired(section: Section, what: str) -> tuple[str, ...]:
    """What a controller `reads` or `drives` that its class states; else what one that is built from `section` does."""
    stated = getattr(made_by(section), what, None)
    return stated if isinstance(stated, tuple) else tuple(getattr(build(section, {}), what))


def build(section: Section, numbers: Numbers) -> Controller:
    """The controller of a scene's section, with the numbers of the design step.

    Raises rig.errors.PartError with file and line where a controller from elsewhere fails.
    """
    module = module_of(section)
    controller: Controller = class_of(module)(section, numbers) if parameters_of(module) else class_of(module)()
    return controller


def described(section: Section, numbers: Numbers) -> dict[str, Any]:
    """A controller as plain values, the way it travels to its process; one from elsewhere with its code."""
    code = code_of(type(section))
    part = {} if code is None else {"part": code.to_json()}
    return {"section": section.model_dump(mode="json"), "numbers": dict(numbers), **part}


def restored(values: Mapping[str, Any]) -> Controller:
    """The controller that `described` told. Raises rig.errors.Untrusted for code that is not trusted."""
    kind = values["section"]["kind"]
    parts = {(KINDS.what, kind): Code.told(values["part"])} if "part" in values else {}
    return build(KINDS.get_from(kind, parts).model_validate(values["section"]), values["numbers"])
