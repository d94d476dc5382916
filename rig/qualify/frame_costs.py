"""Compute times of the frames of a scene over its whole protocol."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rig.bench.experiment import Experiment
from rig.bench.job import Job
from rig.bench.prepared_rigs import PreparedRigs
from rig.bench.rehearsal import visited
from rig.bench.simulate import begun, carry_on
from rig.controllers import restored
from rig.design import described
from rig.errors import NumericsError
from rig.scenes.scene import Scene

Costs = NDArray[np.int64]
Clock = Callable[[], int]
LEAST = 2000
"""Fewest measured frames: the cost at p99 is then exceeded by twenty of them."""
_ROW = 100  # consecutive measured frames: the lateness of one carries over to the next
_ENDLESS_NS = 10_000_000_000  # measured part of a protocol without an end


def costs(scene: Scene, least: int = LEAST, clock: Clock = time.perf_counter_ns) -> Costs:
    """Measure the time of frames of protocol, plant and sensors [ns], at least `least` frames, spread over the
    protocol.

    Controllers in the plant's process are included, others are not. As in a paced run, a rehearsal has built the mode
    sets before. A short protocol is repeated. In a long one the frames between the measured rows run without
    interruption. `clock`: of the measurement [ns].
    """
    job = Job(scene.to_json())
    sets, found, count = visited(scene, job), list[int](), -1
    while count < len(found) < least:
        count = len(found)
        found += _carried_through(scene, sets, least, clock)
    return np.array(found, dtype=np.int64)


def _carried_through(scene: Scene, sets: tuple[int, ...], least: int, clock: Clock) -> list[int]:
    """Frames of one run, in order."""
    duration_ns = _ENDLESS_NS if scene.duration_ns is None else scene.duration_ns
    working = {name: restored(description) for name, description in described(scene).items()}

    def prepare(experiment: Experiment) -> None:
        experiment.runner.motion.foresee(sets)
        PreparedRigs(experiment)

    experiment, answering = begun(scene, working, duration_ns, before=prepare)
    runner, truth = experiment.runner, experiment.runner.truth
    assert truth is not None
    inside, outside = ([one for one in answering if (one.name in scene.in_plant) is here] for here in (True, False))
    apart = _ROW * max(duration_ns // scene.frame_ns // least, 1)
    found: list[int] = []
    try:
        while True:
            tick = runner.tick
            if tick % _ROW == 0:
                runner.hand_over(truth)  # a paced run does not keep it: keep it out of the measured frames
            begin = clock()
            if not experiment.begin():
                break
            protocol = clock() - begin
            if tick % apart >= _ROW:
                carry_on(experiment, answering, min(experiment.until(), tick - tick % apart + apart))
                continue
            for one in outside:
                one.answer()
            begin = clock()
            for one in inside:
                one.answer()
            experiment.take_over()
            runner.frame()
            found.append(protocol + clock() - begin)
    except NumericsError:  # the frames up to there count
        pass
    return found


def behind(found: Costs, wall_ns: float) -> Costs:
    """Return the lag of each frame [ns] because earlier ones took longer than their `wall_ns`; late frames catch up."""
    late = np.empty(len(found), np.int64)
    lag = 0.0
    for i, cost in enumerate(found.tolist()):
        late[i] = lag
        lag = max(lag + cost - wall_ns, 0.0)
    return late
