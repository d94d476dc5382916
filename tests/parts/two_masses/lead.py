"""A filtered velocity feedback to the load, with a design step and a linear form."""

from rig.controllers.blocks.base import ControllerSection, ForcePerSpeed
from rig.controllers.blocks.design import Linear
from rig.quantities import quantity


class Lead(ControllerSection):
    """gain and pole of the filter."""

    sensor: str
    drive: str = "load.force"
    gain: ForcePerSpeed = 10.0
    pole: quantity("1") = 0.5


class LeadController:
    """F = F0 - K y, y: the filtered velocity."""

    def __init__(self, section, numbers):
        self.section, self.numbers = section, numbers
        self.reads, self.drives, self.period_ns = (section.sensor,), (section.drive,), section.period

    @staticmethod
    def design(rig, section):
        """Units of the sensor and of the load."""
        return rig.commands_load(section.drive) | {"scale": rig.read_scale(section.sensor)}

    def linear(self):
        """One state, proportional to the gain."""

        def step(states, sample):
            y = self.section.pole * states[0] + (1 - self.section.pole) * sample * self.numbers["scale"]
            return (y,), -self.section.gain * y * self.numbers["drive_scale"]

        return Linear(1, step, "gain")

    def start(self):
        """The filter at rest."""
        return 0.0

    def update(self, state, t_ns, values):
        """Filter, then press."""
        y = self.section.pole * state + (1 - self.section.pole) * values[0] * self.numbers["scale"]
        f = (self.numbers["nominal"] - self.section.gain * y) * self.numbers["drive_scale"]
        return y, (min(max(f, 0.0), 100.0),)
