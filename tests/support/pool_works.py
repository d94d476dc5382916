"""Works for the tests of the pool, whose units are trivial, slow, large, or end their process."""

import ctypes
import json
import os
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rig.errors import UsageError, WorkerError


@dataclass(frozen=True)
class Trial:
    """Squares of the numbers of its units. `does`: what a unit does besides ("kill", "once", "exit", "leave", "fault",
    "talk", "read", "stop").

    Files in `folder` count how often a unit was computed. `size`: numbers in a result.
    """

    folder: str
    total: int = 8
    does: dict = field(default_factory=dict)
    seconds: float = 0.0
    size: int = 1
    name = "trial"
    digest = "0"

    def prepare(self):
        """Nothing has to be compiled."""

    def compute(self, unit, *given):
        with (Path(self.folder) / f"{unit}.count").open("a") as file:
            file.write("x")
        time.sleep(self.seconds)
        does = self.does.get(str(unit))
        first = len((Path(self.folder) / f"{unit}.count").read_text()) == 1
        if does == "kill" or (does == "once" and first):
            os.kill(os.getpid(), signal.SIGKILL)
        if does == "exit":
            sys.stdout.write("the last words\n")
            sys.stdout.flush()
            os._exit(3)
        if does == "leave":
            os._exit(0)
        if does == "fault":
            raise UsageError("nothing is as it should be")
        if does == "talk":
            sys.stdout.write("half a line")
        if does == "read":
            assert sys.stdin.read() == ""
        if does == "stop":  # in a callback of a C library, which swallows the exception
            ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGTERM))()
        return {"square": np.full(self.size, float(unit**2 + sum(given))), "name": np.array(f"unit {unit}")}

    def failed(self, unit, why):
        if self.does.get(str(unit)) == "exit":
            raise WorkerError(why)
        return {"square": np.full(self.size, np.nan), "name": np.array(why)}

    def counts(self):
        """How often each unit was computed."""
        return {int(path.stem): len(path.read_text()) for path in Path(self.folder).glob("*.count")}

    def to_json(self):
        return json.dumps(vars(self))

    @classmethod
    def from_json(cls, text):
        raw = json.loads(text)
        return cls(**{name: value for name, value in raw.items() if name not in ("work", "digest")})
