"""Connect the shunt when the brake squeals.

The vibration is watched in a narrow band: its root mean square over one frame. Above `threshold` for `confirm` without
a gap it is squeal, and the shunt is connected for `hold`; then it is opened again, to see whether the brake still
squeals without it, and at least `rest` passes before the next decision. A `hold` that is left out never opens again.
Source: Kroeger, Neubauer, Popp (2008), section 4, where the shunt is switched by hand; the rule is ours.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal, NamedTuple

from rig.controllers.blocks.base import ControllerSection, Numbers, OptionalSecond, Samples, Values
from rig.controllers.blocks.design import Rig, heard
from rig.controllers.blocks.resonator import Resonator
from rig.errors import UsageError
from rig.quantities import Hertz, PositiveMetrePerSecond, Second


class SquealSwitch(ControllerSection):
    """Parameters; `threshold` is an amplitude of the pad's velocity."""

    fixed: ClassVar[frozenset[str]] = ControllerSection.fixed | {"sensor", "drive"}

    kind: Literal["squeal_switch"]
    sensor: str
    frequency: Hertz
    bandwidth: Hertz = 200.0
    threshold: PositiveMetrePerSecond = 0.005
    confirm: Second = 0.005
    hold: OptionalSecond = None
    rest: Second = 0.1
    drive: str = "shunt.connected"


class Watch(NamedTuple):
    """What the switch remembers: the band, since when it is loud (-1: it is not), the last change, the command."""

    z: complex = 0j
    loud_ns: int = -1
    changed_ns: int = -1
    connected: bool = False


class SquealWatch:
    """Reads every sample of its sensor, drives the switch of the shunt."""

    every_sample = True

    def __init__(self, section: SquealSwitch, numbers: Numbers) -> None:
        if "sample_period" not in numbers:
            raise UsageError("sensor: the design step gives no sample period for it")
        self.section = section
        self.numbers = numbers
        self.reads = (section.sensor,)
        self.drives = (section.drive,)
        self.period_ns = section.period
        self.band = Resonator(section.frequency, section.bandwidth, float(numbers["sample_period"]))
        self.square = section.threshold**2
        self.confirm_ns = round(section.confirm * 1e9)
        self.rest_ns = round(section.rest * 1e9)
        self.hold_ns = None if section.hold is None else round(section.hold * 1e9)

    @staticmethod
    def design(rig: Rig, section: SquealSwitch) -> dict[str, Any]:
        """The sample period of its sensor."""
        return heard(rig, section)

    def start(self) -> Watch:
        """Before the first sample: open."""
        return Watch()

    def update(self, state: Watch, t_ns: int, values: Samples) -> tuple[Watch, Values]:
        """1 while squeal is being silenced, 0 while it is waited for."""
        z, square, _ = self.band.run(state.z, values[0])
        loud = (t_ns if state.loud_ns < 0 else state.loud_ns) if square > self.square else -1
        connected, changed = state.connected, state.changed_ns
        if connected:
            if self.hold_ns is not None and t_ns - changed >= self.hold_ns:
                connected, changed, loud = False, t_ns, -1
        elif loud >= 0 and t_ns - loud >= self.confirm_ns and (changed < 0 or t_ns - changed >= self.rest_ns):
            connected, changed = True, t_ns
        return Watch(z, loud, changed, connected), (1.0 if connected else 0.0,)
