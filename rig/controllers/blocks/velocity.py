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
from typing import Any, ClassVar, Literal, NamedTuple

from rig.controllers.blocks.base import Ahead, ControllerSection, Numbers, OptionalForce, OptionalHertz
from rig.controllers.blocks.design import Rig
from rig.controllers.blocks.observer import Observer, observer
from rig.errors import UsageError
from rig.quantities import Second


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


class Path(NamedTuple):
    """The constants of a velocity path; `observer` is empty for a measured velocity."""

    period_ns: int
    scale: float
    smoothing: float
    lagging: float
    direct: float
    lagged: float
    observer: Observer | tuple[()]


def path(section: VelocitySection, numbers: Numbers) -> Path:
    """The path from one sensor to the velocity predicted by `compensation` [s]."""
    period = section.period * 1e-9
    observing: Observer | tuple[()] = ()
    ahead = section.compensation
    if section.velocity == "observed":
        if "observer" not in numbers:
            raise UsageError("velocity = 'observed' needs an observer from the design step, and it gave none")
        observing = observer(numbers["observer"], ahead)
        ahead = 0.0
    smoothing = 1.0 if section.filter is None else -math.expm1(-2.0 * math.pi * section.filter * period)
    frequency = section.frequency if section.frequency is not None else numbers.get("frequency")
    prediction = 1.0, 1.0, 0.0
    if frequency is not None:
        prediction = lead(2.0 * math.pi * frequency, period, ahead)
    elif ahead > 0.0:
        raise UsageError("compensation: needs the frequency of the oscillation to predict a measured velocity")
    scale = 1.0 if observing else float(numbers.get("read_scale", 1.0))
    return Path(section.period, scale, smoothing, *prediction, observing)


def lead(w: float, period: float, ahead: float) -> tuple[float, float, float]:
    """Constants b, p, r of the prediction by `ahead` [s] of an oscillation of w [rad/s], sampled every `period` [s]."""
    b = -math.expm1(-w * period)
    response = b / (1.0 - (1.0 - b) * cmath.exp(-1j * w * period))
    r = math.sin(w * ahead) / response.imag if ahead else 0.0
    return b, math.cos(w * ahead) - r * response.real, r
