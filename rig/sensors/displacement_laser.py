"""Laser triangulation sensor: the mean displacement over one sample period, delayed by some samples."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field

from rig.quantities import Metre, PositiveMetre
from rig.sensors.chain import filters
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instrument import SPANNED, Instrument
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
    perfect: ClassVar[dict[str, Any]] = SPANNED | {"processing": 0}

    kind: Literal["displacement_laser"] = "displacement_laser"
    reads: str = "displacement"
    processing: int = Field(default=1, ge=0, le=10)
    span: PositiveMetre = 10e-3
    resolution: Length = 1.5e-6
    noise: Length = 1.5e-6
    offset: Metre = 0.0

    def flawed(self) -> FrontEnd:
        """The front end: mean over a period, published after the processing; an ideal one does not average."""
        return self.spanned(
            filters.PASS if self.ideal else filters.Modal(),
            self.offset,
            self.span,
            self.resolution,
            0.0,
            noise=self.noise,
            delay_ns=self.delay + round(self.processing * self.instants.period_ns),
            averages=not self.ideal,
        )
