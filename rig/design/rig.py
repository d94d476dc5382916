"""The quantities of a rig for the design step of a controller (`controllers.blocks.design.Rig`), from its matrices.

A Kalman observer estimates the contact velocity from another measurement.

    x' = v,  M v' = -K x - D v + t w,  w' = -w/T + noise          y = row (x, v, v', w) + noise of the instrument

The friction force w of each patch is an unknown input: a random walk with the standard deviation `unknown_force` after
one period T of the structure, which decays with the time constant T. No friction law is used. For an instrument that
does not measure a displacement at rest (an accelerometer) the zero error is an additional state, because it could not
be distinguished from a motion.

A command u excites vibration mode i of the sliding rig, and a sensor measures it, by

    xi_i' = lambda_i xi_i + r_i u,   y = 2 Re sum xi_i,   r_i = (c x_i)(y_i^H b) / (y_i^H x_i)

x_i, y_i: right and left eigenvector; b: input vector of u (with its lag); c: row of the sensor.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.design import Actuator, Feedback
from rig.controllers.blocks.observer import propagated
from rig.design.linearised import linear
from rig.design.sampled_loops import ControlLoop, sampled
from rig.model.assembly import Assembly
from rig.model.system import Patch
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
SETTLED = 100.0  # s; longer than the settling time of any lag of a drive
WANDER = 0.5  # default random walk of the unknown force within one period, as a share of the load
ZERO_WANDER = 0.01  # random walk of the zero of an accelerometer within one period, as a share of the measurement
ZERO_FORGET = 0.03  # decay rate of the zero, as a share of that of the unknown force: a zero error lasts
LEAST_NOISE = 1e-4  # least noise, as a share of the measurement due to the unknown force: bounds the observer's speed


class VibrationModes(NamedTuple):
    """Vibration modes of `rig` about steady sliding: eigenvalues [1/s], right eigenvectors [moving state, mode]."""

    rig: Steady
    values: Complex
    right: Complex


class DesignRig:
    """The matrices of a rig, and what a design step may know of them.

    The protocol `controllers.blocks.design.Rig` describes each public method. All raise ValueError if the rig does not
    have the quantity.
    """

    def __init__(self, assembly: Assembly, sensors: Mapping[str, Any], parameters: Any) -> None:
        self._assembly = assembly
        self._sensors = sensors
        self._parameters = parameters
        self._system = assembly.system()
        self._nq = len(self._system.coordinates)

    @cached_property
    def _contact(self) -> Patch:
        """The first friction contact. Raises ValueError for a rig without contact."""
        if not self._system.patches:
            raise ValueError("the rig has no friction contact")
        return self._system.patches[0]

    @cached_property
    def _structure(self) -> Array:
        """The matrix A [2 nq, 2 nq] of the linear structure without friction, over (x, v)."""
        s = self._system
        nq = self._nq
        pull = (s.force + s.coupling)[:, : 2 * nq] - np.hstack([s.stiffness, s.damping])
        return np.block([[np.zeros((nq, nq)), np.eye(nq)], [self._accelerated(pull)]])

    @cached_property
    def _push(self) -> Array:
        """The matrix B [2 nq, patch] of the friction forces."""
        directions = np.array([p.direction for p in self._system.patches]).reshape(-1, self._nq).T
        return np.vstack([np.zeros_like(directions), self._accelerated(directions)])

    def _accelerated(self, forces: Array) -> Array:
        """The accelerations by forces on the coordinates. Raises ValueError for a singular mass matrix."""
        try:
            return np.asarray(np.linalg.solve(self._system.mass, forces), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise ValueError("the mass matrix of the rig is singular; expected a mass of each coordinate") from None

    @cached_property
    def frequency(self) -> float:
        """See `Rig.frequency`."""
        turning = np.abs(np.linalg.eigvals(self._structure))
        return float(min(w for w in turning if w > 1e-6 * turning.max()) / (2.0 * math.pi))

    def _row(self, name: str) -> Array:
        """Output `name` as a row over (x, v, w), w: friction forces; other states are left out."""
        nq = self._nq
        patches = self._system.patches
        out = np.zeros(2 * nq + len(patches))
        accelerations = np.hstack([self._structure[nq:], self._push[nq:]])
        for entry, value in self._assembly.outputs[name].row.items():
            for i, coordinate in enumerate(self._system.coordinates):
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
    def _contact_velocity(self) -> Array:
        """The velocity of the body along the friction force, as a row over (x, v, w)."""
        out = np.zeros(2 * self._nq + len(self._system.patches))
        out[self._nq : 2 * self._nq] = self._contact.direction
        return out

    def read_scale(self, sensor: str) -> float:
        """See `Rig.read_scale`."""
        section = self._sensors[sensor]
        row = section.sensitivity * self._row(section.reads)
        scale = float(row @ self._contact_velocity) / float(row @ row or 1.0)
        if not np.allclose(scale * row, self._contact_velocity, rtol=1e-9, atol=0.0):
            raise ValueError(
                f"velocity: is 'measured', but {sensor} reads {section.reads}, which is not the velocity of the "
                "contact; expected 'observed', or a sensor of the velocity"
            )
        return _rounded(scale)

    def _settled_change(self, row: Array, actuator: str) -> float:
        """The change of a row over the states per unit of a command, after the drive has settled."""
        system = self._system
        first = self._system.one
        lags = system.signals[:, first:].copy()
        for limiter in (entry for entry in system.limiters if entry.state >= first):
            lags[limiter.state - first] += limiter.gain * limiter.row[first:]
        given = self._assembly.inputs.get(actuator)
        change = 0.0
        if given is not None and given.state:
            change = propagated(row[first:], lags, SETTLED)[system.names.index(given.state) - first]
        if abs(change) < 1e-12:
            raise ValueError(f"drive: {actuator} does not move what this controller commands")
        return _rounded(change)

    def _nominal(self, row: Array) -> float:
        """The value of a row over the states at the start, without dither."""
        return _rounded(float(self._undithered(row) @ self._system.start))

    def _commanded(self, row: Array, actuator: str) -> dict[str, float]:
        """`nominal`: the value of a row at the start; `drive_scale`: the command per unit of it."""
        return {"nominal": self._nominal(row), "drive_scale": 1.0 / self._settled_change(row, actuator)}

    def speed_scale(self, sensor: str) -> float:
        """See `Rig.speed_scale`."""
        section = self._sensors[sensor]
        entries = self._assembly.outputs[section.reads].row
        seen = self._undithered(section.sensitivity * np.array([entries.get(n, 0.0) for n in self._system.names]))
        surface = self._undithered(self._contact.surface)
        scale = float(surface @ seen) / float(seen @ seen or 1.0)
        if not np.allclose(scale * seen, surface, rtol=1e-9, atol=0.0):
            raise ValueError(f"speed_sensor: {sensor} reads {section.reads}, which is not the speed of the surface")
        return _rounded(scale)

    def _undithered(self, row: Array) -> Array:
        shaken = [self._assembly.owners.get(name) == "dither" for name in self._system.names]
        return np.where(shaken, 0.0, row)

    @cached_property
    def inertia(self) -> float:
        """See `Rig.inertia`."""
        return _rounded(1.0 / float(self._contact.direction @ self._push[self._nq :, 0]))

    @cached_property
    def _load(self) -> Array:
        """The normal force on the first contact, as a row over the states. Raises ValueError if there is none."""
        rows = [n.row for n in self._system.normals if n.patch == 0]
        if not rows:
            raise ValueError("the rig has no friction contact with a normal force")
        out: Array = np.sum(rows, axis=0)
        return out

    @property
    def surface_speed(self) -> float:
        """See `Rig.surface_speed`."""
        return self._nominal(self._contact.surface)

    def sample_period(self, sensor: str) -> float:
        """See `Rig.sample_period`."""
        return 1e-9 * float(self._sensors[sensor].instants.period_ns)

    def commands_load(self, actuator: str) -> dict[str, float]:
        """See `Rig.commands_load`."""
        return self._commanded(self._load, actuator)

    def commands_surface(self, actuator: str) -> dict[str, float]:
        """See `Rig.commands_surface`."""
        return self._commanded(self._contact.surface, actuator)

    def actuator(self, name: str) -> Actuator | None:
        """See `Rig.actuator`."""
        actuator = self._assembly.inputs.get(name)
        return None if actuator is None else Actuator(actuator.unit, actuator.value, actuator.low, actuator.high)

    def value(self, key: str) -> Any:
        """See `Rig.value`."""
        parameter = self._parameters
        for part in key.split("."):
            parameter = getattr(parameter, part, None)
        return parameter

    def pushed_by(self, state: str) -> bool:
        """See `Rig.pushed_by`."""
        return any(state in row for row in self._assembly.force.values())

    def observer(self, section: Any) -> dict[str, Any]:
        """See `Rig.observer`: the numbers at the period of the section's controller.

        Raises ValueError for a sensor that is too slow or does not measure the structure, and without a load to scale
        with.
        """
        import control

        sensor = self._sensors[section.sensor]
        period = section.period * 1e-9
        if not sensor.instants.fit(section.period):
            raise ValueError(
                f"period: is {period:g} s; an observer needs a fresh sample each time, and {section.sensor} gives one "
                f"every {1e-9 * sensor.instants.period_ns:g} s"
            )
        nq = self._nq
        patches = len(self._system.patches)
        turn = 2.0 * math.pi * self.frequency
        wander = section.unknown_force or WANDER * self._nominal(self._load)
        if wander <= 0.0:
            raise ValueError("unknown_force: is not stated, and there is no load at the start to take it from")
        model = np.block(
            [[self._structure, self._push], [np.zeros((patches, 2 * nq)), -self.frequency * np.eye(patches)]]
        )
        output = sensor.sensitivity * self._row(sensor.reads)
        velocity = self._contact_velocity
        size = self._sizes(wander, turn)
        moved = float(np.abs(output) @ size)
        if moved == 0.0:
            raise ValueError(f"sensor: {section.sensor} reads {sensor.reads}, which does not move with the structure")
        rest = self._rest(output)
        walk = np.zeros(len(size))  # noise of (x, v, w), in units of `size` squared per second
        walk[2 * nq :] = self.frequency
        if not rest.any():  # an accelerometer: a zero error would be integrated to a velocity error, so it is a state
            model = np.pad(model, (0, 1))
            model[-1, -1] = -ZERO_FORGET * self.frequency
            output = np.append(output, 1.0)
            velocity = np.append(velocity, 0.0)
            rest = np.append(rest, 0.0)
            size = np.append(size, ZERO_WANDER * moved)
            walk = np.append(walk, self.frequency)
        n = len(size)
        end = sensor.front_end()
        noise = max(math.hypot(end.noise, end.resolution / math.sqrt(12.0)), LEAST_NOISE * moved)

        scaled = model * size[None, :] / size[:, None]  # states of order one: the Riccati equation is well conditioned
        continuous = control.ss(scaled, np.zeros((n, 1)), np.eye(n), 0)
        transition = control.c2d(continuous, period).A
        seen = (output * size / moved)[None, :]
        spread = _accumulated(scaled, np.diag(walk), period)
        r = np.array([[(noise / moved) ** 2]])
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
        """Orders of magnitude of (x, v, w) under an unknown force of size `wander` [N]."""
        nq = self._nq
        speed = np.abs(self._push[nq:]).sum(axis=1) * wander / turn
        speed = np.maximum(speed, 1e-3 * speed.max())  # a coordinate without a patch moves with the others
        return np.concatenate([speed / turn, speed, np.full(len(self._system.patches), wander)])

    def _rest(self, output: Array) -> Array:
        """The state of a rig at rest per unit of the measurement; zero where the measurement does not determine it."""
        nq = self._nq
        state = np.zeros(len(output))
        pull = -self._structure[nq:, :nq]
        if np.linalg.matrix_rank(pull) < nq:
            return state
        state[:nq] = np.linalg.solve(pull, self._push[nq:, 0])
        state[2 * nq] = 1.0
        seen = float(output @ state)
        return state / seen if abs(seen) > 1e-9 * float(np.abs(output) @ np.abs(state)) else np.zeros(len(output))

    @cached_property
    def _vibration(self) -> VibrationModes:
        rig = steady(self._system, sliding_key(self._system))
        return VibrationModes(rig, *np.linalg.eig(rig.A[np.ix_(rig.moving, rig.moving)]))

    def frequencies(self) -> list[float]:
        """See `Rig.frequencies`."""
        return sorted(float(v.imag) / (2.0 * math.pi) for v in self._vibration.values if v.imag > 0.0)

    def modes(self, sensor: str, drive: str, delay: float, low: float, high: float) -> tuple[Complex, Complex]:
        """See `Rig.modes`."""
        values = self._vibration.values
        hertz = values.imag / (2.0 * math.pi)
        near = (low < hertz) & (hertz < high) & (values.imag > 0.0)
        values = values[near]
        end = self._sensors[sensor].front_end()
        path = [complex(end.response(s) * cmath.exp(-s * delay)) for s in values]
        return values, self._residues(sensor, drive)[near] * np.array(path, complex)

    def _residues(self, sensor: str, drive: str) -> Complex:
        """The residue r_i [mode] of each mode from the command `drive` to the sensor.

        Raises ValueError for an actuator that is not a state of the rig.
        """
        given = self._assembly.inputs.get(drive)
        if given is None or not given.state:
            raise ValueError(f"drive: {drive} is not an actuator whose command is a state of the rig")
        rig, values, right = self._vibration
        command = self._system.names.index(given.state)
        A = rig.A
        moving = rig.moving
        rest = np.setdiff1d(np.arange(len(A)), [*moving, command])
        left = np.linalg.inv(right)
        read = np.zeros(self._system.n)
        over = self._row(self._sensors[sensor].reads)[: 2 * self._nq]
        read[: len(over)] = over
        seen = read[moving] @ right
        pushed = np.empty(len(values), dtype=complex)
        for i, s in enumerate(values):  # the lag between command and force, at the eigenvalue of the mode
            lag = s * np.eye(len(rest)) - A[np.ix_(rest, rest)]
            behind = np.linalg.solve(lag, A[rest, command])
            pushed[i] = left[i] @ (A[moving, command] + A[np.ix_(moving, rest)] @ behind)
        return np.asarray(seen * pushed)

    def closed(self, controller: Feedback, sensor: str, delay: float) -> tuple[float, float]:
        """See `Rig.closed`."""
        section = self._sensors[sensor]
        plant = linear(self._assembly, self._vibration.rig)
        model = sampled(plant, ControlLoop(controller, section.reads, section.front_end(), round(delay * 1e9)))
        z = np.linalg.eigvals(model.closed())
        worst = z[np.argmax(np.abs(z))]
        rate = math.log(abs(worst)) / model.period
        return rate, abs(cmath.phase(worst)) / (2.0 * math.pi * model.period)


def _accumulated(a: Array, q: Array, period: float) -> Array:
    """Covariance after one period of noise of intensity q under x' = a x (Van Loan 1978)."""
    from scipy.linalg import expm

    n = len(a)
    both = expm(np.block([[-a, q], [np.zeros((n, n)), a.T]]) * period)
    gathered: Array = both[n:, n:].T @ both[:n, n:]
    return 0.5 * (gathered + gathered.T)


def _rounded(value: float) -> float:
    """The value rounded to twelve digits, so that 0.06 m/s stays 0.06 m/s after the arithmetic with matrices."""
    return float(f"{value:.12g}")
