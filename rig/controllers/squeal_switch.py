"""Connects a shunt when the brake squeals.

The controller evaluates the RMS of the vibration in a narrow band over one frame. A value above `threshold` for
`confirm` without a gap counts as squeal, and the shunt is connected for `hold`. Then it is opened, to check whether the
brake still squeals without it; the next decision follows after `rest` at the earliest. Without `hold` it stays
connected.
Source: Kroeger, Neubauer, Popp (2008), section 4, where the shunt is switched manually; the rule is chosen here.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from rig.controllers.blocks import base
from rig.controllers.blocks.design import Rig, sampling_numbers
from rig.controllers.blocks.resonator import Resonator
from rig.errors import UsageError
from rig.quantities import Hertz, PositiveMetrePerSecond, Second


class SquealSwitch(base.ControllerSection):
    """Parameters; `threshold`: amplitude of the pad's velocity [m/s]."""

    kind: Literal["squeal_switch"]
    sensor: str
    frequency: Hertz
    bandwidth: Hertz = 200.0
    threshold: PositiveMetrePerSecond = 0.005
    confirm: Second = 0.005
    hold: base.OptionalSecond = None
    rest: Second = 0.1
    drive: str = "shunt.connected"


class Watch(NamedTuple):
    """The state: band signal, time since which it is above the threshold (-1: below), last change, command."""

    z: complex = 0j
    loud_ns: int = -1
    changed_ns: int = -1
    connected: bool = False


class SquealWatch(base.SceneController[SquealSwitch]):
    """The controller; it reads every sample of its sensor and commands the switch of the shunt."""

    every_sample = True

    def __init__(self, section: SquealSwitch, numbers: base.Numbers) -> None:
        if "sample_period" not in numbers:
            raise UsageError("sensor: the design step gives no sample period for it")
        super().__init__(section, numbers)
        self.band = Resonator(section.frequency, section.bandwidth, float(numbers["sample_period"]))
        self.square = section.threshold**2
        self.confirm_ns = round(section.confirm * 1e9)
        self.rest_ns = round(section.rest * 1e9)
        self.hold_ns = None if section.hold is None else round(section.hold * 1e9)

    @staticmethod
    def design(rig: Rig, section: SquealSwitch) -> dict[str, Any]:
        """Numbers: sample period of the sensor."""
        return sampling_numbers(rig, section)

    def start(self) -> Watch:
        """The state before the first sample: open."""
        return Watch()

    def update(self, state: Watch, t_ns: int, values: base.Samples) -> tuple[Watch, base.Values]:
        """The command: 1 (connected) after squeal was detected, otherwise 0."""
        z, square, _ = self.band.run(state.z, values[0])
        loud = -1
        if square > self.square:
            loud = t_ns if state.loud_ns < 0 else state.loud_ns
        connected = state.connected
        changed = state.changed_ns
        if connected:
            if self.hold_ns is not None and t_ns - changed >= self.hold_ns:
                connected = False
                changed = t_ns
                loud = -1
        elif loud >= 0 and t_ns - loud >= self.confirm_ns and (changed < 0 or t_ns - changed >= self.rest_ns):
            connected = True
            changed = t_ns
        return Watch(z, loud, changed, connected), (1.0 if connected else 0.0,)
