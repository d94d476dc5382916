"""Laser triangulation sensor: the mean displacement over one sample period, delayed by some samples."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from pydantic import Field

from rig.quantities import Metre, PositiveMetre
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instrument import Instrument
from rig.sensors.chain.units import Length


class DisplacementLaser(Instrument):
    """Displacement of the spot [m]: exposure over the whole sample period, then processing.

    span        +-10 mm: measuring range 20 mm [public: optoNCDT 1700-20]; its rates: 312.5 Hz to 2.5 kHz [public]
    processing  1 sample [calibrated: 1 to 2 are usual]; `delay` is added
    noise       standard deviation of one sample, white: 1.5 um [public: optoNCDT 1700-20, resolution at 2.5 kHz]
    resolution  1.5 um [public: the same]
    gain_error  linearity .08 % of the range by the data sheet [public: optoNCDT 1402]
    """

    delivers: ClassVar[str] = "m"
    accepts: ClassVar[str] = "m"
    perfect: ClassVar[dict[str, Any]] = Instrument.perfect | {
        "processing": 0,
        "span": math.inf,
        "resolution": 0.0,
        "noise": 0.0,
    }

    kind: Literal["displacement_laser"] = "displacement_laser"
    reads: str = "displacement"
    processing: int = Field(default=1, ge=0, le=10)
    span: PositiveMetre = 10e-3
    resolution: Length = 1.5e-6
    noise: Length = 1.5e-6
    offset: Metre = 0.0

    def flawed(self) -> FrontEnd:
        """The front end: mean over a period, published after the processing; an ideal one does not average."""
        return FrontEnd(
            self.instants,
            self.delay + round(self.processing * self.instants.period_ns),
            direct=1.0 if self.ideal else 0.0,
            averages=not self.ideal,
            gain=self.gain,
            offset=self.offset,
            noise=self.noise,
            low=-self.span,
            high=self.span,
            resolution=self.resolution,
        )
