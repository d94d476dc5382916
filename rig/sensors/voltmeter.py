"""Voltmeter: the voltage of a piezo stack through a divider and an amplifier."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from rig.quantities import Hertz, PositiveVolt, Volt
from rig.sensors.chain import filters
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instrument import SPANNED, Instrument
from rig.sensors.chain.units import Voltage, VoltageDensity


class Voltmeter(Instrument):
    """Voltage of the electrodes [V]; its divider of 100 Mohm is negligible compared with the leak of a stack.

    bandwidth   100 kHz, second order, Butterworth [calibrated]
    span        +-100 V: a divider 10 to 1 in front of +-10 V [calibrated]
    noise       1e-6 V/sqrt(Hz) before the divider [calibrated]
    resolution  3.1 mV: 16 bit over the span [calibrated]
    """

    delivers: ClassVar[str] = "V"
    accepts: ClassVar[str] = "V"
    perfect: ClassVar[dict[str, Any]] = SPANNED | {"bandwidth": math.inf}

    kind: Literal["voltmeter"] = "voltmeter"
    reads: str = "stack_voltage"
    bandwidth: Hertz = 100e3
    span: PositiveVolt = 100.0
    resolution: Voltage = 3.1e-3
    noise: VoltageDensity = 1e-6
    offset: Volt = 0.0

    def flawed(self) -> FrontEnd:
        """The front end: second-order low-pass."""
        modal = filters.second_order(self.bandwidth, math.sqrt(0.5))
        return self.spanned(modal, self.offset, self.span, self.resolution, self.noise)
