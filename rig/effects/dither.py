"""Dither: a fast vibration that is added to the speed of the belt, to the force on the mass or to the normal force.

    s'' = -omega^2 s, states s = a sin, c = a cos:  s' = omega c, c' = -omega s

The generator is part of the plant, so its waveform is exact at every step; a process commands its amplitude, its
frequency and whether it is on. Commands of amplitude and enable change the two states and keep the phase. A new
frequency changes the matrices, which are then built again from the scene.
Source: Kroeger, Neubauer, Popp (2008), section 4 (mentioned); averaged friction: mu (2/pi) asin(v0 / amplitude).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rig.about import About
from rig.effects.drive import command_range
from rig.model.assembly import Assembly, Input
from rig.model.named_rows import add as add_row
from rig.quantities import Angle, Hertz, NonNegativeNewton, Section, Speed

LARGEST = {"m/s": 100.0, "N": 1e5}
"""Largest amplitude that can be commanded, by unit; a larger one in the scene takes its place [chosen]."""


class _Dither(Section):
    declares: ClassVar = About("a fast vibration of belt, mass or load", hardware=True, switch="enable")

    frequency: Hertz
    phase: Angle = 0.0
    enable: bool = True


class BeltDither(_Dither):
    """Dither on the speed of the belt or disc surface; amplitude in m/s."""

    on: Literal["belt"]
    amplitude: Speed


class MassDither(_Dither):
    """Dither as a force on the mass along the belt; amplitude in N."""

    on: Literal["mass"]
    amplitude: NonNegativeNewton


class LoadDither(_Dither):
    """Dither on the normal force; amplitude in N. Above the load the contact opens in every period."""

    on: Literal["load"]
    amplitude: NonNegativeNewton


Dither = Annotated[BeltDither | MassDither | LoadDither, Field(discriminator="on")]
TangentialDither = Annotated[BeltDither | MassDither, Field(discriminator="on")]


def add(
    a: Assembly,
    dither: BeltDither | MassDither | LoadDither,
    patch: str,
    normal: str,
    coordinate: str,
    arm: float = 1.0,
) -> None:
    """Add the generator. `arm` [m] converts a force on the mass to the generalised force (1 for a translation)."""
    omega = 2.0 * math.pi * dither.frequency
    amplitude = dither.amplitude if dither.enable else 0.0
    a.signal("dither.sin", {"dither.cos": omega}, amplitude * math.sin(dither.phase), "dither")
    a.signal("dither.cos", {"dither.sin": -omega}, amplitude * math.cos(dither.phase), "dither")
    unit = "m/s" if dither.on == "belt" else "N"
    if dither.on == "belt":
        add_row(a.surface(patch), {"dither.sin": 1.0})
    elif dither.on == "load":
        add_row(a.load(normal), {"dither.sin": 1.0})
    else:
        a.push(coordinate, {"dither.sin": arm})

    def write(x: NDArray[np.float64], values: Mapping[str, float], t: float) -> None:
        sine = a.names.index("dither.sin")  # effects added later move them
        cosine = a.names.index("dither.cos")
        wanted = values["dither.amplitude"] if values["dither.enable"] >= 0.5 else 0.0
        now = math.hypot(x[sine], x[cosine])
        if now > 0.0 and wanted > 0.0:
            x[sine] *= wanted / now
            x[cosine] *= wanted / now
        else:
            x[sine] = wanted * math.sin(omega * t + dither.phase)
            x[cosine] = wanted * math.cos(omega * t + dither.phase)

    amplitudes = command_range(dither.amplitude, 0.0, math.inf, LARGEST[unit])
    f = dither.frequency
    a.inputs["dither.amplitude"] = Input(unit, *amplitudes, dither.amplitude, 0.0, write=write)
    a.inputs["dither.enable"] = Input("1", 0.0, 1.0, float(dither.enable), 0.0, write=write)
    a.inputs["dither.frequency"] = Input("Hz", min(0.1, f), max(100e3, f), f, f)
