"""A controller that is compiled from C, or from any language that can make a library with C functions.

The header rig/controllers/rig_controller.h documents what the library defines. The process of the controller calls
it: in a live run a process of its own, in `rig simulate` and studies that of the simulation. A crash, or a step that
does not return, ends this process. With where = "plant" it is the plant's process in every kind of run. State in, state
out: the bits of all runs are the same.
"""

from __future__ import annotations

import ctypes
import signal
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from rig.controllers.blocks.base import Numbers, Values
from rig.controllers.blocks.compiled import CompiledSection, Parameter, Signal
from rig.errors import ControllerLost, PartError, UsageError
from rig.parts import Binary

VERSION = 1
_MOST = 1000  # signals, parameters, states

LONGEST_S = 2.0
"""Longest time of a step [s]; then the timer of the system ends the process (SIGALRM). # chosen"""
OPENED: dict[str, Library] = {}
"""SHA-256 -> library that this process has loaded."""
_TIMER: Any = getattr(signal, "setitimer", lambda *_: None)
_REAL = getattr(signal, "ITIMER_REAL", 0)


class _Signal(ctypes.Structure):
    _fields_ = [("name", ctypes.c_char_p), ("unit", ctypes.c_char_p)]


class _Parameter(ctypes.Structure):
    _fields_ = [("name", ctypes.c_char_p), ("unit", ctypes.c_char_p)] + [
        (name, ctypes.c_double) for name in ("value", "low", "high")
    ]


class _About(ctypes.Structure):
    _fields_ = [
        ("version", ctypes.c_int32),
        ("size", ctypes.c_int32),
        ("period_ns", ctypes.c_int64),
        *((name, ctypes.c_int32) for name in ("inputs", "outputs", "parameters", "states")),
        ("input", ctypes.POINTER(_Signal)),
        ("output", ctypes.POINTER(_Signal)),
        ("parameter", ctypes.POINTER(_Parameter)),
    ]


def _about_of(library: ctypes.CDLL) -> dict[str, Any]:
    """What the library says of itself, as plain values. Raises PartError."""
    try:
        stated = _About.in_dll(library, "rig_controller_about")
    except ValueError:
        raise PartError("defines no rig_controller_about (see rig_controller.h)") from None
    if stated.version != VERSION:
        raise PartError(
            f"was compiled with version {stated.version} of rig_controller.h, this rig needs version {VERSION}: "
            "compile it again with the header of this rig"
        )
    if stated.size != ctypes.sizeof(_About):
        raise PartError(
            f"states a size of {stated.size} bytes for struct rig_controller, which has {ctypes.sizeof(_About)}: "
            "compile it again with the header of this rig, for this machine"
        )
    lists: dict[str, list[Any]] = {}
    for count, name, least in (("inputs", "input", 0), ("outputs", "output", 1), ("parameters", "parameter", 0)):
        number = getattr(stated, count)
        first = getattr(stated, name)
        if not least <= number <= _MOST or (number and not first):
            raise PartError(f"states {number} {count}; possible are {least} to {_MOST}, with a list of them")
        lists[count] = [first[i] for i in range(number)]
    if not 0 <= stated.states <= _MOST:
        raise PartError(f"states {stated.states} states; possible are 0 to {_MOST}")
    return {
        "period_ns": stated.period_ns,
        "states": stated.states,
        "inputs": [_named(signal) for signal in lists["inputs"]],
        "outputs": [_named(signal) for signal in lists["outputs"]],
        "parameters": [
            [*_named(parameter), parameter.value, parameter.low, parameter.high] for parameter in lists["parameters"]
        ],
    }


def _named(signal: Any) -> list[Any]:
    """Name and unit of a signal or a parameter."""
    return [_text(signal.name), _text(signal.unit)]


def _text(raw: bytes | None) -> str:
    return (raw or b"").decode(errors="replace")


class Library:
    """The compiled controller in the file `path`. Raises PartError, with the reason, if it cannot be used."""

    def __init__(self, path: str) -> None:
        try:
            self._library = ctypes.CDLL(path)
        except OSError as error:
            raise PartError(f"cannot be loaded: {str(error).removeprefix(f'{path}: ')}") from None
        self.about = about = _about_of(self._library)
        inputs, outputs, parameters = (len(about[name]) for name in ("inputs", "outputs", "parameters"))
        states = about["states"]
        self._parameters = (ctypes.c_double * parameters)()
        self._state = (ctypes.c_double * states)()
        self._input = (ctypes.c_double * inputs)()
        self._next = (ctypes.c_double * states)()
        self._output = (ctypes.c_double * outputs)()
        self._given: Sequence[float] | None = None
        self._init = self._function("init", ctypes.c_void_p, ctypes.c_void_p)
        self._step = self._function("step", *[ctypes.c_void_p] * 3, ctypes.c_int64, *[ctypes.c_void_p] * 2)
        numbers = (self._parameters, self._state, self._next, self._input, self._output)
        self._at = [ctypes.addressof(buffer) for buffer in numbers]

    def _function(self, name: str, *kinds: Any) -> Any:
        try:
            function = getattr(self._library, f"rig_controller_{name}")
        except AttributeError:
            raise PartError(f"defines no rig_controller_{name} (see rig_controller.h)") from None
        function.argtypes = kinds
        function.restype = ctypes.c_int32
        return function

    def _take(self, parameters: Sequence[float]) -> None:
        if parameters is not self._given:
            self._parameters[:] = list(parameters)
            self._given = parameters

    def init(self, parameters: Sequence[float]) -> tuple[int, list[float]]:
        """What init returned, and the state before the first step."""
        self._take(parameters)
        code = self._init(self._at[0], self._at[2])
        return code, self._next[:]

    def step(
        self, parameters: Sequence[float], state: Sequence[float], t_ns: int, values: Sequence[float]
    ) -> tuple[int, list[float], list[float]]:
        """What step returned, the next state, and the commands."""
        self._take(parameters)
        self._state[:] = list(state)
        self._input[:] = list(values)
        p, s, after, heard, given = self._at
        code = self._step(p, s, after, t_ns, heard, given)
        return code, self._next[:], self._output[:]


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
        inputs = [Signal(*row) for row in about["inputs"]]
        outputs = [Signal(*row) for row in about["outputs"]]
        if about["period_ns"] <= 0:
            raise PartError(f"{file}: states a period of {about['period_ns']} ns; expected at least 1")
        return inputs, outputs, [Parameter(*row) for row in about["parameters"]], about["period_ns"]


class CompiledController:
    """The controller; the process that works with it loads the library at the first call."""

    def __init__(self, section: CompiledC, numbers: Numbers) -> None:
        if faults := section.faults():
            raise UsageError("; ".join(faults))
        self.section = section
        self.numbers = numbers
        self.reads = section.connected_sensors
        self.drives = section.connected_actuators
        self.period_ns = section.period
        self._parameters = section.values()
        self._library: Library | None = None

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


def opened(file: Binary) -> Library:
    """The library in this process."""
    if file.sha256 not in OPENED:
        with file.unpacked() as path:
            try:
                OPENED[file.sha256] = Library(str(path))
            except PartError as fault:
                raise PartError(f"{file}: {fault}") from None
    return OPENED[file.sha256]
