"""The commands: each reads its arguments, calls one function of a room and returns the result, which is printed.

app         the program: commands, errors, exit codes
build       a command from its function and a function of `rig`; what it returns is printed, drawn and written
stated      options as functions state them with their parameters
options     how options are read, what several commands take, and how the help shows a command
printing    tables, JSON, progress; files that a command writes: refused if they exist
scenes      list, new, explain, fmu
analysis    modes, cycle, identify, loop, map
study       study, optimise
runs        demo, run, simulate
processes   plant, control, record, view: the same processes one by one
live        commands for a run that goes on; web, bridge
recordings  replay, verify, recover, runs, note, report, export
recorded    spectrum, pressure, hysteresis, response, portrait, amplitude, sound, diff
machine     cost, torture, reproduce, doctor, warmup, clean
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
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # see rig.machine.process.Child
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
