"""Changes of actuators and parameters while a rig runs, by an operator or the protocol, with their allowed ranges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rig.bench.run.exchange import Exchange
from rig.bench.run.journal import OPERATOR, Journal
from rig.bench.run.rig_variants import Wanted
from rig.bench.run.runner import PlantRunner
from rig.errors import UsageError
from rig.scenes.faults import near, shortened, shown
from rig.scenes.scene import Scene
from rig.scenes.sections import values_of
from rig.units import si


class Tuning:
    """Changes actuators and parameters of the rig of `runner`, all at one tick; `journal` records the changes."""

    def __init__(self, scene: Scene, runner: PlantRunner, exchange: Exchange, journal: Journal) -> None:
        self.scene, self.runner, self.exchange, self.journal = scene, runner, exchange, journal

    def wanted(self, changes: Mapping[str, Any]) -> Wanted:
        """The variant of the rig that `change` needs for these changes. Raises UsageError with all faults.

        This method refuses changes that are not `tunable`. `change` accepts them, because old recordings contain some.
        """
        actuators, parameters = self._sorted(changes)
        tunable = self.tunable()
        if fixed := [key for key in parameters if key not in tunable]:
            known = f"what can be tuned: {', '.join(tunable)}"
            raise UsageError("\n".join([*(f"{key}: is fixed while the rig runs" for key in fixed), known]))
        return self._wanted(actuators, parameters)

    def needed(self, changes: Mapping[str, Any]) -> Wanted:
        """Like `wanted`, for changes by the protocol, which need not be `tunable`."""
        return self._wanted(*self._sorted(changes))

    def change(self, changes: Mapping[str, Any], by: str = OPERATOR) -> dict[str, Any]:
        """Change actuators and parameters of the rig at this tick and return the new values. Raises RigError.

        Either all changes are made, or none.
        """
        actuators, parameters = self._sorted(changes)
        self.runner.go_on(self._wanted(actuators, parameters))
        for key, number in actuators.items():
            self.exchange.ask(key, number)
        new = {key: self.value(key) for key in parameters} | actuators
        self.journal.note("parameter", ", ".join(f"{k} = {v}" for k, v in new.items()), by=by, set=new)
        return new

    def _wanted(self, actuators: Mapping[str, float], parameters: Mapping[str, Any]) -> Wanted:
        """The variant with command states for these actuators; without a command state a value is a parameter."""
        runner, lacking = self.runner, self.runner.lacking(actuators)
        matrices = {
            key: value
            for key, value in actuators.items()
            if key not in lacking and runner.rebuilds(key, value) and not self.exchange.overruler(key)
        }
        return Wanted({**parameters, **matrices}, lacking)

    def _sorted(self, changes: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, Any]]:
        """Separate changes of actuators (in SI) and of parameters. Raises UsageError with all faults."""
        inputs, known = self.runner.inputs, dict(values_of(self.scene.parameters))
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
        """Key -> unit of everything that can be changed: actuators, then parameters of the rig."""
        runner = self.runner
        known = {
            key: unit for key, (_, unit) in values_of(runner.scene.parameters) if unit and not key.startswith("start.")
        }
        return {name: one.unit for name, one in runner.inputs.items()} | {
            key: unit for key, unit in known.items() if key not in runner.inputs
        }

    def value(self, key: str) -> Any:
        """The present value of an actuator or a parameter of the rig."""
        return self.runner.values[key] if key in self.runner.inputs else self.runner.parameter(key)


def divided(changes: Mapping[str, Any]) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    """Divide changes by dotted key into those of each controller (by its own keys) and those of the rig."""
    own: dict[str, dict[str, Any]] = {}
    rig: dict[str, Any] = {}
    for key, value in changes.items():
        room, _, rest = key.partition(".")
        name, _, inner = rest.partition(".")
        if room == "controllers":
            own.setdefault(name, {})[inner] = value
        else:
            rig[key] = value
    return own, rig
