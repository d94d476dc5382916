"""A Kalman observer that estimates the contact velocity from another measurement.

    x' = v,  M v' = -K x - D v + t w,  w' = -w/T + noise          y = row (x, v, v', w) + noise of the instrument

The friction force w of each patch is an unknown input: a random walk with the standard deviation `unknown_force` after
one period T of the structure, which decays with the time constant T. No friction law is used. For an instrument that
does not measure a displacement at rest (an accelerometer) the zero error is an additional state, because it could not
be distinguished from a motion.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.design.designer import Designer

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
