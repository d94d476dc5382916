"""A plant that takes commands: actuators, parameters of the rig, knocks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from pydantic import BaseModel

from rig.bench.rig_variant import RigVariant, Wanted
from rig.bench.stepped_plant import SteppedPlant
from rig.effects import knock
from rig.errors import SceneError
from rig.scenes.faults import shortened


class CommandedPlant(SteppedPlant):
    """A plant whose actuators and parameters can be written at the present tick."""

    def apply(self, name: str, value: float) -> None:
        """Set an actuator to `value` at this tick; a ramp in progress ends."""
        one, rebuilds = self.inputs[name], self.rebuilds(name, value)
        self.values[name] = value
        self.state_samples.hears(name, value)
        if one.write is not None:
            one.write(self.motion.x, self.values, self.t_ns * 1e-9)
        elif one.state:
            if one.slope:
                self.motion.write(self._index[one.slope], 0.0)
            self.motion.write(self._index[one.state], value)
        elif rebuilds:
            self.set_parameter(name, value)

    def ramp(self, name: str, to: float, ticks: int) -> None:
        """Move an actuator linearly to `to` within `ticks` frames; `apply` at the end stops it exactly there.

        For actuators with a slope: those that the protocol of the scene ramps.
        """
        one = self.inputs[name]
        start = float(self.motion.x[self._index[one.state]])
        self.values[name] = to
        self.motion.write(self._index[one.slope], (to - start) / (ticks * self.frame_ns * 1e-9))

    def reached(self, name: str) -> float:
        """The value that an actuator has reached: what follows its command, or else the command itself."""
        one = self.inputs[name]
        return float(self.motion.x[self._index[one.lagging or one.state]])

    def plain(self, name: str) -> tuple[int, int] | None:
        """The state that a command to this actuator is written to, and that of its slope (-1: none), where that is all.

        None where a command means more than that.
        """
        one = self.inputs[name]
        if not one.state or one.write or name in self.state_samples.open or self.motion.integration.method == "kick":
            return None
        at = self._index[one.state]
        return None if at < 2 * len(self.motion.system.coordinates) else (at, self._index.get(one.slope, -1))

    def lacking(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return those of these actuators that need a command state and do not have one yet."""
        without = [name for name in names if not (self.inputs[name].state or self.inputs[name].write)]
        return tuple(name for name in without if name not in self._coefficients and name not in self.scene.moved)

    def take(self, variant: RigVariant) -> None:
        """Continue with this variant of the rig from this tick on; it must have been made from the present rig."""
        if self.truth is not None:
            self.hand_over(self.truth)
        self.motion.replace(variant.ready)
        self.variants.use(variant)
        for key, value in variant.wanted.parameters.items():
            if key in self.values:
                self.values[key] = value
            self.state_samples.hears(key, value)
        self.inputs.update(variant.assembly.inputs)
        self._index = {name: i for i, name in enumerate(self.motion.system.names)}
        self.random_numbers.find(self.motion.system)

    def go_on(self, wanted: Wanted) -> None:
        """Continue with the variant `wanted` from this tick on."""
        if wanted:
            self.take(self.variants.build(wanted))

    def coefficient(self, name: str) -> bool:
        """Whether an actuator has no command state: each value needs its own matrices."""
        one = self.inputs[name]
        return not (one.state or one.write)

    def rebuilds(self, name: str, value: float) -> bool:
        """Whether `apply` makes a new matrix of this value: the actuator has no command state and another value."""
        return self.coefficient(name) and value != self.values[name]

    def set_parameter(self, key: str, value: Any) -> None:
        """Change a parameter of the rig (`friction.mu_static`) at this tick. Raises SceneError when it cannot be."""
        self.go_on(Wanted({key: value}))

    def parameter(self, key: str) -> Any:
        """The value of a parameter of the rig now. Raises SceneError for an unknown key."""
        found: Any = self.scene.parameters
        for part in key.split("."):
            inside = found if isinstance(found, dict) else dict(found) if isinstance(found, BaseModel) else {}
            if part not in inside:
                raise SceneError(shortened(key), ["is not a parameter of this rig"])
            found = inside[part]
        return found

    def knock(self, impulse: float, duration_ns: int = 0) -> None:
        """Strike the body with `impulse` [N s], along the sliding direction unless its plant says where.

        With a duration, which the protocol of the scene must have, the force is a half sine until `release`.
        """
        if duration_ns:
            self.motion.write(self._index[knock.states(duration_ns)[1]], knock.peak(impulse, duration_ns))
            return
        system = self.motion.system
        jump = np.linalg.solve(system.mass, system.strike) * impulse
        first = len(system.coordinates)
        for i, step in enumerate(jump):
            self.motion.write(first + i, float(self.motion.x[first + i] + step))

    def release(self) -> None:
        """End a knock with a duration: the force of the hammer is zero."""
        for duration_ns in self.scene.knocks:
            for state in knock.states(duration_ns):
                self.motion.write(self._index[state], 0.0)
