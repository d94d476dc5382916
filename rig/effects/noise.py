"""Process noise: a random force on the body, along the sliding direction. Absent: nothing disturbs the rig.

    F = force sqrt(f / 2) n_k   from frame k to the next, n_k standard normal and independent, f = 1 / frame

White noise of the one-sided spectral density `force` [N/Hz^0.5] up to about half the frame rate f: the density of a
number that is held falls as sinc(frequency / f). On a body of mass m that is free to move the speed wanders by
force sqrt(t / 2) / m. A contact that sticks bears it, up to what it can hold. Numbers depend on the seed of the scene
alone, so a recording is verified to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from annotated_types import Ge

from rig.about import About
from rig.effects import Effect
from rig.model.assembly import Assembly, Output
from rig.quantities import Section, quantity

SIGNAL = "noise"

Density: Any = quantity("N/Hz^0.5", Ge(0.0))


class Noise(Effect):
    """One-sided spectral density of the force."""

    declares: ClassVar = About(
        "a random force along the sliding direction, a new one in every frame", hardware=True, random="force"
    )

    force: Density


class Noisy(Section):
    """The tables that every rig may have."""

    noise: Noise | None = None


def add(a: Assembly, noise: Noise, frame: float, moved: Mapping[str, str]) -> None:
    """Add the force, held for `frame` [s], and the output `noise_force`.

    It acts where a knock would strike.
    """
    size = noise.force * math.sqrt(0.5 / frame)
    a.signal(SIGNAL, {}, 0.0, "noise")
    for coordinate, factor in a.strike.items():
        a.push(coordinate, {SIGNAL: factor * size})
    a.outputs["noise_force"] = Output({SIGNAL: size}, "N")
