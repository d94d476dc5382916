"""Works for the tests of the pool, whose units are trivial, slow, or end their process."""

import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from rig.analysis.pool import Work
from rig.errors import UsageError


def trial(folder, total=8, does=None, seconds=0.0):
    """Squares of the numbers of `total` units. `does`: what a unit does besides ("kill", "once", "long", "fault",
    "talk", "read").

    Files in `folder` count how often a unit was computed.
    """
    compute = partial(_compute, str(folder), does or {}, seconds)
    return Work(compute, range(total), "trial", "0", failed=_failed)


def _compute(folder, does, seconds, unit):
    with (Path(folder) / f"{unit}.count").open("a") as file:
        file.write("x")
    time.sleep(seconds)
    what = does.get(str(unit))
    first = len((Path(folder) / f"{unit}.count").read_text()) == 1
    if what == "kill" or (what == "once" and first):
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "long" and first:
        time.sleep(60.0)

    if what == "fault":
        raise UsageError("nothing is as it should be")
    if what == "talk":
        sys.stdout.write("half a line")
    if what == "read":
        assert sys.stdin.read() == ""
    return {"square": np.array([float(unit**2)]), "name": np.array(f"unit {unit}")}


def _failed(unit, why):
    return {"square": np.array([np.nan]), "name": np.array(why)}


def counts(folder):
    """How often each unit was computed."""
    return {int(path.stem): len(path.read_text()) for path in Path(folder).glob("*.count")}
