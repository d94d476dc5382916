"""Speed pickup on the drive: a toothed wheel and a frequency-to-voltage converter."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from rig.quantities import Hertz, PositiveMetre, RadianPerSecond
from rig.sensors.chain import filters
from rig.sensors.chain.front_end import FrontEnd, deviation
from rig.sensors.chain.instrument import SPANNED, Instrument
from rig.sensors.chain.units import TurnDensity, TurnSpan, TurnStep


class DiscSpeed(Instrument):
    """Speed of the disc [rad/s]; with `radius`, speed of a belt [m/s] on a roller of this radius.

    All values refer to the wheel; no data sheet is known.

    bandwidth   50 Hz, first order: smoothing of the converter [calibrated]
    span        +-30 rad/s [calibrated]
    resolution  1 mrad/s: 16 bit over the span [calibrated]
    noise       1e-4 rad/s/sqrt(Hz) [calibrated]
    """

    delivers: ClassVar[str] = "rad/s"
    accepts: ClassVar[str] = "rad/s"
    perfect: ClassVar[dict[str, Any]] = SPANNED | {"bandwidth": math.inf}

    kind: Literal["disc_speed"] = "disc_speed"
    reads: str = "disc_speed"
    radius: PositiveMetre | None = None
    bandwidth: Hertz = 50.0
    span: TurnSpan = 30.0
    resolution: TurnStep = 1e-3
    noise: TurnDensity = 1e-4
    offset: RadianPerSecond = 0.0

    @property
    def unit(self) -> str:
        """The unit in which the pickup is calibrated."""
        return "rad/s" if self.radius is None else "m/s"

    @property
    def reads_unit(self) -> str:
        """The unit of the output that it reads: m/s on the roller of a belt, rad/s on a disc."""
        return self.unit

    def flawed(self) -> FrontEnd:
        """The front end: low-pass; the values of the wheel are converted to its rim for a belt."""
        rim = 1.0 if self.radius is None else float(self.radius)
        modal = filters.first_order(self.bandwidth)
        noise = rim * deviation(self.noise, self.rate)
        return self.spanned(modal, rim * self.offset, rim * self.span, rim * self.resolution, 0.0, noise=noise)
