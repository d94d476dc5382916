"""Instruments: from a physical quantity to sampled measurements, with the errors of real instruments.

kind                reads               delivers  filter
laser_vibrometer    velocity      m/s   m/s       third-order Bessel; drop-outs, slew limit
displacement_laser  displacement  m     m         mean over one sample period, one sample of processing
strain_gauge        force         N     strain    second-order amplifier; zero drift
accelerometer       acceleration  m/s^2 m/s^2     resonance and high-pass; warming
normal_force        force         N     N         second-order; charge drift
disc_speed          speed         rad/s rad/s     first-order pickup (m/s on a belt's roller)
microphone          velocity      m/s   Pa        diaphragm and vent; sound path, echoes, background noise
voltmeter           voltage       V     V         second-order
stream              any, on a real rig            none: a board measures it, in a paced run (docs/device.md)

Signal model:  y = Q{ sat[ (1+g) H(s) x e^{-s tau} + offset + drift + noise ] }, then drop-outs.
Noise is white from 0 to half the sample rate, with exactly the stated density (the anti-aliasing filter is ideal for
noise). With `ideal = true` every flaw that is not stated is absent; an instrument without any flaw samples the value at
the instant. Stated flaws apply (`Instrument.perfect`).
Where an output jumps at a sample instant, the instrument reads the value before the jump: a measurement never contains
the effect of the command that it causes.

The package `chain` contains the parts that all instruments share.
The compiled code that runs them in every frame is in rig.solve.sampling and rig.solve.expm.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

from rig.errors import PartError
from rig.parts import Room, code_of, file_of, named, one_class
from rig.sensors.chain.instrument import Instrument
from rig.units import brief

if __name__ != "rig.sensors":  # found through the link at the top of a checkout
    raise ImportError("friction-rig's sensors are imported as rig.sensors")


def _section(module: ModuleType, kind: str) -> type[Instrument]:
    """The instrument class of a module."""
    own: type[Instrument] = one_class(
        module, lambda member: issubclass(member, Instrument), "Sensor", "class derived from Instrument"
    )
    if code_of(module) is None:
        return own
    if lacking := sorted(own.__abstractmethods__):
        raise PartError(f"{file_of(module)}: {own.__name__} defines no {', '.join(lacking)}")
    if not isinstance(own.perfect, Mapping):
        raise PartError(f"{file_of(module)}: {own.__name__}.perfect is {brief(own.perfect)}; expected a dict")
    if strange := own.perfect.keys() - own.model_fields.keys() - Instrument.perfect.keys():
        raise PartError(f"{file_of(module)}: {own.__name__}.perfect names {', '.join(sorted(strange))}, no field of it")
    return named(module, (own,), "kind", kind)  # type: ignore[no-any-return]


KINDS: Room[type[Instrument]] = Room("sensors", __name__, __path__, _section)
"""Instruments by kind: `KINDS["microphone"]` is that of rig/sensors/microphone.py."""
