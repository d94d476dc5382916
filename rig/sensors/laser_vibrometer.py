"""Laser Doppler vibrometer, velocity output: Bessel filter, range, noise, speckle drop-outs, slew limit."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from pydantic import ValidationInfo, field_validator

from rig.quantities import Hertz, MetrePerSecond, PositiveMetrePerSecond, Second
from rig.sensors.chain import filters
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instrument import SPANNED, Instrument
from rig.sensors.chain.units import AccelerationSpan, PerSecond, SpeedDensity, SpeedStep


class LaserVibrometer(Instrument):
    """Velocity of the illuminated point along the beam [m/s].

    bandwidth   -3 dB of a third-order Bessel low-pass [public: Polytec OFV-3001/511 manual p36, phase -100 deg and
                amplitude -3 dB at f_c]; 5 kHz is the setting [calibrated]
    span        +-1.25 m/s: 125 mm/s/V, the finest range that reads DC [public: OFV-3001], on +-10 V [calibrated]
    noise       1 um/s/sqrt(Hz): upper end of .1 to 1 [public: PSV-500-3D p66], for a bare disc [calibrated]
    resolution  38 um/s: 16 bit over the span [calibrated]
    slew        160 g, the limit at 5 mm/s full scale and 50 kHz [public: PSV-500-3D p66]; taken for this range
                [calibrated]. A sample changes at most by slew times period
    dropout_rate     30 1/s = v/d p with v = .06 m/s, speckle of d = 40 um, p = .02 [calibrated]; Poisson
    dropout_shortest, dropout_longest   10 and 100 us, uniform between [calibrated]
    dropout     "hold" repeats the last sample (tracking filter on), "zero" reads 0 [calibrated; that drop-outs pull
                to zero is public: "global noise characteristics of a LDV", abstract]
    gain_error  up to +-1 % by the data sheet [public]
    """

    delivers: ClassVar[str] = "m/s"
    accepts: ClassVar[str] = "m/s"
    perfect: ClassVar[dict[str, Any]] = SPANNED | {"bandwidth": math.inf, "slew": math.inf, "dropout_rate": 0.0}
    part_of: ClassVar[dict[str, str]] = dict.fromkeys(
        ("dropout", "dropout_shortest", "dropout_longest"), "dropout_rate"
    )

    kind: Literal["laser_vibrometer"] = "laser_vibrometer"
    reads: str = "velocity"
    bandwidth: Hertz = 5000.0
    span: PositiveMetrePerSecond = 1.25
    resolution: SpeedStep = 38e-6
    noise: SpeedDensity = 1e-6
    offset: MetrePerSecond = 0.0
    slew: AccelerationSpan = 1569.0
    dropout: Literal["hold", "zero"] = "hold"
    dropout_rate: PerSecond = 30.0
    dropout_shortest: Second = 10e-6
    dropout_longest: Second = 100e-6

    @field_validator("dropout_longest")
    @classmethod
    def _not_below_the_shortest(cls, longest: float, info: ValidationInfo) -> float:
        shortest = info.data.get("dropout_shortest", 0.0)
        if longest < shortest:
            raise ValueError(f"is {longest:g} s; expected at least dropout_shortest = {shortest:g} s")
        return longest

    def flawed(self) -> FrontEnd:
        """The front end: Bessel filter, drop-outs, slew limit."""
        return self.spanned(
            filters.bessel(self.bandwidth),
            self.offset,
            self.span,
            self.resolution,
            self.noise,
            slew=self.slew,
            dropout_rate=self.dropout_rate,
            dropout_shortest=self.dropout_shortest,
            dropout_longest=self.dropout_longest,
            holds=self.dropout == "hold",
        )
