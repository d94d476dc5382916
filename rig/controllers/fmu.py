"""A controller from another tool: an FMU for co-simulation, FMI 2.0 or 3.0.

At each update the inputs are set, a step of one period is done, and the outputs are the commands. Inputs and outputs
are real scalars; others keep their start values. Parameters of the FMU are keys of the scene, in SI. An FMU keeps its
state itself. If it can return and take back its state, an update can be tried, and parameters can be tuned while it
runs. An FMU that cannot is not repeatable: what it answers may depend on what it was asked before.

Units of an FMU are exponents of SI base units with factor and offset. Their names are free text and are not compared.

fmpy reads the description, loads the library and calls it: an update takes 12 us.
"""

from __future__ import annotations

import ctypes
import io
import math
import re
import shutil
import tempfile
import weakref
import zipfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

from rig.controllers.blocks.base import Numbers, Values
from rig.controllers.blocks.compiled import CompiledSection, Parameter, Signal
from rig.errors import ControllerLost, PartError, RigError, UsageError
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

_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_WARNING = 1
_KEPT = 20  # messages
_FOLDERS: dict[str, Path] = {}
"""SHA-256 of an FMU -> folder with its files, which is removed when this process ends."""


def unit_of(exponents: Iterable[int]) -> str:
    """The SI unit with these exponents of kg, m, s, A, K, mol, cd, rad."""
    given = [int(power) for power in exponents]
    while given and not given[-1]:
        given.pop()
    if named := _NAMED.get(tuple(given)):
        return named
    factors = ((base, power) for base, power in zip(_BASES, given) if power)
    return "*".join(f"{base}^{power}" if power != 1 else base for base, power in factors)


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
    except (LookupError, AttributeError, TypeError):  # of the reader, whose words name nothing in the file
        raise PartError(
            "is not a usable FMU: its modelDescription.xml contradicts itself or lacks an entry, such as a variable to "
            "which ModelStructure refers by its index; export it again, or check it with fmpy validate"
        ) from None
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
        "outputs": [_output(v, units, direct.get(v.name)) for v in real if v.causality == "output"],
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


def _output(variable: Any, units: Mapping[str, Any], dependencies: Any) -> dict[str, Any]:
    """The same with the names of the inputs that it depends on at once; None if the FMU does not state them."""
    direct = None if dependencies is None else [signal.name for signal in dependencies]
    return {**_signal(variable, units), "direct": direct}


def _parameter(variable: Any, units: Mapping[str, Any]) -> dict[str, Any]:
    signal = _signal(variable, units)
    unit = signal["unit"] or "1"
    most = SIZES.get(unit, OTHERS)[1]

    def si(text: Any, default: float) -> float:
        return default if text is None else float(text) * signal["factor"] + signal["offset"]

    low = si(_of(variable, "min"), -most)
    high = si(_of(variable, "max"), most)
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
        self._inputs = list(inputs)
        self._outputs = list(outputs)
        self._parameters = list(parameters)
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


class Fmu(CompiledSection):
    """Parameters: those of the FMU that are real scalars.

    inputs    names of the inputs that are connected to `reads`, in that order; by default all real ones
    outputs   names of the outputs that are connected to `drives`, in that order; by default all real ones
    """

    fixed: ClassVar[frozenset[str]] = CompiledSection.fixed | {"inputs", "outputs"}
    files: ClassVar[tuple[str, ...]] = (".fmu",)

    kind: Literal["fmu"]
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    @classmethod
    def describe(cls, file: Binary) -> dict[str, Any]:
        """See `CompiledSection.describe`."""
        try:
            return described(file)
        except PartError as fault:
            raise PartError(f"{file}: {fault}") from None
        except UsageError as fault:  # fmpy is missing
            raise PartError(str(fault)) from None

    @classmethod
    def keys(cls, file: Binary) -> tuple[Sequence[Signal], Sequence[Signal], Sequence[Parameter], int | None]:
        """See `CompiledSection.keys`."""
        about = file.about
        inputs = [Signal(row["name"], row["unit"]) for row in about["inputs"]]
        names = tuple(signal.name for signal in inputs)
        outputs = []
        for row in about["outputs"]:
            direct = names if row["direct"] is None else tuple(row["direct"])
            outputs.append(Signal(row["name"], row["unit"], direct))
        parameters = []
        for row in about["parameters"]:
            fixed = not (row["tunable"] and about["repeatable"])
            parameters.append(Parameter(_key(row["name"]), row["unit"], row["value"], row["low"], row["high"], fixed))
        return inputs, outputs, parameters, None

    @property
    def used_inputs(self) -> tuple[Signal, ...]:
        """See `CompiledSection.used_inputs`."""
        return _chosen(self.all_inputs, self.inputs)

    @property
    def used_outputs(self) -> tuple[Signal, ...]:
        """See `CompiledSection.used_outputs`."""
        return _chosen(self.all_outputs, self.outputs)

    def faults(self) -> list[str]:
        """See `CompiledSection.faults`."""
        faults = []
        for key, signals in (("inputs", self.all_inputs), ("outputs", self.all_outputs)):
            known = [signal.name for signal in signals]
            for name in getattr(self, key):
                if name not in known:
                    listed = ", ".join(known) or "none"
                    faults.append(f"{key}: {self.file} has no real {key[:-1]} {name:.80}; it has {listed}")
        faults = faults or super().faults()
        step = self.file.about["step"]
        period = self.period * 1e-9
        if step is not None and (step <= 0.0 or abs(period / step - round(period / step)) > 1e-9 or period < step):
            faults.append(f"period: {period:g} s is not a multiple of {step:g} s, the fixed step of {self.file}")
        return faults

    def notes(self) -> Iterator[str]:
        """What its user must know before a run."""
        if not self.file.about["repeatable"]:
            yield (
                f"{self.file} cannot return and take back its state (canGetAndSetFMUstate), so it is not repeatable, "
                "and its parameters are fixed while it runs; rig verify plays the recorded commands and needs no FMU"
            )


def _key(name: str) -> str:
    """The name of a variable as a key of a scene: controller.gain[1] is controller_gain_1."""
    return re.sub(r"\W+", "_", name).strip("_")


def _chosen(signals: tuple[Signal, ...], names: tuple[str, ...]) -> tuple[Signal, ...]:
    known = {signal.name: signal for signal in signals}
    return tuple(known[name] for name in names if name in known) if names else signals


class Moment(NamedTuple):
    """The state of an FMU: its instance, the number of steps that it has done, and the time of the next one [ns]."""

    unit: Any
    steps: int
    next_ns: int


class _Instance(Unit):
    """An instance with the number of steps that it has done, and the state that was kept last."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.owner: FmuController | None = None
        self.steps = 0
        self._kept: tuple[int, Any] | None = None

    def turn_to(self, owner: FmuController, steps: int) -> None:
        """Continue from `steps` with the parameters of `owner`. Raises ControllerLost if it cannot return there."""
        if steps != self.steps:
            if self._kept is None or self._kept[0] != steps:
                raise ControllerLost(f"{owner.section.file} cannot return to an earlier state")
            self.back(self._kept[1])
            self.steps = steps
        if self.owner is not None and owner.section.file.about["repeatable"]:
            if self._kept is None or self._kept[0] != steps:
                if self._kept is not None:
                    self.drop(self._kept[1])
                self._kept = steps, self.keep()
            self.assign(*owner.tunable)
        self.owner = owner


class FmuController:
    """The controller."""

    def __init__(self, section: Fmu, numbers: Numbers) -> None:
        if faults := section.faults():
            raise UsageError("; ".join(faults))
        self.section = section
        self.numbers = numbers
        self.reads = section.connected_sensors
        self.drives = section.connected_actuators
        self.period_ns = section.period
        self._h = section.period * 1e-9
        about = section.file.about
        self._inputs = _rows(about["inputs"], section.used_inputs)
        self._outputs = _rows(about["outputs"], section.used_outputs)
        self._scaled = any((row["factor"], row["offset"]) != (1.0, 0.0) for row in (*self._inputs, *self._outputs))
        self._values = [_to_fmu(row, value) for row, value in zip(about["parameters"], section.values())]
        pairs = [(p["vr"], value) for p, value in zip(about["parameters"], self._values) if p["tunable"]]
        self.tunable = [vr for vr, _ in pairs], [value for _, value in pairs]
        self._unit: Unit | None = None

    def start(self) -> Moment:
        """A new instance, which is initialised at the time of its first step."""
        file = self.section.file
        inputs = [row["vr"] for row in self._inputs]
        outputs = [row["vr"] for row in self._outputs]
        parameters = [row["vr"] for row in file.about["parameters"]]
        self._unit = unit = _Instance(file, inputs, outputs, parameters, self._values)
        return Moment(unit, 0, -1)

    def update(self, state: Moment, t_ns: int, values: Values) -> tuple[Moment, Values]:
        """The next state, and the outputs after a step of one period [unit of each actuator].

        Steps that were left out, because a measurement was missing, are done first with the inputs of the last one.
        """
        unit, steps, next_ns = state
        if unit.owner is not self or unit.steps != steps:
            unit.turn_to(self, steps)
            self._unit = unit
        if next_ns < 0:
            unit.begin(t_ns * 1e-9)
            next_ns = t_ns
        while next_ns < t_ns:
            unit.step(next_ns * 1e-9, self._h, None)
            next_ns += self.period_ns
        given: Sequence[float] = list(map(_to_fmu, self._inputs, values)) if self._scaled else values
        answer = unit.step(t_ns * 1e-9, self._h, given)
        commands = tuple(map(_from_fmu, self._outputs, answer) if self._scaled else answer)
        unit.steps = steps + 1
        return Moment(unit, steps + 1, next_ns + self.period_ns), commands

    def take_events(self) -> list[tuple[str, str]]:
        """Kind and text of the warnings and errors in the log of the FMU since the last call."""
        return [] if self._unit is None else [("log", text) for text in self._unit.take_messages()]


def _rows(variables: Iterable[dict[str, Any]], signals: Iterable[Signal]) -> list[dict[str, Any]]:
    by_name = {row["name"]: row for row in variables}
    return [by_name[signal.name] for signal in signals]


def _to_fmu(row: dict[str, Any], value: float) -> float:
    return float((value - row["offset"]) / row["factor"])


def _from_fmu(row: dict[str, Any], value: float) -> float:
    return float(value * row["factor"] + row["offset"])
