"""Piezo accelerometer: mounted resonance, high-pass of the charge amplifier, warming."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from rig.quantities import Hertz, PositiveSecond
from rig.sensors.chain import filters, units
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instrument import SPANNED, Instrument


class Accelerometer(Instrument):
    """Acceleration of the point on which it is mounted [m/s^2], without frequencies below the high-pass.

    resonance   40 kHz [public: B&K 4391]
    quality     30 [calibrated]
    highpass    0.1 Hz, first order [public: B&K 4391, from 0.1 Hz]
    span        +-100 m/s^2: setting of the charge amplifier [calibrated]; the pickup withstands 20000 m/s^2 [public]
    noise       7e-5 m/s^2/sqrt(Hz): 10 mm/s^2 rms over 1 Hz to 22 kHz [calibrated, from memory]
    resolution  3.1 mm/s^2: 16 bit over the span [calibrated]
    temperature_sensitivity   .2 m/s^2 per K [public: B&K 4391]
    warming, warm_up   1 K with a time constant of 300 s [calibrated]; the output of the high-pass is
                sensitivity warming b/(w_h - b) (e^{-b t} - e^{-w_h t}),  b = 1/warm_up, w_h = 2 pi highpass
    """

    delivers: ClassVar[str] = "m/s^2"
    accepts: ClassVar[str] = "m/s^2"
    perfect: ClassVar[dict[str, Any]] = SPANNED | {
        "resonance": math.inf,
        "highpass": 0.0,
        "temperature_sensitivity": 0.0,
    }
    part_of: ClassVar[dict[str, str]] = {
        "quality": "resonance",
        "warming": "temperature_sensitivity",
        "warm_up": "temperature_sensitivity",
    }

    kind: Literal["accelerometer"] = "accelerometer"
    reads: str = "acceleration"
    resonance: Hertz = 40e3
    quality: units.Quality = 30.0
    highpass: Hertz = 0.1
    span: units.AccelerationSpan = 100.0
    resolution: units.AccelerationStep = 3.1e-3
    noise: units.AccelerationDensity = 7e-5
    offset: units.Acceleration = 0.0
    temperature_sensitivity: units.AccelerationPerKelvin = 0.2
    warming: units.Kelvin = 1.0
    warm_up: PositiveSecond = 300.0

    def flawed(self) -> FrontEnd:
        """The front end: high-pass, resonance, and the drift due to warming."""
        corner = 2.0 * math.pi * self.highpass
        b = 1.0 / self.warm_up
        if math.isclose(corner, b, rel_tol=1e-6):  # the limit is a double pole; this is within 1e-6 of it
            b *= 1.0 - 1e-6
        modal = filters.resonance(self.resonance, self.quality, self.highpass)
        warmth = self.temperature_sensitivity * self.warming * b / (corner - b)
        drift = {"warmth": warmth, "fade": b, "rise": corner}
        return self.spanned(modal, self.offset, self.span, self.resolution, self.noise, **drift)
