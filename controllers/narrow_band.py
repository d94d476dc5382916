"""Damp one mode of the brake through the voltage of its stack: the pad's velocity in a narrow band, at the right phase.

    U = -gain Re(z exp(i phase))        z: the band of the measured velocity (`resonator`)        |U| <= limit

A force along the brake's axis that follows the velocity of the pad along its surface damps the squeal mode only at one
phase: near flutter the coupling is complex, so plain feedback of either sign mostly shifts the frequency, and without
the band it destabilises another mode. The design step finds phase and gain from the eigenvectors, the delay of the
loop and the instrument included; what is stated in the scene overrules it.
Source: Kroeger, Neubauer, Popp (2008), figure 21; phase and band are ours.
"""

from __future__ import annotations

import cmath
from typing import ClassVar, Literal

from controllers.base import ControllerSection, DecayRate, Numbers, OptionalAngle, OptionalGain, Values, Voltage
from controllers.resonator import Resonator
from rig.errors import UsageError
from rig.quantities import Hertz, Second


class NarrowBand(ControllerSection):
    """Parameters; `decay` is the rate at which the design lets the mode near `frequency` die away."""

    fixed: ClassVar[frozenset[str]] = ControllerSection.fixed | {"sensor", "drive", "decay"}

    kind: Literal["narrow_band"]
    sensor: str
    frequency: Hertz
    bandwidth: Hertz = 400.0
    decay: DecayRate = 150.0
    gain: OptionalGain = None
    phase: OptionalAngle = None
    limit: Voltage = 50.0
    enable_at: Second = 0.0
    drive: str = "amplifier.voltage"


class NarrowBandFeedback:
    """One sample in, one voltage out; the state is the band."""

    def __init__(self, section: NarrowBand, numbers: Numbers) -> None:
        self.section = section
        self.numbers = numbers
        gain = section.gain if section.gain is not None else numbers.get("gain")
        phase = section.phase if section.phase is not None else numbers.get("phase")
        if gain is None or phase is None:
            raise UsageError("gain, phase: are not stated, and the design step gives no numbers for them")
        self.reads = (section.sensor,)
        self.drives = (section.drive,)
        self.period_ns = section.period
        self.band = Resonator(section.frequency, section.bandwidth, section.period * 1e-9)
        self.factor = -gain * cmath.exp(1j * phase)
        self.enable_ns = round(section.enable_at * 1e9)

    def start(self) -> complex:
        """Before the first sample."""
        return 0j

    def update(self, state: complex, t_ns: int, values: Values) -> tuple[complex, Values]:
        """The band after one more sample, and the voltage [V]."""
        z = self.band.update(state, values[0])
        u, limit = (self.factor * z).real if t_ns >= self.enable_ns else 0.0, self.section.limit
        return z, (-limit if u < -limit else limit if u > limit else u,)
