"""The program `rig`: its commands, and what a user sees when something goes wrong."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
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
    study,
)
from rig.cli.options import Command, Group
from rig.errors import ExitCode, RigError
from rig.machine.process import MORE_FILES, NO_FILES

_app = typer.Typer(
    name="rig",
    cls=Group,
    help="friction-rig: a virtual test rig for friction-induced vibration.",
    epilog="First steps:  rig demo | rig list | rig run pendulum --view",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        import rig

        printing.line(str(rig.__version__))
        raise typer.Exit


@_app.callback()
def _program(
    version: Annotated[bool, typer.Option("--version", is_eager=True, callback=_version, help="Print it.")] = False,
) -> None: ...


COMMANDS: Mapping[str, tuple[Any, str]] = {
    name: command
    for module in (analysis, lesson, live, machine, measurements, processes, recorded, recordings, runs, scenes, study)
    for name, command in module.COMMANDS.items()
}
"""Name -> function, example."""
PANELS = {
    "Run a scene": "demo run simulate web bridge",
    "Look at scenes": "list new explain fmu",
    "Learn": "lesson",
    "Analyse a rig": "modes cycle branches identify loop map study optimise reproduce",
    "Choose method and step": "cost",
    "Test the methods": "torture",
    "Recordings": "import runs note report replay verify recover diff export",
    "Analyse a recording": "amplitude sound events stick spectrum pressure hysteresis response portrait",
    "Use a live run": "tune disconnect connect knock pause step resume stop",
    "Start processes one by one": "plant control record view",
    "Check this machine": "doctor warmup clean",
}
"""Panels of the help text -> their commands."""
_app.add_typer(live.topic, name="topic", rich_help_panel="Use a live run")


class Commands(Mapping[str, Any]):
    """All commands. One is made when it is asked for: to read the options of all from their signatures takes 50 ms."""

    def __init__(self, made: Mapping[str, Any]) -> None:
        self._made = {**made}
        self._names = (*" ".join(PANELS.values()).split(), *made)

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            (function, example), only = COMMANDS[name], typer.Typer(add_completion=False)
            panel = next(panel for panel, commands in PANELS.items() if name in commands.split())
            cls = live.CLASSES.get(name, Command)
            only.command(name, cls=cls, epilog=f"Example:  {example}", rich_help_panel=panel)(function)
            self._made[name] = typer.main.get_command(only)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


program: Any = typer.main.get_command(_app)
"""The program with all commands."""
program.commands = Commands(program.commands)


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
        if parts is None or not (text := parts.foreign_fault(error)):  # of this project, not of a part from a file
            raise
        printing.note(text)
        sys.exit(ExitCode.MISTAKE)
