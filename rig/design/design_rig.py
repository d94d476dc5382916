"""The quantities of a rig for the design step of a controller (`controllers.blocks.design.Rig`), from its matrices."""

from __future__ import annotations

import cmath
import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.design import Actuator, Feedback
from rig.design import modal
from rig.design.designer import Designer
from rig.design.kalman import observer
from rig.design.linearised import linear
from rig.design.sampled import sampled

Complex = NDArray[np.complex128]


class DesignRig:
    """The rig of a `Designer`. The protocol `controllers.blocks.design.Rig` describes each method."""

    def __init__(self, designer: Designer) -> None:
        self._designer = designer
        self.read_scale, self.speed_scale = designer.read_scale, designer.speed_scale

    @cached_property
    def _vibration_modes(self) -> modal.VibrationModes:
        return modal.vibration_modes(self._designer)

    @property
    def frequency(self) -> float:
        """See `Rig.frequency`."""
        return self._designer.frequency

    @property
    def inertia(self) -> float:
        """See `Rig.inertia`."""
        return self._designer.inertia

    @property
    def surface_speed(self) -> float:
        """See `Rig.surface_speed`."""
        return self._designer.nominal(self._designer.contact.surface)

    def sample_period(self, sensor: str) -> float:
        """See `Rig.sample_period`."""
        return 1e-9 * float(self._designer.sensors[sensor].instants.period_ns)

    def observer(self, section: Any) -> dict[str, Any]:
        """See `Rig.observer`."""
        return observer(self._designer, section)

    def commands_load(self, actuator: str) -> dict[str, float]:
        """See `Rig.commands_load`."""
        return self._designer.commanded(self._designer.load, actuator)

    def commands_surface(self, actuator: str) -> dict[str, float]:
        """See `Rig.commands_surface`."""
        return self._designer.commanded(self._designer.contact.surface, actuator)

    def actuator(self, name: str) -> Actuator | None:
        """See `Rig.actuator`."""
        found = self._designer.assembly.inputs.get(name)
        return None if found is None else Actuator(found.unit, found.value, found.low, found.high)

    def value(self, key: str) -> Any:
        """See `Rig.value`."""
        found = self._designer.parameters
        for part in key.split("."):
            found = getattr(found, part, None)
        return found

    def pushed_by(self, state: str) -> bool:
        """See `Rig.pushed_by`."""
        return any(state in row for row in self._designer.assembly.force.values())

    def frequencies(self) -> list[float]:
        """See `Rig.frequencies`."""
        return sorted(float(v.imag) / (2.0 * math.pi) for v in self._vibration_modes.values if v.imag > 0.0)

    def modes(self, sensor: str, drive: str, delay: float, low: float, high: float) -> tuple[Complex, Complex]:
        """See `Rig.modes`."""
        found = self._vibration_modes
        hertz = found.values.imag / (2.0 * math.pi)
        near = (low < hertz) & (hertz < high) & (found.values.imag > 0.0)
        values, end = found.values[near], self._designer.sensors[sensor].front_end()
        residues = modal.residues(self._designer, found, sensor, drive)[near]
        path = [complex(end.response(s) * cmath.exp(-s * delay)) for s in values]
        return values, residues * np.array(path, complex)

    def closed(self, controller: Feedback, sensor: str, delay: float) -> tuple[float, float]:
        """See `Rig.closed`."""
        designer, section = self._designer, self._designer.sensors[sensor]
        plant = linear(designer.assembly, self._vibration_modes.rig)
        model = sampled(plant, controller, section.reads, section.front_end(), round(delay * 1e9))
        z = np.linalg.eigvals(model.closed())
        worst = z[np.argmax(np.abs(z))]
        rate = math.log(abs(worst)) / model.period
        return rate, abs(cmath.phase(worst)) / (2.0 * math.pi * model.period)
