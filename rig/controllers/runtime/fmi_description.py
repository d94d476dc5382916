"""What the description of an FMU says, as plain values: signals and parameters with their units in SI, step, platform.

Units of an FMU are exponents of SI base units with factor and offset. Their names are free text and are not compared.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterable, Mapping
from typing import Any

from rig.errors import PartError
from rig.extras import needed
from rig.parts import Binary
from rig.units import OTHERS, SIZES
from rig.user_files import unpacked

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
    given = [int(one) for one in exponents]
    while given and not given[-1]:
        given.pop()
    if (found := _NAMED.get(tuple(given))) is not None:
        return found
    return "*".join(f"{base}^{power}" if power != 1 else base for base, power in zip(_BASES, given) if power)


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
        found = fmpy.read_model_description(io.BytesIO(file.content))
    except Exception as error:  # of many kinds
        raise PartError(f"is not a usable FMU: {_brief(error)}") from None
    if found.fmiMajorVersion not in (2, 3):
        raise PartError(f"is of FMI {found.fmiVersion}; FMI 2.0 and 3.0 are possible")
    co = found.coSimulation
    if co is None:
        raise PartError("is for model exchange only; a controller is an FMU for co-simulation")
    if co.needsExecutionTool:
        raise PartError("needs the tool that made it while it runs; export it as a standalone FMU")
    binaries = {name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") >= 2}
    platform = fmpy.platform if found.fmiMajorVersion == 2 else fmpy.platform_tuple
    if platform not in binaries:
        has = ", ".join(sorted(binaries)) or "no machine (source code only)"
        raise PartError(f"has code for {has}; this machine needs {platform}")
    units = {one.name: one.baseUnit for one in found.unitDefinitions}
    real = [one for one in found.modelVariables if one.type in ("Real", "Float64") and not one.dimensions]
    direct = {one.variable.name: one.dependencies for one in found.outputs if one.variable is not None}
    return {
        "fmi": found.fmiMajorVersion,
        "identifier": co.modelIdentifier,
        "token": found.guid,
        "repeatable": bool(co.canGetAndSetFMUstate),
        "once": bool(co.canBeInstantiatedOnlyOncePerProcess),
        "step": _step(found),
        "inputs": [_signal(one, units) for one in real if one.causality == "input"],
        "outputs": [
            {**_signal(one, units), "direct": None if (of := direct.get(one.name)) is None else [v.name for v in of]}
            for one in real
            if one.causality == "output"
        ],
        "parameters": [_parameter(one, units) for one in real if one.causality == "parameter"],
    }


def _step(found: Any) -> float | None:
    """The step [s] of which the time between two calls must be a multiple; None if any time is possible."""
    co = found.coSimulation
    if co.fixedInternalStepSize is not None:
        return float(co.fixedInternalStepSize)
    experiment = found.defaultExperiment
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
