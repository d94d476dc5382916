"""Cases of the torture test: a rig with a start, actions while it runs, and the expected results."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from annotated_types import Gt
from pydantic import Field, ValidationError, model_validator

from rig import scenes
from rig.errors import SceneError, UsageError
from rig.model.tables import UNROLLED
from rig.quantities import Nanoseconds, Section
from rig.scenes import faults, places, source
from rig.scenes.places import Place

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
    """One case. `scene`: a shipped one, "*" for each, a scene file, or `rig`: one of rig.qualify.torture.rigs.

    `set` changes values of the rig; `places`: where the file gives them.

    `steps`: sample steps to try. `frame`: loop period, at whose begin modes are settled; by default a step. `wrong`:
    methods of rig.qualify.torture.wrong_methods that must fail in this case. `limited`: the run ends where the motion
    leaves a limit of its scene, as every run does. `box`: ranges in which a random search looks for failures. `quick`:
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
    steps: tuple[Nanoseconds, ...] = (1_000_000, 100_000)
    frame: Nanoseconds | None = None
    limited: bool = False
    wrong: tuple[Literal["held", "clipped", "stale"], ...] = ()
    quick: bool = True
    seconds: Share = 2.0
    processes: bool = False
    acts: tuple[Act, ...] = ()
    box: dict[str, tuple[float, float]] = Field(default_factory=dict)
    expect: Expect = Expect()

    @model_validator(mode="after")
    def _frames(self) -> Self:
        if self.frame and any(act.do not in ("set", "knock", "blocks") or act.over for act in self.acts):
            raise ValueError("actions that count frames need frames of one step: leave `frame` out")
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
    raw["places"], changes = {}, raw.get("set")
    if isinstance(changes, dict) and "scene" in raw:
        raw["set"], lines = dict(source.dotted(changes)), places.lines(text)
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


def each(case: Case, quick: bool) -> list[Case]:
    """Return the case; for scene "*" a case for each scene, with its own step. The quick ones have few states."""
    if case.scene != "*":
        return [case]
    found = []
    for name in scenes.names():
        scene = scenes.load(name)
        if not quick or scene.assemble().system().n <= UNROLLED:
            found.append(
                case.model_copy(update={"name": f"{case.name}:{name}", "scene": name, "steps": (scene.step_ns,)})
            )
    return found


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
