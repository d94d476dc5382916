"""A controller that is compiled from C, or from any language that can make a library with C functions.

The header rig/controllers/rig_controller.h documents what the library defines. The library is called in the process of
its controller; a run in one process (`rig simulate`, studies) calls it through a helper process, so that a crash is
only the controller's. With where = "plant" the plant's process calls it, in every kind of run, and a crash is that of
the plant. State in, state out: the bits of all runs are the same.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, ClassVar, Literal, Self

from rig.controllers.blocks.base import Numbers, Values
from rig.controllers.blocks.compiled import CompiledSection, Parameter, Signal
from rig.controllers.runtime import c_library
from rig.controllers.runtime.c_process import LONGEST_S, helper
from rig.errors import ControllerLost, PartError, UsageError
from rig.parts import Binary

OPENED: dict[str, c_library.Library] = {}
"""SHA-256 -> library that this process has loaded."""


class _Watch(threading.Thread):
    """Ends this process if a call does not return within `LONGEST_S`: no signal handler runs meanwhile."""

    def __init__(self) -> None:
        super().__init__(name="watch-library", daemon=True)
        self._calls, self.what = 0, ""
        """Calls begun and ended; the library that is called."""

    def __enter__(self) -> None:
        self._calls += 1

    def __exit__(self, *_: object) -> None:
        self._calls += 1

    def run(self) -> None:
        """See threading.Thread."""
        while True:
            begun = self._calls
            time.sleep(LONGEST_S)
            if begun % 2 and self._calls == begun:
                os.write(2, f"{self.what}: rig_controller_step has not returned for {LONGEST_S:g} s\n".encode())
                os._exit(1)


_WATCH = _Watch()


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
        self._direct = section.where == "plant" or "direct" in numbers
        self._watch: AbstractContextManager[None] = _WATCH if "direct" in numbers else nullcontext()
        self._parameters = section.values()
        self._library: Any = None

    def in_own_process(self) -> Self:
        """The same controller for a process that runs nothing else: it calls the library itself.

        If a step does not return within `LONGEST_S`, the process ends with a message.
        """
        _WATCH.what = self.section.file
        if not _WATCH.is_alive():
            _WATCH.start()
        return type(self)(self.section, {**self.numbers, "direct": True})

    def start(self) -> Values:
        """The state before the first sample."""
        code, state = self._opened().init(self._parameters)
        return tuple(self._checked("init", code, state))

    def update(self, state: Values, t_ns: int, values: Values) -> tuple[Values, Values]:
        """Next state, and the commands [unit of each output]."""
        library = self._library or self._opened()
        try:
            with self._watch:
                code, after, commands = library.step(self._parameters, state, t_ns, values)
        except ControllerLost:
            self._library = None
            raise
        if code:
            self._checked("step", code, after)
        return tuple(after), tuple(commands)

    def _opened(self) -> Any:
        """The library, in this process or in its helper."""
        self._library = _opened(self.section.file) if self._direct else helper(self.section.file)
        return self._library

    def _checked(self, function: str, code: int, numbers: Sequence[float]) -> Sequence[float]:
        if not code:
            return numbers
        name = f"{self.section.file}: rig_controller_{function}"
        if code == c_library.OVERRUN:
            states, outputs = self.section.file.about["states"], len(self.section.all_outputs)
            raise ControllerLost(f"{name} writes more than the {states} states and {outputs} outputs that it states")
        raise ControllerLost(f"{name} returned {code}")


def _opened(file: Binary) -> c_library.Library:
    """The library in this process."""
    if file.sha256 not in OPENED:
        with file.unpacked() as path:
            try:
                OPENED[file.sha256] = c_library.Library(str(path))
            except c_library.LibraryFault as fault:
                raise PartError(f"{file}: {fault}") from None
    return OPENED[file.sha256]
