"""Friction of rubber: it rises with the slip speed, has a maximum at `peak`, and falls beyond.

    mu = mu_slow + rise (w / peak) exp(1 - w / peak)

Try it:   rig explain docs/example_law.toml      rig simulate docs/example_law.toml
"""

import math

from rig.laws import FrictionLaw
from rig.quantities import PositiveMetrePerSecond, PositiveNumber, Ratio


class Rubber(FrictionLaw):
    """Coefficient in slow slip, its rise up to the maximum, and the slip speed of the maximum."""

    mu_slow: PositiveNumber
    rise: Ratio
    peak: PositiveMetrePerSecond

    @staticmethod
    def mu(p, w):
        """The coefficient of friction at slip speed w [m/s]."""
        return p.mu_slow + p.rise * bump(w / p.peak)

    @staticmethod
    def slope(p, w):
        """Its derivative with respect to w [s/m]."""
        u = w / p.peak
        return p.rise * (1.0 - u) * math.exp(1.0 - u) / p.peak


def bump(u):
    """A curve with the maximum 1 at u = 1; functions that a formula calls are compiled too."""
    return u * math.exp(1.0 - u)
