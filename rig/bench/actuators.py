"""Actuators as commands reach them: their ranges, and the values that the protocol sets for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from rig.model.assembly import Input


class Actuators(Protocol):
    """The part of the plant runner that commands reach."""

    @property
    def tick(self) -> int:
        """The present tick."""

    @property
    def inputs(self) -> Mapping[str, Input]:
        """Actuators with unit, range and safe value."""

    def apply(self, name: str, value: float) -> None:
        """Set an actuator to a value at the present tick."""

    def ramp(self, name: str, to: float, ticks: int) -> None:
        """Move an actuator linearly to a value within whole ticks."""


def in_range(inputs: Mapping[str, Input], drives: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
    """Return the values clamped to the ranges of this tick; a parameter of the rig may have changed the ranges."""
    for drive, value in zip(drives, values):
        one = inputs[drive]
        if not one.low <= value <= one.high:  # rare, but checked at every command
            return tuple([min(max(v, inputs[d].low), inputs[d].high) for d, v in zip(drives, values)])
    return tuple(values)


class ProtocolValues:
    """The value that the protocol sets for each actuator, also while a controller drives the actuator."""

    def __init__(self, runner: Actuators) -> None:
        self._runner = runner
        self._values = {name: one.value for name, one in runner.inputs.items()}
        self._moves: dict[str, tuple[float, float, int, int]] = {}
        """Actuator -> first and last value of its move, first tick, number of ticks."""

    def set(self, name: str, value: float) -> float:
        """Set a value; a move ends. Returns the value clamped to the range of the actuator."""
        self._moves.pop(name, None)
        self._values[name] = in_range(self._runner.inputs, [name], [value])[0]
        return self._values[name]

    def move(self, name: str, to: float, ticks: int) -> float:
        """Move linearly to a value within `ticks`. Returns the value clamped to the range of the actuator."""
        start = self.now(name)
        self._values[name] = in_range(self._runner.inputs, [name], [to])[0]
        self._moves[name] = (start, self._values[name], self._runner.tick, ticks)
        return self._values[name]

    def now(self, name: str) -> float:
        """The value at this tick, also during a move."""
        value = self._values[name]
        if name in self._moves:
            start, to, begin, ticks = self._moves[name]
            value = start + (to - start) * min((self._runner.tick - begin) / ticks, 1.0)
        return in_range(self._runner.inputs, [name], [value])[0]

    def rest_of_move(self, name: str) -> tuple[float, int] | None:
        """Last value and remaining ticks of a move that goes on; None without one."""
        if name not in self._moves:
            return None
        _, to, begin, ticks = self._moves[name]
        left = begin + ticks - self._runner.tick
        return (to, left) if left > 0 else None

    def make_safe(self) -> None:
        """Set the safe value of every actuator; all moves end."""
        self._moves.clear()
        self._values = {name: one.safe for name, one in self._runner.inputs.items()}
