"""A linear piezo stack in the load path: it turns extension into charge, and voltage into force.

    F = c33 dx - e U        q = e dx + Cps U        e = c33 d33

F deforms the stack by dx, U is the voltage of its electrodes, q the charge on them. c33 is its stiffness with the
electrodes shorted, Cps its capacitance with the ends held; hysteresis is absent. With the electrodes open it is stiffer
by kappa = e^2/Cps. The electrodes are connected to a shunt (rig.effects.shunt) or to a voltage amplifier; without these
they are open. With an amplifier the stack is an actuator, with the force e U on its ends:

    U = u,  or  U' = (min(max(u, -limit), limit) - U) / lag        u: commanded voltage

The amplifier delivers any current. Its work on the structure is part of the term `forces` of the energy balance.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, equations 4.14 to 4.20; section 4 a and
figure 21 (active control of the brake, about 50 V).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

from pydantic import model_validator

from rig.about import About
from rig.effects import shunt
from rig.effects.drive import Lag, actuator
from rig.effects.noise import Noisy
from rig.effects.shunt import Shunt, Stack, scaled
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.picture import IN_FIGURE, Plot
from rig.quantities import Farad, MetrePerVolt, NewtonPerVolt, NonNegativeNewtonPerMetre, PositiveVolt, Section, Volt


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


def add_amplifier(a: Assembly, stack: Stack, amplifier: Amplifier, moved: Mapping[str, str]) -> None:
    """Add the amplifier on `stack` and its actuator `amplifier.voltage` [V]."""
    bounds = (-amplifier.limit, amplifier.limit)
    voltage = actuator(
        a, "amplifier.voltage", "V", amplifier.voltage, 0.0, bounds, amplifier.limit, amplifier.lag, "amplifier", moved
    )
    for c, f in stack.path.items():
        a.push(c, scaled(voltage, f * stack.e))
    a.outputs["stack_voltage"] = Output(dict(voltage), "V", Plot(place=IN_FIGURE))


class Piezo(Section):
    """Clamped capacitance Cps [F] and either the coupling e [N/V] or d33 [m/V], where e = c33 d33.

    `stiffness`: c33 [N/m], which the stack adds to the load path; 0 if a spring of the rig already represents the stack
    with shorted electrodes.
    """

    declares: ClassVar = About(
        "a stack in the load path that turns extension into charge; open without a shunt", hardware=True
    )

    capacitance: Farad
    coupling: NewtonPerVolt | None = None
    d33: MetrePerVolt | None = None
    stiffness: NonNegativeNewtonPerMetre = 0.0

    @model_validator(mode="after")
    def _one_coupling(self) -> Self:
        if (self.coupling is None) == (self.d33 is None):
            raise ValueError("give either coupling [N/V] or d33 [m/V], which is coupling / stiffness")
        if self.d33 is not None and self.stiffness == 0.0:
            raise ValueError("d33 needs the stiffness of the stack above 0 N/m: coupling = d33 * stiffness")
        return self

    @property
    def e(self) -> float:
        """Coupling e [N/V], [As/m]."""
        return float(self.coupling if self.coupling is not None else (self.d33 or 0.0) * self.stiffness)


class WithStack(Noisy):
    """The optional tables of a rig with a stack in its load path; at most one of `shunt` and `amplifier`."""

    piezo: Piezo | None = None
    shunt: Shunt | None = None
    amplifier: Amplifier | None = None

    @model_validator(mode="after")
    def _one_use(self) -> Self:
        if self.piezo is None and (self.shunt is not None or self.amplifier is not None):
            raise ValueError("a shunt or an amplifier needs a stack: give [piezo]")
        if self.shunt is not None and self.amplifier is not None:
            raise ValueError("the stack has one pair of electrodes: give [shunt] or [amplifier], not both")
        return self


def add(a: Assembly, p: WithStack, path: Row, moved: Mapping[str, str]) -> None:
    """Add the stack of `p`, if it has one. `path`: its extension [m] as a row over coordinates."""
    if p.piezo is None:
        return
    a.spring(path, p.piezo.stiffness)
    stack = Stack(p.piezo.e, p.piezo.capacitance, path)
    a.outputs["stack_extension"] = Output(dict(path), "m", Plot())
    if p.amplifier is not None:
        add_amplifier(a, stack, p.amplifier, moved)
    else:
        shunt.add(a, stack, p.shunt or shunt.Open(kind="open"), moved)
