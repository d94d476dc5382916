"""A stream: a channel that a board or a data acquisition measures on a real rig, in a paced run (docs/device.md).

The board sends its values on its own. A run takes the newest one at each tick and records it beside the measurements of
the simulated instruments. A second sensor, NAME_age, has the time since the last value arrived.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from rig.machine.board import BAUD, MOST, Address, Baud, PortName
from rig.quantities import PositiveSecond
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.chain.instrument import Instrument

AGE = 0
"""The channel with the time since the last value arrived [s]."""


class Stream(Instrument):
    """A measured channel, in the SI unit that it `delivers`.

    reads     the output of the simulated rig that it takes the place of
    port      "serial:/dev/ttyACM1" or "udp:192.168.7.3:5007": the board sends from this port number to the next one
    channel   place of the value in a frame, from 1; a frame has as many values as its port has streams
    baud      rate of a serial port [chosen]
    patience  time without a value after which the stream counts as lost [chosen]
    rate      1 kHz: a sample in each frame of 1 ms; with other frames one sample per frame, or fewer
    """

    given: ClassVar[bool] = True

    kind: Literal["stream"] = "stream"
    delivers: str = Field(min_length=1)  # type: ignore[misc]
    reads: str = Field(min_length=1)
    port: PortName
    channel: int = Field(default=1, ge=AGE, le=MOST)
    baud: Baud = BAUD
    patience: PositiveSecond = 0.05

    @model_validator(mode="after")
    def _as_it_is(self) -> Stream:
        if self.delay or self.gain_error or self.ideal:
            raise ValueError("a stream is what a real sensor measures; leave out delay, gain_error and ideal")
        return self

    @property
    def address(self) -> Address:
        """Where the board is."""
        return Address.read(self.port)

    @property
    def reads_unit(self) -> str:
        """See `Instrument.reads_unit`: the unit of the channel; "" for the age, which has another one."""
        return "" if self.channel == AGE else self.delivers

    @property
    def conversion(self) -> float | None:
        """See `Instrument.conversion`; the age of a value is no measure of what is read."""
        return None if self.channel == AGE else 1.0

    def flawed(self) -> FrontEnd:
        """A perfect front end, for the design of controllers."""
        return FrontEnd(self.instants)


def with_ages(sensors: Mapping[str, Any]) -> dict[str, Any]:
    """The sensors, and behind each stream the one with the age of its values, unless there is one of this name."""
    every = dict[str, Any]()
    for name, section in sensors.items():
        every[name] = section
        age = f"{name}_age"
        if isinstance(section, Stream) and section.channel != AGE and age not in sensors:
            every[age] = section.model_copy(update={"channel": AGE, "delivers": "s"})
    return every


def streams(sensors: Mapping[str, Any]) -> dict[str, Stream]:
    """The streams among the sensors, their ages included."""
    return {name: section for name, section in sensors.items() if isinstance(section, Stream)}
