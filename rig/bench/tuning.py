"""Values that change while a rig runs: what an operator or the protocol may set, in which range, and what is now."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rig.bench.exchange import Exchange
from rig.bench.journal import OPERATOR, Journal
from rig.bench.rig_variant import Wanted
from rig.bench.runner import PlantRunner
from rig.errors import UsageError
from rig.quantities import si
from rig.scenes.faults import near, shortened, shown
from rig.scenes.scene import Scene, leaves


class Tuning:
    """Changes actuators and parameters of the rig on `stand`, as a whole and at one tick; `journal` tells it."""

    def __init__(self, scene: Scene, runner: PlantRunner, exchange: Exchange, journal: Journal) -> None:
        self.scene, self.runner, self.exchange, self.journal = scene, runner, exchange, journal

    def wanted(self, changes: Mapping[str, Any]) -> Wanted:
        """What the rig must have before `change` can make these changes. Raises UsageError with every fault.

        What is not `tunable` is refused here and not by `change`: recordings hold such changes, from before.
        """
        actuators, parameters = self._sorted(changes)
        tunable = self.tunable()
        if fixed := [key for key in parameters if key not in tunable]:
            known = f"what can be tuned: {', '.join(tunable)}"
            raise UsageError("\n".join([*(f"{key}: is fixed while the rig runs" for key in fixed), known]))
        return self._wanted(actuators, parameters)

    def needed(self, changes: Mapping[str, Any]) -> Wanted:
        """The same for changes of the protocol, which may be of what is not `tunable`."""
        return self._wanted(*self._sorted(changes))

    def change(self, changes: Mapping[str, Any], by: str = OPERATOR) -> dict[str, Any]:
        """Change actuators and parameters of the rig at this tick: all, or with a RigError none. The new values."""
        actuators, parameters = self._sorted(changes)
        self.runner.go_on(self._wanted(actuators, parameters))
        for key, number in actuators.items():
            self.exchange.ask(key, number)
        new = {key: self.value(key) for key in parameters} | actuators
        self.journal.note("parameter", ", ".join(f"{k} = {v}" for k, v in new.items()), by=by, set=new)
        return new

    def _wanted(self, actuators: Mapping[str, float], parameters: Mapping[str, Any]) -> Wanted:
        """Command states for the actuators that lack one; the values of those that can have none are matrices."""
        runner, lacking = self.runner, self.runner.lacking(actuators)
        matrices = {
            key: value
            for key, value in actuators.items()
            if key not in lacking and runner.rebuilds(key, value) and not self.exchange.overruler(key)
        }
        return Wanted({**parameters, **matrices}, lacking)

    def _sorted(self, changes: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, Any]]:
        """Changes of actuators, in SI, and of parameters; UsageError with every fault."""
        inputs, known = self.runner.inputs, dict(leaves(self.scene.parameters))
        actuators: dict[str, float] = {}
        parameters: dict[str, Any] = {}
        faults = []
        for key, value in changes.items():
            if key not in inputs:
                parameters[key] = value
                if key not in known:
                    faults.append(f"{shortened(key)}: unknown key; {near(key, self.tunable())}")
                continue
            one = inputs[key]
            try:
                actuators[key] = si(value, one.unit)
            except ValueError as fault:
                faults.append(f"{key} {fault}")
                continue
            if not one.low <= actuators[key] <= one.high:
                faults.append(f"{key} = {shown(value)}: must be {one.low:g} to {one.high:g} {one.unit}")
        if faults:
            raise UsageError("\n".join(faults))
        return actuators, parameters

    def tunable(self) -> dict[str, str]:
        """Actuators, then parameters of the rig, that `change` can change -> their units."""
        runner = self.runner
        known = {
            key: unit for key, (_, unit) in leaves(runner.scene.parameters) if unit and not key.startswith("start.")
        }
        return {name: one.unit for name, one in runner.inputs.items()} | {
            key: unit for key, unit in known.items() if key not in runner.inputs
        }

    def value(self, key: str) -> Any:
        """An actuator or a parameter of the rig as it is now."""
        return self.runner.values[key] if key in self.runner.inputs else self.runner.parameter(key)
