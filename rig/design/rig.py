"""The quantities of a rig for the design step of a controller (`controllers.blocks.design.Rig`), from its matrices.

A Kalman observer that estimates the contact velocity from another measurement.

    x' = v,  M v' = -K x - D v + t w,  w' = -w/T + noise          y = row (x, v, v', w) + noise of the instrument

The friction force w of each patch is an unknown input: a random walk with the standard deviation `unknown_force` after
one period T of the structure, which decays with the time constant T. No friction law is used. For an instrument that
does not measure a displacement at rest (an accelerometer) the zero error is an additional state, because it could not
be distinguished from a motion.

The vibration modes of a sliding rig, and the residue of each mode from a command to a sensor.

A command u excites mode i of the sliding rig, and a sensor measures it, by

    xi_i' = lambda_i xi_i + r_i u,   y = 2 Re sum xi_i,   r_i = (c x_i)(y_i^H b) / (y_i^H x_i)

x_i, y_i: right and left eigenvector; b: input vector of u (with its lag); c: row of the sensor.
"""

from __future__ import annotations

import cmath
import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.design import Actuator, Feedback
from rig.design.designer import Designer
from rig.design.linearised import linear
from rig.design.sampled import sampled
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
WANDER = 0.5  # default random walk of the unknown force within one period, as a share of the load
ZERO_WANDER = 0.01  # random walk of the zero of an accelerometer within one period, as a share of the measurement
ZERO_FORGET = 0.03  # decay rate of the zero, as a share of that of the unknown force: a zero error lasts
LEAST_NOISE = 1e-4  # least noise, as a share of the measurement due to the unknown force: bounds the observer's speed


def observer(designer: Designer, section: Any) -> dict[str, Any]:
    """The observer numbers of a section's sensor for the contact velocity, at the period of its controller.

    Raises ValueError for a sensor that is too slow or does not measure the structure, and without a load to scale with.
    """
    import control

    sensor = designer.sensors[section.sensor]
    period = section.period * 1e-9
    if not sensor.instants.fit(section.period):
        raise ValueError(
            f"period: is {period:g} s; an observer needs a fresh sample each time, and {section.sensor} gives one "
            f"every {1e-9 * sensor.instants.period_ns:g} s"
        )
    nq, patches = designer.nq, len(designer.system.patches)
    turn = 2.0 * math.pi * designer.frequency
    wander = section.unknown_force or WANDER * designer.nominal(designer.load)
    if wander <= 0.0:
        raise ValueError("unknown_force: is not stated, and there is no load at the start to take it from")
    model = np.block(
        [[designer.structure, designer.push], [np.zeros((patches, 2 * nq)), -designer.frequency * np.eye(patches)]]
    )
    output, velocity = sensor.sensitivity * designer.row(sensor.reads), designer.contact_velocity
    size = _sizes(designer, wander, turn)
    moved = float(np.abs(output) @ size)
    if moved == 0.0:
        raise ValueError(f"sensor: {section.sensor} reads {sensor.reads}, which does not move with the structure")
    rest = _rest(designer, output)
    walk = np.zeros(len(size))  # noise of (x, v, w), in units of `size` squared per second
    walk[2 * nq :] = designer.frequency
    if not rest.any():  # an accelerometer: a zero error would be integrated to a velocity error, so it is a state
        model = np.pad(model, (0, 1))
        model[-1, -1] = -ZERO_FORGET * designer.frequency
        output, velocity, rest = np.append(output, 1.0), np.append(velocity, 0.0), np.append(rest, 0.0)
        size, walk = np.append(size, ZERO_WANDER * moved), np.append(walk, designer.frequency)
    n = len(size)
    end = sensor.front_end()
    noise = max(math.hypot(end.noise, end.resolution / math.sqrt(12.0)), LEAST_NOISE * moved)

    scaled = model * size[None, :] / size[:, None]  # states of order one: the Riccati equation is well conditioned
    transition = control.c2d(control.ss(scaled, np.zeros((n, 1)), np.eye(n), 0), period).A
    seen = (output * size / moved)[None, :]
    spread, r = _accumulated(scaled, np.diag(walk), period), np.array([[(noise / moved) ** 2]])
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


def _sizes(designer: Designer, wander: float, turn: float) -> Array:
    """Orders of magnitude of (x, v, w) under an unknown force of size `wander` [N]."""
    nq = designer.nq
    speed = np.abs(designer.push[nq:]).sum(axis=1) * wander / turn
    speed = np.maximum(speed, 1e-3 * speed.max())  # a coordinate without a patch moves with the others
    return np.concatenate([speed / turn, speed, np.full(len(designer.system.patches), wander)])


def _rest(designer: Designer, output: Array) -> Array:
    """The state of a rig at rest per unit of the measurement; zero where the measurement does not determine it."""
    nq = designer.nq
    state = np.zeros(len(output))
    pull = -designer.structure[nq:, :nq]
    if np.linalg.matrix_rank(pull) < nq:
        return state
    state[:nq] = np.linalg.solve(pull, designer.push[nq:, 0])
    state[2 * nq] = 1.0
    seen = float(output @ state)
    return state / seen if abs(seen) > 1e-9 * float(np.abs(output) @ np.abs(state)) else np.zeros(len(output))


def _accumulated(a: Array, q: Array, period: float) -> Array:
    """Covariance after one period of noise of intensity q under x' = a x (Van Loan 1978)."""
    from scipy.linalg import expm

    n = len(a)
    both = expm(np.block([[-a, q], [np.zeros((n, n)), a.T]]) * period)
    gathered: Array = both[n:, n:].T @ both[:n, n:]
    return 0.5 * (gathered + gathered.T)


Complex = NDArray[np.complex128]


class VibrationModes(NamedTuple):
    """Vibration modes of `rig` about steady sliding: eigenvalues [1/s], right eigenvectors [moving state, mode]."""

    rig: Steady
    values: Complex
    right: Complex


def vibration_modes(designer: Designer) -> VibrationModes:
    """The vibration modes of a designer's rig."""
    rig = steady(designer.system, sliding_key(designer.system))
    values, right = np.linalg.eig(rig.A[np.ix_(rig.moving, rig.moving)])
    return VibrationModes(rig, values, right)


def residues(designer: Designer, vibration: VibrationModes, sensor: str, drive: str) -> Complex:
    """The residue r_i [mode] of each mode from the command `drive` to the sensor.

    Raises ValueError for an actuator that is not a state of the rig.
    """
    given = designer.assembly.inputs.get(drive)
    if given is None or not given.state:
        raise ValueError(f"drive: {drive} is not an actuator whose command is a state of the rig")
    command, A, moving = designer.system.names.index(given.state), vibration.rig.A, vibration.rig.moving
    rest = np.setdiff1d(np.arange(len(A)), [*moving, command])
    left = np.linalg.inv(vibration.right)
    read = np.zeros(designer.system.n)
    over = designer.row(designer.sensors[sensor].reads)[: 2 * designer.nq]
    read[: len(over)] = over
    seen = read[moving] @ vibration.right
    pushed = np.empty(len(vibration.values), dtype=complex)
    for i, s in enumerate(vibration.values):  # the lag between command and force, at the eigenvalue of the mode
        behind = np.linalg.solve(s * np.eye(len(rest)) - A[np.ix_(rest, rest)], A[rest, command])
        pushed[i] = left[i] @ (A[moving, command] + A[np.ix_(moving, rest)] @ behind)
    return np.asarray(seen * pushed)


class DesignRig:
    """The rig of a `Designer`. The protocol `controllers.blocks.design.Rig` describes each method."""

    def __init__(self, designer: Designer) -> None:
        self._designer = designer
        self.read_scale, self.speed_scale = designer.read_scale, designer.speed_scale

    @cached_property
    def _vibration_modes(self) -> VibrationModes:
        return vibration_modes(self._designer)

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
        actuator = self._designer.assembly.inputs.get(name)
        return None if actuator is None else Actuator(actuator.unit, actuator.value, actuator.low, actuator.high)

    def value(self, key: str) -> Any:
        """See `Rig.value`."""
        parameter = self._designer.parameters
        for part in key.split("."):
            parameter = getattr(parameter, part, None)
        return parameter

    def pushed_by(self, state: str) -> bool:
        """See `Rig.pushed_by`."""
        return any(state in row for row in self._designer.assembly.force.values())

    def frequencies(self) -> list[float]:
        """See `Rig.frequencies`."""
        return sorted(float(v.imag) / (2.0 * math.pi) for v in self._vibration_modes.values if v.imag > 0.0)

    def modes(self, sensor: str, drive: str, delay: float, low: float, high: float) -> tuple[Complex, Complex]:
        """See `Rig.modes`."""
        vibration = self._vibration_modes
        hertz = vibration.values.imag / (2.0 * math.pi)
        near = (low < hertz) & (hertz < high) & (vibration.values.imag > 0.0)
        values, end = vibration.values[near], self._designer.sensors[sensor].front_end()
        share = residues(self._designer, vibration, sensor, drive)[near]
        path = [complex(end.response(s) * cmath.exp(-s * delay)) for s in values]
        return values, share * np.array(path, complex)

    def closed(self, controller: Feedback, sensor: str, delay: float) -> tuple[float, float]:
        """See `Rig.closed`."""
        designer, section = self._designer, self._designer.sensors[sensor]
        plant = linear(designer.assembly, self._vibration_modes.rig)
        model = sampled(plant, controller, section.reads, section.front_end(), round(delay * 1e9))
        z = np.linalg.eigvals(model.closed())
        worst = z[np.argmax(np.abs(z))]
        rate = math.log(abs(worst)) / model.period
        return rate, abs(cmath.phase(worst)) / (2.0 * math.pi * model.period)
