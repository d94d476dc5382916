"""Dither as a sampled and held signal over the bus, which demonstrates the error of this approach.

    v_b = v0 + a sin(2 pi f t_k)      for t_k <= t < t_k + period

At 150 Hz and 1 kHz the held signal lags by half a period of the controller (27 degrees), loses 4 % of its amplitude
(its samples just before each command lag by a whole period, 54 degrees, and lose nothing),
contains images at 850 and 1150 Hz, and is distorted by every late command. The generator of the rig does not have these
errors: see `dither`.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, Literal, NamedTuple, Self

from pydantic import model_validator

from rig.controllers.blocks.base import ControllerSection, Numbers, OptionalSpeed, SceneController, Update, Values
from rig.controllers.blocks.design import Rig
from rig.errors import UsageError
from rig.quantities import Hertz, MetrePerSecond, PositiveMetrePerSecond, Second, Speed


class SampledDither(ControllerSection):
    """Parameters; `nominal` is the belt speed v0 at the contact, by default that of the scene."""

    kind: Literal["dither_sampled"]
    amplitude: Speed
    frequency: Hertz = 150.0
    nominal: OptionalSpeed = None
    lowest: MetrePerSecond = -1.0
    highest: PositiveMetrePerSecond = 1.0
    enable_at: Second = 0.0
    drive: str = "drive.speed"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.lowest >= self.highest:
            raise ValueError(f"highest = {self.highest:g} is not above lowest = {self.lowest:g}")
        return self


class Signal(NamedTuple):
    """The constants: nominal and amplitude [m/s], frequency [Hz], limits [m/s], command per unit of the speed."""

    enable_ns: int
    nominal: float
    amplitude: float
    frequency: float
    lowest: float
    highest: float
    scale: float


def law(p: Signal, state: tuple[()], t_ns: int, values: Values) -> tuple[tuple[()], Values]:
    """The surface speed of this sample [unit of the drive]."""
    v = p.nominal
    if t_ns >= p.enable_ns:
        turns = (t_ns - p.enable_ns) * 1e-9 * p.frequency
        v += p.amplitude * math.sin(2.0 * math.pi * (turns - math.floor(turns)))
    return state, (p.scale * min(max(v, p.lowest), p.highest),)


class SampledDitherSignal(SceneController[SampledDither]):
    """A sine of the simulated time; it has no sensor and no state."""

    reads = ()

    update: Update

    def __init__(self, section: SampledDither, numbers: Numbers) -> None:
        super().__init__(section, numbers)
        nominal = section.nominal if section.nominal is not None else numbers.get("nominal")
        if nominal is None:
            raise UsageError("nominal: is not stated, and the design step gives no number for it")
        levels = float(nominal), section.amplitude, section.frequency, section.lowest, section.highest
        scale = float(numbers.get("drive_scale", 1.0))
        self.update = partial(law, Signal(round(section.enable_at * 1e9), *levels, scale))

    @staticmethod
    def design(rig: Rig, section: SampledDither) -> dict[str, Any]:
        """The command per unit of the speed of the surface."""
        return dict(rig.commands_surface(section.drive))

    def start(self) -> tuple[()]:
        """The empty state."""
        return ()
