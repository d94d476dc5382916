"""A mass on a belt in the form for other solvers: slip as a right-hand side with an event, stick in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.scenes.scene import Scene

Array = NDArray[np.float64]
Slip = Callable[[float, float, float, Array], tuple[float, float] | None]
"""(t, x, v, sample times from t on) -> time and displacement where the slip speed comes back to zero, or None."""
SAMPLES = 1e-3  # s
BEGIN = 1e-5  # s


@dataclass(frozen=True)
class Oscillator:
    """m x'' + d x' + c x = mu(V - x') N in slip with x' < V; `scale` is 0 for Coulomb friction. Starts stuck at x."""

    mass: float
    damping: float
    stiffness: float
    load: float
    speed: float
    static: float
    kinetic: float
    scale: float
    x: float
    seconds: float

    @classmethod
    def of(cls, scene: Scene) -> Oscillator:
        """Return the oscillator of a belt scene."""
        p = scene.parameters
        b, f, start = p.body, p.friction, p.start  # type: ignore[attr-defined]
        speed = p.drive.speed  # type: ignore[attr-defined]
        kinetic, scale = (f.mu_kinetic, 0.0) if f.law == "coulomb" else (f.mu_dynamic, f.speed_scale)
        seconds = min((scene.duration_ns or 4_000_000_000) * 1e-9, 4.0)
        load = p.load.force  # type: ignore[attr-defined]
        return cls(
            b.mass, b.damping, b.stiffness, load, speed, f.mu_static, kinetic, scale, start.displacement, seconds
        )

    def friction(self) -> Callable[[float], float]:
        """Return the friction force in slip over velocity, fast in Python; smooth beyond V, where trial steps
        may end.
        """
        kinetic, more, speed = self.kinetic * self.load, (self.static - self.kinetic) * self.load, self.speed
        if not self.scale:
            return lambda v: kinetic
        slower, exp = 1.0 / self.scale, math.exp
        return lambda v: kinetic + more * exp(min((v - speed) * slower, 1.0))

    def acceleration(self) -> Callable[[float, float], float]:
        """Return the acceleration in slip over displacement and velocity."""
        mass, damping, stiffness = 1.0 / self.mass, self.damping, self.stiffness
        if not self.scale:
            force = self.kinetic * self.load
            return lambda x, v: (force - stiffness * x - damping * v) * mass
        friction = self.friction()
        return lambda x, v: (friction(v) - stiffness * x - damping * v) * mass

    def begun(self, x: float, v: float) -> tuple[float, float, float]:
        """Return time, displacement and velocity a little later, by series: for solvers that cannot start on an
        event.
        """
        a, h = self.acceleration(), BEGIN
        first = a(x, v)
        second = (a(x + v * h, v + first * h) - a(x - v * h, v - first * h)) / (2.0 * h)
        return h, x + h * (v + h * (first / 2.0 + h * second / 6.0)), v + h * (first + h * second / 2.0)

    @property
    def release(self) -> float:
        """The displacement at which a stuck mass is released."""
        return (self.static * self.load - self.damping * self.speed) / self.stiffness

    def run(self, slip: Slip) -> list[float]:
        """Return the times of the mode set changes with a peer's `slip`."""
        t, x, times = 0.0, self.x, list[float]()
        grid = np.arange(0.0, self.seconds + 0.5 * SAMPLES, SAMPLES)
        while True:
            leaves = t + max(self.release - x, 0.0) / self.speed
            stuck = grid[np.searchsorted(grid, t) : np.searchsorted(grid, leaves)]
            _ = x + self.speed * (stuck - t)  # the samples of stick
            if leaves >= self.seconds:
                return times
            times.append(leaves)
            ended = slip(leaves, self.release, self.speed, grid[np.searchsorted(grid, leaves, side="right") :])
            if ended is None or ended[0] >= self.seconds:
                return times
            t, x = ended
            times.append(t)
