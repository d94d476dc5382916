"""What a protocol asks of an experiment at a tick, one record for each kind of action."""

from __future__ import annotations

from typing import NamedTuple


class Apply(NamedTuple):
    """Set an actuator to a value at once."""

    name: str
    value: float


class Move(NamedTuple):
    """Move an actuator linearly to a value within a number of ticks; an `Apply` of that value follows at the end."""

    name: str
    to: float
    ticks: int


class Strike(NamedTuple):
    """Change the momentum of the body by an impulse [N s]: at once, or by a half sine of force [ns].

    A `Release` follows at the end of the half sine.
    """

    impulse: float
    duration_ns: int = 0


class Release(NamedTuple):
    """The hammer leaves the body."""


class Change(NamedTuple):
    """Change a parameter of the rig or of a controller ("controllers.<name>.<parameter>")."""

    key: str
    value: float


class Switch(NamedTuple):
    """Connect a controller to its actuators, or disconnect it."""

    controller: str
    on: bool


class Note(NamedTuple):
    """Record an event of the kind `step`, `mark` or `timeout`."""

    kind: str
    text: str


class Finish(NamedTuple):
    """End the run."""

    reason: str


Action = Apply | Move | Strike | Release | Change | Switch | Note | Finish
