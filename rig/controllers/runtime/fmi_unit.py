"""An instance of an FMU for co-simulation (FMI 2.0, 3.0): inputs, a step, outputs, state kept and restored.

fmpy loads the library and defines the types of its functions. A step calls these functions itself, with buffers that
are made once: three calls take 2 to 4 us.
"""

from __future__ import annotations

import ctypes
import io
import math
import shutil
import tempfile
import weakref
import zipfile
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rig.controllers.runtime.fmi_description import LARGEST
from rig.errors import ControllerLost, RigError
from rig.extras import needed
from rig.parts import Binary, require
from rig.user_files import unpacked

_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_WARNING = 1
_KEPT = 20  # messages
_FOLDERS: dict[str, Path] = {}
"""SHA-256 of an FMU -> folder with its files, which is removed when this process ends."""


def _folder(file: Binary) -> Path:
    """The folder with the files of an FMU. Raises Untrusted for one that is not trusted."""
    require([file])
    if file.sha256 not in _FOLDERS:
        try:
            with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
                unpacked(archive, LARGEST)  # a recording states what `described` found, and its FMU may be another
                folder = Path(tempfile.mkdtemp(prefix="friction-rig-fmu-"))
                weakref.finalize(Binary, shutil.rmtree, folder, True)  # at the end of the process
                archive.extractall(folder)  # it removes .. and absolute paths
        except (OSError, zipfile.BadZipFile) as error:
            raise ControllerLost(f"{file}: cannot be unpacked: {getattr(error, 'strerror', None) or error}") from None
        _FOLDERS[file.sha256] = folder
    return _FOLDERS[file.sha256]


class _Log:
    """The warnings and errors in the log of the FMU `file` that nobody has taken yet."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.messages: deque[str] = deque(maxlen=_KEPT)

    def add(self, status: int, text: bytes | None) -> None:
        """Add a message with its status."""
        if status >= _WARNING:
            label = _STATUS[min(status, len(_STATUS) - 1)]
            self.messages.append(f"{self.file}: {label}: {(text or b'').decode(errors='replace').strip()}")


class Unit:
    """An instance of the FMU `file`; call `begin` before the first step.

    `inputs`, `outputs`, `parameters`: value references; `values`: of the parameters, in the units of the FMU. All
    methods raise ControllerLost if the FMU reports an error.
    """

    def __init__(
        self,
        file: Binary,
        inputs: Sequence[int],
        outputs: Sequence[int],
        parameters: Sequence[int],
        values: Sequence[float],
    ) -> None:
        self._file = file
        self._log = log = _Log(str(file))
        about = file.about
        self._three = about["fmi"] == 3
        name = "fmi3" if self._three else "fmi2"
        module = needed(f"fmpy.{name}", "fmi")
        folder = str(_folder(file))
        try:
            made = (module.FMU3Slave if self._three else module.FMU2Slave)(
                guid=about["token"], modelIdentifier=about["identifier"], unzipDirectory=folder, instanceName=str(file)
            )
            self._fmu = made
            self._instantiate(module, log)
        except RigError:
            raise
        except Exception as error:  # fmpy raises Exception itself
            raise self._lost(f"cannot be instantiated: {error}") from None
        self._end = weakref.finalize(self, _free, made)
        dll = made.dll
        kind = "Float64" if self._three else "Real"
        self._set, self._get = (getattr(dll, f"{name}{verb}{kind}") for verb in ("Set", "Get"))
        self._do = getattr(dll, f"{name}DoStep")
        self._name, self._component = name, made.component
        references = ctypes.c_uint32
        self._in = (references * len(inputs))(*inputs), len(inputs), (ctypes.c_double * len(inputs))()
        self._out = (references * len(outputs))(*outputs), len(outputs), (ctypes.c_double * len(outputs))()
        self._parameters, self._values = tuple(parameters), tuple(values)
        self._flags: list[Any] = [ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double()]
        self._more = [ctypes.byref(one) for one in self._flags] if self._three else []
        self._sizes: tuple[int, ...] = (len(inputs),) if self._three else ()
        self._out_sizes: tuple[int, ...] = (len(outputs),) if self._three else ()

    def _instantiate(self, module: Any, log: _Log) -> None:
        if self._three:
            self._fmu.instantiate(loggingOn=True, logMessage=lambda _, status, category, text: log.add(status, text))
            return
        callbacks = module.fmi2CallbackFunctions()
        callbacks.logger = module.fmi2CallbackLoggerTYPE(lambda _, name, status, category, text: log.add(status, text))
        callbacks.allocateMemory = module.fmi2CallbackAllocateMemoryTYPE(module.calloc)
        callbacks.freeMemory = module.fmi2CallbackFreeMemoryTYPE(module.free)
        module.addLoggerProxy(ctypes.byref(callbacks))
        self._fmu.instantiate(callbacks=callbacks, loggingOn=True)

    def begin(self, t: float) -> None:
        """Initialise at time t [s] with the parameters."""
        try:
            if self._three:
                self._assign(self._parameters, self._values)
                self._fmu.enterInitializationMode(startTime=t)
            else:
                self._fmu.setupExperiment(startTime=t)
                self._assign(self._parameters, self._values)
                self._fmu.enterInitializationMode()
            self._fmu.exitInitializationMode()
        except Exception as error:
            raise self._lost(f"cannot be initialised: {error}") from None

    def _assign(self, references: Sequence[int], values: Sequence[float]) -> None:
        if references:
            (self._fmu.setFloat64 if self._three else self._fmu.setReal)(list(references), list(values))

    def assign(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Set tunable parameters between two steps."""
        try:
            self._assign(references, values)
        except Exception as error:
            raise self._lost(f"refuses its parameters: {error}") from None

    def step(self, t: float, h: float, values: Sequence[float] | None) -> list[float]:
        """The outputs after a step of h [s] from time t [s] with these inputs; None: with those of the last step."""
        vr, count, buffer = self._in
        if count and values is not None:
            buffer[:] = list(values)
            if self._set(self._component, vr, count, buffer, *self._sizes) > _WARNING:
                raise self._lost(f"refuses its inputs {list(values)}")
        status = self._do(self._component, t, h, True, *self._more)
        if status > _WARNING:
            raise self._lost(f"the step from t = {t:.9g} s ended with the status {_STATUS[min(status, 5)]}")
        if self._three:
            _, ends, early, last = self._flags
            if ends.value:
                raise self._lost(f"asked to end the simulation in the step from t = {t:.9g} s")
            if early.value and not math.isclose(last.value, t + h, abs_tol=1e-12):
                raise self._lost(f"ended the step from t = {t:.9g} s early, at t = {last.value:.9g} s")
        vr, count, buffer = self._out
        if self._get(self._component, vr, count, buffer, *self._out_sizes) > _WARNING:
            raise self._lost("does not return its outputs")
        return buffer[:]

    def keep(self) -> Any:
        """The state of the FMU, for `back`; `drop` frees its memory."""
        try:
            return self._fmu.getFMUState() if self._three else self._fmu.getFMUstate()
        except Exception as error:
            raise self._lost(f"does not return its state: {error}") from None

    def back(self, kept: Any) -> None:
        """Return to a state of this instance."""
        try:
            (self._fmu.setFMUState if self._three else self._fmu.setFMUstate)(kept)
        except Exception as error:
            raise self._lost(f"does not take its state back: {error}") from None

    def drop(self, kept: Any) -> None:
        """Free the memory of a state."""
        (self._fmu.freeFMUState if self._three else self._fmu.freeFMUstate)(kept)

    def take_messages(self) -> list[str]:
        """Warnings and errors of its log since the last call."""
        found = list(self._log.messages)
        self._log.messages.clear()
        return found

    def _lost(self, why: str) -> ControllerLost:
        said = "; ".join(text.removeprefix(f"{self._file}: ") for text in self.take_messages())
        return ControllerLost(f"{self._file}: {why}{f'; its log: {said}' if said else ''}")


def _free(fmu: Any) -> None:
    if fmu.component:
        fmu.freeInstance()
