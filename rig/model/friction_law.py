"""Friction laws as a rig states them, and their packing for kernels (rig.solve.forces)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import PartError
from rig.solve.forces import (
    COULOMB,
    FALLING,
    FORMULA,
    MEMORY,
    SEAL,
    SMOOTH,
    STRIBECK,
    TABLE,
    coefficient_at,
    coefficients,
    slope_at,
)

Array = NDArray[np.float64]
_Function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p, ctypes.c_double, ctypes.c_double] + [ctypes.c_void_p] * 2)
_SLOW = np.geomspace(1e-6, 1.0, 25)  # m/s; slip speeds at which the largest coefficient of steady slip is looked for
_ROUNDS = 80  # most steps of the search for steady slip
_FIRST = 1e-9  # s: the first of these steps
_LONGER = 5.0  # factor of the next step
FASTEST = 100.0
"""Slip speed up to which a law from elsewhere has to be finite [m/s]."""


@dataclass(frozen=True)
class InternalState:
    """A state of a law with memory. `along`: it changes its sign with the direction of slip, as a deflection does."""

    name: str
    unit: str
    start: float = 0.0
    along: bool = False


@dataclass(frozen=True)
class Formula:
    """The compiled functions of a law, which kernels call by their addresses.

    Both are C functions void(double *p, double w, double N, double *z, double *out) of the numbers p, the slip speed
    w >= 0 [m/s], the load N [N] and the m states z in the direction of slip.

    values  out[0] = mu, out[1 + i] = rate of state i, out[1 + m] = energy stored in the contact [J]
    slopes  out[m + 1, m + 2]: derivatives of mu and of the rates over w, N and each state

    `sticks`: the contact sticks truly, up to mu at w = 0; otherwise it has presliding. `keeps`: what has to stay alive
    while the functions are called.
    """

    values: int
    slopes: int
    states: tuple[InternalState, ...] = ()
    sticks: bool = True
    keeps: Any = field(default=None, compare=False, repr=False)

    def evaluate(self, numbers: Sequence[float], w: float, N: float, z: Array) -> tuple[Array, Array]:
        """`values` [m + 2] and `slopes` [m + 1, m + 2] at one point."""
        m = len(self.states)
        p = np.array(numbers, dtype=np.float64)
        states = np.ascontiguousarray(z, dtype=np.float64)
        values = np.zeros(m + 2)
        slopes = np.zeros((m + 1, m + 2))
        for address, out in ((self.values, values), (self.slopes, slopes)):
            _Function(address)(p.ctypes.data, w, N, states.ctypes.data, out.ctypes.data)
        return values, slopes

    def steady(self, numbers: Sequence[float], w: float, N: float) -> Array:
        """The states in steady slip at the speed w > 0 [state]: from their start, by implicit steps in time that grow.

        Newton's method alone does not leave the elastic range, where the rate does not depend on the state.
        """
        z = np.array([state.start for state in self.states])
        step = _FIRST
        for _ in range(_ROUNDS):
            values, slopes = self.evaluate(numbers, w, N, z)
            change = np.linalg.solve(np.eye(len(z)) / step - slopes[1:, 2:], values[1:-1])
            z = z + change
            step = step * _LONGER
            if step > 1.0 and np.all(np.abs(change) <= 1e-15 * np.abs(z)):
                break
        return z


@dataclass(frozen=True)
class Origin:
    """Where a law from elsewhere comes from, for messages.

    law     file, name and values
    places  lines of its formulas: name -> the end of the name in a message, such as " (line 25)"
    """

    law: str
    places: Mapping[str, str]


@dataclass(frozen=True)
class Law:
    """A friction law: static coefficient, code of the law, its numbers, and for FORMULA and MEMORY its functions.

    `backward`: the law of slip in negative direction, if it is another one. `origin`: of a law from elsewhere. The
    methods of such a law raise PartError for a value that is not finite at a slip speed up to `FASTEST`.
    """

    static: float
    code: int
    numbers: tuple[float, ...]
    formula: Formula | None = None
    backward: Law | None = None
    origin: Origin | None = field(default=None, compare=False)

    def towards(self, direction: float) -> Law:
        """The law of slip in this direction, and of friction forces of this sign in stick."""
        return self.backward if direction < 0.0 and self.backward is not None else self

    @property
    def directions(self) -> tuple[Law, ...]:
        """The laws of both directions; one if they are the same."""
        return (self,) if self.backward is None else (self, self.backward)

    @property
    def states(self) -> tuple[InternalState, ...]:
        """The internal states of a law with memory."""
        return self.formula.states if self.formula is not None else ()

    @property
    def presliding(self) -> bool:
        """Whether a contact with this law deflects elastically instead of sticking."""
        return self.formula is not None and not self.formula.sticks

    @property
    def constant(self) -> bool:
        """Whether the coefficient does not depend on speed."""
        return self.code == COULOMB

    @property
    def sticks(self) -> bool:
        """Whether a contact with this law can stick."""
        return self.code != SMOOTH and not self.presliding

    def mu(self, speed: float, load: float | None = None) -> float:
        """The coefficient at slip speed `speed` >= 0 [m/s]; of a law with memory that of steady slip under `load` [N].

        Raises ValueError for a law with memory without a load: its steady slip may depend on it.
        """
        if self.states:
            mu = float(self._in_steady_slip(speed, load)[0][0])
        else:
            mu = float(coefficient_at(self.code, self.row(), speed))
        self._require_finite("mu", mu, speed)
        return mu

    def at_rest(self, load: float) -> float:
        """The coefficient at which a contact at rest begins to slide under `load` [N].

        With memory: while the internal states are those of the start. Of a contact that deflects or creeps instead of
        sticking: the largest coefficient of steady slip.
        """
        if self.presliding:
            return float(self.over(_SLOW, load).max())
        if not self.states:
            return self.static
        return float(self.at_once(np.zeros(1), load, np.array([state.start for state in self.states]))[0][0])

    def over(self, speeds: NDArray[np.float64], load: float | None = None) -> NDArray[np.float64]:
        """The coefficients at many slip speeds >= 0 [m/s], as `mu`."""
        if self.states:
            return np.array([self.mu(speed, load) for speed in speeds.tolist()])
        values = np.zeros(len(speeds))
        coefficients(self.code, self.row(), speeds, values)
        if self.origin is not None and not np.isfinite(values).all():
            for speed, mu in zip(speeds.tolist(), values.tolist()):
                self._require_finite("mu", mu, speed)
        return values

    def slope(self, speed: float, load: float | None = None) -> float:
        """The slope d mu / d speed [s/m] at `speed` > 0 [m/s]; of a law with memory along steady slip under `load` [N].

        Raises ValueError as `mu`.
        """
        if self.states:
            d = self._in_steady_slip(speed, load)[1]
            self._require_finite("slopes", float(d.sum()), speed)
            return float(d[0, 0] - d[0, 2:] @ np.linalg.lstsq(d[1:, 2:], d[1:, 0], rcond=None)[0])
        change = float(slope_at(self.code, self.row(), speed))
        self._require_finite("slope", change, speed)
        return change

    def tangent(self) -> Callable[[float, float], tuple[float, float]]:
        """`mu` and `slope` together, as a function of slip speed and load that is called many times."""
        if self.formula is not None:
            return lambda speed, load: (self.mu(speed, load), self.slope(speed, load))
        code = self.code
        row = self.row()
        return lambda speed, _: (float(coefficient_at(code, row, speed)), float(slope_at(code, row, speed)))

    def steady(self, speed: float, N: float) -> Array:
        """The internal states in steady slip at `speed` > 0 [m/s] under the load N [N], see `Formula.steady`."""
        assert self.formula is not None
        try:
            z = self.formula.steady(self.numbers, speed, N)
        except np.linalg.LinAlgError:
            if self.origin is None:
                raise
            z = np.full(len(self.states), np.nan)
        self._require_finite("a state in steady slip", float(z.sum()), speed)
        return z

    def fault(self, speed: float, N: float, z: Array) -> str:
        """What of a law from elsewhere is not finite at a slip speed, a load and internal states; "" if all is.

        `speed` [m/s], at least 0; N: load [N]; z: internal states in the direction of slip [state].
        """
        if self.origin is None or self.formula is None or not 0.0 <= speed <= FASTEST:
            return ""
        values, slopes = self.formula.evaluate(self.numbers, speed, N, z)
        states = "".join(f", {state.name} = {value:.6g}" for state, value in zip(self.states, z.tolist()))
        under = f", N = {N:.6g} N" if isfinite(N) else ""  # the load may depend on this friction force
        where = f"w = {speed:.6g} m/s{under}{states}"
        for what, value in zip(["mu", *["rates"] * len(self.states), "stored"], values.tolist()):
            if not isfinite(value):
                return self._not_finite(what, value, where)
        wrong = slopes[~np.isfinite(slopes)]
        return self._not_finite("slopes" if self.states else "slope", wrong[0], where) if wrong.size else ""

    def at_once(self, speeds: NDArray[np.float64], load: float, states: Array) -> tuple[Array, Array]:
        """Coefficients and slopes [s/m] at slip speeds >= 0 [m/s] as long as the internal states keep these values.

        They are what a contact feels that changes its speed faster than the memory of its law fades. `load` [N]:
        without influence for a law without memory.
        """
        if self.formula is None or not self.states:
            return self.over(speeds), np.array([self.slope(speed) for speed in speeds.tolist()])
        points = [self.formula.evaluate(self.numbers, speed, load, states) for speed in speeds.tolist()]
        return np.array([values[0] for values, _ in points]), np.array([slopes[0, 0] for _, slopes in points])

    def row(self, first: int = 0, rate: int = 0) -> Array:
        """The numbers as kernels read them. `first`, `rate`: indices of the first internal state, and of its rate."""
        if self.formula is None:
            return np.array(self.numbers)
        f = self.formula
        along = [float(state.along) for state in self.states]
        return np.array([f.values, f.slopes, len(along), first, rate, *along, *self.numbers], dtype=np.float64)

    def _in_steady_slip(self, speed: float, load: float | None) -> tuple[Array, Array]:
        """Values and slopes of the formula of a law with memory, see `Formula.evaluate`."""
        assert self.formula is not None
        if load is None:
            raise ValueError("the steady slip of a friction law with memory depends on the load: state it")
        states = self.steady(speed, load)
        return self.formula.evaluate(self.numbers, speed, load, states)

    def _require_finite(self, what: str, value: float, speed: float) -> None:
        if self.origin is not None and not isfinite(value) and 0.0 <= speed <= FASTEST:
            raise PartError(self._not_finite(what, value, f"w = {speed:.6g} m/s"))

    def _not_finite(self, what: str, value: float, where: str) -> str:
        assert self.origin is not None
        named = f"{what}{self.origin.places.get(what, '')}"
        return f"{self.origin.law}: {named} is {value:g} at {where}; it must be finite from 0 to {FASTEST:g} m/s"


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
    return Law(law.static, SMOOTH, (scale, float(law.code), *law.row().tolist()))


def table(speeds: NDArray[np.float64], values: NDArray[np.float64], static: float) -> Law:
    """Monotone cubic through (speeds [m/s], values); constant beyond the ends."""
    from scipy.interpolate import PchipInterpolator

    cubic = PchipInterpolator(speeds, values)
    coefficients = cubic.c[::-1].T  # per interval c0 + c1 d + c2 d^2 + c3 d^3
    numbers = [float(len(speeds)), *speeds, *coefficients.ravel(), float(values[-1])]
    return Law(static, TABLE, tuple(float(v) for v in numbers))


def from_formula(static: float, numbers: Sequence[float], formula: Formula, origin: Origin | None = None) -> Law:
    """A law from the compiled functions of a file."""
    return Law(static, MEMORY if formula.states else FORMULA, tuple(numbers), formula, origin=origin)


def width(laws: Iterable[Law]) -> int:
    """The largest count of numbers that one of these laws has."""
    return max((len(law.row()) for law in laws), default=1)


def pack(
    laws: Sequence[Law], places: Sequence[tuple[int, int]], width: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Codes [patch] and numbers [patch, width] of the laws of the patches for the kernels; `places` as in Law.row."""
    numbers = np.zeros((len(laws), width))
    for p, law in enumerate(laws):
        row = law.row(*places[p])
        numbers[p, : len(row)] = row
    return np.array([law.code for law in laws], dtype=np.int64), numbers
