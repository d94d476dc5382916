"""Process noise: a random force on the body along the sliding direction. Absent: no random force.

    F = force sqrt(f / 2) n_k   from frame k to the next, n_k standard normal and independent, f = 1 / frame

White noise of the one-sided amplitude spectral density `force` [N/Hz^0.5] up to about half the frame rate f: the
density of a held value falls as sinc(frequency / f). The speed of a free body of mass m has the standard deviation
force sqrt(t / 2) / m after the time t. A sticking contact resists the force up to its static friction. The numbers
depend only on the seed of the scene, so `rig verify` finds the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from annotated_types import Ge

from rig.about import About
from rig.effects import Effect
from rig.model.assembly import Assembly, Output
from rig.picture import Plot
from rig.quantities import Section, quantity

SIGNAL = "noise"

Density: Any = quantity("N/Hz^0.5", Ge(0.0))


class Noise(Effect):
    """The table `noise`: the one-sided amplitude spectral density of the force [N/Hz^0.5]."""

    declares: ClassVar = About(
        "a random force along the sliding direction, a new one in every frame", hardware=True, random="force"
    )

    force: Density


class Noisy(Section):
    """The optional tables of every plant."""

    noise: Noise | None = None


def add(a: Assembly, noise: Noise, frame: float, moved: Mapping[str, str]) -> None:
    """Add the force, held for `frame` [s], and the output `noise_force` [N].

    It acts at the point of the protocol's step `knock`.
    """
    size = noise.force * math.sqrt(0.5 / frame)
    a.signal(SIGNAL, {}, 0.0, "noise")
    for coordinate, factor in a.strike.items():
        a.push(coordinate, {SIGNAL: factor * size})
    a.outputs["noise_force"] = Output({SIGNAL: size}, "N", Plot())
