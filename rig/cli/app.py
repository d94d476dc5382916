"""The program `rig`: its commands, and what a user sees when something goes wrong."""

from __future__ import annotations

import sys

import typer

from rig.cli import analysis, cost, host, live, logs, processes, recorded, runs, scenes, torture
from rig.errors import RigError, UsageError

app = typer.Typer(
    name="rig",
    help="friction-rig: a virtual test rig for friction-induced vibration.",
    epilog="First steps:  rig demo | rig list | rig run pendulum --view",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for panel, room in {
    "Run a scene": runs,
    "Look at scenes": scenes,
    "Analyse a rig": analysis,
    "Choose the accuracy": cost,
    "Test the methods": torture,
    "Recordings": logs,
    "Analyse a recording": recorded,
    "Use a live run": live,
    "Start processes one by one": processes,
    "Check this machine": host,
}.items():
    for name, (function, example) in room.COMMANDS.items():
        cls = live.CLASSES.get(name)
        app.command(name, cls=cls, epilog=f"Example:  {example}", rich_help_panel=panel)(function)
app.add_typer(live.topic, name="topic", rich_help_panel="Use a live run")


def run(arguments: list[str] | None = None) -> None:
    """Run a command and leave with its exit code; what a user did wrong is told in words, never by a traceback."""
    try:
        app(arguments)
    except RigError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(error.exit_code)
    except BrokenPipeError:  # whoever read the output has seen enough
        pass
    except OSError as error:  # of the system, as a full disk
        sys.stderr.write(f"{error}\n")
        sys.exit(1)
    except Exception as error:
        from rig.parts import told

        if not (text := told(error)):  # of this project, not of a part from a file
            raise
        sys.stderr.write(f"{text}\n")
        sys.exit(UsageError.exit_code)
