"""Faults of actuators while a rig runs (rig.scenes.part_faults): what becomes of commands on their way to the plant.

Commands are recorded as they were asked for; what a faulty actuator makes of them is repeated with the scene.
"""

from __future__ import annotations

from collections.abc import Mapping

from rig.bench.runner import PlantRunner
from rig.model.assembly import Input
from rig.scenes.part_faults import Authority, Jam


class FaultyActuators:
    """The actuators of `runner`, some of which are faulty: `faulty` has the fault of each at the present tick.

    It takes the place of the runner in the exchange (see rig.bench.actuators.Actuators).
    """

    def __init__(self, runner: PlantRunner) -> None:
        self._runner = runner
        self.faulty: dict[str, Jam | Authority] = {}

    @property
    def tick(self) -> int:
        """The present tick."""
        return self._runner.tick

    @property
    def inputs(self) -> Mapping[str, Input]:
        """Actuators with unit, range and safe value."""
        return self._runner.inputs

    def apply(self, name: str, value: float) -> None:
        """Set an actuator to a value at the present tick, as far as its fault allows."""
        if not self._jams(name):
            self._runner.apply(name, self._reached(name, value))

    def ramp(self, name: str, to: float, ticks: int) -> None:
        """Move an actuator linearly to a value within whole ticks, as far as its fault allows."""
        if not self._jams(name):
            self._runner.ramp(name, self._reached(name, to), ticks)

    def jam(self, name: str) -> None:
        """Hold an actuator where it is."""
        self._runner.apply(name, self._runner.reached(name))

    def _jams(self, name: str) -> bool:
        return isinstance(self.faulty.get(name), Jam)

    def _reached(self, name: str, value: float) -> float:
        fault = self.faulty.get(name)
        if not isinstance(fault, Authority):
            return value
        one = self.inputs[name]
        return float(min(max(fault.factor * value, one.low), one.high))
