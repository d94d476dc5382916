"""A controller that is compiled from C, or from any language that can make a library with C functions.

The header rig/controllers/rig_controller.h documents what the library defines. The library is called in the process of
its controller; a run in one process (`rig simulate`, studies) calls it through a helper process, so that a crash is
only the controller's. With where = "plant" the plant's process calls it, in every kind of run, and a crash is that of
the plant. State in, state out: the bits of all runs are the same.
"""

from __future__ import annotations

import signal
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, Self

from rig.controllers.blocks.base import Numbers, Values
from rig.controllers.blocks.compiled import CompiledSection, Parameter, Signal
from rig.controllers.runtime import c_library
from rig.controllers.runtime.c_process import LONGEST_S, helper
from rig.errors import ControllerLost, PartError, UsageError
from rig.parts import Binary

OPENED: dict[str, c_library.Library] = {}
"""SHA-256 -> library that this process has loaded."""


class CompiledC(CompiledSection):
    """Parameters: those that the library declares."""

    files: ClassVar[tuple[str, ...]] = (".so", ".dylib", ".dll")

    kind: Literal["c"]

    @classmethod
    def describe(cls, file: Binary) -> dict[str, Any]:
        """See `CompiledSection.describe`; the library is loaded in the helper process."""
        return helper(file).about

    @classmethod
    def keys(cls, file: Binary) -> tuple[Sequence[Signal], Sequence[Signal], Sequence[Parameter], int | None]:
        """See `CompiledSection.keys`."""
        about = file.about
        inputs, outputs = ([Signal(*row) for row in about[name]] for name in ("inputs", "outputs"))
        if about["period_ns"] <= 0:
            raise PartError(f"{file}: states a period of {about['period_ns']} ns; expected at least 1")
        return inputs, outputs, [Parameter(*row) for row in about["parameters"]], about["period_ns"]


class CompiledController:
    """The controller; it calls the library in this process if `numbers` say "direct", or where = "plant"."""

    def __init__(self, section: CompiledC, numbers: Numbers) -> None:
        if faults := section.faults():
            raise UsageError("; ".join(faults))
        self.section, self.numbers = section, numbers
        self.reads, self.drives = section.connected_sensors, section.connected_actuators
        self.period_ns = section.period
        self._alone = "direct" in numbers
        self._parameters = section.values()
        self._library: Any = None

    def in_own_process(self) -> Self:
        """The same controller for a process that runs nothing else: it calls the library itself.

        If a step does not return within `LONGEST_S`, the timer of the system ends the process.
        """
        return type(self)(self.section, {**self.numbers, "direct": True})

    def start(self) -> Values:
        """The state before the first sample."""
        code, state = self._opened().init(self._parameters)
        return tuple(self._checked("init", code, state))

    def update(self, state: Values, t_ns: int, values: Values) -> tuple[Values, Values]:
        """Next state, and the commands [unit of each output]."""
        library = self._library or self._opened()
        if self._alone:
            signal.setitimer(signal.ITIMER_REAL, LONGEST_S)  # SIGALRM ends a process, in whose code it may be
        try:
            code, after, commands = library.step(self._parameters, state, t_ns, values)
        except ControllerLost:
            self._library = None
            raise
        finally:
            if self._alone:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
        if code:
            self._checked("step", code, after)
        return tuple(after), tuple(commands)

    def _opened(self) -> Any:
        """The library, in this process or in its helper."""
        direct = self._alone or self.section.where == "plant"
        self._library = (_opened if direct else helper)(self.section.file)
        return self._library

    def _checked(self, function: str, code: int, numbers: Sequence[float]) -> Sequence[float]:
        if code:
            raise ControllerLost(f"{self.section.file}: rig_controller_{function} returned {code}")
        return numbers


def _opened(file: Binary) -> c_library.Library:
    """The library in this process."""
    if file.sha256 not in OPENED:
        with file.unpacked() as path:
            try:
                OPENED[file.sha256] = c_library.Library(str(path))
            except c_library.LibraryFault as fault:
                raise PartError(f"{file}: {fault}") from None
    return OPENED[file.sha256]
