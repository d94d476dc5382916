"""From the plant's matrices to the numbers of its controllers.

A controller never sees the plant. This step, run once for a scene, gives each controller what it needs as plain
numbers: scales between the units of its sensor and drive and those of the contact, the frequency of the structure,
and, for a velocity that is observed rather than measured, a Kalman observer:

    x' = v,  M v' = -K x - D v + t w,  w' = -w/T + noise          y = row (x, v, v', w) + noise of the instrument

The friction force w of each patch is an unknown input: a random walk that wanders by `unknown_force` within one period
T of the structure and is forgotten in as long. No friction law enters. An instrument that does not see a displacement
at rest, an accelerometer, could not tell its own wrong zero from a motion: there, the zero is one more unknown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.observer import propagated
from rig.design import squeal
from rig.errors import SceneError
from rig.model.assembly import Assembly

Array = NDArray[np.float64]

GENERATOR = "dither.amplitude"
WANDER = 0.5  # of the load: how far the unknown force wanders within one period, unless the section says so
SETTLED = 100.0  # s: every lag of a drive has settled by then
ZERO_WANDER = 0.01  # of the measurement: how far the zero of an accelerometer wanders within one period
ZERO_FORGET = 0.03  # of a period's forgetting: a wrong zero stays
LEAST_NOISE = 1e-4  # of the measurement that the unknown force makes: bounds the speed of an observer


def numbers(scene: Any, assembly: Assembly | None = None) -> dict[str, dict[str, Any]]:
    """Numbers for each controller of `scene`, as plain JSON values. Raises SceneError with all that cannot be done."""
    if not scene.controllers:
        return {}
    designer = Designer(assembly if assembly is not None else scene.assemble(), scene.sensors, scene.parameters)
    found: dict[str, dict[str, Any]] = {}
    faults: list[str] = []
    for name, section in scene.controllers.items():
        try:
            found[name] = DESIGNS.get(section.kind, _nothing)(designer, section)
        except ValueError as fault:
            faults.append(f"controllers.{name}.{fault}")
        except ArithmeticError as fault:  # sizes whose squares no number holds
            faults.append(f"controllers.{name}: its numbers cannot be computed for this rig: {fault.args[-1]}")
    if faults:
        raise SceneError(scene.name, faults)
    return found


class Designer:
    """The matrices of a rig as a controller's designer sees them: structure, contact, actuators, instruments."""

    def __init__(self, assembly: Assembly, sensors: Mapping[str, Any], parameters: Any) -> None:
        self.assembly, self.sensors, self.parameters = assembly, sensors, parameters
        self.system = assembly.system()
        self.nq = len(self.system.coordinates)
        self.contact = self.system.patches[0]

    @cached_property
    def structure(self) -> Array:
        """A [2 nq, 2 nq] of the linear structure without friction, over (x, v)."""
        s, nq = self.system, self.nq
        pull = (s.force + s.coupling)[:, : 2 * nq] - np.hstack([s.stiffness, s.damping])
        return np.block([[np.zeros((nq, nq)), np.eye(nq)], [np.linalg.solve(s.mass, pull)]])

    @cached_property
    def push(self) -> Array:
        """B [2 nq, patches] of the friction forces."""
        directions = np.array([p.direction for p in self.system.patches]).T
        return np.vstack([np.zeros_like(directions), np.linalg.solve(self.system.mass, directions)])

    @cached_property
    def frequency(self) -> float:
        """Lowest frequency of the structure [Hz]."""
        turning = np.abs(np.linalg.eigvals(self.structure))
        return float(min(w for w in turning if w > 1e-6 * turning.max()) / (2.0 * math.pi))

    def row(self, name: str) -> Array:
        """Output `name` as a row over (x, v, w); what does not move with the structure is left out."""
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
        return _tidy(scale)

    def settled(self, row: Array, actuator: str) -> float:
        """What a row over the states gains per unit of a command once the drive has settled."""
        system, first = self.system, self.system.one
        lags = system.signals[:, first:].copy()
        for limiter in (one for one in system.limiters if one.state >= first):
            lags[limiter.state - first] += limiter.gain * limiter.row[first:]
        given = self.assembly.inputs.get(actuator)
        change = 0.0
        if given is not None and given.state:
            change = propagated(row[first:], lags, SETTLED)[system.names.index(given.state) - first]
        if abs(change) < 1e-12:
            raise ValueError(f"drive: {actuator} does not move what this controller commands")
        return _tidy(change)

    def nominal(self, row: Array) -> float:
        """The value of a row over the states at the start, without dither."""
        return _tidy(float(self._undithered(row) @ self.system.start))

    def commanded(self, row: Array, actuator: str) -> dict[str, float]:
        """The value of a row at the start, and the command per unit of it."""
        return {"nominal": self.nominal(row), "drive_scale": 1.0 / self.settled(row, actuator)}

    def speed_scale(self, sensor: str) -> float:
        """Speed of the surface per unit of a sensor that follows the drive."""
        section = self.sensors[sensor]
        entries = self.assembly.outputs[section.reads].row
        seen = self._undithered(section.sensitivity * np.array([entries.get(n, 0.0) for n in self.system.names]))
        surface = self._undithered(self.contact.surface)
        scale = float(surface @ seen) / float(seen @ seen or 1.0)
        if not np.allclose(scale * seen, surface, rtol=1e-9, atol=0.0):
            raise ValueError(f"speed_sensor: {sensor} reads {section.reads}, which is not the speed of the surface")
        return _tidy(scale)

    def _undithered(self, row: Array) -> Array:
        shaken = [self.assembly.owners.get(name) == "dither" for name in self.system.names]
        return np.where(shaken, 0.0, row)

    @cached_property
    def inertia(self) -> float:
        """Mass that the contact feels along the friction force [kg]."""
        return _tidy(1.0 / float(self.contact.direction @ self.push[self.nq :, 0]))

    @cached_property
    def load(self) -> Array:
        """The normal force on the first patch, as a row over the states."""
        out: Array = np.sum([n.row for n in self.system.normals if n.patch == 0], axis=0)
        return out

    def observer(self, section: Any) -> dict[str, Any]:
        """The observer of a section's sensor for the contact velocity, at the period of its controller."""
        import control

        sensor = self.sensors[section.sensor]
        period = section.period * 1e-9
        if not sensor.instants.fit(section.period):
            raise ValueError(
                f"period: is {period:g} s; an observer needs a fresh sample each time, and {section.sensor} gives one "
                f"every {1e-9 * sensor.instants.period_ns:g} s"
            )
        nq, patches = self.nq, len(self.system.patches)
        turn = 2.0 * math.pi * self.frequency
        wander = section.unknown_force or WANDER * self.nominal(self.load)
        if wander <= 0.0:
            raise ValueError("unknown_force: is not stated, and there is no load at the start to take it from")
        model = np.block(
            [[self.structure, self.push], [np.zeros((patches, 2 * nq)), -self.frequency * np.eye(patches)]]
        )
        output, velocity = sensor.sensitivity * self.row(sensor.reads), self.contact_velocity
        size = self._sizes(wander, turn)
        moved = float(np.abs(output) @ size)
        if moved == 0.0:
            raise ValueError(f"sensor: {section.sensor} reads {sensor.reads}, which does not move with the structure")
        rest = self._rest(output)
        walk = np.zeros(len(size))  # noise of (x, v, w), in units of `size` squared per second
        walk[2 * nq :] = self.frequency
        if not rest.any():  # an accelerometer: a wrong zero would be integrated to a wrong velocity, so it is a state
            model = np.pad(model, (0, 1))
            model[-1, -1] = -ZERO_FORGET * self.frequency
            output, velocity, rest = np.append(output, 1.0), np.append(velocity, 0.0), np.append(rest, 0.0)
            size, walk = np.append(size, ZERO_WANDER * moved), np.append(walk, self.frequency)
        n = len(size)
        end = sensor.front_end()
        noise = max(math.hypot(end.noise, end.resolution / math.sqrt(12.0)), LEAST_NOISE * moved)

        scaled = model * size[None, :] / size[:, None]  # states of order one: the Riccati equation is well conditioned
        transition = control.c2d(control.ss(scaled, np.zeros((n, 1)), np.eye(n), 0), period).A
        seen = (output * size / moved)[None, :]
        spread, r = _gathered(scaled, np.diag(walk), period), np.array([[(noise / moved) ** 2]])
        _, p, _ = control.dlqe(transition, np.eye(n), seen, spread, r)
        gain = (p @ seen.T / (seen @ p @ seen.T + r)).ravel() * size / moved
        return {
            "transition": (transition * size[:, None] / size[None, :]).tolist(),
            "output": output.tolist(),
            "gain": gain.tolist(),
            "model": model.tolist(),
            "velocity": velocity.tolist(),
            "rest": rest.tolist(),
        }

    def _sizes(self, wander: float, turn: float) -> Array:
        """Orders of magnitude of (x, v, w) under an unknown force of size `wander`."""
        nq = self.nq
        speed = np.abs(self.push[nq:]).sum(axis=1) * wander / turn
        speed = np.maximum(speed, 1e-3 * speed.max())  # a coordinate that no patch touches moves with the others
        return np.concatenate([speed / turn, speed, np.full(len(self.system.patches), wander)])

    def _rest(self, output: Array) -> Array:
        """The state of a rig at rest per unit of the measurement; zero where the measurement does not tell."""
        nq = self.nq
        state = np.zeros(len(output))
        pull = -self.structure[nq:, :nq]
        if np.linalg.matrix_rank(pull) < nq:
            return state
        state[:nq] = np.linalg.solve(pull, self.push[nq:, 0])
        state[2 * nq] = 1.0
        seen = float(output @ state)
        return state / seen if abs(seen) > 1e-9 * float(np.abs(output) @ np.abs(state)) else np.zeros(len(output))


def _tidy(value: float) -> float:
    """Twelve digits: 0.06 m/s stays 0.06 m/s on its way through the matrices."""
    return float(f"{value:.12g}")


def _gathered(a: Array, q: Array, period: float) -> Array:
    """Covariance that noise of intensity q gathers within a period under x' = a x (Van Loan 1978)."""
    from scipy.linalg import expm

    n = len(a)
    both = expm(np.block([[-a, q], [np.zeros((n, n)), a.T]]) * period)
    gathered: Array = both[n:, n:].T @ both[:n, n:]
    return 0.5 * (gathered + gathered.T)


def _velocity(designer: Designer, section: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"frequency": designer.frequency}
    if section.velocity == "observed":
        found["observer"] = designer.observer(section)
    else:
        found["read_scale"] = designer.read_scale(section.sensor)
    return found


def _normal_force(designer: Designer, section: Any) -> dict[str, Any]:
    return _velocity(designer, section) | designer.commanded(designer.load, section.drive)


def _belt_velocity(designer: Designer, section: Any) -> dict[str, Any]:
    return _velocity(designer, section) | designer.commanded(designer.contact.surface, section.drive)


def _dither_sampled(designer: Designer, section: Any) -> dict[str, Any]:
    return dict(designer.commanded(designer.contact.surface, section.drive))


def _dither(designer: Designer, section: Any) -> dict[str, Any]:
    inputs = designer.assembly.inputs
    if GENERATOR not in inputs:
        raise ValueError("kind: commands a dither generator, and the scene has no [dither]")
    found: dict[str, Any] = {"frequency": inputs["dither.frequency"].value}
    found["read_scale"] = designer.read_scale(section.sensor)
    if inputs[GENERATOR].unit == "N":
        if not any("dither.sin" in row for row in designer.assembly.force.values()):
            raise ValueError("kind: searches a tangential dither; the generator of this scene shakes the load")
        found["force_per_hertz"] = 2.0 * math.pi * designer.inertia
    found["nominal"] = designer.nominal(designer.contact.surface)
    if section.speed_sensor is not None:
        found["speed_scale"] = designer.speed_scale(section.speed_sensor)
    return found


def _nothing(designer: Designer, section: Any) -> dict[str, Any]:
    return {}


DESIGNS = {
    "normal_force": _normal_force,
    "belt_velocity": _belt_velocity,
    "dither": _dither,
    "dither_sampled": _dither_sampled,
    "narrow_band": squeal.narrow_band,
    "shunt_tuner": squeal.tuner,
    "squeal_switch": squeal.heard,
}
