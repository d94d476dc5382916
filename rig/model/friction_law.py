"""Friction laws as a rig states them, and their packing for kernels (rig.solve.forces)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.solve.forces import COULOMB, FALLING, SEAL, SMOOTH, STRIBECK, TABLE, coefficient, coefficients, slope


@dataclass(frozen=True)
class Law:
    """A friction law: static coefficient, code of the law, and its numbers."""

    static: float
    code: int
    numbers: tuple[float, ...]

    @property
    def constant(self) -> bool:
        """Whether the coefficient does not depend on speed."""
        return self.code == COULOMB

    @property
    def sticks(self) -> bool:
        """Whether a contact with this law can stick."""
        return self.code != SMOOTH

    def mu(self, speed: float) -> float:
        """The coefficient at slip speed `speed` >= 0 [m/s]."""
        return float(coefficient(self.code, np.array(self.numbers), speed))

    def over(self, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
        """The coefficients at many slip speeds >= 0 [m/s]."""
        values = np.zeros(len(speeds))
        coefficients(self.code, np.array(self.numbers), speeds, values)
        return values

    def slope(self, speed: float) -> float:
        """The slope d mu / d speed [s/m] at `speed` > 0 [m/s]."""
        return float(slope(self.code, np.array(self.numbers), speed))


def coulomb(static: float, kinetic: float) -> Law:
    """One coefficient in slip, another one in stick."""
    return Law(static, COULOMB, (kinetic,))


def stribeck(static: float, dynamic: float, speed: float) -> Law:
    """Exponential decay from the static to the dynamic coefficient over `speed` [m/s]."""
    return Law(static, STRIBECK, (dynamic, static - dynamic, 1.0 / speed))


def falling(zero: float, slope: float, floor: float) -> Law:
    """Linear decrease with `slope` [s/m] from `zero` down to `floor`."""
    return Law(zero, FALLING, (zero, slope, floor))


def seal(mixed: float, decay: float, film: float, offset: float) -> Law:
    """Mixed friction that decays with `decay` [s/m], plus film friction `film` [(s/m)^0.5]; `offset` [m/s] > 0."""
    return Law(mixed + film * offset**0.5, SEAL, (mixed, decay, film, offset))


def smoothed(law: Law, scale: float) -> Law:
    """`law` as an odd and smooth function of the slip speed, which rises over `scale` [m/s]."""
    return Law(law.static, SMOOTH, (scale, float(law.code), *law.numbers))


def table(speeds: NDArray[np.float64], values: NDArray[np.float64], static: float) -> Law:
    """Monotone cubic through (speeds [m/s], values); constant beyond the ends."""
    from scipy.interpolate import PchipInterpolator

    cubic = PchipInterpolator(speeds, values)
    coefficients = cubic.c[::-1].T  # per interval c0 + c1 d + c2 d^2 + c3 d^3
    numbers = [float(len(speeds)), *speeds, *coefficients.ravel(), float(values[-1])]
    return Law(static, TABLE, tuple(float(v) for v in numbers))


def width(laws: tuple[Law, ...]) -> int:
    """The largest count of numbers that one of these laws has."""
    return max((len(law.numbers) for law in laws), default=1)


def pack(laws: tuple[Law, ...], width: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Codes [patch] and numbers [patch, width] for the kernels."""
    numbers = np.zeros((len(laws), width))
    for i, law in enumerate(laws):
        numbers[i, : len(law.numbers)] = law.numbers
    return np.array([law.code for law in laws], dtype=np.int64), numbers
