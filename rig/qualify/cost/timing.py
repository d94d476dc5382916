"""Compute time of a setting: frames as in a run, and the plant alone without interruption.

Frames are computed by the loop of a run without the bus: each waits until it is due on the wall clock, then limits,
exchange, plant and sensors have their turn. Between two frames other programs use the processor, and its caches forget
the plant. Therefore a frame takes several times as long as in a loop that does not wait. Frames that a run computes in
one piece are timed in one piece. Scheduling and core are those of a run.

All settings take turns, round by round, so that a busy machine slows all of them. p50 and p99 are over the frames of
all rounds, delays by other programs included. The plant alone has one time per round: other work on the machine makes
it longer, never shorter, so the lower quartile counts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.analysis.cycles.motion_measures import Problem, Setting
from rig.bench.free_rig import FreeRig
from rig.bench.live import pace
from rig.bench.live.pace import LONGEST_NS, length
from rig.bench.run.experiment import Experiment
from rig.bench.run.local_controllers import CompiledControllers
from rig.bench.run.simulate import carry_on
from rig.errors import NumericsError
from rig.machine import scheduling
from rig.machine.process import no_garbage

Array = NDArray[np.float64]
ROUNDS = 7
"""Default number of rounds: in each of them all settings alternate."""
QUIET = 0.25  # quantile of the wall times of the plant alone
_ROUND_NS = 150_000_000  # wall time of the frames of one setting in one round
_PIECES = 30  # fewest pieces in one round
_ENDLESS_NS = 10**18


@dataclass(frozen=True)
class Spread:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


UNKNOWN = Spread(math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Cost:
    """Compute time of a setting. `p50`, `p99` [us] per 1 ms of simulated time, frame by frame as in a run.

    `factor`: real-time factor of the plant alone, without interruption and with a state at every sample step; a method
    with adaptive steps ends one with each frame, as in a run. `tick` [ns]: the same for one sample step.
    """

    p50: Spread
    p99: Spread
    factor: Spread
    tick: Spread


class Contender:
    """One setting, ready to run repeatedly from state `x`, over `ticks` sample steps."""

    def __init__(self, problem: Problem, setting: Setting, x: Array) -> None:
        self._x = x
        self.ticks = problem.timed
        scene = setting.applied(problem.scene)
        rig = FreeRig(
            scene,
            problem.assembly,
            x,
            method=setting.method,
            tolerance=scene.clock.tolerance,
            framed=setting.adapts,
        )
        self._motion = rig.in_motion(longest=self.ticks)
        self._step = rig.step_ns
        # the frames may go on where the motion leaves a limit of the scene
        unlimited = replace(problem, scene=replace(problem.scene, limits={}))
        self.runner = runner = unlimited.runner(setting)
        self._experiment = Experiment(replace(runner.scene, protocol=()), runner, _ENDLESS_NS, lambda *_: None)
        self._experiment.open()
        self._inside = CompiledControllers(self._experiment)
        self._each = length(runner.scene, 1.0)
        self._pieces = max(self.ticks // (runner.steps * self._each), 1)
        self._done = 0
        for _ in range(self._pieces):  # mode sets are built when they are first visited
            self._piece()
        self.run()

    def _piece(self) -> None:
        """Carry the runner through the frames of one piece, as a run does between its waits."""
        experiment = self._experiment
        runner = self.runner
        end = runner.tick + self._each
        while runner.tick < end and experiment.begin():
            carry_on(experiment, (), min(end, experiment.until()), self._inside)

    def frames(self, clock: pace.Clock) -> Array:
        """Return the times of some pieces [us per 1 ms of simulated time], each when it is due by `clock`.

        They continue those of the last call, and begin again at `x` at the end of the motion to be timed.
        """
        piece_ns = self._each * self.runner.frame_ns
        times = np.empty(max(_ROUND_NS // piece_ns, _PIECES))
        pacer = pace.Pacer(piece_ns, 1.0, "slow", clock)
        now = time.perf_counter_ns
        pacer.anchor()
        for i in range(len(times)):
            if self._done % self._pieces == 0:
                for place, value in enumerate(self._x.tolist()):
                    self.runner.motion.write(place, value)
            self._done += 1
            pacer.wait()
            begin = now()
            self._piece()
            times[i] = now() - begin
        return times / piece_ns * 1e3

    def run(self) -> float:
        """Return the wall time [s] of the plant alone over `ticks`."""
        for i, value in enumerate(self._x.tolist()):
            self._motion.write(i, value)
        begin = time.perf_counter()
        end = self._motion.tick + self.ticks
        while self._motion.tick < end:
            self._motion.advance(end - self._motion.tick)
        return time.perf_counter() - begin

    def round(self, clock: pace.Clock) -> tuple[Array, float]:
        """Return the times of some pieces by `frames`, and the wall time [s] of the plant alone."""
        with scheduling.ahead(scheduling.PLANT):
            times = self.frames(clock)
        return times, self.run()

    def cost(self, rounds: Sequence[tuple[Array, float]]) -> Cost:
        """Return the cost from the results of `round`."""
        frames = np.concatenate([times for times, _ in rounds])
        wall = spread([times for _, times in rounds], QUIET)
        span = self.ticks * self._step * 1e-9
        factor = Spread(span / wall.value, span / wall.high, span / wall.low)
        tick = Spread(*(value / self.ticks * 1e9 for value in (wall.value, wall.low, wall.high)))
        return Cost(spread(frames, 0.5), spread(frames, 0.99), factor, tick)


def spread(samples: ArrayLike, share: float) -> Spread:
    """Return the quantile `share` of independent values with its 95 % interval: all three are values of `samples`.

    The number of values below the true quantile has a binomial distribution. With few values one end of the interval
    is the least or the largest value, although the true quantile may lie beyond it.
    """
    from scipy.stats import binom

    values = np.sort(np.asarray(samples, dtype=np.float64))
    count = len(values)
    low = int(binom.ppf(0.025, count, share))
    high = int(binom.ppf(0.975, count, share)) + 1
    places = (math.ceil(share * count), low, high)
    return Spread(*(float(values[min(max(place, 1), count) - 1]) for place in places))


def measured(contenders: Sequence[Contender], rounds: int, report: Callable[[], object]) -> list[Cost | str]:
    """Return the cost of each, in turns; for one that has to stop, the reason."""
    results: list[list[tuple[Array, float]]] = [[] for _ in contenders]
    faults = [""] * len(contenders)
    with no_garbage(), scheduling.placed(*scheduling.choose()):
        with scheduling.ahead(scheduling.PLANT):
            clock = pace.WallClock(pace.choose(LONGEST_NS).spin_ns)
        for _ in range(rounds):
            for i, contender in enumerate(contenders):
                try:
                    if not faults[i]:
                        results[i].append(contender.round(clock))
                except NumericsError as error:
                    faults[i] = error.what
                report()
    return [fault or contender.cost(times) for contender, times, fault in zip(contenders, results, faults)]
