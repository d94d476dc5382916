"""Cases of the torture test: a rig with a start, actions while it runs, and the expected results.

The rig is that of a scene or a small one that no scene has, which isolates one difficulty. Small rigs are written like
plants, so that cases change them by the same keys. `watched` makes the scene of a case: with its sensors, a given step,
and outputs of each contact.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

from annotated_types import Gt
from pydantic import Field, ValidationError, model_validator

from rig import scenes
from rig.errors import SceneError, UsageError
from rig.model import friction_law
from rig.model.assembly import Assembly, Output
from rig.model.tables import UNROLLED
from rig.quantities import Nanoseconds, Section
from rig.scenes import faults, places, source
from rig.scenes.faults import lines
from rig.scenes.places import Place
from rig.scenes.protocol import Clock, Frame
from rig.scenes.scene import Scene
from rig.sensors.chain.instrument import Instrument
from rig.sensors.displacement_laser import DisplacementLaser
from rig.sensors.laser_vibrometer import LaserVibrometer

FOLDER = Path(__file__).parent / "cases"
Share = Annotated[float, Gt(0.0)]


class Act(Section):
    """An action on the running rig at time `at`.

    set      actuator `target` takes `to`; with a time `over` it is ramped there
    command  a controller commands `target`, "*" for all: `values` one after another, one per period `every`
    follow   `target` is set to `to` + `gain` times the output `of` in every period `every`, up to the end
    change   parameter `target` takes `to`
    knock    an impulse `to` [N s] along the sliding direction
    blocks   from here on the plant is advanced in blocks of `values` ticks, in turn
    pause    the paced loop stops for `to` seconds of the clock and continues
    """

    do: Literal["set", "command", "follow", "change", "knock", "blocks", "pause"]
    at: Nanoseconds | Literal[0] = 0
    target: str = ""
    to: float = 0.0
    over: Nanoseconds | None = None
    values: tuple[Any, ...] = ()
    every: Nanoseconds = 1_000_000
    gain: float = 0.0
    of: str = ""


class Expect(Section):
    """The expected results in addition to the invariants of every case; numbers come from `source`.

    events   number of contact events of the reference
    still    outputs that keep their first value to the last bit
    growth   growth rate [1/s] of an unstable rig: the stability report must name it
    jams     the stability report must name jamming
    refused  text that the stability report must contain
    stops    text that the run must give when it ends early
    ends     output -> largest absolute value at the end
    largest  output -> largest absolute value at any time
    stuck    whether the rig must be stuck at the end
    """

    events: int | None = None
    still: tuple[str, ...] = ()
    growth: float | None = None
    jams: bool = False
    refused: str = ""
    stops: str = ""
    ends: dict[str, float] = Field(default_factory=dict)
    largest: dict[str, float] = Field(default_factory=dict)
    stuck: bool | None = None
    source: str = ""


class Case(Section):
    """One case. `scene`: a shipped one, "*" for each, a scene file, or `rig`: one of rig.qualify.torture.case.

    `set` changes values of the rig; `places`: where the file gives them.

    `steps`: sample steps to try. `frame`: loop period, at whose begin modes are settled; by default a step.
    `limited`: the run ends where the motion leaves a limit of its scene, as every run does. `quick`:
    part of the quick matrix, then over `quick_duration` if that is given. `seconds`: time limit of a cell, in processor
    time. `processes`: the scene also runs as processes in lockstep, with its controllers.
    """

    name: str
    title: str
    about: str
    scene: str = ""
    rig: str = ""
    set: dict[str, Any] = Field(default_factory=dict)
    places: dict[str, Place] = Field(default_factory=dict, exclude=True)
    duration: Nanoseconds
    quick_duration: Nanoseconds | None = None
    steps: tuple[Nanoseconds, ...] = Field((1_000_000, 100_000), min_length=1)
    frame: Frame | None = None
    limited: bool = False
    quick: bool = True
    seconds: Share = 2.0
    processes: bool = False
    acts: tuple[Act, ...] = ()
    expect: Expect = Expect()

    @model_validator(mode="after")
    def _frames(self) -> Self:
        if self.frame and any(act.do not in ("set", "knock", "blocks") or act.over for act in self.acts):
            raise ValueError("actions that count frames need frames of one step: leave `frame` out")
        if not self.frame and min(self.steps) < 1_000:
            raise ValueError("steps below 1 us need frames of several steps: give `frame`")
        if self.processes and self.rig:
            raise ValueError("processes = true needs a scene: no process knows a rig of the torture test")
        return self


def read(path: Path) -> Case:
    """Return the case of a file. A scene file is sought from its folder. Raises SceneError with every fault."""
    text = source.text(path)
    raw = source.parsed(path, text)
    if {"plant", "based_on"} & raw.keys():
        example = f'a case names one, scene = "{path.name}", with title, about and duration (docs/torture.md)'
        raise SceneError(str(path), [f"is a scene; {example}"])
    raw["places"] = {}
    changes = raw.get("set")
    if isinstance(changes, dict) and "scene" in raw:
        raw["set"] = dict(source.dotted(changes))
        lines = places.lines(text)
        raw["places"] = {key: Place(str(path), lines[f"set.{key}"]) for key in raw["set"]}
    raw["acts"] = raw.pop("act", [])
    try:
        case = Case.model_validate({"name": path.stem, **raw})
    except ValidationError as error:
        wrong = [re.sub(r"\bacts\b", "act", line) for _, line in faults.lines(error, Case, raw)]
        raise SceneError(str(path), wrong) from None
    if bool(case.scene) == bool(case.rig):
        raise SceneError(str(path), ["give either scene, the name of a shipped scene or a scene file, or rig"])
    if case.scene.endswith(".toml"):
        return case.model_copy(update={"scene": os.path.abspath(path.parent / case.scene)})
    return case


def of_scenes(case: Case, quick: bool) -> list[Case]:
    """Return the case; for scene "*" a case for each scene, with its own step. The quick ones have few states."""
    if case.scene != "*":
        return [case]
    cases = []
    for name in scenes.names():
        scene = scenes.load(name)
        if not quick or scene.assemble().system().n <= UNROLLED:
            cases.append(
                case.model_copy(update={"name": f"{case.name}:{name}", "scene": name, "steps": (scene.step_ns,)})
            )
    return cases


def names() -> list[str]:
    """Return the names of the cases."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(name: str) -> Case:
    """Return a case by its name or file. Raises UsageError for an unknown one."""
    if name.endswith(".toml"):
        return read(Path(name))
    if name not in names():
        like = faults.close(name, names())
        hint = f"did you mean {' or '.join(like)}?" if like else f"known: {', '.join(names())}"
        raise UsageError(f"there is no case {name!r}; {hint}")
    return read(FOLDER / f"{name}.toml")


class Ball(Section):
    """A mass that falls on a stiff, damped contact with a belt; a spring and a damper, `sway`, hold it sideways.

    Without the damper it would, once at rest, just reach the belt speed in every period, with zero margin.
    """

    mass: float = 1.0
    gravity: float = 9.81
    height: float = 0.01
    stiffness: float = 1e5
    damping: float = 100.0
    spring: float = 1000.0
    sway: float = 1.0
    mu: float = 0.3
    belt: float = 0.05


def ball(p: Ball, moved: Mapping[str, str]) -> Assembly:
    """Assemble N = -k z - d z' of the height z; the contact opens where it would pull."""
    a = Assembly("ball")
    a.coordinate("x", p.mass, p.sway, p.spring)
    a.coordinate("z", p.mass)
    a.push("z", {"one": -p.mass * p.gravity})
    a.patch("contact", {"x": 1.0}, {"one": p.belt}, friction_law.coulomb(p.mu, p.mu))
    a.normal("load", "contact", {"z": -p.stiffness, "z'": -p.damping}, {"z": 1.0})
    a.start |= {"z": p.height}
    a.outputs |= {"height": Output({"z": 1.0}, "m"), "fall": Output({"z'": 1.0}, "m/s")}
    return a


class Twins(Section):
    """Two masses side by side on one belt, equal except for `apart`, by which the second starts later."""

    mass: float = 1.0
    stiffness: float = 1000.0
    damping: float = 0.0
    belt: float = 0.05
    load: float = 10.0
    mu_static: float = 0.4
    mu_kinetic: float = 0.25
    apart: float = 0.0


def twins(p: Twins, moved: Mapping[str, str]) -> Assembly:
    """Assemble two oscillators whose events are simultaneous."""
    a = Assembly("twins")
    for name, late in (("x1", 0.0), ("x2", p.apart)):
        a.coordinate(name, p.mass, p.damping, p.stiffness)
        a.patch(f"contact {name}", {name: 1.0}, {"one": p.belt}, friction_law.coulomb(p.mu_static, p.mu_kinetic))
        a.normal(f"load {name}", f"contact {name}", {"one": p.load})
        a.start |= {name: -late * p.belt, f"{name}'": p.belt}
        a.outputs[name] = Output({name: 1.0}, "m")
    return a


class Sectored(Twins):
    """The twins on a belt whose first lane has sectors of another friction, `piece` long, `gap` apart.

    `sliding`: the first mass begins in its sliding equilibrium; if both frictions are equal in slip it stays there, and
    edges come at belt / piece.
    """

    piece: float = 0.0005
    gap: float = 0.0005
    mu_piece: float = 0.3
    sliding: bool = False


def sectored(p: Sectored, moved: Mapping[str, str]) -> Assembly:
    """Assemble the twins with the position of the first mass on its lane, which is constant in stick."""
    a = twins(p, moved)
    a.signal("turn", {"one": p.belt}, 0.0, "belt")
    law = friction_law.coulomb(p.mu_static, p.mu_kinetic)
    piece = friction_law.coulomb(max(p.mu_piece, p.mu_static), p.mu_piece)
    length = p.piece + p.gap
    a.sector("lane", "contact x1", {"turn": 1.0, "x1": -1.0}, "turn", length, (0.0, p.piece), (piece, law))
    if p.sliding:
        rest = p.mu_kinetic * p.load / p.stiffness
        a.start |= {"x1": rest, "x1'": 0.0, "turn": rest}
    return a


class BeltLoop(Section):
    """A mass on a belt that follows it: command v0 + gain x', a lag, and limits if there are any."""

    mass: float = 5.0
    stiffness: float = 2500.0
    damping: float = 2.0
    load: float = 20.0
    mu_static: float = 0.5
    mu_kinetic: float = 0.4
    belt: float = 0.06
    gain: float = 5.33
    lag: float = 0.01
    lowest: float = 0.0
    highest: float = 0.25
    limited: bool = True


def belt_loop(p: BeltLoop, moved: Mapping[str, str]) -> Assembly:
    """Assemble V' = (clamp(v0 + K x') - V) / lag: in stick x' = V, growth (K - 1) / lag until the drive clamps."""
    a = Assembly("belt_loop")
    a.coordinate("x", p.mass, p.damping, p.stiffness)
    a.signal("command", {}, p.belt, "drive")
    a.signal("actual", {"actual": -1.0 / p.lag}, p.belt, "drive")
    row = {"command": 1.0, "x'": p.gain}
    if p.limited:
        a.limit("drive", row, p.lowest, p.highest, "actual", 1.0 / p.lag)
    else:
        a.signals["actual"] |= {name: value / p.lag for name, value in row.items()}
    a.patch("contact", {"x": 1.0}, {"actual": 1.0}, friction_law.coulomb(p.mu_static, p.mu_kinetic))
    a.normal("load", "contact", {"one": p.load})
    a.start |= {"x'": p.belt}
    a.outputs["surface_speed"] = Output({"actual": 1.0}, "m/s")
    return a


class SmallRig(NamedTuple):
    """A rig of the torture test, and an ideal instrument on it."""

    parameters: type[Section]
    assemble: Callable[[Any, Mapping[str, str]], Assembly]
    instrument: Instrument


RIGS = {
    "ball": SmallRig(Ball, ball, DisplacementLaser(reads="height", ideal=True)),
    "twins": SmallRig(Twins, twins, DisplacementLaser(reads="x1", ideal=True)),
    "sectored": SmallRig(Sectored, sectored, DisplacementLaser(reads="x1", ideal=True)),
    "belt_loop": SmallRig(BeltLoop, belt_loop, LaserVibrometer(reads="surface_speed", ideal=True)),
}


@dataclass(frozen=True)
class Watched(Scene):
    """A scene with outputs for every contact: friction (T:), slip speed (w:) and normal forces (N:).

    Without `contacts` it has its own outputs only, whose names a recording accepts.
    """

    rig: str = ""
    drives: tuple[tuple[str, str], ...] = ()
    step: int = 0
    contacts: bool = True

    @cached_property
    def step_ns(self) -> int:
        """Sample step [ns]: that of the case; sensors publish between the ticks too."""
        return self.step

    @cached_property
    def moved(self) -> dict[str, str]:
        """Actuators that the case moves, in addition to those of the scene."""
        known = {} if self.rig else super().moved
        return known | dict(self.drives)

    def assemble(self, parameters: Section | None = None) -> Any:
        """Return the rig with the outputs that the invariants need."""
        a = (
            RIGS[self.rig].assemble(parameters or self.parameters, self.moved)
            if self.rig
            else super().assemble(parameters)
        )
        if a.film is not None or not self.contacts:  # points of a film are states, which `Trial` checks
            return a
        for name, *_ in a.patches:
            a.outputs |= {f"T:{name}": Output({f"T:{name}": 1.0}, "N"), f"w:{name}": Output({f"w:{name}": 1.0}, "m/s")}
        for name, *_ in a.normals:
            a.outputs[f"N:{name}"] = Output({f"N:{name}": 1.0}, "N")
        return a


@lru_cache(maxsize=64)
def _loaded(name: str, changes: str, given: tuple[tuple[str, Place], ...]) -> Scene:
    """A scene with `changes`, as JSON, and their places; read once for all methods and steps of a case."""
    return scenes.load(name, json.loads(changes), dict(given))


def changed(case: Case) -> Scene:
    """Return the scene of a case with the values of the case."""
    return _loaded(case.scene, json.dumps(case.set), (*case.places.items(),))


def own_method(case: Case) -> str:
    """The method that the scene of a case states; "auto" if it states none."""
    return "auto" if case.rig else changed(case).clock.method


def watched(case: Case, method: str, step_ns: int, tolerance: float | None = None) -> Watched:
    """Return the scene of a case with a method and a step. Raises SceneError if the case is inconsistent."""
    clock: dict[str, Any] = {
        "frame": max((case.frame or 0) // step_ns, 1) * step_ns * 1e-9,
        "method": method,
        "rk4_step": step_ns * 1e-9,
        "unstable": "run",
    }
    if tolerance is not None:
        clock["tolerance"] = tolerance
    drives: dict[str, str] = {}
    for act in case.acts:
        if act.do in ("set", "command", "follow"):
            drives[act.target] = "ramped" if act.over else drives.get(act.target, "held")
    parameters: Any
    sensors: dict[str, Any]
    limits: dict[str, Any]
    if case.rig:
        parameters = _own_parameters(case)
        sensors = {"ideal": RIGS[case.rig].instrument}
        limits = {}
    else:
        scene = changed(case)
        if scene.assemble().film is not None:  # a tick has its own steps
            clock["rk4_step"] = min(step_ns, int(scene.clock.rk4_step)) * 1e-9
        if tolerance is None and method != scene.clock.method:  # that of a scene is chosen for its method
            clock["tolerance"] = Clock.model_fields["tolerance"].default
        clock = scene.clock.model_dump(mode="json") | clock
        # the noise would be another one in frames of another length
        parameters = scene.parameters.model_copy(update={"noise": None})
        sensors = scene.sensors
        limits = scene.limits if case.limited else {}
    return Watched(
        name=case.name,
        title=case.title,
        about=case.about,
        plant=case.rig or scene.plant,
        parameters=parameters,
        clock=Clock.model_validate(clock),
        seed=1,
        sensors=sensors,
        controllers={},
        protocol=(),
        limits=limits,
        rig=case.rig,
        drives=tuple(drives.items()),
        step=step_ns,
    )


def _own_parameters(case: Case) -> Section:
    """The parameters of a rig of the torture test. Raises SceneError with every fault."""
    if case.rig not in RIGS:
        raise SceneError(case.name, [f"rig = {case.rig!r}: unknown; known: {', '.join(RIGS)}"])
    kind = RIGS[case.rig].parameters
    try:
        return kind.model_validate(case.set)
    except ValidationError as error:
        raise SceneError(case.name, [line for _, line in lines(error, kind, case.set, "set")]) from None
