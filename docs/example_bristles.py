"""A friction law with memory: a spring in series with a slider, which deflects instead of sticking.

Try it:   rig explain docs/example_bristles.toml      rig simulate docs/example_bristles.toml
"""

from rig.laws import FrictionLaw, InternalState
from rig.quantities import PositiveNumber, quantity


class Bristles(FrictionLaw):
    """Coefficient in steady slip; stiffness per newton of load."""

    states = (InternalState("deflection", "m", along=True),)
    sticks = False
    limit: PositiveNumber
    stiffness: quantity("1/m")

    @staticmethod
    def mu(p, w, N, z):
        """The coefficient of friction at slip speed w [m/s], load N [N] and states z."""
        return p.stiffness * z[0]

    @staticmethod
    def rates(p, w, N, z, dz):
        """Write the rate of the deflection: all of the slip at first, none of it at the limit."""
        dz[0] = w * (1.0 - share(p, z))

    @staticmethod
    def slopes(p, w, N, z, d):
        """Write the derivatives of mu and of the rate; those that are 0 need not be written."""
        d[0, 2] = p.stiffness
        d[1, 0] = 1.0 - share(p, z)
        d[1, 2] = -w * p.stiffness / p.limit

    @staticmethod
    def stored(p, N, z):
        """The energy of the spring [J]."""
        return 0.5 * p.stiffness * N * z[0] * z[0]


def share(p, z):
    """Friction as a share of its limit."""
    return p.stiffness * z[0] / p.limit
