"""Pieces: the frames that a live run computes at once, with one look at the clock and at the bus for all of them.

A frame of 50 us has no time for the bus, and needs none if its controllers work in the plant process. Protocol, limits
and these controllers still act at their ticks. Messages of other processes are read at the first tick of a piece, and
messages about its ticks are sent at its end.
"""

from __future__ import annotations

from collections.abc import Collection
from math import gcd

from rig.bench.experiment import Experiment
from rig.bench.timing import Timing
from rig.scenes.scene import Scene

LONGEST_NS = 1_000_000
"""Longest piece [ns of the wall clock]. # chosen: other processes see less delay from it than from the bus at times"""


def length(scene: Scene, pace: float | None, periods: Collection[int] | None = None) -> int:
    """Number of frames in a piece of `scene` at `pace` (None: without a clock, as at pace 1).

    `periods`: periods [frames] of the controllers in other processes, by default of those in the scene. They get a step
    at the first tick of a piece, so a piece begins at every tick at which one is due. If all controllers are in other
    processes, a piece is one frame, because their commands take effect one frame later.
    """
    if periods is None:
        outside = [one for name, one in scene.controllers.items() if name not in scene.in_plant]
        periods = [one.period // scene.frame_ns for one in outside]
    most = max(int(LONGEST_NS * (pace or 1.0)) // scene.frame_ns, 1)
    if not periods:
        return most
    if not scene.in_plant:
        return 1
    common = gcd(*periods)
    return next(frames for frames in range(min(most, common), 0, -1) if common % frames == 0)


class FrameBatches:
    """The division of a run into pieces of several frames."""

    def __init__(self, experiment: Experiment, pace: float | None) -> None:
        self._runner, self._queues = experiment.runner, experiment.exchange.queues
        self._scene, self._pace = experiment.scene, pace
        self._short = length(self._scene, pace, ()) == 1
        """Whether every piece is one frame."""

    @property
    def length(self) -> int:
        """Number of frames in a whole piece, as long as no controller joins or leaves."""
        if self._short:
            return 1
        in_plant = self._scene.in_plant
        return length(self._scene, self._pace, [o.period for name, o in self._queues.items() if name not in in_plant])

    def next(self, timing: Timing) -> int:
        """Number of frames up to the first tick of the next piece; tells `timing` the length of a whole piece."""
        if self._short:
            return 1
        whole = self.length
        timing.resize(whole)
        return whole - self._runner.tick % whole
