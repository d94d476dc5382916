"""Dither: a fast vibration that is laid over the speed of the belt, a force on the mass, or the normal force.

    s'' = -omega^2 s, states s = a sin, c = a cos:  s' = omega c, c' = -omega s

The generator is part of the plant, so its waveform is exact at every step; what a process commands is its amplitude,
its frequency and whether it is on. Amplitude and enable write the two states and keep the phase; a new frequency is
a new matrix and goes through the scene key.
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
from rig.effects.drive import reach
from rig.model.assembly import Assembly, Input
from rig.model.named_rows import add as add_row
from rig.quantities import Angle, Hertz, PositiveNewton, Section, Speed


class _Dither(Section):
    declares: ClassVar = About("a fast vibration of belt, mass or load", hardware=True, switch="enable")

    frequency: Hertz
    phase: Angle = 0.0
    enable: bool = True


class BeltDither(_Dither):
    """On the speed of the belt or disc surface; amplitude in m/s."""

    on: Literal["belt"]
    amplitude: Speed


class MassDither(_Dither):
    """A force on the mass along the belt; amplitude in N."""

    on: Literal["mass"]
    amplitude: PositiveNewton


class LoadDither(_Dither):
    """On the normal force; amplitude in N. Above the load the contact opens in every period."""

    on: Literal["load"]
    amplitude: PositiveNewton


Dither = Annotated[BeltDither | MassDither | LoadDither, Field(discriminator="on")]
TangentialDither = Annotated[BeltDither | MassDither, Field(discriminator="on")]


LARGEST = {"m/s": 100.0, "N": 1e5}
"""Amplitude that can be commanded, or that of the scene if it is larger [chosen]."""


def add(
    a: Assembly,
    dither: BeltDither | MassDither | LoadDither,
    patch: str,
    normal: str,
    coordinate: str,
    arm: float = 1.0,
) -> None:
    """Add the generator; `arm` [m] turns a force on the mass into the coordinate's own (1 for a translation)."""
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
        sine, cosine = a.names.index("dither.sin"), a.names.index("dither.cos")  # effects added later move them
        wanted = values["dither.amplitude"] if values["dither.enable"] >= 0.5 else 0.0
        now = math.hypot(x[sine], x[cosine])
        if now > 0.0 and wanted > 0.0:
            x[sine] *= wanted / now
            x[cosine] *= wanted / now
        else:
            x[sine] = wanted * math.sin(omega * t + dither.phase)
            x[cosine] = wanted * math.cos(omega * t + dither.phase)

    amplitudes, f = reach(dither.amplitude, 0.0, math.inf, LARGEST[unit]), dither.frequency
    a.inputs["dither.amplitude"] = Input(unit, *amplitudes, dither.amplitude, 0.0, write=write)
    a.inputs["dither.enable"] = Input("1", 0.0, 1.0, float(dither.enable), 0.0, write=write)
    a.inputs["dither.frequency"] = Input("Hz", min(0.1, f), max(100e3, f), f, f)
