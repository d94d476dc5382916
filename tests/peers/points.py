"""A ring of 24 points on contact springs, which a travelling force opens and closes one after the other.

m y_i'' + d y_i' + c y_i + k (2 y_i - y_(i-1) - y_(i+1)) = max(-K y_i, 0) - F0 + A sin(omega t + 2 pi i / n)

For other Pythons: this file needs numpy alone until `ours` or `exact` is called.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

COUNT, MASS, DAMPING, CONTACT = 24, 0.01, 2.0, 1e5
PRESS, FORCE, OMEGA, SECONDS = 5.0, 12.0, 2.0 * math.pi * 100.0, 0.2
ANGLES = 2.0 * math.pi * np.arange(COUNT) / COUNT


def stiffness() -> Any:
    """The matrix of the springs to the frame and round the ring, without contacts [N/m]."""
    next_one = np.roll(np.eye(COUNT), 1, axis=0)
    return 1e4 * np.eye(COUNT) + 2e4 * (2.0 * np.eye(COUNT) - next_one - next_one.T)


@cache
def exact() -> float:
    """The height of the first point at the end, by a multistep method of variable order at 1e-12."""
    from scipy.integrate import solve_ivp

    none = np.zeros((COUNT, COUNT))
    linear = np.block([[none, np.eye(COUNT)], [-stiffness() / MASS, -DAMPING / MASS * np.eye(COUNT)]])

    def rates(t: float, state: Any) -> Any:
        out = linear @ state
        out[COUNT:] += (np.maximum(-CONTACT * state[:COUNT], 0.0) - PRESS + FORCE * np.sin(OMEGA * t + ANGLES)) / MASS
        return out

    end = solve_ivp(rates, (0.0, SECONDS), np.zeros(2 * COUNT), method="LSODA", rtol=1e-12, atol=1e-15)
    return float(end.y[0, -1])


def ours(step_ns: int, substeps: int) -> Any:
    """A function that runs once and returns the same height: a film of points in steps of `step_ns` / `substeps`."""
    from rig.model.assembly import Assembly
    from rig.model.film import Film
    from rig.motion.motion import Motion

    a, names = Assembly(title="ring of points"), tuple(f"y{i}" for i in range(COUNT))
    a.block(names, MASS * np.eye(COUNT), DAMPING * np.eye(COUNT), stiffness())
    a.signal("sine", {"cosine": OMEGA}, 0.0, "wave")
    a.signal("cosine", {"sine": -OMEGA}, 1.0, "wave")
    for name, angle in zip(names, ANGLES.tolist()):
        a.push(name, {"one": -PRESS, "sine": FORCE * math.cos(angle), "cosine": FORCE * math.sin(angle)})
    a.signal("slid", {"one": 1.0}, 0.0, "drive")
    rows, where = np.stack([-np.eye(COUNT), np.zeros((COUNT, COUNT))])[None], np.zeros(COUNT)
    a.film = Film(rows, "slid", np.array(CONTACT), np.array(CONTACT), np.array(0.3), where, where)
    system, ticks = a.system(), round(SECONDS * 1e9 / step_ns)
    motion = Motion(system, step_ns, "kick", substeps=substeps, with_energy=False, longest=ticks)

    def run() -> float:
        motion.restart(system.start)
        motion.advance(ticks)
        return float(motion.x[0])

    return run


def siconos(step: float) -> tuple[float, float]:
    """The same height and its processor time [s]: complementarity of gap and force, theta and gamma 1/2, Lemke."""
    import time

    import siconos.kernel as sk

    n = 2 * COUNT + 3  # states: heights, speeds, sine, cosine, one
    A = np.zeros((n, n))
    A[:COUNT, COUNT : 2 * COUNT] = np.eye(COUNT)
    A[COUNT : 2 * COUNT, :COUNT] = -stiffness() / MASS
    A[COUNT : 2 * COUNT, COUNT : 2 * COUNT] = -DAMPING / MASS * np.eye(COUNT)
    A[COUNT : 2 * COUNT, -3:] = (
        np.column_stack([FORCE * np.cos(ANGLES), FORCE * np.sin(ANGLES), np.full(COUNT, -PRESS)]) / MASS
    )
    A[-3, -2], A[-2, -3] = OMEGA, -OMEGA
    start = np.zeros(n)
    start[-2:] = 1.0
    body = sk.FirstOrderLinearTIDS(start, A)
    gaps, forces = np.eye(COUNT, n), np.zeros((n, COUNT))
    forces[COUNT : 2 * COUNT] = np.eye(COUNT) / MASS
    relation = sk.FirstOrderLinearTIR(gaps, forces)
    relation.setDPtr(np.eye(COUNT) / CONTACT)
    contact = sk.Interaction(sk.ComplementarityConditionNSL(COUNT), relation)
    world = sk.NonSmoothDynamicalSystem(0.0, SECONDS)
    world.insertDynamicalSystem(body)
    world.link(contact, body)
    steps = sk.EulerMoreauOSI(0.5)
    steps.setGamma(0.5)
    steps.setUseGamma(True)
    parts = sk.TimeDiscretisation(0.0, step), steps, sk.LCP()
    stepping, begin = sk.TimeStepping(world, *parts), time.process_time()
    for _ in range(round(SECONDS / step)):
        stepping.computeOneStep()
        stepping.nextStep()
    return float(body.x()[0]), time.process_time() - begin
