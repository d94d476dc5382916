"""Controllers: pure objects that get measurements and return commands, and the process that runs one of them.

normal_force     normal-force feedback of the body's velocity
belt_velocity    belt-velocity feedback of the body's velocity
dither           search for the smallest dither amplitude that suppresses stick-slip
dither_sampled   dither as a sampled and held signal, to show its error
narrow_band      damping of the modes in a band through the voltage of a stack
shunt_schedule   a shunt that is switched at stated times
squeal_switch    a shunt that is connected when the brake squeals
lti              a linear controller from a file or from python-control
shunt_tuner      a shunt whose inductance follows the frequency of the squeal
c                a controller compiled from C
device           a controller on a board, by serial port or UDP

blocks           building blocks of controllers
runtime          the code that runs controllers

A controller never sees the plant. Numbers that depend on the plant's matrices come from the design step.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from rig.controllers.blocks.base import Controller, ControllerSection, Numbers
from rig.controllers.blocks.compiled import CompiledSection
from rig.errors import UsageError
from rig.parts import Code, Parts, Room, calling, code_of, named, one_class
from rig.quantities import Nanoseconds, Section

if __name__ != "rig.controllers":  # found through the link at the top of a checkout
    raise ImportError("friction-rig's controllers are imported as rig.controllers")


def _section(module: ModuleType, kind: str) -> Any:
    """The section of a controller's module; a foreign one is extended by the keys of every controller of a scene."""
    made = class_of(module)
    own = parameters_of(module)
    if code_of(module) is None:
        return own
    bases: tuple[type[Section], ...] = (ControllerSection,)
    if own is not None:
        bases = (own,) if issubclass(own, ControllerSection) else (own, ControllerSection)
    period = getattr(made, "period_ns", None)
    whole = isinstance(period, int) and not isinstance(period, bool) and period > 0  # else the trial refuses it
    return named(module, bases, "kind", kind, {"period": (Nanoseconds, period)} if whole else {})


def _missing(made: type) -> list[str]:
    """The methods of a controller that a class does not have; a compiled one declares `update` and sets it."""
    stated = {name for base in made.__mro__ for name in vars(base).get("__annotations__", ())}
    return [name for name in ("start", "update") if not callable(getattr(made, name, None)) and name not in stated]


def _is_controller(made: type) -> bool:
    return made.__name__ == "Controller" or not (_missing(made) or issubclass(made, Section))


@cache
def class_of(module: ModuleType) -> Any:
    """The controller class of a module."""
    return one_class(module, _is_controller, "Controller", f"class Controller{''.join(_unfinished(module))}")


def _unfinished(module: ModuleType) -> Iterator[str]:
    """The classes of a module that have one of the two methods of a controller, in words."""
    for made in vars(module).values():
        if isinstance(made, type) and made.__module__ == module.__name__:
            missing = _missing(made)
            if len(missing) == 1:
                yield f"; {made.__name__} has no {missing[0]}"


@cache
def parameters_of(module: ModuleType) -> Any:
    """The section class of a module; None if it has none."""
    return one_class(module, lambda kind: issubclass(kind, Section), "Parameters", "")


KINDS: Room[Any] = Room("controllers", __name__, __path__, _section)
"""Sections of controllers by kind: `KINDS["normal_force"]` is that of rig/controllers/normal_force.py."""


def kind_of_file(file: Path) -> str:
    """The kind of controller that reads files like this one, by its suffix. Raises UsageError if there is none."""
    suffixes = {suffix: kind for kind in KINDS for suffix in getattr(KINDS[kind], "files", ())}
    if file.suffix not in suffixes:
        known = ", ".join([".py", *suffixes])
        raise UsageError(f"{file}: no kind of controller reads such a file; its name ends in {known}")
    return suffixes[file.suffix]


def recorded_class(table: Mapping[str, Any], parts: Parts) -> Any:
    """The section class for a table of a recorded scene with the parts `parts`.

    Raises KeyError for an unknown kind, PartError for a part that fails.
    """
    section = KINDS.get_from(table["kind"], parts)
    return section.of_table(table) if issubclass(section, CompiledSection) else section


def module_of(section: Section) -> ModuleType:
    """The module that defines a section; one file contains a whole controller."""
    return sys.modules[type(section).__module__]


def controller_class(section: Section) -> Any:
    """The class of the controllers that a section describes."""
    return class_of(module_of(section))


def controller_reads(section: Section) -> dict[str, str]:
    """Key -> sensor, for the sensors that a controller's section, or else its class, names."""
    fields = [f for f in type(section).model_fields if f == "sensor" or f.endswith("_sensor")]
    if not fields:
        return {f"reads[{i}]": name for i, name in enumerate(_connections(section, "reads"), 1)}
    return {name: getattr(section, name) for name in fields if getattr(section, name) is not None}


def controller_drives(section: Any) -> tuple[str, ...]:
    """Actuators that a controller's section, or else its class, names."""
    if "drive" in type(section).model_fields:
        return (section.drive,)
    return _connections(section, "drives")


def _connections(section: Section, what: str) -> tuple[str, ...]:
    """Names that a controller `reads` or `drives`: stated by its section, its class, or the controller itself."""
    stated = getattr(section, what, None) or getattr(controller_class(section), what, None)
    return stated if isinstance(stated, tuple) else tuple(getattr(build(section, {}), what))


def build(section: Section, numbers: Numbers) -> Controller:
    """Build the controller of a scene's section with the numbers of the design step.

    Raises rig.errors.PartError with file and line where a foreign controller fails.
    """
    module = module_of(section)
    with calling(module):
        controller: Controller = class_of(module)(section, numbers) if parameters_of(module) else class_of(module)()
    return controller


def described(section: Section, numbers: Numbers) -> dict[str, Any]:
    """The description of a controller as plain values, for its process; that of a foreign one contains its code."""
    code = code_of(type(section))
    part = {} if code is None else {"part": code.to_json()}
    return {"section": section.model_dump(mode="json"), "numbers": dict(numbers), **part}


def restored(values: Mapping[str, Any]) -> Controller:
    """The controller that `described` returned. Raises rig.errors.Untrusted for code that is not trusted."""
    kind = values["section"]["kind"]
    parts = {(KINDS.what, kind): Code.from_json(values["part"])} if "part" in values else {}
    return build(recorded_class(values["section"], parts).model_validate(values["section"]), values["numbers"])
