"""Compute time of a setting: frames of plant and sensors as in a run, and the plant alone without interruption.

All settings alternate, round by round, so that a busy machine slows all of them. Each round begins from the same state
and simulates the same frames, so that every frame has one time per round. The lower quartile of these is the frame's
compute time; p50 and p99 are over the frames. Occasional delays by the operating system (`rig doctor`) are not
included. The 95 % interval is over the rounds (bootstrap).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.analysis.motion_measures.problem import Problem
from rig.analysis.motion_measures.settings import Setting
from rig.analysis.orbit import in_frames
from rig.errors import NumericsError
from rig.motion.motion import Motion
from rig.process import no_garbage

Array = NDArray[np.float64]
ROUNDS = 7
_WALL = 0.15  # s, for the frames of one setting in one round
_FRAMES = 150  # fewest frames, for a valid p99
_DRAWS = 100


@dataclass(frozen=True)
class Spread:
    """A number with its 95 % interval over the rounds."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Cost:
    """Compute time of a setting. `p50`, `p99` [us] per 1 ms of simulated time, frame by frame with the sensors.

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
        self._runner = problem.runner(setting)
        self._x, self.ticks = x, problem.timed
        self._frame = self._runner.frame_ns
        self.frames = max(self.ticks // self._runner.steps, 1)
        clock = setting.applied(problem.scene).clock
        step_ns = problem.scene.step_ns
        self._motion = Motion(
            replace(problem.assembly.system(), start=x),  # the original: kick would not recognise a modified one
            step_ns,
            setting.method,
            tolerance=clock.tolerance,
            substeps=clock.substeps(step_ns),
            cap=clock.events_per_frame,
            frame=self._runner.steps,
            limit=clock.limit,
            with_energy=False,
            longest=self.ticks,
            frames=in_frames(problem.scene, self._runner.steps) if setting.adapts else None,
        )
        self._step = step_ns
        begin = time.perf_counter()
        self._frames(3)
        self.frames = max(min(self.frames, int(3 * _WALL / (time.perf_counter() - begin))), _FRAMES)
        self.run()

    def _frames(self, count: int) -> Array:
        """Time of each of the first frames from `x` on [us per 1 ms of simulated time]."""
        runner = self._runner
        for i, value in enumerate(self._x.tolist()):
            runner.motion.write(i, value)
        found = np.zeros(count)
        for i in range(count):
            begin = time.perf_counter_ns()
            runner.frame()
            found[i] = time.perf_counter_ns() - begin
        return found / self._frame * 1e3

    def round(self) -> tuple[Array, float]:
        """Return the time of each frame, and the wall time [s] of the plant alone."""
        return self._frames(self.frames), self.run()

    def run(self) -> float:
        """Return the wall time [s] of the plant alone over `ticks`."""
        for i, value in enumerate(self._x.tolist()):
            self._motion.write(i, value)
        begin = time.perf_counter()
        end = self._motion.tick + self.ticks
        while self._motion.tick < end:
            self._motion.advance(end - self._motion.tick)
        return time.perf_counter() - begin

    def cost(self, rounds: Sequence[tuple[Array, float]]) -> Cost:
        """Return the cost from the results of `round`."""
        frames = np.array([one for one, _ in rounds])
        wall = np.array([one for _, one in rounds])
        return Cost(
            spread(frames, lambda a: float(np.quantile(a, 0.5))),
            spread(frames, lambda a: float(np.quantile(a, 0.99))),
            spread(wall, lambda a: self.ticks * self._step * 1e-9 / float(a)),
            spread(wall, lambda a: float(a) / self.ticks * 1e9),
        )


def spread(rounds: Array, statistic: Callable[[Array], float]) -> Spread:
    """Return `statistic` of the rounds with its interval, by resampling the rounds."""
    draws = np.random.default_rng(0).integers(len(rounds), size=(_DRAWS, len(rounds)))
    found = [statistic(_quiet(rounds[draw])) for draw in draws]
    return Spread(statistic(_quiet(rounds)), *np.quantile(found, (0.025, 0.975)).tolist())


def _quiet(rounds: Array) -> Array:
    """The lower quartile over the rounds: other work on the machine makes rounds longer, never shorter."""
    return np.sort(rounds, axis=0)[(len(rounds) - 1) // 4]  # type: ignore[no-any-return]


def measured(contenders: Sequence[Contender], rounds: int, report: Callable[[], object]) -> list[Cost | str]:
    """Return the cost of each, interleaved; for one that has to stop, the reason."""
    found: list[list[tuple[Array, float]]] = [[] for _ in contenders]
    faults = [""] * len(contenders)
    with no_garbage():
        for _ in range(rounds):
            for i, one in enumerate(contenders):
                try:
                    if not faults[i]:
                        found[i].append(one.round())
                except NumericsError as error:
                    faults[i] = error.what
                report()
    return [fault or one.cost(times) for one, times, fault in zip(contenders, found, faults)]
