"""Microphone in a room: the sound of a vibrating surface with its delay, its echoes and the noise of the laboratory."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from rig.quantities import Hertz, PositiveMetre, PositiveMetrePerSecond
from rig.sensors.chain import filters, units
from rig.sensors.chain.front_end import FrontEnd, deviation
from rig.sensors.chain.instrument import SPANNED, Instrument


class Microphone(Instrument):
    """Sound pressure [Pa] at `distance` [m] from a surface; it reads the surface's velocity.

    radiation    11 Pa per m/s at that distance: 2 Pa at the pad speed of a squealing brake [calibrated to figure 29]
    distance     0.5 m: 1.46 ms [paper: Kroeger, Neubauer, Popp (2008), section 4d]
    sound_speed  343 m/s [public: air at 20 degrees Celsius]
    paths, reflection  echoes with paths of 1.4, 2.6 and 4.1 m; each attenuated by its length and by 0.5, delayed to
                 the nearest sample [calibrated]
    resonance, quality, highpass  23 kHz, 0.7, 4 Hz [public: 1/2 inch, 6.3 Hz to 20 kHz within 2 dB]
    noise        7.8e-7 Pa/sqrt(Hz): 15 dB(A) [calibrated, from memory]
    background   0.03 Pa rms from 0 to half the sample rate: the motor [calibrated: not stated in the text of the paper]
    span         +-400 Pa, 146 dB [calibrated, from memory]
    resolution   4.8e-5 Pa: 24 bit over the span [calibrated]
    """

    delivers: ClassVar[str] = "Pa"
    accepts: ClassVar[str] = "m/s"
    perfect: ClassVar[dict[str, Any]] = SPANNED | {
        "distance": 0.0,
        "paths": (),
        "resonance": math.inf,
        "highpass": 0.0,
        "background": 0.0,
    }
    part_of: ClassVar[dict[str, str]] = {
        "sound_speed": "distance",
        "paths": "distance",
        "reflection": "paths",
        "quality": "resonance",
    }

    kind: Literal["microphone"] = "microphone"
    reads: str = "velocity"
    radiation: units.PressurePerSpeed = 11.0
    distance: PositiveMetre = 0.5
    sound_speed: PositiveMetrePerSecond = 343.0
    paths: units.Paths = (1.4, 2.6, 4.1)
    reflection: units.Share = 0.5
    resonance: Hertz = 23e3
    quality: units.Quality = 0.7
    highpass: Hertz = 4.0
    noise: units.PressureDensity = 7.8e-7
    background: units.Pressure = 0.03
    offset: units.PressureOffset = 0.0
    span: units.PressureSpan = 400.0
    resolution: units.Pressure = 4.8e-5

    @model_validator(mode="after")
    def _longer(self) -> Self:
        short = [f"{path:g} m" for path in self.paths if path <= self.distance]
        if short:
            raise ValueError(f"paths: {', '.join(short)} no longer than the direct way of {self.distance:g} m")
        return self

    @property
    def sensitivity(self) -> float:
        """Sound pressure per velocity [Pa s/m]."""
        return float(self.radiation)

    @property
    def conversion(self) -> None:
        """None: the sound arrives late, with its echoes."""

    def flawed(self) -> FrontEnd:
        """The front end: delay of the sound path, diaphragm and vent, echoes as delayed and attenuated copies."""
        echoes = tuple(
            (self.reflection * self.distance / path, (path - self.distance) / self.sound_speed) for path in self.paths
        )
        return self.spanned(
            filters.resonance(self.resonance, self.quality, self.highpass),
            self.offset,
            self.span,
            self.resolution,
            0.0,
            noise=math.hypot(deviation(self.noise, self.rate), self.background),
            delay_ns=self.delay + round(1e9 * self.distance / self.sound_speed),
            echoes=echoes,
        )
