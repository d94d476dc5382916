"""Strain-gauge bridge with amplifier: it measures a force by the strain that the force causes."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from rig.quantities import Hertz, Number, PositiveSecond
from rig.sensors.chain import filters
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instrument import SPANNED, Instrument
from rig.sensors.chain.units import Kelvin, StrainDensity, StrainPerKelvin, StrainPerNewton, StrainSpan, StrainStep


class StrainGauge(Instrument):
    """Strain [1] of the flexure that carries a force, `strain_per_newton` per newton.

    strain_per_newton   20 um/m per N: 50 N at full scale [calibrated]
    bandwidth   1.6 kHz, second order, Butterworth: amplifier on a 4.8 kHz carrier [calibrated, from memory]
    span        +-1000 um/m: +-2 mV/V of a full bridge with gauge factor 2 [public: HBM bridge notes]
    noise       1.5e-9 1/sqrt(Hz): 350 ohm bridge and a 15 nV/sqrt(Hz) amplifier at 5 V, factor 2 [calibrated, derived]
    resolution  3.1e-8: 16 bit over the span [calibrated]
    zero_drift  1 um/m per K [public: HBK, quarter bridge]
    warming, warm_up   2 K with a time constant of 600 s [calibrated]:
                zero(t) = zero_drift warming (1 - e^{-t/warm_up})
    """

    delivers: ClassVar[str] = "1"
    accepts: ClassVar[str] = "N"
    perfect: ClassVar[dict[str, Any]] = SPANNED | {"bandwidth": math.inf, "zero_drift": 0.0}
    part_of: ClassVar[dict[str, str]] = {"warming": "zero_drift", "warm_up": "zero_drift"}

    kind: Literal["strain_gauge"] = "strain_gauge"
    reads: str = "friction_force"
    strain_per_newton: StrainPerNewton = 20e-6
    bandwidth: Hertz = 1600.0
    span: StrainSpan = 1000e-6
    resolution: StrainStep = 3.1e-8
    noise: StrainDensity = 1.5e-9
    offset: Number = 0.0
    zero_drift: StrainPerKelvin = 1e-6
    warming: Kelvin = 2.0
    warm_up: PositiveSecond = 600.0

    @property
    def sensitivity(self) -> float:
        """Strain per newton [1/N]."""
        return float(self.strain_per_newton)

    def flawed(self) -> FrontEnd:
        """The front end: amplifier and zero drift."""
        modal = filters.second_order(self.bandwidth, math.sqrt(0.5))
        drift = {"warmth": self.zero_drift * self.warming, "rise": 1.0 / self.warm_up}
        return self.spanned(modal, self.offset, self.span, self.resolution, self.noise, **drift)
