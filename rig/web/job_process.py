"""A job of the page as a process: `python -m rig.web.job_process COMMAND` is `rig COMMAND` while its parent lives.

A server that is killed cannot stop its jobs, and a view would stay open for ever.
"""

from __future__ import annotations

import os
import runpy
import signal
import threading
import time

LOOK_S = 0.5
"""Time between two looks at whether the parent lives."""
PATIENCE_S = 10.0
"""Time in which a job that was interrupted must end."""


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK_S)
    os.kill(os.getpid(), signal.SIGINT)  # in order, as Ctrl-C does
    time.sleep(PATIENCE_S)
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    runpy.run_module("rig", run_name="__main__", alter_sys=True)
