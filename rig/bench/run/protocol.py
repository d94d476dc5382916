"""The protocol of an experiment, step by step: what is due depends only on the tick and on the measurements.

`Protocol.due` is called once in every frame, after the measurements of that tick. Steps without a duration follow each
other within one tick; a ramp, a hold, a wait or a recording to follow delays the next steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.bench.run.actions import Action, Apply, Change, Finish, Move, Note, Release, Strike, Switch
from rig.bench.run.condition import Condition
from rig.model.assembly import Input
from rig.scenes.protocol import Follow, Hold, Knock, Load, Mark, Ramp, Set, Track, Wait, duration_ns
from rig.scenes.sections import least_ns, number, unrolled

NOTHING: tuple[Action, ...] = ()


class Following:
    """The moves of a step `Follow` of a `track` from `tick` on: one for each frame in which a value changes."""

    def __init__(self, step: Follow, track: Track, tick: int, frame_ns: int) -> None:
        self._names = tuple(step.channels)
        self._first = tick
        values = track.values(len(self._names))
        if track.frame_ns != frame_ns:  # a recorded step that is continued with another frame
            ticks = np.arange(step.duration // frame_ns + 1) * frame_ns
            frames = np.arange(values.shape[1]) * track.frame_ns
            values = np.array([np.interp(ticks, frames, row) for row in values])
        same = (values[:, 1:] == values[:, :-1]).all(axis=0)
        self._values = values
        knots = np.flatnonzero(~(same[1:] & same[:-1])) + 1
        self._knots: list[int] = [0, *knots.tolist(), values.shape[1] - 1]
        """Frames at which a move begins; between two of them nothing changes, or one frame passes."""
        self._at = 0

    @property
    def next(self) -> int:
        """The tick of the next move."""
        return self._first + self._knots[self._at]

    def due(self, latest: NDArray[Any]) -> list[Action]:
        """The moves from the next knot to the one after it; `latest` as of `Protocol.due`."""
        begin, end = self._knots[self._at : self._at + 2]
        self._at += 1
        columns = zip(self._names, self._values[:, begin], self._values[:, end])
        actions = list[Action]()
        later = list[Action]()
        for name, value, next_value in columns:
            if not begin:
                actions.append(Apply(name, float(value)))
            if value != next_value:
                later.append(Move(name, float(next_value), end - begin))
            elif begin:
                later.append(Apply(name, float(value)))
        return actions + later

    def end(self) -> list[Action]:
        """The values at the end."""
        return [Apply(name, float(value)) for name, value in zip(self._names, self._values[:, -1])]


class FollowingSensors:
    """The moves of a step `Follow` from `tick` on that follows sensors: one in each frame in which a value changes.

    `columns`: actuator -> place of its sensor in the latest samples.
    """

    def __init__(self, columns: Mapping[str, int], tick: int) -> None:
        self._columns = columns
        self._values: dict[str, float] = {}
        self.next = tick
        """The tick of the next look at the sensors."""

    def due(self, latest: NDArray[Any]) -> list[Action]:
        """The moves to the latest samples; without samples, before the first tick, the look is repeated."""
        actions = list[Action]()
        values = {name: float(latest[column]) for name, column in self._columns.items()}
        if not all(map(isfinite, values.values())):
            return actions
        for name, value in values.items():
            if name not in self._values:
                actions.append(Apply(name, value))
            elif value != self._values[name]:
                actions.append(Move(name, value, 1))
        self._values = values
        self.next += 1
        return actions

    def end(self) -> list[Action]:
        """The values stay."""
        return []


class Progress(NamedTuple):
    """Progress of an experiment.

    `steps`: number of steps; None if steps repeat for ever. `left_ns`: least time that the remaining steps take; waits
    may add to it.
    """

    phase: str
    step: int
    steps: int | None
    fraction: float | None
    left_ns: int | None


class Protocol:
    """The steps of a scene, carried out in frames of `frame_ns`.

    `inputs` and `sensors` (names in the order of the samples, with units): what the steps may name.
    """

    def __init__(
        self,
        steps: Sequence[Any],
        frame_ns: int,
        sensors: Mapping[str, str],
        inputs: Mapping[str, Input],
    ) -> None:
        self.done = not steps
        self._frame_ns = frame_ns
        self._columns = {name: column for column, name in enumerate(sensors)}
        self._inputs = {name: actuator.unit for name, actuator in inputs.items()}
        self._sensors = dict(sensors)
        self._steps = unrolled(steps)
        self._count = number(steps)
        self._length = least_ns(steps)
        self.begun = 0
        """Number of steps that have begun, with repeats unrolled."""
        self._passed = 0
        self._until = 0
        self._current: Any = None
        self._condition: Condition | None = None
        self._following: Following | FollowingSensors | None = None
        self.phase = ""

    def due(self, tick: int, latest: NDArray[Any]) -> Sequence[Action]:
        """Actions that are due at `tick`, if the latest samples of the sensors are `latest` [sensors]."""
        condition = self._condition
        if condition is not None:
            met = condition.met(float(latest[condition.column]))
            if not met and tick < self._until:
                return NOTHING
        elif self._following is not None and tick < self._until:
            return self._following.due(latest) if tick >= self._following.next else NOTHING
        elif tick < self._until or self.done:
            return NOTHING
        return self._go_on(tick, latest)

    def until(self, tick: int) -> int | None:
        """The first tick after `tick` at which something may be due; None if the protocol is done."""
        if self._condition is not None:
            return tick + 1
        if self.done:
            return None
        return self._until if self._following is None else self._following.next

    def _go_on(self, tick: int, latest: NDArray[Any]) -> list[Action]:
        actions = self._finished()
        for step in self._steps:
            actions += self._begin(step, tick)
            if isinstance(step, Follow) and self._following is not None:
                actions += self._following.due(latest)
            condition = self._condition
            if condition is not None:
                if not condition.met(float(latest[condition.column])):
                    return actions
                actions += self._finished()
            elif self._until > tick:
                return actions
        self.done = True
        self.phase = "done"
        return actions

    def _finished(self) -> list[Action]:
        """The present step, which had a duration, is over: return its last actions."""
        step = self._current
        condition = self._condition
        following = self._following
        self._following = None
        self._current = self._condition = None
        if following is not None:
            return following.end()
        if isinstance(step, Ramp | Load):
            return [Apply(step.target, _value(step))]
        if isinstance(step, Knock):
            return [Release()]
        if condition is None or condition.is_met:
            return []
        text = f"{self.described(step)}: not so within {step.timeout / 1e9:g} s"
        return [Finish(text)] if step.otherwise == "stop" else [Note("timeout", text)]

    def _begin(self, step: Any, tick: int) -> list[Action]:
        self.begun += 1
        self.phase = step.step
        self._passed += duration_ns(step)
        self._until = tick + duration_ns(step) // self._frame_ns
        if isinstance(step, Mark):
            return [Note("mark", step.text)]
        return [Note("step", self.described(step)), *self._started(step, tick)]

    def _started(self, step: Any, tick: int) -> list[Action]:
        if isinstance(step, Ramp | Load):
            if self._until == tick:
                return [Apply(step.target, _value(step))]
            self._current = step
            return [Move(step.target, _value(step), self._until - tick)]
        if isinstance(step, Wait):
            self._current = step
            self._condition = Condition(step, self._columns[step.sensor], self._frame_ns)
            self._until = tick + step.timeout // self._frame_ns
        elif isinstance(step, Follow):
            if step.file is None:
                columns = {name: self._columns[sensor] for name, sensor in step.channels.items()}
                self._following = FollowingSensors(columns, tick)
            else:
                self._following = Following(step, step.file, tick, self._frame_ns)
        elif isinstance(step, Knock):
            self._current = step if step.duration else None
            return [Strike(step.impulse, step.duration or 0)]
        elif isinstance(step, Set):
            known = step.target in self._inputs
            return [Apply(step.target, step.to) if known else Change(step.target, step.to)]
        elif not isinstance(step, Hold):
            return [Switch(step.controller, step.step == "connect")]
        return []

    def progress(self, tick: int) -> Progress:
        """Progress of the experiment at `tick`."""
        left = None
        fraction = None
        if self._length is not None:
            waits = self._condition is not None
            left = self._length - self._passed + (0 if waits else max(self._until - tick, 0) * self._frame_ns)
            if self._length:
                fraction = 1.0 - left / self._length
        if self.done:
            fraction = 1.0
        return Progress(self.phase, self.begun, self._count, fraction, left)

    def described(self, step: Any) -> str:
        """A step in words: a ramp, a hold, a wait, a knock, a recording to follow, a change, a connection."""
        if isinstance(step, Ramp | Load):
            unit = self._inputs.get(step.target, "")
            within = f" within {step.over / 1e9:g} s" if step.over else ""
            return f"{step.step} {step.target} to {_value(step):g} {unit}{within}"
        if isinstance(step, Follow):
            ways = ", ".join(f"{name} follows {channel}" for name, channel in step.channels.items())
            of = "" if step.file is None else f" of {step.file}"
            return f"{ways}{of} for {(step.time or step.duration) / 1e9:g} s"
        if isinstance(step, Hold):
            return f"hold for {step.time / 1e9:g} s"
        if isinstance(step, Wait):
            return f"wait until {step.sensor} is {step.condition} {step.limit:g} {self._sensors[step.sensor]}"
        if isinstance(step, Knock):
            within = f" within {step.duration / 1e9:g} s" if step.duration else ""
            return f"knock with {step.impulse:g} N s{within}"
        if isinstance(step, Set):
            return f"set {step.target} = {step.to:g} {self._inputs.get(step.target, '')}".rstrip()
        return f"{step.step} {step.controller}"


def _value(step: Ramp | Load) -> float:
    return step.force if isinstance(step, Load) else step.to
