"""The program `rig`: its commands, and what a user sees when something goes wrong."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Annotated, Any

import typer

from rig.cli import analysis, lesson, live, machine, printing, processes, recorded, recordings, runs, scenes, study
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


PANELS: Mapping[str, Mapping[str, tuple[Any, str]]] = {
    "Run a scene": {**runs.COMMANDS, **runs.COMMANDS, **live.COMMANDS},
    "Look at scenes": {**scenes.COMMANDS, **scenes.COMMANDS, **scenes.COMMANDS},
    "Learn": lesson.COMMANDS,
    "Analyse a rig": {
        **analysis.COMMANDS,
        **analysis.COMMANDS,
        **analysis.COMMANDS,
        **study.COMMANDS,
        **study.COMMANDS,
        **machine.COMMANDS,
    },
    "Choose method and step": machine.COMMANDS,
    "Test the methods": machine.COMMANDS,
    "Recordings": {
        **recordings.COMMANDS,
        **recordings.COMMANDS,
        **recordings.COMMANDS,
        **recorded.COMMANDS,
        **recordings.COMMANDS,
    },
    "Analyse a recording": {**recorded.COMMANDS, **recorded.COMMANDS},
    "Use a live run": live.COMMANDS,
    "Start processes one by one": processes.COMMANDS,
    "Check this machine": machine.COMMANDS,
}
"""Panels of the help text -> their commands: name -> function, example."""
for panel, commands in PANELS.items():
    for name, (function, example) in commands.items():
        cls = live.CLASSES.get(name, Command)
        _app.command(name, cls=cls, epilog=f"Example:  {example}", rich_help_panel=panel)(function)
_app.add_typer(live.topic, name="topic", rich_help_panel="Use a live run")
program = typer.main.get_command(_app)
"""All commands. Reading their options from the signatures takes 25 ms: once per process."""


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
    except Exception as error:
        from rig.parts import foreign_fault

        if not (text := foreign_fault(error)):  # of this project, not of a part from a file
            raise
        printing.note(text)
        sys.exit(ExitCode.MISTAKE)
