"""Cases of the torture test: a rig with a start, what is done to it while it runs, and what must hold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from annotated_types import Gt
from pydantic import Field, ValidationError, model_validator

from rig import scenes
from rig.errors import SceneError, UsageError
from rig.model.tables import UNROLLED
from rig.quantities import Nanoseconds, Section
from rig.scenes import faults, source

FOLDER = Path(__file__).parent / "cases"
Share = Annotated[float, Gt(0.0)]


class Act(Section):
    """Something that is done to the running rig at time `at`.

    set      actuator `target` takes `to`; `over` a time: it runs there
    command  a controller commands `target`, "*" for all: `values` one after another, `every` so long
    follow   `target` is put to `to` + `gain` times the output `of`, `every` so long, up to the end
    change   parameter `target` takes `to`
    knock    an impulse `to` [N s] along the sliding direction
    blocks   from here on the plant is carried in blocks of `values` ticks, in turn
    pause    the paced loop stands still for `to` seconds of the clock and goes on
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
    """What must be found beside the invariants of every case; numbers come from `source`.

    events   number of contact events of the reference
    still    outputs that keep their first value to the last bit
    growth   rate [1/s] with which physics makes it run away: the stability report must name it
    jams     the stability report must name jamming
    refused  what the stability report must say
    stops    what the run must say when it comes to its end before its time
    ends     output -> the most it may be at the end, in size
    largest  output -> the most it may ever be, in size
    stuck    whether it must be stuck at the end
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
    """One case. `scene`: a shipped one, "*" for each, or `rig`: one of rig.qualify.torture.rigs; `set` changes it.

    `steps`: sample steps to try. `frame`: loop period, at whose begin modes are settled; a step where it is not given.
    `wrong`: ways of rig.qualify.torture.wrong_methods that this case shows to fail.
    `limited`: the run ends where the motion leaves a limit of its scene, as every run does.
    `box`: ranges in which a random search looks for values that break it. `quick`: part of the quick matrix, then over
    `quick_duration` if that is given. `seconds`: time box of a cell, of processor time.
    """

    name: str
    title: str
    about: str
    scene: str = ""
    rig: str = ""
    set: dict[str, Any] = Field(default_factory=dict)
    duration: Nanoseconds
    quick_duration: Nanoseconds | None = None
    steps: tuple[Nanoseconds, ...] = (1_000_000, 100_000)
    frame: Nanoseconds | None = None
    limited: bool = False
    wrong: tuple[Literal["held", "clipped", "stale"], ...] = ()
    quick: bool = True
    seconds: Share = 2.0
    acts: tuple[Act, ...] = ()
    box: dict[str, tuple[float, float]] = Field(default_factory=dict)
    expect: Expect = Expect()

    @model_validator(mode="after")
    def _frames(self) -> Self:
        if self.frame and any(act.do not in ("set", "knock", "blocks") or act.over for act in self.acts):
            raise ValueError("acts that count frames go with frames of one step: leave `frame` out")
        return self


def read(path: Path, overrides: Mapping[str, Any] | None = None) -> Case:
    """The case of a file. Raises SceneError with every fault."""
    raw = source.tree(path)
    raw["set"] = raw.get("set", {}) | dict(overrides or {})
    raw["acts"] = raw.pop("act", [])
    try:
        case = Case.model_validate({"name": path.stem, **raw})
    except ValidationError as error:
        lines = [f"{'.'.join(map(str, f['loc']))}: {f['msg'].removeprefix('Value error, ')}" for f in error.errors()]
        raise SceneError(path.name, lines) from None
    if bool(case.scene) == bool(case.rig):
        raise SceneError(path.name, ["give either scene, the name of a shipped scene, or rig"])
    return case


def each(case: Case, quick: bool) -> list[Case]:
    """The case; for one of every scene as many cases, of their own steps. The quick ones are of few states."""
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
    """Names of the cases."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(name: str) -> Case:
    """A case by its name, or by its file. Raises UsageError for an unknown one."""
    if name.endswith(".toml"):
        return read(Path(name))
    if name not in names():
        raise UsageError(f"there is no case {name!r}; {faults.near(name, names(), 'the table of rig torture')}")
    return read(FOLDER / f"{name}.toml")
