"""A coil with a low-pass."""

from typing import Any, ClassVar

from rig.quantities import Hertz, Volt, quantity
from rig.sensors.chain import filters
from rig.sensors.chain.front_end import FrontEnd, deviation
from rig.sensors.chain.instrument import Instrument


class Coil(Instrument):
    """Voltage of the coil [V].

    gain_at   10 V per m/s [chosen]
    corner    200 Hz [chosen]
    """

    delivers: ClassVar[str] = "V"
    accepts: ClassVar[str] = "m/s"
    perfect: ClassVar[dict[str, Any]] = Instrument.perfect | {"corner": float("inf"), "noise": 0.0}

    reads: str = "v_left"
    gain_at: quantity("V*s/m") = 10.0
    corner: Hertz = 200.0
    noise: quantity("V/Hz^0.5") = 1e-7
    offset: Volt = 0.0

    @property
    def sensitivity(self):
        """Output per input."""
        return self.gain_at

    def flawed(self):
        """A low-pass of first order."""
        return FrontEnd(
            self.instants,
            self.delay,
            *filters.first_order(self.corner),
            gain=self.gain,
            offset=self.offset,
            noise=deviation(self.noise, self.rate),
        )
