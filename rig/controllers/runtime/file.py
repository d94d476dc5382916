"""A user's own controller: a Python file with a class `Controller`, optionally with its parameters.

    class Parameters(Section): ...                        optional: what can be tuned live, each with a default
    class Controller:
        reads, drives, period_ns                          sensors, actuators, time between updates [ns]
        every_sample = True                               optional: all samples of a frame, not the latest one
        def __init__(self, section, numbers): ...         only with Parameters; keep the section as an attribute
        def start(self): ...
        def update(self, state, t_ns, values): ...

The file is checked before it is let near a rig: by one update on zeros, and with Parameters by a retune and another.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rig.controllers import build, class_of, module_of, parameters_of
from rig.controllers.blocks.base import Controller, hears
from rig.controllers.runtime.loop import Loop
from rig.errors import UsageError
from rig.parts import Code, told, trust
from rig.quantities import Section, brief


def load_file(path: str | Path) -> Controller:
    """The controller of a file. Raises UsageError with the line or the part that is wrong."""
    path = Path(path)
    code = Code.read(path)
    trust([code])
    module = code.module(path)
    make, parameters = class_of(module), parameters_of(module)
    try:
        controller = make() if parameters is None else make(parameters(), {})
        faults = _faults(controller) or ([] if parameters is None else _untunable(controller))
    except Exception as error:
        raise UsageError(told(error) or f"{path}: {type(error).__name__}: {error}") from error
    if faults:
        raise UsageError("\n".join(f"{path}: {fault}" for fault in faults))
    return controller  # type: ignore[no-any-return]


def refused(section: Section) -> list[str]:
    """What keeps a controller from elsewhere, that a scene's section describes, from working, a line each.

    One that has a design step is not tried, because it needs numbers.
    """
    if hasattr(module_of(section), "design"):
        return []
    try:
        return _faults(build(section, {}))
    except Exception as error:
        return [told(error) or f"{type(error).__name__}: {error}"]


def _faults(controller: Any) -> list[str]:
    """What keeps an object from being a controller."""
    names = [n for n in ("reads", "drives", "period_ns", "start", "update") if not hasattr(controller, n)]
    if names:
        return [f"Controller has no {name}" for name in names]
    faults = []
    for name in ("reads", "drives"):
        entries = getattr(controller, name)
        if not isinstance(entries, tuple) or not all(isinstance(entry, str) for entry in entries):
            faults.append(f'Controller.{name} is {brief(entries)}; expected a tuple of names, e.g. ("vibrometer",)')
    period = controller.period_ns
    if not isinstance(period, int) or isinstance(period, bool) or period <= 0:
        faults.append(f"Controller.period_ns is {brief(period)}; expected whole nanoseconds, e.g. 1_000_000")
    if faults:
        return faults
    answer = controller.update(controller.start(), 0, _zeros(controller))
    if not isinstance(answer, tuple) or len(answer) != 2:
        return [f"Controller.update returns {brief(answer)}; expected (state, commands)"]
    commands = answer[1]
    if not isinstance(commands, tuple) or len(commands) != len(controller.drives):
        drives = ", ".join(controller.drives)
        return [f"Controller.update commands {brief(commands)}; expected a tuple with one number for each of {drives}"]
    if not all(isinstance(c, int | float) and not isinstance(c, bool) for c in commands):
        return [f"Controller.update commands {brief(commands)}; expected numbers"]
    return []


def _zeros(controller: Controller) -> Any:
    zero = (0.0,) if hears(controller) else 0.0
    return tuple(zero for _ in controller.reads)


def _untunable(controller: Controller) -> list[str]:
    """What keeps a controller with Parameters from being retuned."""
    if not isinstance(getattr(controller, "section", None), Section):
        return ["Controller keeps no section, so its Parameters could not be tuned: self.section = section in __init__"]
    loop = Loop(controller)
    loop.answer(0, _zeros(controller))
    try:
        loop.retune({})
    except UsageError as fault:
        if fault.__cause__ is not None:
            raise fault.__cause__ from None
        return [f"Controller cannot be retuned: {fault}"]
    return []
