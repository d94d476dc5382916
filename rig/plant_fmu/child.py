"""The child process of an FMU: runs a rig at the requests of shim.c, and ends when the other end of the socket closes.

request   kind (0 start, 1 step), time or seed, step [s], inputs; all doubles
answer    status (0: well), outputs; doubles, then 512 bytes of text

A start has the seed as its time and the start time as its step. A step is a whole number of frames. An input takes
effect at the tick at which the step begins; one that is NaN has never been set, and belongs to the protocol.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import numpy as np

from rig.bench.run.experiment import Experiment
from rig.bench.run.local_controllers import CompiledControllers
from rig.bench.run.simulate import RestartableRig, carry_on
from rig.errors import RigError, UsageError
from rig.machine.process import as_process, with_parent
from rig.parts import trust_scene
from rig.quantities import LONGEST
from rig.scenes.scene import Scene

LINK = 3
"""Descriptor of the socket."""
START = 0.0
_TEXT = 512  # bytes of the text of an answer; TEXT in shim.c
_ROUNDING = 1e-6  # frames


class Plant:
    """The rig of `scene` with the inputs `drives`, stepped by another program."""

    def __init__(self, scene: Scene, drives: Sequence[str]) -> None:
        self.rig = RestartableRig(scene, drives)
        self._drives = tuple(drives)
        self._experiment: Experiment | None = None

    def start(self, seed: int, start: float) -> None:
        """Begin at tick 0, which is time `start` [s] of the other program. Raises UsageError if that is no number."""
        if not isfinite(start):
            raise UsageError(f"the start time is {start:g} s; it must be a finite number")
        self._experiment = experiment = self.rig.begin(seed, LONGEST)
        self._start = start
        self._admitted = set[int]()
        self._heard = np.zeros(len(self.rig.runner.bank.names))
        experiment.open()
        self._inside = CompiledControllers(experiment)

    def step(self, t: float, h: float, inputs: Sequence[float]) -> None:
        """Carry the rig on from t by h [s]. Raises UsageError for a step that it cannot make, NumericsError."""
        experiment = self._experiment
        runner = self.rig.runner
        if experiment is None:
            raise UsageError("the rig has not been initialised")
        if not (isfinite(t) and isfinite(h)):
            raise UsageError(f"a step of {h:g} s from t = {t:g} s is not possible: both must be finite numbers")
        frame = runner.frame_ns * 1e-9
        ticks = round(h / frame)
        at = (t - self._start) / frame
        if ticks < 1 or abs(h / frame - ticks) > _ROUNDING * ticks:
            raise UsageError(f"a step of {h:.9g} s is not a whole number of frames of {frame:.9g} s")
        if abs(at - runner.tick) > _ROUNDING * max(runner.tick, 1):
            now = self._start + runner.tick * frame
            raise UsageError(f"the step begins at t = {t:.9g} s, but the rig is at t = {now:.9g} s")
        end = runner.tick + ticks
        first = True
        while runner.tick < end:
            if not experiment.begin():
                raise UsageError(f"the experiment has ended: {experiment.over}")
            if first:
                self._command(experiment, inputs, ticks)
                first = False
            carry_on(experiment, self.rig.working, min(end, experiment.until()), self._inside)

    def _command(self, experiment: Experiment, inputs: Sequence[float], ticks: int) -> None:
        for i, (drive, value) in enumerate(zip(self._drives, inputs)):
            if not isfinite(value):
                continue
            name = f"fmu.{drive}"
            if i not in self._admitted:
                experiment.exchange.admit(name, [drive], self.rig.runner.frame_ns)
                self._admitted.add(i)
            experiment.exchange.queues[name].period = ticks
            experiment.exchange.receive(name, self.rig.runner.tick, (value,))

    def results(self) -> list[float]:
        """The measurements (the last one where there is none, 0 before the first), then the outputs of the plant."""
        latest = self.rig.runner.hearing.latest
        self._heard = np.where(np.isfinite(latest), latest, self._heard)
        return [*self._heard.tolist(), *self.rig.runner.output_values().tolist()]


def serve(link: socket.socket, scene: str, drives: Sequence[str], results: int) -> None:
    """Answer requests for the rig of a scene (JSON) until the other end closes."""
    request = struct.Struct(f"={3 + len(drives)}d")
    answer = struct.Struct(f"={1 + results}d{_TEXT}s")
    plant: Plant | None = None
    while len(raw := link.recv(request.size, socket.MSG_WAITALL)) == request.size:
        kind, first, second, *values = request.unpack(raw)
        answered = [0.0] * results
        text = ""
        try:
            if plant is None:
                trust_scene(scene)  # its parts come with the FMU, whose code the user runs already
                plant = Plant(Scene.from_json(scene), drives)
            if kind == START:
                plant.start(int(first), second)
            else:
                plant.step(first, second, values)
            answered = plant.results()
        except RigError as fault:
            text = str(fault).replace("\n", "; ")
        link.sendall(answer.pack(float(bool(text)), *answered, text.encode()[: _TEXT - 1]))


def main() -> int:
    """`python -m rig.plant_fmu.child SCENE.json`, with the socket as descriptor 3."""
    with_parent(lambda: os._exit(1))  # a step may take longer than the importing program lives
    os.closerange(LINK + 1, 1024)  # what the importing program has left open
    path = Path(sys.argv[1])
    drives = json.loads(path.with_name("interface.json").read_text())
    with socket.socket(fileno=LINK) as link:
        serve(link, path.read_text(), drives["inputs"], drives["outputs"])
    return 0


if __name__ == "__main__":
    as_process(main)
