"""The history of what drove the rig during a run: driving states that an absent effect may bring follow from it.

An absent effect may bring states that only drive the rig: the speed behind a lag, the angle of a disc. Each follows

    z' = a z + u(t),    u: a row over the driving states of the run and over limiters

so that its value at any tick follows from what was kept, without a second run. u is linear between two kept ticks, and
z is exact for that. Up to `MOST_STATES` ticks are kept, all of them or evenly spaced ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.model.assembly import Input
from rig.model.system import System
from rig.motion.motion import Motion
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
Variant = Callable[[Scene], tuple[System, Mapping[str, Input]]]
"""The rig of a scene with an effect more, and its actuators."""
MOST_STATES = 1 << 16
"""Most ticks that are kept; beyond that every second one is dropped."""
_SMALL = 1e-3  # of a h: below this the series of the weights is exact to rounding


class Stretch:
    """A part of a run with one rig, `scene` and `system`: driving states [kept tick, state] from tick `first` on."""

    def __init__(self, scene: Scene, system: System, first: int) -> None:
        self.scene = scene
        self.system = system
        self.first = first
        self.count = 0
        self.rows = np.empty((MOST_STATES, system.n - system.one))

    def driving(self, inputs: Mapping[str, Input]) -> dict[str, Array]:
        """Each driving state at the kept ticks; commands are clamped to the ranges of `inputs`."""
        values = dict(zip(self.system.names[self.system.one :], self.rows[: self.count].T))
        return clamped(values, inputs)


class DrivingHistory:
    """Keeps the driving states of a run. `stretches`: one for each rig of the run, in order."""

    def __init__(self) -> None:
        self.stretches: list[Stretch] = []
        self._count = 0
        self._every = 1

    def follow(self, motion: Motion, scene: Scene) -> None:
        """Keep what is in the log of `motion`, which follows what was kept before."""
        first = motion.tick - motion.kept + 1
        every = self._every
        after = -first % every
        taken = motion.log.out[after : motion.kept : every]
        if not len(taken):
            return
        stretch = self.stretches[-1] if self.stretches else None
        if stretch is None or stretch.system is not motion.system:
            stretch = Stretch(scene, motion.system, first + after)
            self.stretches.append(stretch)
        if self._count + len(taken) > MOST_STATES:
            self._thin()
            self.follow(motion, scene)
            return
        stretch.rows[stretch.count : stretch.count + len(taken)] = taken[:, stretch.system.one :]
        stretch.count += len(taken)
        self._count += len(taken)

    def _thin(self) -> None:
        """Drop every second tick."""
        self._every *= 2
        for stretch in self.stretches:
            after = -stretch.first % self._every // (self._every // 2)
            kept = stretch.rows[after : stretch.count : 2].copy()
            stretch.first += after * (self._every // 2)
            stretch.rows[: len(kept)] = kept
            stretch.count = len(kept)
        self._count = sum(stretch.count for stretch in self.stretches)

    def ticks(self, stretch: Stretch) -> Array:
        """The kept ticks of a stretch."""
        return stretch.first + self._every * np.arange(stretch.count, dtype=np.float64)

    def at_limit(self, table: str, variant: Variant | None = None) -> float:
        """The share of the ticks in which a command to an actuator of `table` was at a limit of its range.

        With `variant`, which has limits that the run has not: in which the command was beyond them.
        """
        met = total = 0
        for stretch in self.stretches:
            inputs = variant(stretch.scene)[1] if variant else stretch.scene.assemble().inputs
            values = stretch.driving({})
            for key, actuator in inputs.items():
                if key.partition(".")[0] != table or actuator.state not in values:
                    continue
                command = values[actuator.state]
                inside = np.clip(command, actuator.low, actuator.high)
                away = inside != command if variant else (command <= actuator.low) | (command >= actuator.high)
                met += int(np.count_nonzero(away))
                total += stretch.count
        return met / max(total, 1)

    def added_states(self, step: float, variant: Variant) -> Callable[[int], dict[str, float]] | None:
        """The driving states that `variant` has more than the run, by name, as a function of the tick.

        `step`: of a tick [s]. None if one of them follows from something else than driving states.
        """
        ticks: list[Array] = []
        traces: dict[str, list[Array]] = {}
        last: dict[str, float] = {}
        for stretch in self.stretches:
            system, inputs = variant(stretch.scene)
            time = self.ticks(stretch)
            known = stretch.driving(inputs)
            wanted = [name for name in system.names[system.one :] if name not in known]
            while wanted:
                rates = {name: rate for name in wanted if (rate := _rate(system, name, known)) is not None}
                if not rates:
                    return None
                for name, rate in rates.items():
                    known[name] = _followed(system, name, rate, time * step, last.get(name))
                    traces.setdefault(name, []).append(known[name])
                    wanted.remove(name)
            if len(time):
                ticks.append(time)
                last |= {name: float(trace[-1][-1]) for name, trace in traces.items()}
        if not ticks:
            return None
        at = np.concatenate(ticks)
        values = {name: np.concatenate(trace) for name, trace in traces.items()}
        return lambda tick: {name: float(np.interp(tick, at, trace)) for name, trace in values.items()}


def clamped(values: Mapping[str, Any], inputs: Mapping[str, Input]) -> dict[str, Any]:
    """`values` of states (numbers or arrays), with each command clamped to the range of its actuator."""
    ranges = {actuator.state: (actuator.low, actuator.high) for actuator in inputs.values() if actuator.state}
    return {name: np.clip(v, *ranges[name]) if name in ranges else v for name, v in values.items()}


def _rate(system: System, name: str, known: Mapping[str, Array]) -> Array | None:
    """The values of u of driving state `name` at the ticks of `known`; None if it needs a state that is not known."""
    index = system.names.index(name)
    limiters = [limiter for limiter in system.limiters if limiter.state == index]
    rows = [system.signals[index - system.one], *(limiter.row for limiter in limiters)]
    others = np.delete(np.array(rows), index, axis=1)
    names = [*system.names[:index], *system.names[index + 1 :]]
    if any(names[i] not in known for i in np.flatnonzero(others.any(axis=0))):
        return None
    values = others @ np.array([known.get(state, np.zeros_like(known["one"])) for state in names])
    for limiter, row in zip(limiters, values[1:]):
        values[0] += limiter.gain * np.clip(row, limiter.low, limiter.high)
    return np.asarray(values[0])


def _followed(system: System, name: str, rate: Array, time: Array, start: float | None) -> Array:
    """Values of z at `time` [s] for its `rate` u there.

    Without `start` it has settled at first, or, if it cannot settle, had its start value when the run began.
    """
    index = system.names.index(name)
    a = float(system.signals[index - system.one, index])
    if not len(time):
        return np.zeros(0)
    if start is None:
        start = -rate[0] / a if a < 0.0 else float(system.start[index]) + float(rate[0]) * time[0]
    h = np.diff(time)
    s = a * h
    with np.errstate(invalid="ignore", divide="ignore"):
        whole = np.where(np.abs(s) < _SMALL, 1.0 + s / 2.0 + s * s / 6.0, np.expm1(s) / s)
        slope = np.where(np.abs(s) < _SMALL, 0.5 + s / 6.0 + s * s / 24.0, (np.expm1(s) - s) / (s * s))
    gained = h * (whole * rate[:-1] + slope * np.diff(rate))
    if a == 0.0:
        return np.cumsum(np.concatenate([[float(start)], gained]))

    def values() -> Iterator[float]:
        z = float(start)
        yield z
        for kept, more in zip(np.exp(s).tolist(), gained.tolist()):
            z = kept * z + more
            yield z

    return np.fromiter(values(), np.float64, len(time))
