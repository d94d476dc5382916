"""Piezo force transducer under the load: low-pass of its mounting and amplifier, charge drift."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from rig.quantities import Hertz, Newton
from rig.sensors.chain import filters
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instrument import SPANNED, Instrument
from rig.sensors.chain.units import ForceDensity, ForceRate, ForceSpan, ForceStep, Quality


class NormalForce(Instrument):
    """Normal force [N].

    bandwidth, quality   2 kHz, .707: lower end of mounted resonances of 2 to 6 kHz, damped by the amplifier
                [calibrated, from memory]
    span        +-100 N: amplifier setting [calibrated]
    noise       2e-4 N/sqrt(Hz): .01 N rms over the bandwidth [calibrated, from memory]
    resolution  3.1 mN: 16 bit over the span [calibrated]
    drift       5 mN/s, linear: .05 pC/s at 11 pC/N, the worst the data sheet allows [calibrated, from memory]
    """

    delivers: ClassVar[str] = "N"
    accepts: ClassVar[str] = "N"
    perfect: ClassVar[dict[str, Any]] = SPANNED | {"bandwidth": math.inf, "drift": 0.0}
    part_of: ClassVar[dict[str, str]] = {"quality": "bandwidth"}

    kind: Literal["normal_force"] = "normal_force"
    reads: str = "normal_force"
    bandwidth: Hertz = 2000.0
    quality: Quality = 0.7071067811865476
    span: ForceSpan = 100.0
    resolution: ForceStep = 3.1e-3
    noise: ForceDensity = 2e-4
    offset: Newton = 0.0
    drift: ForceRate = 5e-3

    def flawed(self) -> FrontEnd:
        """The front end: low-pass and linear drift."""
        modal = filters.second_order(self.bandwidth, self.quality)
        return self.spanned(modal, self.offset, self.span, self.resolution, self.noise, slope=self.drift)
