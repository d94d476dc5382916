"""Smoothed friction, for comparison only: T = mu(|w|) N tanh(w / scale), without stick and without events.

A stuck contact creeps at scale atanh(T / (mu N)) forever. The jump from static to kinetic friction has no smooth form.
As in the literature it becomes a decay over 5 scales, whose maximum is a sixth below the static coefficient for any
scale. The result is finite, smooth and wrong; the method exists to show this error.

Source: the form of Liu and Ouyang, Mechanical Systems and Signal Processing (2022), with tanh(50 v).
"""

from __future__ import annotations

from dataclasses import replace

from rig.model import friction_law
from rig.model.friction_law import Law
from rig.model.system import System

_FALL = 5.0  # number of scales over which static friction falls to kinetic


def smoothed(system: System, scale: float) -> System:
    """The system with every friction law smoothed over `scale` [m/s]."""
    patches = tuple(replace(patch, law=_smooth(patch.law, scale)) for patch in system.patches)
    sectors = tuple(replace(s, laws=tuple(_smooth(law, scale) for law in s.laws)) for s in system.sectors)
    return replace(system, patches=patches, sectors=sectors)


def _smooth(law: Law, scale: float) -> Law:
    if law.constant and law.static > law.numbers[0]:
        law = friction_law.stribeck(law.static, law.numbers[0], _FALL * scale)
    return friction_law.smoothed(law, scale)
