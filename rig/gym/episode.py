"""An episode: a rig whose actuators an agent drives, step by step, with the same bits as every run with these commands.

The agent is a controller: its command for the measurements of a tick is received at this tick. Controllers of the scene
that drive the same actuators are left out; the others work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isfinite, nan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.bench.run.local_controllers import CompiledControllers
from rig.bench.run.runner import PlantRunner
from rig.bench.run.simulate import RestartableRig, carry_on
from rig.errors import NumericsError, UsageError
from rig.quantities import finite, nanoseconds, whole
from rig.scenes.scene import Scene
from rig.units import brief

Ranges = Mapping[str, tuple[Any, Any]]
"""Sensor or actuator -> its least and largest value: numbers in SI, or texts with a unit."""
AGENT = "agent"
# Largest number of frames in a step. # chosen
MOST_FRAMES = 1_000_000


class Now(NamedTuple):
    """What a reward may depend on, after a step.

    `t`: simulated time [s]. `measured`: sensor -> the measurement that the agent observes. `commanded`: actuator -> the
    command of this step. `output(name)`: an output of the plant as it is, without an instrument. All in SI.
    """

    t: float
    measured: dict[str, float]
    commanded: dict[str, float]
    output: Callable[[str], float]


Reward = Callable[[Now], float]


class Stepped(NamedTuple):
    """The result of a step."""

    observation: list[float]
    reward: float
    terminated: bool
    truncated: bool
    info: dict[str, Any]


class Episode:
    """A rig that is reset and stepped. Raises UsageError with all faults of `observe`, `act` and the times.

    `observe`, `act`: sensors and actuators of the agent with their ranges. `reward`: a function of `Now`. `frames`:
    frames in a step. `duration`: length of an episode [s, or a text with a unit]; None: that of the protocol.
    """

    def __init__(
        self, scene: Scene, observe: Ranges, act: Ranges, reward: Reward, frames: int = 1, duration: Any = None
    ) -> None:
        assembly = scene.assemble()
        faults = [*_unknown("observe", observe, scene.sensors), *_unknown("act", act, assembly.inputs)]
        if AGENT in scene.controllers:
            faults.append(f"the scene already has a controller {AGENT}; rename it")
        if not callable(reward):
            faults.append(f"reward = {brief(reward)}: must be a function of what is now")
        length, wrong = _length(scene, duration)
        try:
            self._frames = whole("frames", frames, 1, MOST_FRAMES)
        except UsageError as fault:
            faults.append(str(fault))
        if faults := [*faults, *wrong]:
            raise UsageError("\n".join(faults))
        self.sensors = tuple(observe)
        self.actuators = tuple(act)
        self._reward = reward
        self._length_ns = length
        self._begun = False
        self._ended = True
        self._rig = RestartableRig(scene, self.actuators)
        bank = self.runner.bank
        inputs = self.runner.inputs
        units = dict(zip(bank.names, bank.units))
        self.observed, wrong_observed = _ranges("observe", observe, units, {})
        limits = {name: (actuator.low, actuator.high) for name, actuator in inputs.items()}
        units_of_inputs = {name: actuator.unit for name, actuator in inputs.items()}
        self.driven, wrong_driven = _ranges("act", act, units_of_inputs, limits)
        faults = [*wrong_observed, *wrong_driven]
        for name in act:
            if self.runner.coefficient(name):
                faults.append(f"act: {name}: each value needs new matrices; an agent cannot drive it")
        if faults:
            raise UsageError("\n".join(faults))
        self._columns = [bank.names.index(name) for name in self.sensors]
        self._last_tick = -(-self._length_ns // self.scene.frame_ns)

    @property
    def runner(self) -> PlantRunner:
        """The plant runner; a reset may replace it."""
        return self._rig.runner

    @property
    def scene(self) -> Scene:
        """The scene, without the controllers that are left out."""
        return self._rig.scene

    def reset(self, seed: int) -> list[float]:
        """Begin a new episode with this seed of all noise; returns the first observation."""
        experiment = self._experiment = self._rig.begin(seed, self._length_ns)
        experiment.exchange.admit(AGENT, self.actuators, self._frames * self.scene.frame_ns)
        experiment.open()
        self.working = self._rig.working
        self._inside = CompiledControllers(experiment) if self._frames > 1 or self.working else None
        self._heard = [nan] * len(self._columns)
        self._begun = True
        self._ended = False
        return self.observation()

    def step(self, command: Sequence[float]) -> Stepped:
        """Carry the rig on by one step with this command [SI], which is limited to the range of each actuator.

        `command`: one finite number per actuator, as `commands` returns them.
        `terminated`: a limit of the scene was exceeded or the integration had to stop, `info["why"]` says which.
        `truncated`: the episode has its full length. Raises UsageError before the first reset and after the end.
        """
        if self._ended:
            raise UsageError("the episode has ended; call reset" if self._begun else "no episode has begun; call reset")
        runner = self._rig.runner
        experiment = self._experiment
        self.check(command)
        given = tuple([_within(u, low, high) for u, (low, high) in zip(command, self.driven)])
        end = runner.tick + self._frames
        first = True
        why = ""
        try:
            while runner.tick < end and not runner.limited and experiment.begin():
                if first:
                    experiment.exchange.receive(AGENT, runner.tick, given)
                    first = False
                until = end if self._frames == 1 else min(end, experiment.until())
                carry_on(experiment, self.working, until, self._inside)
        except NumericsError as fault:
            why = fault.what
        observation = self.observation()
        if runner.limited:
            why = f"{runner.beyond()} exceeds its limit"
        truncated = not why and (runner.tick >= self._last_tick or bool(experiment.over))
        self._ended = bool(why) or truncated
        t = runner.t_ns * 1e-9
        measured = dict(zip(self.sensors, observation))
        commanded = dict(zip(self.actuators, given))
        now = Now(t, measured, commanded, runner.output)
        info = {"t": t, "why": why} if why else {"t": t}
        return Stepped(observation, float(self._reward(now)), bool(why), truncated, info)

    def commands(self, action: Any) -> NDArray[np.float64]:
        """An action of an agent as commands [SI], one per actuator. Raises UsageError for anything but real numbers."""
        try:
            given = np.asarray(action)
        except ValueError:  # rows of different lengths
            given = np.asarray(None)
        shape = (len(self.actuators),)
        if given.dtype.kind not in "fiu" or given.shape != shape:
            what = f"numbers of shape {given.shape}" if given.dtype.kind in "fiu" else brief(action)
            raise UsageError(
                f"the action is {what}; state numbers of shape {shape}, a row of {', '.join(self.actuators)}"
            )
        return given.astype(np.float64, copy=False)

    def check(self, command: Sequence[float]) -> None:
        """Raise UsageError for a command that is not finite."""
        if not isfinite(sum(command)) and not all(map(isfinite, command)):
            values = ", ".join(f"{name} = {u:g}" for name, u in zip(self.actuators, command) if not isfinite(u))
            t = self.runner.t_ns * 1e-9
            raise UsageError(f"the action at t = {t:.9g} s has {values}; a command is a finite number")

    def observation(self) -> list[float]:
        """The latest measurements within their ranges; where there is none, the last one."""
        latest = self.runner.hearing.latest
        heard = self._heard
        values = []
        for i, (column, (low, high)) in enumerate(zip(self._columns, self.observed)):
            value = latest.item(column)
            if isfinite(value):
                heard[i] = value
            elif not isfinite(value := heard[i]):
                value = 0.0
            values.append(_within(value, low, high))
        return values


def _within(value: float, low: float, high: float) -> float:
    """The value, or the end of the range beyond which it lies."""
    if value < low:
        return low
    return high if value > high else value


def _unknown(what: str, given: Ranges, known: Iterable[str]) -> list[str]:
    """Faults of names that do not exist."""
    names = sorted(known)
    if not given:
        return [f"{what}: names nothing; there are {', '.join(names) or 'none'}"]
    return [f"{what}: there is no {name:.80}; there are {', '.join(names)}" for name in given if name not in names]


def _ranges(
    what: str, given: Ranges, units: Mapping[str, str], limits: Mapping[str, tuple[float, float]]
) -> tuple[list[tuple[float, float]], list[str]]:
    """The ranges in SI, and their faults. `limits`: what is possible at most."""
    in_si = []
    faults = []
    for name, values in given.items():
        try:
            low, high = (finite(value, units[name]) for value in values)
            if low >= high:
                raise ValueError(f"the least value {low:g} is not below the largest one, {high:g} {units[name]}")
            least, most = limits.get(name, (low, high))
            if low < least or high > most:
                raise ValueError(f"the actuator takes {least:g} to {most:g} {units[name]}")
            in_si.append((low, high))
        except (TypeError, ValueError) as fault:
            faults.append(f"{what}: {name} = {values!r:.80}: {fault}; state (least, largest) value")
    return in_si, faults


def _length(scene: Scene, duration: Any) -> tuple[int, list[str]]:
    """The length of an episode [ns], and what is wrong with it."""
    if duration is None:
        if scene.duration_ns is None:
            return 0, [f"duration: {scene.name} has no protocol that ends; state one, e.g. duration=10.0"]
        return scene.duration_ns, []
    try:
        length = nanoseconds(duration)
    except ValueError as fault:
        return 0, [f"duration: {fault}"]
    return length, [] if length > 0 else [f"duration = {duration}: must be above 0 s"]
