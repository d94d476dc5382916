"""Carries out the faults of a scene at their ticks: notes each in the journal, and makes actuators faulty or sound."""

from __future__ import annotations

from collections import deque

from rig.bench.exchange import Exchange
from rig.bench.faulty_actuators import FaultyActuators
from rig.bench.journal import Journal
from rig.bench.runner import PlantRunner
from rig.scenes.part_faults import ActuatorFault, PartFault, described
from rig.scenes.scene import Scene

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
