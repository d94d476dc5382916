"""What an effect declares of itself, so that no other code has to name it.

An effect is a table that a plant may be without, or an optional value of a table that it always has:

    class TunedMass(Section):                                       # a table: of its class
        declares = About("a tilted absorber on the body", hardware=True)

    lag: Annotated[PositiveSecond | None, About("a first-order actuator")] = None       # a value: of its field
    speed_max: Annotated[MetrePerSecond | None, Bound(of="speed", sign=1)] = None       # two bounds are one effect

    speed: Annotated[MetrePerSecond, SetPoint()]                # an operator sets it: controllers are told of a change

What a field declares comes before what its class declares. An optional value that declares nothing is no effect.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class About:
    """One effect: its description in a line.

    hardware  a device that is bought and mounted: absent on purpose, so the audit of a run does not miss it
    needs     other tables of the plant without which it cannot be
    switch    its value that switches it on and off, an input of the rig
    random    its value that is the size of its randomness: runs with it and without it are not compared one by one
    """

    text: str = ""
    hardware: bool = False
    needs: tuple[str, ...] = ()
    switch: str = ""
    random: str = ""


@dataclass(frozen=True)
class Bound(About):
    """A bound of the value `of` in the same table, lower (`sign` -1) or upper (1): a clamp inside the plant."""

    text: str = "a clamp inside the plant, behind a lag"
    of: str = ""
    sign: int = 1


@dataclass(frozen=True)
class SetPoint:
    """Marks a value that an operator sets at the bench and everybody there knows: the speed of a drive, a load.

    Controllers are told of a change of it; of no other value of the rig (rig.scenes.belief).
    """
