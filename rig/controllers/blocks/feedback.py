"""Proportional feedback of a velocity to an actuator: u = nominal + direction gain v, within limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple, Self

from pydantic import model_validator

from rig.controllers.blocks.base import Numbers, SceneController, Update, Values
from rig.controllers.blocks.design import Linear
from rig.controllers.blocks.observer import advanced, advanced3, advanced4, at_rest, skipped
from rig.controllers.blocks.velocity import Path, VelocitySection, path
from rig.errors import UsageError

PathState = tuple[Values, int, float, float]
"""State of the observer, time of the next sample [ns], filtered velocity, lagging copy."""
GAP = 1000  # longest gap that an observer bridges [periods]; after a longer one it starts again


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


class Feedback(NamedTuple):
    """The constants of a proportional feedback; nominal value, slope and limits in the unit of the drive."""

    path: Path
    enable_ns: int
    nominal: float
    slope: float
    low: float
    high: float


def on_measured(p: Feedback, state: PathState, t_ns: int, values: Values) -> tuple[PathState, Values]:
    """Next state of the velocity path, and the command, from a measured velocity."""
    (period_ns, scale, smoothing, lagging, direct, lagged, _), enable_ns, nominal, slope, low, high = p
    z, expected, smooth, lag = state
    v = scale * values[0]
    if expected < 0:
        smooth = lag = v
    smooth += smoothing * (v - smooth)
    lag += lagging * (smooth - lag)
    u = nominal + slope * (direct * smooth + lagged * lag) if t_ns >= enable_ns else nominal
    if u < low:
        u = low
    elif u > high:
        u = high
    return (z, t_ns + period_ns, smooth, lag), (u,)


def _on_observed(p: Any, state: PathState, t_ns: int, y: float, advance: Any) -> tuple[PathState, Values]:
    z, expected, smooth, lag = state
    path = p.path
    if t_ns != expected or len(z) == 0:
        late = (t_ns - expected) // path.period_ns
        z = skipped(path.observer, z, late) if len(z) > 0 and 0 < late <= GAP else at_rest(path.observer, y)
    z, v = advance(path.observer, z, y)
    return on_measured(p, (z, expected, smooth, lag), t_ns, (v,))  # its scale is 1


def on_observed(p: Feedback, state: PathState, t_ns: int, values: Values) -> tuple[PathState, Values]:
    """The same with an observer."""
    return _on_observed(p, state, t_ns, values[0], advanced)


def on_observed3(p: Feedback, state: PathState, t_ns: int, values: Values) -> tuple[PathState, Values]:
    """The same with an observer of three states."""
    return _on_observed(p, state, t_ns, values[0], advanced3)


def on_observed4(p: Feedback, state: PathState, t_ns: int, values: Values) -> tuple[PathState, Values]:
    """The same with an observer of four states."""
    return _on_observed(p, state, t_ns, values[0], advanced4)


class VelocityFeedback(SceneController[FeedbackSection]):
    """A proportional feedback of a velocity. Its state is that of the velocity path."""

    direction: ClassVar[float]

    update: Update

    def __init__(self, section: FeedbackSection, numbers: Numbers) -> None:
        super().__init__(section, numbers)
        nominal = section.nominal if section.nominal is not None else numbers.get("nominal")
        if nominal is None:
            raise UsageError("nominal: is not stated, and the design step gives no number for it")
        scale = float(numbers.get("drive_scale", 1.0))
        levels = scale * nominal, scale * self.direction * section.gain, scale * section.lowest, scale * section.highest
        self.constants = Feedback(path(section, numbers), round(section.enable_at * 1e9), *levels)
        observer = self.constants.path.observer
        self.states = len(observer.rest) if observer else 0
        self.law = {0: on_measured, 3: on_observed3, 4: on_observed4}.get(self.states, on_observed)
        self.update = partial(self.law, self.constants)

    def linear(self) -> Linear:
        """See `Linear`."""
        free = self.constants._replace(enable_ns=0, nominal=0.0, low=-math.inf, high=math.inf)

        def step(xi: Sequence[float], y: float) -> tuple[Sequence[float], float]:
            (z, _, smooth, lag), (u,) = self.law(free, (tuple(xi[:-2]), 0, xi[-2], xi[-1]), 0, (y,))
            return [*z, smooth, lag], u

        return Linear(self.states + 2, step, gain="gain")

    def start(self) -> PathState:
        """The state before the first sample."""
        return (), -1, 0.0, 0.0
