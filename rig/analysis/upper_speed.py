"""The upper critical speed of a tip whose friction drops at once: the highest speed at which it sticks again.

Slip begins at the static limit with the speed V of the disc. It is a damped oscillation about the sliding equilibrium.
If its next velocity maximum reaches V, the tip sticks again; otherwise it never does. Both have closed forms, and the
critical speed is the largest V at which the maximum is V. For light damping it approaches

    w_s D / sqrt(exp(4 pi zeta) - 1)       D: distance from the begin of slip to the sliding equilibrium

The disc has a constant speed here. On a ramp the last stick is up to one period of vibration away.
Source: derived; of the form of Thomsen and Fidlin, Int. J. Non-Linear Mech. 38 (2003) 389, for little damping.
"""

from __future__ import annotations

import math

from scipy.optimize import brentq

from rig.errors import UsageError
from rig.plants.tip import Parameters

_SCAN = 1.05
"""Ratio of neighbouring trial speeds."""
_LEAST = 1e-4
"""Smallest trial speed over the largest."""


def upper_speed(p: Parameters) -> float:
    """Return the upper critical speed [m/s] of a tip on an even surface; 0 if it never sticks again.

    Raises UsageError for a friction law that depends on the speed.
    """
    law = p.friction.friction()
    if not law.constant:
        raise UsageError(f"friction.law = {p.friction.law!r}: the closed form needs coulomb or constant")
    tip, force, static, kinetic = p.at_fixed_height, p.load.force, law.static, law.numbers[0]
    material = tip.retardation * tip.stiffness
    stiffness = (1.0 + kinetic * tip.relief) * tip.stiffness
    damping = tip.damping + (1.0 + kinetic * tip.relief) * material
    rate, decay = math.sqrt(stiffness / tip.mass), 0.5 * damping / tip.mass
    if decay >= rate or static <= kinetic:  # overdamped, or no drop of friction
        return 0.0
    swing = math.sqrt(rate**2 - decay**2)
    rest = kinetic * force / stiffness

    def missing(speed: float) -> float:
        """The next velocity maximum of a slip that begins on a disc of this speed, minus that speed."""
        held = static * force - (tip.damping + (1.0 + static * tip.relief) * material) * speed
        y = held / ((1.0 + static * tip.relief) * tip.stiffness) - rest
        # y' = exp(-decay t) (speed cos(swing t) - b sin(swing t))
        b = (rate**2 * y + decay * speed) / swing
        turn = math.atan2(b * swing + decay * speed, b * decay - speed * swing) % math.pi
        peaks = (turn + i * math.pi for i in range(3))
        values = (math.exp(-decay * a / swing) * (speed * math.cos(a) - b * math.sin(a)) for a in peaks)
        return float(max(values) - speed)

    fast = rate * force * static / tip.stiffness
    while fast > 0.0 and missing(_SCAN * fast) > 0.0:
        fast *= 2.0
    slow = fast
    while slow > _LEAST * fast:
        if missing(slow) > 0.0:
            return float(brentq(missing, slow, slow * _SCAN, rtol=1e-12))
        slow /= _SCAN
    return 0.0
