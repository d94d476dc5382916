"""The description of a rig as an FMU: its inputs and outputs, with units as exponents of SI base units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from rig.scenes.scene import Scene
from rig.units import exponents

SENSORS, OUTPUTS = "sensors", "outputs"
NEEDS = (
    "The rig runs in a child process. Needed: a Python with friction-rig of the same version; its path is the "
    "parameter `python`."
)


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
    defined, variables = "\n".join(_units(units)), "\n".join(_variables(interface, python, scene.seed))
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
        found = exponents(unit)
        if found is not None:
            powers = "".join(f' {base}="{power}"' for base, power in found.items())
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
