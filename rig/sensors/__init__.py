"""Instruments: a physical quantity in, sampled measurements out, with the flaws of the real thing.

kind                reads               delivers  filter
laser_vibrometer    velocity      m/s   m/s       third-order Bessel; drop-outs, slew limit
displacement_laser  displacement  m     m         mean over one sample period, one sample of processing
strain_gauge        force         N     strain    second-order amplifier; zero drift
accelerometer       acceleration  m/s^2 m/s^2     resonance and high-pass; warming
normal_force        force         N     N         second-order; charge drift
disc_speed          speed         rad/s rad/s     first-order pickup (m/s on a belt's roller)
microphone          velocity      m/s   Pa        diaphragm and vent; way through the air, echoes, background
voltmeter           voltage       V     V         second-order

Signal model:  y = Q{ sat[ (1+g) H(s) x e^{-s tau} + offset + drift + noise ] }, then drop-outs.
Noise is white from 0 to half the sample rate, with exactly the stated density there (the card's anti-aliasing is taken
as ideal for noise). With `ideal = true` every flaw that is not stated is absent; without any, a sample is the value at
its instant. Flaws that are stated hold (`Instrument.perfect`).
At an instant where a signal jumps the value before the jump is read: a measurement never knows the command it causes.

The package `chain` holds what all instruments are made of.
What runs them in every frame is compiled: rig.solve.sampling, rig.solve.pole_response.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

from rig.parts import Room, code_of, named, one_class
from rig.sensors.chain.instrument import Instrument

if __name__ != "rig.sensors":  # found through the link at the top of a checkout
    raise ImportError("friction-rig's sensors are imported as rig.sensors")


def _section(module: ModuleType, kind: str) -> Any:
    """The instrument of a module."""
    own = one_class(module, lambda one: issubclass(one, Instrument), "Sensor", "class derived from Instrument")
    return own if code_of(module) is None else named(module, (own,), "kind", kind)


KINDS: Room[type[Instrument]] = Room("sensors", __name__, __path__, _section)
"""Instruments by kind: `KINDS["microphone"]` is that of rig/sensors/microphone.py."""
