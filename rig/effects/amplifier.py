"""A voltage amplifier on the electrodes of a piezo stack: the stack as an actuator, force e U on its ends.

    U = u,  or  U' = (min(max(u, -limit), limit) - U) / lag        u: commanded voltage

The amplifier delivers any current. Its work on the structure is part of the term `forces` of the energy balance.
Source: Kroeger, Neubauer, Popp (2008), section 4 a and figure 21 (active control of the brake, about 50 V).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

from pydantic import model_validator

from rig.about import About
from rig.effects.drive import Lag, actuator
from rig.effects.stack import Stack, scaled
from rig.model.assembly import Assembly, Output
from rig.picture import IN_FIGURE, Plot
from rig.quantities import PositiveVolt, Section, Volt


class Amplifier(Section):
    """The table `amplifier`: voltage at the start [V], largest voltage of either sign [V], lag [s]."""

    declares: ClassVar = About("a commanded voltage on the stack's electrodes", hardware=True, needs=("piezo",))

    voltage: Volt = 0.0
    limit: PositiveVolt
    lag: Lag = None

    @model_validator(mode="after")
    def _within(self) -> Self:
        if abs(self.voltage) > self.limit:
            raise ValueError(f"voltage {self.voltage:g} V is beyond the limit of {self.limit:g} V")
        return self


def add(a: Assembly, stack: Stack, amplifier: Amplifier, moved: Mapping[str, str]) -> None:
    """Add the amplifier on `stack` and its actuator `amplifier.voltage` [V]."""
    bounds = (-amplifier.limit, amplifier.limit)
    voltage = actuator(
        a, "amplifier.voltage", "V", amplifier.voltage, 0.0, bounds, amplifier.limit, amplifier.lag, "amplifier", moved
    )
    for c, f in stack.path.items():
        a.push(c, scaled(voltage, f * stack.e))
    a.outputs["stack_voltage"] = Output(dict(voltage), "V", Plot(place=IN_FIGURE))
