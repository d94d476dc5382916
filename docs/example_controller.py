"""Press lightly while the body runs with the belt, hard while it runs against it: two levels of normal force.

Try it beside a running rig:   rig live control docs/example_controller.py
"""

from rig.quantities import MetrePerSecond, Newton, Section


class Parameters(Section):
    """What `rig live tune` can change while the rig runs."""

    load: Newton = 20.0
    swing: Newton = 10.0
    dead_band: MetrePerSecond = 0.002


class Controller:
    """State in, state out: here the side on which the velocity was last seen outside the dead band."""

    reads = ("vibrometer",)  # sensors of the scene
    drives = ("load.force",)  # actuators of the rig
    period_ns = 1_000_000  # of simulated time

    def __init__(self, section, numbers):
        self.section, self.numbers = section, numbers

    def start(self):
        """No side yet."""
        return 0

    def update(self, state, t_ns, values):
        """From the state before, the time [ns] and the latest samples: the state after, and the commands."""
        (v,) = values
        side = state if abs(v) < self.section.dead_band else (1 if v > 0.0 else -1)
        return side, (self.section.load - side * self.section.swing,)
