"""A geophone: a coil on a soft spring around a magnet. Its voltage follows the velocity above its natural frequency.

Try it:   rig simulate docs/example_parts.toml --figure parts.png
"""

from typing import Any, ClassVar

from rig.quantities import Hertz, Volt, quantity
from rig.sensors.chain import filters
from rig.sensors.chain.front_end import FrontEnd, deviation
from rig.sensors.chain.instrument import Instrument


class Geophone(Instrument):
    """Voltage of the coil [V].

    sensitivity_at   28 V per m/s [public: a common 10 Hz element]
    lowest      first-order corner below which it does not follow, 1 Hz [chosen]
    bandwidth   240 Hz, of the amplifier, second order [chosen]
    noise       1e-7 V/sqrt(Hz) [calibrated]
    """

    delivers: ClassVar[str] = "V"
    accepts: ClassVar[str] = "m/s"
    perfect: ClassVar[dict[str, Any]] = Instrument.perfect | {"lowest": 0.0, "bandwidth": float("inf"), "noise": 0.0}

    reads: str = "velocity"
    sensitivity_at: quantity("V*s/m") = 28.0
    lowest: quantity("Hz") = 1.0
    bandwidth: Hertz = 240.0
    noise: quantity("V/Hz^0.5") = 1e-7
    offset: Volt = 0.0

    @property
    def sensitivity(self) -> float:
        """Output per input."""
        return self.sensitivity_at

    def flawed(self) -> FrontEnd:
        """High-pass of the suspension, low-pass of the amplifier."""
        return FrontEnd(
            self.instants,
            self.delay,
            *filters.resonance(self.bandwidth, 0.7, self.lowest),
            gain=self.gain,
            offset=self.offset,
            noise=deviation(self.noise, self.rate),
        )
