"""What all instruments declare: what they read, how often, how late."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from pydantic import Field

from rig.quantities import Section
from sensors.front_end import FrontEnd
from sensors.units import SECOND, Delay, GainError, Rate


class Instrument(Section):
    """An instrument on the rig. Subclasses add their numbers and compile to a `FrontEnd`.

    rate     1 kHz [calibrated]: the rate of the loop; 25 and 100 Hz are those of a slow acquisition card
             [public: LabJack U12, at most 25 Hz in a command/response loop]
    delay    0 [calibrated]: transport and conversion beside the lag of the filter
    gain_error, offset   0 [calibrated]: a specimen after calibration
    """

    delivers: ClassVar[str]  # unit of the measurement
    accepts: ClassVar[str]  # unit of what is read

    reads: str = Field(min_length=1)
    rate: Rate = 1000.0
    delay: Delay = 0
    gain_error: GainError = 0.0
    ideal: bool = False

    @property
    def unit(self) -> str:
        """Unit of the measurement."""
        return self.delivers

    @property
    def reads_unit(self) -> str:
        """Unit that the plant's output `reads` must have."""
        return self.accepts

    @property
    def period_ns(self) -> int:
        """Sample period [ns]."""
        return round(SECOND / self.rate)

    @property
    def sensitivity(self) -> float:
        """Output per input of a perfect specimen."""
        return 1.0

    @property
    def gain(self) -> float:
        """Output per input of this specimen."""
        return float(self.sensitivity * (1.0 + self.gain_error))

    @abstractmethod
    def flawed(self) -> FrontEnd:
        """The front end with all its flaws."""

    def front_end(self) -> FrontEnd:
        """What the bank runs: with `ideal` the value at the sample instant and nothing else."""
        return FrontEnd(self.period_ns, gain=self.sensitivity) if self.ideal else self.flawed()
