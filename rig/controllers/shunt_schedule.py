"""A shunt that is connected and disconnected at stated times, to show its effect.

Source: Kroeger, Neubauer, Popp (2008), figure 29: the shunt of a squealing brake switched every ten seconds.
"""

from __future__ import annotations

from typing import Literal

from rig.controllers.blocks.base import ControllerSection, Numbers, SceneController, Values
from rig.quantities import PositiveSecond, Second


class ShuntSchedule(ControllerSection):
    """Parameters: from `begin` [s] on, alternately connected for `connected_for` [s] and open for `open_for` [s]."""

    kind: Literal["shunt_schedule"]
    begin: Second = 0.0
    connected_for: PositiveSecond = 10.0
    open_for: PositiveSecond = 10.0
    drive: str = "shunt.connected"


class ShuntClock(SceneController[ShuntSchedule]):
    """The controller; it has no sensor and no state."""

    reads = ()

    def __init__(self, section: ShuntSchedule, numbers: Numbers) -> None:
        super().__init__(section, numbers)
        self.begin_ns = round(section.begin * 1e9)
        self.on_ns = round(section.connected_for * 1e9)
        self.round_ns = self.on_ns + round(section.open_for * 1e9)

    def start(self) -> tuple[()]:
        """The empty state."""
        return ()

    def update(self, state: tuple[()], t_ns: int, values: Values) -> tuple[tuple[()], Values]:
        """The command: 1 connected, 0 open."""
        since = t_ns - self.begin_ns
        return state, (1.0 if since >= 0 and since % self.round_ns < self.on_ns else 0.0,)
