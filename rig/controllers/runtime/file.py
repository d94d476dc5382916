"""A user's own controller: a Python file with a class `Controller`, optionally with its parameters.

    class Parameters(Section): ...                        optional: what can be tuned live, each with a default
    class Controller:
        reads, drives, period_ns                          sensors, actuators, time between updates [ns]
        every_sample = True                               optional: all samples of a frame, not the latest one
        def __init__(self, section, numbers): ...         only with Parameters; keep the section as an attribute
        def start(self): ...
        def update(self, state, t_ns, values): ...

The file is checked before it runs with a rig: by one update with zeros, and with Parameters by a retune and a second
update.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rig.controllers import build, class_of, described, kind_of_file, module_of, parameters_of, recorded_class
from rig.controllers.blocks.base import Controller, Numbers, explain, gets_every_sample
from rig.controllers.blocks.compiled import CompiledSection
from rig.controllers.runtime.loop import Loop
from rig.errors import ControllerLost, PartError, UsageError
from rig.parts import Code, calling, is_file, trust
from rig.quantities import Section
from rig.units import brief

_TRIAL_S = 30.0  # chosen: the start of a process on a busy machine, and the timer of a step
_TRIAL = """
import json, sys
from rig.controllers import restored
from rig.controllers.runtime.file import faults_of
faults_of(restored(json.load(sys.stdin)))
"""
_tried: set[str] = set()  # SHA-256 of the compiled files whose first call returned


def load_file(path: str | Path, keys: Mapping[str, object] | None = None) -> Controller:
    """Load the controller of a file. Raises UsageError with the line or the attribute that is wrong.

    `keys`: of the table that a scene would have for a file of another tool.
    """
    path = Path(path)
    if not is_file(path.name):
        return _of_another_tool(path, keys or {})
    code = Code.read(path)
    trust([code])
    module = code.module(path)
    make = class_of(module)
    parameters = parameters_of(module)
    try:
        with calling(module, ValidationError):
            controller = make() if parameters is None else make(parameters(), {})
            faults = faults_of(controller) or ([] if parameters is None else _untunable(controller))
    except ValidationError as error:  # without a scene, every parameter has its default
        faults = [f"{error.title}.{line}" for line in explain(error)]
    if faults:
        raise UsageError("\n".join(f"{path}: {fault}" for fault in faults))
    return controller  # type: ignore[no-any-return]


def _of_another_tool(path: Path, keys: Mapping[str, object]) -> Controller:
    table = {"kind": kind_of_file(path), "file": str(path), **keys}
    try:
        model = recorded_class(table, {})
        if issubclass(model, CompiledSection):
            table["file"] = model.model_fields["file"].default
        section = model.model_validate(table)
        faults = section_faults(section, {})
    except ValidationError as error:
        faults = explain(error)
    except PartError as error:
        faults = [str(error)]
    if faults:
        raise UsageError("\n".join(f"{path}: {fault}" for fault in faults))
    return build(section, {})


def section_faults(section: Section, numbers: Numbers) -> list[str]:
    """The faults of a foreign controller that a scene's section describes, one line each; empty if it works."""
    if isinstance(section, CompiledSection) and section.file.sha256 not in _tried:
        if ending := _ending(section, numbers):
            return [f"{section.file}: its first call ends the process that makes it ({ending})"]
        _tried.add(section.file.sha256)
    try:
        with calling(module_of(section)):
            return faults_of(build(section, numbers))
    except (UsageError, ControllerLost) as error:
        return [str(error)]


def _ending(section: Section, numbers: Numbers) -> str:
    """How a first call of compiled code ends a process of its own; "" if it does not.

    What it raises is raised again, and reported, in this process.
    """
    content = json.dumps(described(section, numbers)).encode()
    command = [sys.executable, "-P", "-c", _TRIAL]
    try:
        trial = subprocess.run(command, input=content, capture_output=True, check=False, timeout=_TRIAL_S)
    except subprocess.TimeoutExpired:
        return f"after {_TRIAL_S:g} s without an answer"
    return signal.Signals(-trial.returncode).name if trial.returncode < 0 else ""


def faults_of(controller: Any) -> list[str]:
    """The faults of an object that should be a controller, one line each."""
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
    if not all(map(isfinite, commands)):
        return [f"Controller.update commands {brief(commands)} when all measurements are zero; expected finite numbers"]
    return []


def _zeros(controller: Controller) -> Any:
    zero = (0.0,) if gets_every_sample(controller) else 0.0
    return tuple(zero for _ in controller.reads)


def _untunable(controller: Controller) -> list[str]:
    """The faults of a controller with Parameters that cannot be retuned, one line each."""
    if not isinstance(getattr(controller, "section", None), Section):
        return ["Controller has no attribute section, so its Parameters cannot be tuned; set self.section in __init__"]
    loop = Loop(controller)
    loop.answer(0, _zeros(controller))
    try:
        loop.retune({})
    except UsageError as fault:
        if fault.__cause__ is not None:
            raise fault.__cause__ from None
        return [f"Controller cannot be retuned: {fault}"]
    return []
