"""Types of quantities that only instruments have: rates, noise densities, sensitivities."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt

from rig.quantities import PositiveMetre, Unit, duration, quantity

Rate = quantity("Hz", Ge(1.0), Le(100e3))
Delay = duration(0, 100_000_000_000)
GainError = quantity("1", Gt(-1.0))
Quality = quantity("1", Ge(0.55))  # of a second-order filter; the double pole at 1/2 has no modal form
PerSecond = quantity("1/s", Ge(0.0))
Kelvin = quantity("K")

Length = quantity("m", Ge(0.0))

SpeedDensity = quantity("m/s/Hz^0.5", Ge(0.0))
SpeedStep = quantity("m/s", Ge(0.0))

TurnSpan = quantity("rad/s", Gt(0.0))
TurnStep = quantity("rad/s", Ge(0.0))
TurnDensity = quantity("rad/s/Hz^0.5", Ge(0.0))

Acceleration = quantity("m/s^2")
AccelerationSpan = quantity("m/s^2", Gt(0.0))
AccelerationStep = quantity("m/s^2", Ge(0.0))
AccelerationDensity = quantity("m/s^2/Hz^0.5", Ge(0.0))
AccelerationPerKelvin = quantity("m/s^2/K")

ForceSpan = quantity("N", Gt(0.0))
ForceStep = quantity("N", Ge(0.0))
ForceDensity = quantity("N/Hz^0.5", Ge(0.0))
ForceRate = quantity("N/s")

StrainPerNewton = quantity("1/N", Gt(0.0))
StrainSpan = quantity("1", Gt(0.0))
StrainStep = quantity("1", Ge(0.0))
StrainDensity = quantity("1/Hz^0.5", Ge(0.0))
StrainPerKelvin = quantity("1/K")

Pressure = quantity("Pa", Ge(0.0))
PressureOffset = quantity("Pa")
PressureSpan = quantity("Pa", Gt(0.0))
PressureDensity = quantity("Pa/Hz^0.5", Ge(0.0))
PressurePerSpeed = quantity("Pa*s/m", Gt(0.0))
Share = quantity("1", Ge(0.0), Lt(1.0))
Paths = Annotated[tuple[PositiveMetre, ...], Unit("m")]

Voltage = quantity("V", Ge(0.0))
VoltageDensity = quantity("V/Hz^0.5", Ge(0.0))
