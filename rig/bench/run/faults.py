"""Faults of a scene that are carried out while a rig runs.

Faults of actuators while a rig runs (rig.scenes.part_faults): what becomes of commands on their way to the plant.

Commands are recorded as they were asked for; what a faulty actuator makes of them is repeated with the scene.

Carries out the faults of a scene at their ticks: notes each in the journal, and makes actuators faulty or sound.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from rig.bench.run.exchange import Exchange
from rig.bench.run.journal import Journal
from rig.bench.run.runner import PlantRunner
from rig.model.assembly import Input
from rig.scenes.part_faults import ActuatorFault, Authority, Jam, PartFault, described
from rig.scenes.scene import Scene


class FaultyActuators:
    """The actuators of `runner`, some of which are faulty: `faulty` has the fault of each at the present tick.

    It takes the place of the runner in the exchange (see rig.bench.run.exchange.Actuators).
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


FAULT = "fault"
"""Kind of event that says that a fault begins or is over."""


class FaultTimes:
    """The begins and ends of the faults of `scene` that are still to come, in order.

    `actuators`: those that the exchange commands; None if no actuator becomes faulty.
    """

    def __init__(self, scene: Scene, runner: PlantRunner, journal: Journal, actuators: FaultyActuators | None) -> None:
        self._runner, self._journal, self._actuators = runner, journal, actuators
        units = {name: one.unit for name, one in runner.inputs.items()} | dict(
            zip(runner.bank.names, runner.bank.units)
        )
        self._words = {name: described(fault, units[fault.part]) for name, fault in scene.faults.items()}
        frame = scene.frame_ns
        found = [(fault.at // frame, 1, name, fault) for name, fault in scene.faults.items()]
        found += [(fault.end // frame, 0, name, fault) for name, fault in scene.faults.items() if fault.end is not None]
        self._due: deque[tuple[int, int, str, PartFault]] = deque(sorted(found, key=lambda one: one[:3]))

    @property
    def next(self) -> int | None:
        """The tick of the next begin or end; None if none comes any more."""
        return self._due[0][0] if self._due else None

    def carry_out(self, exchange: Exchange) -> None:
        """Carry out what is due at this tick: a fault that is over first, then those that begin."""
        while self._due and self._due[0][0] <= self._runner.tick:
            _, begins, name, fault = self._due.popleft()
            words = self._words[name]
            text = f"{name}: {words}" if begins else f"{name} is over: {fault.part} is sound again"
            self._journal.note(FAULT, text, fault=name, begins=bool(begins))
            if isinstance(fault, ActuatorFault):
                assert self._actuators is not None
                self._switch(exchange, self._actuators, fault, bool(begins))

    @staticmethod
    def _switch(exchange: Exchange, actuators: FaultyActuators, fault: ActuatorFault, begins: bool) -> None:
        if begins and fault.kind == "jam":
            actuators.jam(fault.actuator)
        if begins:
            actuators.faulty[fault.actuator] = fault
        else:
            del actuators.faulty[fault.actuator]
        exchange.renew(fault.actuator)

    def never(self) -> list[str]:
        """A line for each fault whose time has not come."""
        frame, end = self._runner.frame_ns * 1e-9, self._runner.t_ns * 1e-9
        return [
            f"faults.{name}.at: {tick * frame:g} s is after the end of the run at {end:g} s, so this fault never acts "
            f"({self._words[name]}); let it begin earlier or run longer"
            for tick, begins, name, _ in self._due
            if begins
        ]
