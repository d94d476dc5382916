"""FMUs for co-simulation (FMI 2.0, 3.0): their description as plain values, and an instance that makes steps.

Units of an FMU are exponents of SI base units with factor and offset. Their names are free text and are not compared.

fmpy reads the description, loads the library and calls it: an update takes 12 us.
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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rig.errors import ControllerLost, PartError, RigError
from rig.extras import needed
from rig.machine.files import unpacked
from rig.parts import Binary, require
from rig.units import OTHERS, SIZES

LARGEST = 256 << 20
"""Largest size of the files of an FMU together [bytes]. # chosen"""
NO_UNIT = ""
"""Unit of a signal without one in the description: it is connected to any sensor or actuator."""
_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_NAMED = {
    (1, 1, -2): "N",
    (1, 0, -2): "N/m",
    (1, 0, -1): "N*s/m",
    (1, 1, -1): "N*s",
    (1, -1, -2): "Pa",
    (1, 2, -3, -1): "V",
    (1, 1, -2, -1): "V*s/m",
    (1, 2, -3, -2): "ohm",
    (1, 2, -2, -2): "H",
    (-1, -2, 4, 2): "F",
    (0, 1): "m",
    (0, 1, -1): "m/s",
    (0, 1, -2): "m/s^2",
    (0, 0, 1): "s",
    (0, 0, -1): "Hz",
    (0, 0, 0, 0, 0, 0, 0, 1): "rad",
    (0, 0, -1, 0, 0, 0, 0, 1): "rad/s",
    (): "1",
}
"""Exponents of the base units, without zeros at the end -> unit."""


def unit_of(exponents: Iterable[int]) -> str:
    """The SI unit with these exponents of kg, m, s, A, K, mol, cd, rad."""
    given = [int(power) for power in exponents]
    while given and not given[-1]:
        given.pop()
    return _NAMED.get(tuple(given)) or "*".join(
        f"{base}^{power}" if power != 1 else base for base, power in zip(_BASES, given) if power
    )


def described(file: Binary) -> dict[str, Any]:
    """The description of an FMU for co-simulation (FMI 2.0 or 3.0), as plain JSON values.

    Raises PartError for what is no such FMU, or has no code for this machine; UsageError without the library fmpy.
    """
    fmpy = needed("fmpy", "fmi")
    try:
        with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
            unpacked(archive, LARGEST)
            names = archive.namelist()
    except zipfile.BadZipFile:
        raise PartError("is not an FMU: it is not a zip file") from None
    except OSError as error:
        raise PartError(f"is not usable: {error.strerror}") from None
    try:
        model = fmpy.read_model_description(io.BytesIO(file.content))
    except Exception as error:  # of many kinds
        raise PartError(f"is not a usable FMU: {_brief(error)}") from None
    if model.fmiMajorVersion not in (2, 3):
        raise PartError(f"is of FMI {model.fmiVersion}; FMI 2.0 and 3.0 are possible")
    co = model.coSimulation
    if co is None:
        raise PartError("is for model exchange only; a controller is an FMU for co-simulation")
    if co.needsExecutionTool:
        raise PartError("needs the tool that made it while it runs; export it as a standalone FMU")
    binaries = {name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") >= 2}
    platform = fmpy.platform if model.fmiMajorVersion == 2 else fmpy.platform_tuple
    if platform not in binaries:
        has = ", ".join(sorted(binaries)) or "no machine (source code only)"
        raise PartError(f"has code for {has}; this machine needs {platform}")
    units = {unit.name: unit.baseUnit for unit in model.unitDefinitions}
    real = [v for v in model.modelVariables if v.type in ("Real", "Float64") and not v.dimensions]
    direct = {o.variable.name: o.dependencies for o in model.outputs if o.variable is not None}
    return {
        "fmi": model.fmiMajorVersion,
        "identifier": co.modelIdentifier,
        "token": model.guid,
        "repeatable": bool(co.canGetAndSetFMUstate),
        "once": bool(co.canBeInstantiatedOnlyOncePerProcess),
        "step": _step(model),
        "inputs": [_signal(v, units) for v in real if v.causality == "input"],
        "outputs": [
            {**_signal(v, units), "direct": None if (of := direct.get(v.name)) is None else [i.name for i in of]}
            for v in real
            if v.causality == "output"
        ],
        "parameters": [_parameter(v, units) for v in real if v.causality == "parameter"],
    }


def _step(model: Any) -> float | None:
    """The step [s] of which the time between two calls must be a multiple; None if any time is possible."""
    co = model.coSimulation
    if co.fixedInternalStepSize is not None:
        return float(co.fixedInternalStepSize)
    experiment = model.defaultExperiment
    if co.canHandleVariableCommunicationStepSize or experiment is None or experiment.stepSize is None:
        return None
    return float(experiment.stepSize)


def _signal(variable: Any, units: Mapping[str, Any]) -> dict[str, Any]:
    """Name, reference, and unit: value in the FMU = (value in SI - offset) / factor."""
    base = units.get(_of(variable, "unit"))
    factor, offset = (1.0, 0.0) if base is None else (float(base.factor), float(base.offset))
    unit = NO_UNIT if base is None else unit_of(int(getattr(base, name)) for name in _BASES)
    return {"name": variable.name, "vr": variable.valueReference, "unit": unit, "factor": factor, "offset": offset}


def _parameter(variable: Any, units: Mapping[str, Any]) -> dict[str, Any]:
    signal = _signal(variable, units)
    unit = signal["unit"] or "1"
    most = SIZES.get(unit, OTHERS)[1]

    def si(text: Any, default: float) -> float:
        return default if text is None else float(text) * signal["factor"] + signal["offset"]

    low, high = si(_of(variable, "min"), -most), si(_of(variable, "max"), most)
    value = si(variable.start, math.nan)
    tunable = variable.variability == "tunable"
    return {**signal, "unit": unit, "value": value, "low": low, "high": high, "tunable": tunable}


def _of(variable: Any, attribute: str) -> Any:
    """An attribute of a variable, or else of its type."""
    own = getattr(variable, attribute)
    return own if own is not None or variable.declaredType is None else getattr(variable.declaredType, attribute)


def _brief(error: Exception) -> str:
    lines = [line for line in str(error).splitlines() if line.strip()]
    return "; ".join(lines[:3])[:300] or type(error).__name__


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


def _log(file: str, messages: deque[str]) -> Callable[[int, bytes | None], None]:
    """What adds a warning or error of the FMU to `messages`."""

    def add(status: int, text: bytes | None) -> None:
        if status >= _WARNING:
            label = _STATUS[min(status, len(_STATUS) - 1)]
            messages.append(f"{file}: {label}: {(text or b'').decode(errors='replace').strip()}")

    return add


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
        self._messages: deque[str] = deque(maxlen=_KEPT)
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
            self._instantiate(module, _log(str(file), self._messages))
        except RigError:
            raise
        except Exception as error:  # fmpy raises Exception itself
            raise self._lost(f"cannot be instantiated: {error}") from None
        self._end = weakref.finalize(self, _free, made)
        kind, state = ("Float64", "FMUState") if self._three else ("Real", "FMUstate")
        self._keep, self._back, self._drop = (getattr(made, f"{verb}{state}") for verb in ("get", "set", "free"))
        self._assign, self._read = (getattr(made, f"{verb}{kind}") for verb in ("set", "get"))
        self._inputs, self._outputs, self._parameters = list(inputs), list(outputs), list(parameters)
        self._values = list(values)

    def _instantiate(self, module: Any, log: Callable[[int, bytes | None], None]) -> None:
        if self._three:
            self._fmu.instantiate(loggingOn=True, logMessage=lambda _, status, category, text: log(status, text))
            return
        callbacks = module.fmi2CallbackFunctions()
        callbacks.logger = module.fmi2CallbackLoggerTYPE(lambda _, name, status, category, text: log(status, text))
        callbacks.allocateMemory = module.fmi2CallbackAllocateMemoryTYPE(module.calloc)
        callbacks.freeMemory = module.fmi2CallbackFreeMemoryTYPE(module.free)
        module.addLoggerProxy(ctypes.byref(callbacks))
        self._fmu.instantiate(callbacks=callbacks, loggingOn=True)

    def begin(self, t: float) -> None:
        """Initialise at time t [s] with the parameters."""
        with self._losing("cannot be initialised"):
            begin = {"startTime": t}
            if not self._three:
                self._fmu.setupExperiment(**begin)
            if self._parameters:
                self._assign(self._parameters, self._values)
            self._fmu.enterInitializationMode(**begin if self._three else {})
            self._fmu.exitInitializationMode()

    def assign(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Set tunable parameters between two steps."""
        with self._losing("refuses its parameters"):
            if references:
                self._assign(list(references), list(values))

    def step(self, t: float, h: float, values: Sequence[float] | None) -> list[float]:
        """The outputs after a step of h [s] from time t [s] with these inputs; None: with those of the last step."""
        if self._inputs and values is not None:
            with self._losing(f"refuses its inputs {list(values)}"):
                self._assign(self._inputs, list(values))
        with self._losing(f"the step from t = {t:.9g} s failed"):
            ended = self._fmu.doStep(currentCommunicationPoint=t, communicationStepSize=h)
        if self._three:
            _, ends, early, last = ended
            if ends:
                raise self._lost(f"asked to end the simulation in the step from t = {t:.9g} s")
            if early and not math.isclose(last, t + h, abs_tol=1e-12):
                raise self._lost(f"ended the step from t = {t:.9g} s early, at t = {last:.9g} s")
        with self._losing("does not return its outputs"):
            return [float(value) for value in self._read(self._outputs)] if self._outputs else []

    def keep(self) -> Any:
        """The state of the FMU, for `back`; `drop` frees its memory."""
        with self._losing("does not return its state"):
            return self._keep()

    def back(self, kept: Any) -> None:
        """Return to a state of this instance."""
        with self._losing("does not take its state back"):
            self._back(kept)

    def drop(self, kept: Any) -> None:
        """Free the memory of a state."""
        self._drop(kept)

    def take_messages(self) -> list[str]:
        """Warnings and errors of its log since the last call."""
        messages = list(self._messages)
        self._messages.clear()
        return messages

    @contextmanager
    def _losing(self, why: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # fmpy raises Exception itself
            raise self._lost(f"{why}: {error}") from None

    def _lost(self, why: str) -> ControllerLost:
        said = "; ".join(text.removeprefix(f"{self._file}: ") for text in self.take_messages())
        return ControllerLost(f"{self._file}: {why}{f'; its log: {said}' if said else ''}")


def _free(fmu: Any) -> None:
    if fmu.component:
        fmu.freeInstance()
