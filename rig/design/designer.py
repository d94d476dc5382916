"""The matrices of a rig for controller design: structure, contact, actuators, instruments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.observer import propagated
from rig.model.assembly import Assembly
from rig.model.system import Patch

Array = NDArray[np.float64]
SETTLED = 100.0  # s; longer than the settling time of any lag of a drive


class Designer:
    """The matrices of a rig for controller design: structure, contact, actuators, instruments."""

    def __init__(self, assembly: Assembly, sensors: Mapping[str, Any], parameters: Any) -> None:
        self.assembly, self.sensors, self.parameters = assembly, sensors, parameters
        self.system = assembly.system()
        self.nq = len(self.system.coordinates)

    @cached_property
    def contact(self) -> Patch:
        """The first friction contact. Raises ValueError for a rig without contact."""
        if not self.system.patches:
            raise ValueError("the rig has no friction contact")
        return self.system.patches[0]

    @cached_property
    def structure(self) -> Array:
        """The matrix A [2 nq, 2 nq] of the linear structure without friction, over (x, v)."""
        s, nq = self.system, self.nq
        pull = (s.force + s.coupling)[:, : 2 * nq] - np.hstack([s.stiffness, s.damping])
        return np.block([[np.zeros((nq, nq)), np.eye(nq)], [self._accelerated(pull)]])

    @cached_property
    def push(self) -> Array:
        """The matrix B [2 nq, patch] of the friction forces."""
        directions = np.array([p.direction for p in self.system.patches]).reshape(-1, self.nq).T
        return np.vstack([np.zeros_like(directions), self._accelerated(directions)])

    def _accelerated(self, forces: Array) -> Array:
        """The accelerations by forces on the coordinates. Raises ValueError for a singular mass matrix."""
        try:
            return np.asarray(np.linalg.solve(self.system.mass, forces), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise ValueError("the mass matrix of the rig is singular; expected a mass of each coordinate") from None

    @cached_property
    def frequency(self) -> float:
        """Lowest frequency of the structure [Hz]."""
        turning = np.abs(np.linalg.eigvals(self.structure))
        return float(min(w for w in turning if w > 1e-6 * turning.max()) / (2.0 * math.pi))

    def row(self, name: str) -> Array:
        """Output `name` as a row over (x, v, w), w: friction forces; other states are left out."""
        nq, patches = self.nq, self.system.patches
        out = np.zeros(2 * nq + len(patches))
        accelerations = np.hstack([self.structure[nq:], self.push[nq:]])
        for entry, value in self.assembly.outputs[name].row.items():
            for i, coordinate in enumerate(self.system.coordinates):
                if entry == coordinate:
                    out[i] += value
                elif entry == f"{coordinate}'":
                    out[nq + i] += value
                elif entry == f"{coordinate}''":
                    out += value * accelerations[i]
            for p, patch in enumerate(patches):
                if entry == f"T:{patch.name}":
                    out[2 * nq + p] += value
                elif entry == f"w:{patch.name}":
                    out[nq : 2 * nq] -= value * patch.direction
        return out

    @cached_property
    def contact_velocity(self) -> Array:
        """The velocity of the body along the friction force, as a row over (x, v, w)."""
        out = np.zeros(2 * self.nq + len(self.system.patches))
        out[self.nq : 2 * self.nq] = self.contact.direction
        return out

    def read_scale(self, sensor: str) -> float:
        """Contact velocity per unit of a sensor that measures a velocity."""
        section = self.sensors[sensor]
        row = section.sensitivity * self.row(section.reads)
        scale = float(row @ self.contact_velocity) / float(row @ row or 1.0)
        if not np.allclose(scale * row, self.contact_velocity, rtol=1e-9, atol=0.0):
            raise ValueError(
                f"velocity: is 'measured', but {sensor} reads {section.reads}, which is not the velocity of the "
                "contact; expected 'observed', or a sensor of the velocity"
            )
        return _rounded(scale)

    def settled_change(self, row: Array, actuator: str) -> float:
        """The change of a row over the states per unit of a command, after the drive has settled."""
        system, first = self.system, self.system.one
        lags = system.signals[:, first:].copy()
        for limiter in (entry for entry in system.limiters if entry.state >= first):
            lags[limiter.state - first] += limiter.gain * limiter.row[first:]
        given = self.assembly.inputs.get(actuator)
        change = 0.0
        if given is not None and given.state:
            change = propagated(row[first:], lags, SETTLED)[system.names.index(given.state) - first]
        if abs(change) < 1e-12:
            raise ValueError(f"drive: {actuator} does not move what this controller commands")
        return _rounded(change)

    def nominal(self, row: Array) -> float:
        """The value of a row over the states at the start, without dither."""
        return _rounded(float(self._undithered(row) @ self.system.start))

    def commanded(self, row: Array, actuator: str) -> dict[str, float]:
        """`nominal`: the value of a row at the start; `drive_scale`: the command per unit of it."""
        return {"nominal": self.nominal(row), "drive_scale": 1.0 / self.settled_change(row, actuator)}

    def speed_scale(self, sensor: str) -> float:
        """Speed of the surface per unit of a sensor that follows the drive."""
        section = self.sensors[sensor]
        entries = self.assembly.outputs[section.reads].row
        seen = self._undithered(section.sensitivity * np.array([entries.get(n, 0.0) for n in self.system.names]))
        surface = self._undithered(self.contact.surface)
        scale = float(surface @ seen) / float(seen @ seen or 1.0)
        if not np.allclose(scale * seen, surface, rtol=1e-9, atol=0.0):
            raise ValueError(f"speed_sensor: {sensor} reads {section.reads}, which is not the speed of the surface")
        return _rounded(scale)

    def _undithered(self, row: Array) -> Array:
        shaken = [self.assembly.owners.get(name) == "dither" for name in self.system.names]
        return np.where(shaken, 0.0, row)

    @cached_property
    def inertia(self) -> float:
        """Effective mass at the contact along the friction force [kg]."""
        return _rounded(1.0 / float(self.contact.direction @ self.push[self.nq :, 0]))

    @cached_property
    def load(self) -> Array:
        """The normal force on the first contact, as a row over the states. Raises ValueError if there is none."""
        rows = [n.row for n in self.system.normals if n.patch == 0]
        if not rows:
            raise ValueError("the rig has no friction contact with a normal force")
        out: Array = np.sum(rows, axis=0)
        return out


def _rounded(value: float) -> float:
    """The value rounded to twelve digits, so that 0.06 m/s stays 0.06 m/s after the arithmetic with matrices."""
    return float(f"{value:.12g}")
