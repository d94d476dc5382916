"""Proportional feedback of a velocity to an actuator: u = nominal + direction gain v, within limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Self

from pydantic import model_validator

from rig.controllers.blocks.base import Numbers, SceneController, Values
from rig.controllers.blocks.design import Linear
from rig.controllers.blocks.velocity import PathState, VelocityPath, VelocitySection
from rig.errors import UsageError


class FeedbackSection(VelocitySection):
    """Parameters of a proportional feedback; the subclass states the units of gain, nominal value and limits."""

    gain: float
    nominal: float | None
    lowest: float
    highest: float
    drive: str

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.lowest >= self.highest:
            raise ValueError(f"highest = {self.highest:g} is not above lowest = {self.lowest:g}")
        if self.nominal is not None and not self.lowest <= self.nominal <= self.highest:
            raise ValueError(f"nominal = {self.nominal:g} is outside {self.lowest:g} to {self.highest:g}")
        return self


class VelocityFeedback(SceneController[FeedbackSection]):
    """A proportional feedback of a velocity. Its state is that of the velocity path."""

    direction: ClassVar[float]

    def __init__(self, section: FeedbackSection, numbers: Numbers) -> None:
        super().__init__(section, numbers)
        self.path = VelocityPath(section, numbers)
        nominal = section.nominal if section.nominal is not None else numbers.get("nominal")
        if nominal is None:
            raise UsageError("nominal: is not stated, and the design step gives no number for it")
        scale = float(numbers.get("drive_scale", 1.0))
        self.nominal = scale * nominal
        self.slope = scale * self.direction * section.gain
        self.low, self.high = scale * section.lowest, scale * section.highest
        self.enable_ns = round(section.enable_at * 1e9)

    def linear(self) -> Linear:
        """See `Linear`."""

        def step(xi: Sequence[float], y: float) -> tuple[Sequence[float], float]:
            after, v = self.path.linear(xi, y)
            return after, self.slope * v

        return Linear(self.path.states, step, gain="gain")

    def start(self) -> PathState:
        """The state before the first sample."""
        return self.path.start()

    def update(self, state: PathState, t_ns: int, values: Values) -> tuple[PathState, Values]:
        """Next state of the velocity path, and the command [unit of the drive]."""
        state, v = self.path.update(state, t_ns, values[0])
        u = self.nominal + self.slope * v if t_ns >= self.enable_ns else self.nominal
        return state, (self.low if u < self.low else self.high if u > self.high else u,)
