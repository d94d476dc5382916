"""The commands: each reads its arguments, calls one function of a room and prints the result.

app         the program: commands, errors, exit codes
command     how the help shows a command
options     what several commands take
outputs     files that a command writes: refused if they exist
printing    tables, JSON, progress
scenes      list, new, migrate, explain
analysis    modes, cycle, identify; maps: map; study: study; optimise: optimise; reproduce: reproduce
runs        demo, run; simulate: simulate
processes   plant, control, record, view: the same processes one by one
live        tune, topic
export, diff    the commands of these names
logs        replay, verify, amplitude, sound, recover
recorded    spectrum, pressure, hysteresis
cost, torture   the commands of these names
host        doctor, warmup
lesson      lesson

Exit codes: rig.errors.ExitCode.
Nothing heavy is imported before it is needed.
"""

from __future__ import annotations

import os
import sys


def main() -> None:
    """Entry point of the command `rig`. A Ctrl-C ends it quietly from here on."""
    try:
        os.environ["RIG_OWN_PROCESS"] = "1"  # see rig.compiled.kernel: for this process and those it starts
        os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"  # to look for some takes 20 ms; no scene has any
        from rig.machine.process import as_process

        as_process(_run)
    except KeyboardInterrupt:  # before as_process has taken over: nothing has begun that must be put away
        os._exit(130)


def _run() -> None:
    from io import TextIOWrapper

    from rig.cli.app import run

    if isinstance(sys.stdout, TextIOWrapper):  # a terminal that has no ± or µ shows their escapes
        sys.stdout.reconfigure(errors="backslashreplace")
    run()
