"""The velocity for a feedback: measured or observed, filtered, and predicted over the delay of its loop.

    measured   v = scale y
    observed   v = observer of a displacement, an angle or an acceleration, predicted by the model
    filter     s += (1 - exp(-2 pi f T)) (v - s)                                       first-order low-pass
    predicted  v(t + tau) = p s(t) + r l(t)       with the lagging copy  l += b (s - l),  b = 1 - exp(-w T)

p and r make the prediction exact for an oscillation of frequency w: p + r H(w) = exp(i w tau), where H is the frequency
response of the lagging copy. The prediction has one state and amplifies noise at most by sqrt(2).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from rig.controllers.blocks.base import Ahead, ControllerSection, Numbers, OptionalForce, OptionalHertz, Values
from rig.controllers.blocks.design import Rig
from rig.controllers.blocks.observer import Observer
from rig.errors import UsageError
from rig.quantities import Second

PathState = tuple[Values, int, float, float]
GAP = 1000  # longest gap that an observer bridges [periods]; after a longer one it starts again


class VelocitySection(ControllerSection):
    """Parameters of the velocity path of a feedback controller."""

    fixed: ClassVar[frozenset[str]] = ControllerSection.fixed | {"velocity", "unknown_force"}

    sensor: str
    velocity: Literal["measured", "observed"] = "measured"
    unknown_force: OptionalForce = None
    filter: OptionalHertz = None
    compensation: Ahead = 0.0
    frequency: OptionalHertz = None
    enable_at: Second = 0.0


def designed(rig: Rig, section: VelocitySection) -> dict[str, Any]:
    """Numbers of a velocity path: `frequency` [Hz], and its `observer` or the `read_scale` of its sensor."""
    if section.velocity == "observed":
        return {"frequency": rig.frequency, "observer": rig.observer(section)}
    return {"frequency": rig.frequency, "read_scale": rig.read_scale(section.sensor)}


class VelocityPath:
    """The path from one sensor to the velocity predicted by `compensation` [s]."""

    def __init__(self, section: VelocitySection, numbers: Numbers) -> None:
        self.period_ns = section.period
        period = section.period * 1e-9
        self.scale = float(numbers.get("read_scale", 1.0))
        self.observer: Observer | None = None
        ahead = section.compensation
        if section.velocity == "observed":
            if "observer" not in numbers:
                raise UsageError("velocity = 'observed' needs an observer from the design step, and it gave none")
            self.observer = Observer(numbers["observer"], ahead)
            ahead = 0.0
        self.smoothing = 1.0 if section.filter is None else -math.expm1(-2.0 * math.pi * section.filter * period)
        frequency = section.frequency if section.frequency is not None else numbers.get("frequency")
        self.lagging, self.direct, self.lagged = 1.0, 1.0, 0.0
        if frequency is not None:
            self.lagging, self.direct, self.lagged = lead(2.0 * math.pi * frequency, period, ahead)
        elif ahead > 0.0:
            raise UsageError("compensation: needs the frequency of the oscillation to predict a measured velocity")

    def start(self) -> PathState:
        """The state before the first sample."""
        return (), -1, 0.0, 0.0

    def update(self, state: PathState, t_ns: int, y: float) -> tuple[PathState, float]:
        """Next state, and velocity [m/s] from the sample y of time t_ns [ns]."""
        z, expected, smooth, lag = state
        if self.observer is None:
            v = self.scale * y
        else:
            if t_ns != expected or not z:
                late = (t_ns - expected) // self.period_ns
                z = self.observer.skip(z, late) if z and 0 < late <= GAP else self.observer.start(y)
            z, v = self.observer.update(z, y)
        if expected < 0:
            smooth = lag = v
        smooth += self.smoothing * (v - smooth)
        lag += self.lagging * (smooth - lag)
        return (z, t_ns + self.period_ns, smooth, lag), self.direct * smooth + self.lagged * lag

    @property
    def states(self) -> int:
        """Number of states of `linear`."""
        return (0 if self.observer is None else len(self.observer.start(0.0))) + 2

    def linear(self, xi: Sequence[float], y: float) -> tuple[Sequence[float], float]:
        """The linear form of `update`: the states after a sample, and the velocity."""
        (z, _, smooth, lag), v = self.update((tuple(xi[:-2]), 0, xi[-2], xi[-1]), 0, y)
        return [*z, smooth, lag], v


def lead(w: float, period: float, ahead: float) -> tuple[float, float, float]:
    """Constants b, p, r of the prediction by `ahead` [s] of an oscillation of w [rad/s], sampled every `period` [s]."""
    b = -math.expm1(-w * period)
    response = b / (1.0 - (1.0 - b) * cmath.exp(-1j * w * period))
    r = math.sin(w * ahead) / response.imag if ahead else 0.0
    return b, math.cos(w * ahead) - r * response.real, r
