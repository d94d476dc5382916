"""Normal force by the filtered velocity: a control law that can be compiled, and that states itself as a linear map.

Try it:   rig loop belt --controller docs/example_linear.py
"""

import math
from functools import partial
from typing import NamedTuple

from rig.controllers.blocks.design import Linear
from rig.quantities import Hertz, Newton, NewtonSecondPerMetre, Section


class Parameters(Section):
    """Nominal load, gain, and cut-off frequency of the filter."""

    load: Newton = 20.0
    gain: NewtonSecondPerMetre = 100.0
    filter: Hertz = 35.0


class Constants(NamedTuple):
    """What the law needs, as numbers."""

    load: float
    gain: float
    smoothing: float


def law(p, state, t_ns, values):
    """The state after, and the command: a function of the module, so that it can be compiled."""
    smooth = state + p.smoothing * (values[0] - state)  # a filter of first order
    return smooth, (p.load - p.gain * smooth,)


class Controller:
    """Its state is the filtered velocity [m/s]."""

    reads, drives, period_ns = ("vibrometer",), ("load.force",), 1_000_000

    def __init__(self, section, numbers):
        self.section, self.numbers = section, numbers
        smoothing = 1.0 - math.exp(-2.0 * math.pi * section.filter * 1e-3)
        self.update = partial(law, Constants(section.load, section.gain, smoothing))

    def start(self):
        """At rest."""
        return 0.0

    def linear(self):
        """One state; the command without its nominal value; the gain is that of the table."""

        def step(states, sample):
            smooth, (command,) = self.update(states[0], 0, (sample,))
            return [smooth], command - self.section.load

        return Linear(1, step, gain="gain")
