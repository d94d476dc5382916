"""Tunes a shunt to the squeal: its inductance L follows the frequency that the vibrometer measures.

    L = ratio (1 + delta) / (C_ps (2 pi f)^2)

The frequency is the angular velocity of the complex band signal, averaged over `average`. It is used while the
amplitude is above `threshold` and held otherwise. L changes in relative steps of at least `step`, because each change
may build new matrices.
Source: Kroeger, Neubauer, Popp (2008), equation 4.18 solved for the inductance.
"""

from __future__ import annotations

import cmath
import math
from typing import Any, Literal, NamedTuple

from rig.controllers.blocks import base
from rig.controllers.blocks.design import Rig, sampling_numbers
from rig.controllers.blocks.resonator import Resonator
from rig.quantities import Hertz, PositiveMetrePerSecond, PositiveNumber, PositiveSecond, Second


class ShuntTuner(base.ControllerSection):
    """Parameters; `ratio`: L over the inductance that resonates at the tracked frequency."""

    kind: Literal["shunt_tuner"]
    sensor: str
    frequency: Hertz
    bandwidth: Hertz = 200.0
    threshold: PositiveMetrePerSecond = 0.002
    average: PositiveSecond = 0.02
    step: base.Fraction = 0.002
    ratio: PositiveNumber = 1.0
    enable_at: Second = 0.0
    drive: str = "shunt.inductance"


class Track(NamedTuple):
    """The state: band signal, its averaged rotation from sample to sample, inductance in force [H]."""

    z: complex = 0j
    turned: complex = 0j
    inductance: float = 0.0


class FrequencyTuner(base.SceneController[ShuntTuner]):
    """The controller; it reads every sample of its sensor and commands the inductance."""

    every_sample = True

    def __init__(self, section: ShuntTuner, numbers: base.Numbers) -> None:
        base.require(numbers, ("sample_period", "capacitance", "delta"))
        super().__init__(section, numbers)
        self.band = Resonator(section.frequency, section.bandwidth, float(numbers["sample_period"]))
        self.keep = math.exp(-section.period * 1e-9 / section.average)
        self.enable_ns = round(section.enable_at * 1e9)
        self.scale = section.ratio * (1.0 + float(numbers["delta"])) / float(numbers["capacitance"])

    @staticmethod
    def design(rig: Rig, section: ShuntTuner) -> dict[str, Any]:
        """Numbers: sample period of the sensor, capacitance of the stack, delta and inductance of the shunt."""
        keys = {"capacitance": "piezo.capacitance", "delta": "shunt.delta", "inductance": "shunt.inductance"}
        numbers = {name: rig.value(key) for name, key in keys.items()}
        if numbers["capacitance"] is None or numbers["delta"] is None:
            raise ValueError('kind: tunes a shunt of kind "series" on a piezo stack, and the scene has none')
        return sampling_numbers(rig, section) | numbers

    def start(self) -> Track:
        """The state with the inductance of the scene, or that for the stated frequency."""
        return Track(inductance=float(self.numbers.get("inductance", self.tuned(self.section.frequency))))

    def tuned(self, frequency: float) -> float:
        """The inductance [H] for a frequency [Hz]."""
        return float(self.scale / (2.0 * math.pi * frequency) ** 2)

    def update(self, state: Track, t_ns: int, values: base.Samples) -> tuple[Track, base.Values]:
        """The inductance [H] after the samples of one frame."""
        z, square, turned = self.band.run(state.z, values[0])
        inductance = state.inductance
        if t_ns >= self.enable_ns and square > self.section.threshold**2:
            turned = self.keep * state.turned + turned
            frequency = cmath.phase(turned) / (2.0 * math.pi * self.band.period)
            wanted = self.tuned(frequency) if frequency > 0.0 else inductance
            if abs(wanted - inductance) > self.section.step * inductance:
                inductance = wanted
        else:
            turned = state.turned
        return Track(z, turned, inductance), (inductance,)
