"""Writes a scene as an FMU.

The description of a rig as an FMU: its inputs and outputs, with units as exponents of SI base units.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from xml.sax.saxutils import quoteattr

from rig.bench.run.simulate import RestartableRig
from rig.errors import UsageError
from rig.machine.files import draft_of
from rig.scenes.scene import Scene
from rig.units import exponents

SENSORS = "sensors"
OUTPUTS = "outputs"
NEEDS = (
    "The rig runs in a child process. Needed: a Python with friction-rig of the same version; its path is the "
    "parameter `python`."
)
_SHIM = Path(__file__).with_name("shim.c")
_COMPILER_S = 120.0  # s that the C compiler may take [chosen]


@dataclass(frozen=True)
class Interface:
    """What an FMU of a scene has: name -> unit for each. `starts`: actuator -> its value in the scene."""

    inputs: Mapping[str, str]
    sensors: Mapping[str, str]
    outputs: Mapping[str, str]
    starts: Mapping[str, float]

    @property
    def results(self) -> dict[str, str]:
        """All outputs of the FMU, in order: the sensors, then the outputs of the plant."""
        sensors = {f"{SENSORS}.{name}": unit for name, unit in self.sensors.items()}
        return sensors | {f"{OUTPUTS}.{name}": unit for name, unit in self.outputs.items()}


def text(scene: Scene, interface: Interface, guid: str, identifier: str, python: str, version: str) -> str:
    """The file modelDescription.xml."""
    units = {*interface.inputs.values(), *interface.results.values(), "s"}
    stop = (scene.duration_ns or 10_000_000_000) * 1e-9
    defined = "\n".join(_units(units))
    variables = "\n".join(_variables(interface, python, scene.seed))
    first = len(interface.inputs) + 1  # variables are counted from 1
    results = range(first, first + len(interface.results))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(scene.name)} guid={quoteattr(guid)}
  description={quoteattr(f"{scene.title}. {NEEDS}")} generationTool={quoteattr(f"friction-rig {version}")}
  variableNamingConvention="structured" numberOfEventIndicators="0">
<CoSimulation modelIdentifier={quoteattr(identifier)} canHandleVariableCommunicationStepSize="true"
  canNotUseMemoryManagementFunctions="true"/>
<UnitDefinitions>
{defined}
</UnitDefinitions>
<LogCategories><Category name="logStatusError"/><Category name="logAll"/></LogCategories>
<DefaultExperiment startTime="0" stopTime="{stop:.9g}" stepSize="{scene.frame_ns * 1e-9:.9g}"/>
<ModelVariables>
{variables}
</ModelVariables>
<ModelStructure>
<Outputs>{"".join(f'<Unknown index="{i}" dependencies=""/>' for i in results)}</Outputs>
<InitialUnknowns>{"".join(f'<Unknown index="{i}" dependencies=""/>' for i in results)}</InitialUnknowns>
</ModelStructure>
</fmiModelDescription>
"""


def _units(units: set[str]) -> Iterator[str]:
    for unit in sorted(units):
        powers_of = exponents(unit)
        if powers_of is not None:
            powers = "".join(f' {base}="{power}"' for base, power in powers_of.items())
            yield f"<Unit name={quoteattr(unit)}><BaseUnit{powers}/></Unit>"


def _variables(interface: Interface, python: str, seed: int) -> Iterator[str]:
    """Inputs, outputs, then the parameters timeout, seed and python; value references as shim.c has them."""
    count = 0
    for name, unit in interface.inputs.items():
        about = f"command of the actuator {name}; until it is set, the protocol of the scene drives it"
        real = f'<Real start="{interface.starts[name]!r}"{_unit(unit)}/>'
        yield _variable(name, count, "input", "continuous", "", about, real)
        count += 1
    for name, unit in interface.results.items():
        kind = (
            "latest measurement" if name.startswith(f"{SENSORS}.") else "the plant's own value, without an instrument"
        )
        yield _variable(name, count, "output", "continuous", "calculated", kind, f"<Real{_unit(unit)}/>")
        count += 1
    about = "longest time that the rig may take to start, and for a step"
    yield _variable(
        "timeout", count, "parameter", "fixed", "exact", about, f'<Real start="60" min="0" max="1e6"{_unit("s")}/>'
    )
    about = "seed of all noise"
    yield _variable("seed", 0, "parameter", "fixed", "exact", about, f'<Integer start="{seed}" min="0"/>')
    about = "a Python with friction-rig: its path, or its name on PATH"
    yield _variable("python", 0, "parameter", "fixed", "exact", about, f"<String start={quoteattr(python)}/>")


def _unit(unit: str) -> str:
    return "" if exponents(unit) is None else f" unit={quoteattr(unit)}"


def _variable(
    name: str, reference: int, causality: str, variability: str, initial: str, about: str, inside: str
) -> str:
    first = f' initial="{initial}"' if initial else ""
    return (
        f'<ScalarVariable name={quoteattr(name)} valueReference="{reference}" causality="{causality}" '
        f'variability="{variability}"{first} description={quoteattr(about)}>{inside}</ScalarVariable>'
    )


def export(scene: Scene, path: Path, inputs: Sequence[str] = (), python: str = sys.executable) -> Interface:
    """Write `scene` as the FMU `path`; returns what the FMU has.

    `inputs`: actuators that are inputs; by default all that can be commanded without new matrices. `python`: start
    value of the parameter of this name. Raises UsageError for inputs that are not possible and without a C compiler,
    OutputError.
    """
    compiler = shutil.which("gcc") or shutil.which("cc")
    if not sys.platform.startswith("linux"):
        raise UsageError("an FMU of a rig can be made on Linux only: its code starts a process of this system")
    if compiler is None:
        raise UsageError("an FMU needs a C compiler, and neither gcc nor cc is installed")
    possible = _possible(scene)
    every = scene.assemble().inputs
    drives = list(inputs) or possible
    faults = [f"{name:.80}: there is no such actuator" for name in drives if name not in every]
    faults += [f"{name}: each value needs new matrices" for name in drives if name in every and name not in possible]
    if faults:
        raise UsageError(f"{'; '.join(faults)}; {scene.name} has {', '.join(possible) or 'none'}")
    rig = RestartableRig(scene, drives)  # it also compiles what the FMU will need
    runner = rig.runner
    units_of_drives = {name: runner.inputs[name].unit for name in drives}
    units_of_sensors = dict(zip(runner.bank.names, runner.bank.units))
    at_start = {name: runner.values[name] for name in drives}
    interface = Interface(units_of_drives, units_of_sensors, dict(runner.units), at_start)
    identifier = re.sub(r"\W", "_", f"rig_{scene.name}")
    with tempfile.TemporaryDirectory(prefix="friction-rig-fmu-") as folder, draft_of(path) as draft:
        guid = f"{{{uuid.uuid4()}}}"
        library = _compiled(compiler, Path(folder) / f"{identifier}.so", guid, interface, scene.seed, python)
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
            described = text(scene, interface, guid, identifier, python, version("friction-rig"))
            archive.writestr("modelDescription.xml", described)
            archive.write(library, f"binaries/linux64/{identifier}.so")
            archive.writestr("resources/scene.json", scene.to_json())
            sizes = {"inputs": drives, "outputs": len(interface.results)}
            archive.writestr("resources/interface.json", json.dumps(sizes))
    return interface


def _possible(scene: Scene) -> list[str]:
    """Actuators that can be commanded without new matrices."""
    driven = replace(scene, driven=frozenset(scene.assemble().inputs)).assemble().inputs
    return [name for name, actuator in driven.items() if actuator.state or actuator.write]


def _compiled(compiler: str, path: Path, guid: str, interface: Interface, seed: int, python: str) -> Path:
    """Compile the shim. Raises UsageError with the message of the compiler."""
    quoted = python.replace("\\", "\\\\").replace('"', '\\"')
    given = {"GUID": f'"{guid}"', "PYTHON": f'"{quoted}"', "SEED": seed}
    given |= {"NAMES": "".join(f'"{name}",' for name in interface.inputs)}
    given |= {"INPUTS": len(interface.inputs), "OUTPUTS": len(interface.results)}
    options = [f"-D{name}={value}" for name, value in given.items()]
    command = [compiler, "-O2", "-shared", "-fPIC", *options, str(_SHIM), "-o", str(path)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_COMPILER_S)
    except subprocess.TimeoutExpired:
        raise UsageError(f"{compiler} did not finish within {_COMPILER_S:g} s") from None
    if done.returncode:
        said = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip())
        raise UsageError(f"{compiler} cannot compile the FMU: {said:.300}")
    return path
