"""Parameters of the functions of `rig` as the commands show them: each is stated once, on the function that has it.

Nothing of this is imported before a command is built (rig.cli.build) or types are checked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

if TYPE_CHECKING:
    from rig.scenes.scene import Scene

_CONTROLLER = (
    "A controller: one of the scene by its NAME, or one from a FILE, which is added under the file's name or NAME, or "
    "replaces one."
)


class Option(NamedTuple):
    """How a command shows a parameter: `value`, what is typed for it, which decides how it is read; and a help text.

    `flag`: the option's name, where it is not that of the parameter. `low`, `high`: of a whole number; `low` of a time
    [s] too. `check`: of what was typed, when all of it has been read.
    """

    value: str
    help: str
    flag: str = ""
    low: float | None = None
    high: float | None = None
    check: Callable[..., Any] | None = None


class Argument(Option):
    """A parameter whose value is typed without a name."""


def controller_option(about: str) -> Option:
    """The controller of a loop."""
    return Option("NAME|[NAME=]FILE", f"{about} {_CONTROLLER}")


SceneOrName = Annotated[
    "Scene | str | Path", Argument("SCENE", "Name of a shipped scene (see rig list), or a TOML file.")
]
Log = Annotated[str | Path, Argument("LOG", "A recording (MCAP).")]
Overrides = Annotated[
    Mapping[str, object] | None,
    Option("KEY=VALUE", 'Change a value: -p drive.speed="2 rpm". "none" removes it. Repeatable.', "-p"),
]
Untold = Annotated[
    Mapping[str, object] | None,
    Option(
        "KEY=VALUE", "Give the rig a value that its controllers do not know: they are designed without it. Repeatable."
    ),
]
Redesign = Annotated[bool, Option("", "Tell the controllers all that is varied: they are designed for each rig.")]
Controllers = Option("NAME|[NAME=]FILE", f"{_CONTROLLER} Repeatable.", "--controller")
Duration = Annotated[float | None, Option("TIME", 'Simulated time, in seconds or with a unit: "500 ms".')]
Begin = Annotated[float, Option("TIME", "Start of the evaluated time span.", "--from", low=0)]
End = Annotated[float, Option("TIME", "End of the evaluated time span.", "--to")]
Channel = Annotated[
    str, Option("NAME", "Sensor or plant output to analyse. Default: a sensor that measures vibration.")
]
Trust = Annotated[
    bool, Option("", "Run the code of plants, sensors and other parts that the recording or run contains.")
]
Seed = Annotated[int | None, Option("N", "Seed of samples and runs. Default: the scene's.", low=0)]
Workers = Annotated[int | None, Option("N", "Number of processes. Default: one for each core.", low=1, high=256)]
Cluster = Annotated[
    str, Option("WHERE", "Compute on a dask cluster: address of its scheduler, tcp://HOST:PORT or tls://HOST:PORT.")
]
Results = Annotated[
    str | Path,
    Option("FOLDER", "Folder for the results; each scene, map, study or search has a folder of its own in it."),
]


def common(
    scene: SceneOrName,
    log: Log,
    overrides: Overrides = None,
    untold: Untold = None,
    controllers: Annotated[Mapping[str, object] | None, Controllers] = None,
    duration: Duration = None,
    trust: Trust = False,
    out: Results = ".",
) -> None:
    """Parameters of commands that have no function of `rig`, but take the same."""
