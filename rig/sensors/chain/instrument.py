"""The base class of all instruments: what they read, sample rate, delay, and the flaws that an ideal one lacks."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, Self

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from rig.quantities import Section
from rig.sensors.chain.filters import Modal
from rig.sensors.chain.front_end import FrontEnd, deviation
from rig.sensors.chain.instants import Instants
from rig.sensors.chain.units import Delay, GainError, Rate


class Instrument(Section):
    """An instrument on the rig. Subclasses add their parameters and return a `FrontEnd`.

    rate     1 kHz [calibrated]: the rate of the loop; 25 and 100 Hz are those of a slow acquisition card
             [public: LabJack U12, at most 25 Hz in a command/response loop]. Any rate from 1 Hz to 100 kHz: sample k is
             taken at k / rate, to the nearest nanosecond
    delay    0 [calibrated]: transport and conversion in addition to the lag of the filter
    gain_error, offset   0 [calibrated]: a specimen after calibration

    With `ideal`, a flaw that is not stated is absent: it takes its value from `perfect`. A stated flaw applies, with
    the defaults of the keys that are `part_of` it; one of these keys without its flaw raises ValueError.
    """

    delivers: ClassVar[str]  # unit of the measurement
    accepts: ClassVar[str]  # unit of what is read
    perfect: ClassVar[dict[str, Any]] = {"delay": 0, "gain_error": 0.0, "offset": 0.0}  # flaw -> value without it
    part_of: ClassVar[dict[str, str]] = {}  # key -> the flaw of which it is a detail

    given: ClassVar[bool] = False  # whether a run gives it its samples, measured on a real rig

    reads: str = Field(min_length=1)
    rate: Rate = 1000.0
    delay: Delay = 0
    gain_error: GainError = 0.0
    ideal: bool = False

    @model_validator(mode="after")
    def _whole_flaws(self) -> Self:
        stated = self.model_fields_set
        alone = [(key, flaw) for key, flaw in self.part_of.items() if key in stated and flaw not in stated]
        if self.ideal and alone:
            text = "; ".join(f"{key} describes {flaw}, which is not stated" for key, flaw in alone)
            raise ValueError(f"ideal = true: {text}. State it too, or leave out {', '.join(key for key, _ in alone)}")
        return self

    @model_serializer(mode="wrap")
    def _as_stated(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The fields without the flaws that an ideal instrument lacks, so that reading them gives an equal one."""
        absent = (self.perfect.keys() | self.part_of.keys()) - self.model_fields_set if self.ideal else set()
        return {key: value for key, value in plain(self).items() if key not in absent}

    @property
    def unit(self) -> str:
        """Unit of the measurement."""
        return self.delivers

    @property
    def reads_unit(self) -> str:
        """Unit that the plant's output `reads` must have."""
        return self.accepts

    @property
    def instants(self) -> Instants:
        """The sample instants."""
        return Instants.of(self.rate)

    @property
    def period_ns(self) -> int:
        """Sample period, to the nearest whole nanosecond [ns]."""
        return round(self.instants.period_ns)

    @property
    def sensitivity(self) -> float:
        """Output per input of a specimen without gain error."""
        return 1.0

    @property
    def conversion(self) -> float | None:
        """Factor from a measurement to the quantity that it reads; None if it is not proportional to this quantity."""
        return 1.0 / self.sensitivity if self.sensitivity else None

    @property
    def gain(self) -> float:
        """Output per input of this specimen."""
        return float(self.sensitivity * (1.0 + self.gain_error))

    @abstractmethod
    def flawed(self) -> FrontEnd:
        """The front end with all its flaws."""

    def spanned(
        self, modal: Modal, offset: float, span: float, resolution: float, density: float, **more: Any
    ) -> FrontEnd:
        """A front end with this filter, which saturates at +-`span`, and white noise of this density [unit/sqrt(Hz)].

        Delay and gain are those of the instrument. `more`: further fields of the front end, or others of these.
        """
        common = {"delay_ns": self.delay, "gain": self.gain, "noise": deviation(density, self.rate)}
        limits = {"offset": offset, "low": -span, "high": span, "resolution": resolution}
        return FrontEnd(self.instants, **modal._asdict() | common | limits | more)

    def front_end(self) -> FrontEnd:
        """The front end that the bank runs: with all flaws, or with `ideal` only with those that are stated."""
        if not self.ideal:
            return self.flawed()
        absent = {key: value for key, value in self.perfect.items() if key not in self.model_fields_set}
        return self.model_copy(update=absent).flawed()


SPANNED = Instrument.perfect | {"span": math.inf, "resolution": 0.0, "noise": 0.0}
"""`perfect` of an instrument with a span, a resolution and noise."""
