"""A controller that is compiled from C, or from any language that can make a library with C functions.

The header rig/controllers/rig_controller.h documents what the library defines. The process of the controller calls
it: in a live run a process of its own, in `rig simulate` and studies that of the simulation. A crash, or a step that
does not return, ends this process. With where = "plant" it is the plant's process in every kind of run. State in, state
out: the bits of all runs are the same.
"""

from __future__ import annotations

import signal
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from rig.controllers.blocks.base import Numbers, Values
from rig.controllers.blocks.compiled import CompiledSection, Parameter, Signal
from rig.controllers.runtime import c_library
from rig.errors import ControllerLost, PartError, UsageError
from rig.parts import Binary

LONGEST_S = 2.0
"""Longest time of a step [s]; then the timer of the system ends the process (SIGALRM). # chosen"""
OPENED: dict[str, c_library.Library] = {}
"""SHA-256 -> library that this process has loaded."""
_TIMER: Any = getattr(signal, "setitimer", lambda *_: None)
_REAL = getattr(signal, "ITIMER_REAL", 0)


class CompiledC(CompiledSection):
    """Parameters: those that the library declares."""

    files: ClassVar[tuple[str, ...]] = (".so", ".dylib", ".dll")

    kind: Literal["c"]

    @classmethod
    def describe(cls, file: Binary) -> dict[str, Any]:
        """See `CompiledSection.describe`."""
        return opened(file).about

    @classmethod
    def keys(cls, file: Binary) -> tuple[Sequence[Signal], Sequence[Signal], Sequence[Parameter], int | None]:
        """See `CompiledSection.keys`."""
        about = file.about
        inputs, outputs = ([Signal(*row) for row in about[name]] for name in ("inputs", "outputs"))
        if about["period_ns"] <= 0:
            raise PartError(f"{file}: states a period of {about['period_ns']} ns; expected at least 1")
        return inputs, outputs, [Parameter(*row) for row in about["parameters"]], about["period_ns"]


class CompiledController:
    """The controller; the process that works with it loads the library at the first call."""

    def __init__(self, section: CompiledC, numbers: Numbers) -> None:
        if faults := section.faults():
            raise UsageError("; ".join(faults))
        self.section, self.numbers = section, numbers
        self.reads, self.drives = section.connected_sensors, section.connected_actuators
        self.period_ns = section.period
        self._parameters = section.values()
        self._library: c_library.Library | None = None

    def start(self) -> Values:
        """The state before the first sample."""
        self._library = opened(self.section.file)
        code, state = self._library.init(self._parameters)
        self._check("init", code)
        return tuple(state)

    def update(self, state: Values, t_ns: int, values: Values) -> tuple[Values, Values]:
        """Next state, and the commands [unit of each output]."""
        library = self._library or opened(self.section.file)
        _TIMER(_REAL, LONGEST_S)
        try:
            code, after, commands = library.step(self._parameters, state, t_ns, values)
        finally:
            _TIMER(_REAL, 0.0)
        self._check("step", code)
        return tuple(after), tuple(commands)

    def _check(self, function: str, code: int) -> None:
        if code:
            raise ControllerLost(f"{self.section.file}: rig_controller_{function} returned {code}")


def opened(file: Binary) -> c_library.Library:
    """The library in this process."""
    if file.sha256 not in OPENED:
        with file.unpacked() as path:
            try:
                OPENED[file.sha256] = c_library.Library(str(path))
            except PartError as fault:
                raise PartError(f"{file}: {fault}") from None
    return OPENED[file.sha256]
