"""A shunt that is connected and disconnected at stated times, to show its effect.

Source: Kroeger, Neubauer, Popp (2008), figure 29: the shunt of a squealing brake switched every ten seconds.
"""

from __future__ import annotations

from functools import partial
from typing import Literal, NamedTuple

from rig.controllers.blocks.base import ControllerSection, Numbers, SceneController, Update, Values
from rig.quantities import PositiveSecond, Second


class ShuntSchedule(ControllerSection):
    """Parameters: from `begin` [s] on, alternately connected for `connected_for` [s] and open for `open_for` [s]."""

    kind: Literal["shunt_schedule"]
    begin: Second = 0.0
    connected_for: PositiveSecond = 10.0
    open_for: PositiveSecond = 10.0
    drive: str = "shunt.connected"


class Times(NamedTuple):
    """Begin, time for which it is connected, and length of a round [ns]."""

    begin_ns: int
    on_ns: int
    round_ns: int


def law(p: Times, state: tuple[()], t_ns: int, values: Values) -> tuple[tuple[()], Values]:
    """The command: 1 connected, 0 open."""
    since = t_ns - p.begin_ns
    return state, (1.0 if since >= 0 and since % p.round_ns < p.on_ns else 0.0,)


class ShuntClock(SceneController[ShuntSchedule]):
    """The controller; it has no sensor and no state."""

    reads = ()

    update: Update

    def __init__(self, section: ShuntSchedule, numbers: Numbers) -> None:
        super().__init__(section, numbers)
        on_ns = round(section.connected_for * 1e9)
        self.update = partial(law, Times(round(section.begin * 1e9), on_ns, on_ns + round(section.open_for * 1e9)))

    def start(self) -> tuple[()]:
        """The empty state."""
        return ()
