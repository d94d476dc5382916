"""Works for the tests of the pool, whose units are trivial, slow, large, or end their process."""

import ctypes
import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from rig.analysis.pool import Work
from rig.errors import UsageError, WorkerError


def trial(folder, total=8, does=None, seconds=0.0, size=1):
    """Squares of the numbers of `total` units. `does`: what a unit does besides ("kill", "once", "long", "exit",
    "fault", "talk", "read", "stop").

    Files in `folder` count how often a unit was computed. `size`: numbers in a result.
    """
    compute = partial(_compute, str(folder), does or {}, seconds, size)
    return Work(compute, range(total), "trial", "0", failed=partial(_failed, does or {}, size))


def _compute(folder, does, seconds, size, unit, *given):
    with (Path(folder) / f"{unit}.count").open("a") as file:
        file.write("x")
    time.sleep(seconds)
    what = does.get(str(unit))
    first = len((Path(folder) / f"{unit}.count").read_text()) == 1
    if what == "kill" or (what == "once" and first):
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "exit":
        sys.stdout.write("the last words\n")
        sys.stdout.flush()
        os._exit(3)
    if what == "long" and first:
        time.sleep(60.0)

    if what == "fault":
        raise UsageError("nothing is as it should be")
    if what == "talk":
        sys.stdout.write("half a line")
    if what == "read":
        assert sys.stdin.read() == ""
    if what == "stop":  # in a callback of a C library, which swallows the exception
        ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGTERM))()
    return {"square": np.full(size, float(unit**2 + sum(given))), "name": np.array(f"unit {unit}")}


def _failed(does, size, unit, why):
    if does.get(str(unit)) == "exit":
        raise WorkerError(why)
    return {"square": np.full(size, np.nan), "name": np.array(why)}


def counts(folder):
    """How often each unit was computed."""
    return {int(path.stem): len(path.read_text()) for path in Path(folder).glob("*.count")}
