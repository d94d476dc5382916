"""The program `rig`: its commands, and what a user sees when something goes wrong."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any

import typer

from rig.cli import (
    analysis,
    lesson,
    live,
    machine,
    measurements,
    printing,
    processes,
    recorded,
    recordings,
    runs,
    scenes,
    serving,
    study,
)
from rig.cli.build import Made, build
from rig.cli.options import Command, Group
from rig.errors import ExitCode, RigError
from rig.machine.process import MORE_FILES, NO_FILES

_app = typer.Typer(
    name="rig",
    cls=Group,
    help="friction-rig: a virtual test rig for friction-induced vibration.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS: Mapping[str, Made] = {
    name: command
    for module in (
        analysis,
        lesson,
        live,
        machine,
        measurements,
        processes,
        recorded,
        recordings,
        runs,
        scenes,
        serving,
        study,
    )
    for name, command in module.COMMANDS.items()
}
"""The commands by name."""
PANELS: Mapping[str, Mapping[str, str]] = {
    "Begin": {
        "demo": "a rig that sticks and slips: recording, figure, summary",
        "list": "the shipped scenes, by what happens in them",
        "web": "the bench as a page in the browser",
        "run": "run a scene in real time, with its controllers as processes",
        "simulate": "simulate a scene in one process, as fast as possible",
    },
    "Scenes": {
        "explain": "what a scene contains, and the origin of every value",
        "new": "write a scene that is based on another one",
        "lesson": "lessons with questions, commands and expected numbers",
        "fmu": "write a scene as an FMU, for controllers in other tools",
    },
    "Analyse a rig": {
        "modes": "eigenvalues and modes of steady sliding, over a parameter too",
        "cycle": "limit cycle: period, stick, extremes, Floquet multipliers",
        "branches": "stable and unstable motions followed over a parameter",
        "map": "where it slides, sticks and slips, or both, over one or two",
        "loop": "delay budget and margins of a control loop",
        "identify": "parameters from recordings, with intervals",
        "study": "measures over grids, samples and repeated runs",
        "optimise": "parameters with the best value of a measure",
        "cost": "error against compute time of each method and step",
    },
    "Recordings": {
        "runs": "list recordings: scene, date, length, verdict, notes",
        "report": "one page about a recording that any browser opens",
        "verify": "whether it is complete and has the same bits again",
        "diff": "compare two, or a measurement with a simulation",
        "export": "write one for other programs: CSV, HDF5, MATLAB ...",
        "import": "make a recording of a measurement",
        "note": "add a note or tags, or print them",
        "recover": "save what is whole of one that is damaged",
        "analyse": "spectrum, amplitude, stick and slip, sound and more",
    },
    "A live run, this machine": {
        "view": "show a recording or a live run in rerun",
        "live": "change or stop a live run; its processes one by one",
        "tool": "check this machine and the methods, reproduce papers",
    },
}
"""Panels of the help text -> commands and groups of commands, each with what it is for."""
GROUPS = {
    "analyse": (
        "Analyse a recording, simulated or measured.",
        {"": "amplitude events hysteresis portrait pressure response sound spectrum stick"},
    ),
    "live": (
        "Change and stop a live run, look at its messages, or start its processes one by one.",
        {
            "Use a live run": "tune connect disconnect knock pause step resume stop topic",
            "Start processes one by one": "plant control record replay bridge",
        },
    ),
    "topic": ("Show the messages on the bus of a run.", {"": "ls hz echo"}),
    "tool": (
        "Check this machine, a board and the methods, and reproduce the figures of the papers.",
        {"": "doctor device warmup clean torture reproduce"},
    ),
}
"""Group -> what it is for, its panels -> their commands."""


def _version(asked: bool) -> None:
    if asked:
        import rig

        printing.line(str(rig.__version__))
        raise typer.Exit


@_app.callback()
def _program(
    version: Annotated[bool, typer.Option("--version", is_eager=True, callback=_version, help="Print it.")] = False,
) -> None: ...


class Commands(Mapping[str, Any]):
    """The commands of `panels`. One is made when it is asked for: to read the options of all takes 50 ms."""

    def __init__(self, panels: Mapping[str, Iterable[str]]) -> None:
        self._panels = {name: panel for panel, names in panels.items() for name in names}
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            self._made[name] = (_group if name in GROUPS else _command)(name, self._panels[name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._panels)

    def __len__(self) -> int:
        return len(self._panels)


_SHORT = {name: about for commands in PANELS.values() for name, about in commands.items()}


def _command(name: str, panel: str) -> Any:
    made = COMMANDS[name]
    cls = live.CLASSES.get(name, Command)
    epilog = f"Example:  {made.example}"
    only = typer.Typer(add_completion=False)
    shown = only.command(name, cls=cls, epilog=epilog, short_help=_SHORT.get(name), rich_help_panel=panel or None)
    shown(build(made))
    return typer.main.get_command(only)


def _group(name: str, panel: str) -> Any:
    about, panels = GROUPS[name]
    group = typer.Typer(name=name, cls=Group, help=about, no_args_is_help=True, add_completion=False)
    group.callback(short_help=_SHORT.get(name), rich_help_panel=panel)(_nothing)
    made: Any = typer.main.get_command(group)
    made.commands = Commands({panel: names.split() for panel, names in panels.items()})
    return made


def _nothing() -> None:
    """A group has no work of its own."""


program: Any = typer.main.get_command(_app)
"""The program with all commands."""
program.commands = Commands(PANELS)


def every() -> dict[str, Any]:
    """All commands by what is typed behind `rig`, such as "live tune"."""
    return dict(_below("", program.commands))


def _below(path: str, commands: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, command in commands.items():
        if hasattr(command, "commands"):
            yield from _below(f"{path}{name} ", command.commands)
        else:
            yield f"{path}{name}", command


def run(arguments: list[str] | None = None) -> None:
    """Run a command and leave with its exit code; errors of a user are reported as text, never as a traceback."""
    try:
        program(arguments)
    except RigError as error:
        printing.note(str(error))
        sys.exit(error.exit_code)
    except BrokenPipeError:  # whoever read the output has seen enough
        pass
    except OSError as error:  # of the system, as a full disk
        where = f"{error.filename}: " if error.filename else ""
        printing.note(where + (MORE_FILES if error.errno in NO_FILES else error.strerror or str(error)))
        sys.exit(ExitCode.FAILED)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        parts = sys.modules.get("rig.parts")  # slow to import; without it no part of a file has run
        text = "" if parts is None else parts.foreign_fault(error)
        if not text:  # of this project, not of a part from a file
            raise
        printing.note(text)
        sys.exit(ExitCode.MISTAKE)
