"""A job of the page as a process: `python -m rig.web.job_process COMMAND` is `rig COMMAND` while its parent lives.

A server that is killed cannot stop its jobs, and a view would stay open for ever.
"""

from __future__ import annotations

import os
import runpy
import signal
import time

from rig.machine.process import with_parent

PATIENCE_S = 10.0
"""Time in which a job that was interrupted must end."""


def _end() -> None:
    os.kill(os.getpid(), signal.SIGINT)  # in order, as Ctrl-C does
    time.sleep(PATIENCE_S)
    os._exit(1)


if __name__ == "__main__":
    with_parent(_end)
    runpy.run_module("rig", run_name="__main__", alter_sys=True)
