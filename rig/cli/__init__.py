"""The commands, thin: each reads its arguments, calls one function of a room, prints what it returns.

app         the program: commands, errors, exit codes
options     what several commands take
tell        tables, JSON, the line that is written again and again
scenes      list, new, migrate, explain
analysis    modes, cycle, map
runs        demo, run, simulate
processes   plant, control, record, view: the same processes one by one
live        tune, topic
logs        replay, verify, diff, sound, recover
host        doctor, warmup

Exit codes: 0 ok, 1 a check failed, 2 usage, 3 timing invalid, 4 diverged.
Nothing heavy is imported before it is needed.
"""

from __future__ import annotations

import os


def main() -> None:
    """Entry point of the command `rig`. A Ctrl-C ends it quietly from here on."""
    try:
        os.environ["RIG_OWN_PROCESS"] = "1"  # see rig.kernel: for this process and those it starts
        os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"  # to look for some takes 20 ms; no scene has any
        from rig.process import as_process

        as_process(_run)
    except KeyboardInterrupt:  # before as_process has taken over: nothing has begun that must be put away
        os._exit(130)


def _run() -> None:
    from rig.cli.app import run

    run()
