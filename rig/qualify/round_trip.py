"""Round trip of a message to another process over the private socket of a run: the latency of the bus on this
machine.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time

import numpy as np
from numpy.typing import NDArray

from rig import bus
from rig.bus import encode
from rig.errors import RigError
from rig.placement import choose, placed
from rig.scheduling import CONTROLLER, PLANT, ahead

Array = NDArray[np.int64]
_ECHO = "import sys; from rig.qualify.round_trip import echo; echo(*sys.argv[1:])"
_PAUSE_S = 0.0005
_EACH_S = 0.001


def round_trips(seconds: float, *, paced: bool = True) -> tuple[Array, Array, str]:
    """Measure round trips and single publications [ns] for about `seconds`; empty with a reason if they fail.

    `paced`: with real-time scheduling and a pause before each, as in a paced run; else one after the other, as in
    lockstep. The processes use the same cores as in such a run.
    """
    name, none = f"doctor-{os.getpid()}", np.zeros(0, dtype=np.int64)
    latest, fresh = np.zeros(2), np.ones(2, dtype=np.int64)
    trips, puts = [], []
    try:
        with bus.host(name, "doctor") as session:
            answers, present = session.subscribe("act/*"), session.watch("controller/*")
            step = session.publisher("step")
            session.announce()
            own, of_bus = choose()
            command = [sys.executable, "-P", "-c", _ECHO, name, str(of_bus), *(["paced"] if paced else [])]
            with contextlib.closing(_Child(command)):
                if not present.wait_for("controller", "echo", 8.0):
                    return none, none, "the other process did not start"
                with placed(own if paced else of_bus, of_bus), ahead(PLANT) if paced else contextlib.nullcontext():
                    for number in range(max(int(seconds / _EACH_S), 50)):
                        payload = encode.step(number, number, latest, fresh)
                        begin = time.perf_counter_ns()
                        step.put(payload, number)
                        puts.append(time.perf_counter_ns() - begin)
                        if answers.get(timeout=0.5) is None:
                            return none, none, "no answer within 0.5 s"
                        trips.append(time.perf_counter_ns() - begin)
                        if paced:
                            time.sleep(_PAUSE_S)
    except RigError as error:
        return none, none, str(error)
    return np.array(trips), np.array(puts), ""


class _Child:
    """The process at the other end."""

    def __init__(self, command: list[str]) -> None:
        self._process = subprocess.Popen(command)

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def echo(run: str, core: str, paced: str = "") -> None:
    """Run the other process on a core: answer every step until none has come for two seconds; `paced`: in real time."""
    with bus.join(run, role="controller", name="echo", wait=5.0) as session:
        steps, act = session.subscribe("step"), session.publisher("act/echo")
        session.announce()
        with placed(int(core), int(core)), ahead(CONTROLLER) if paced else contextlib.nullcontext():
            while (step := steps.get(timeout=2.0)) is not None:
                act.put(encode.act(step.said.tick, step.t_ns, step.said.values), step.t_ns)
