"""What is designed and what is not known: the free values of a design, and the box of rigs that it has to hold for.

Both are unit cubes. A design is x [free value], from the low end of each range (0) to its high end (1). A rig is u
[uncertain value], likewise over the box that was stated. Coordinates beyond 0 and 1 continue both linearly, so that a
wider box, and a design outside of the ranges, need no box of their own.

Values of a rig are errors of the rig that nobody knows of; values of a design are known to its controllers
(rig.analysis.robust.growth).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.analysis.studies.factors import IDENTIFIED, Distribution, Identified, drawn
from rig.scenes.axis import Axis

Array = NDArray[np.float64]
TAIL = 0.00135
"""Share of a distribution that the box leaves out on each side: three deviations of a normal one."""
_EDGE = 1e-12  # the nearest that a share comes to 0 and 1: a normal distribution has no value there


@dataclass(frozen=True)
class Uncertain:
    """One uncertain value: `axis.values` are its two ends (SI) at the scene's own value `nominal`.

    `ends`: the deviations from the nominal value, as a share of it if `relative`. `free`: it is the tolerance of a
    value that is designed, and the deviations are from the design. `step`: it takes multiples of this [s]; 0: all
    values. `given`: its distribution, if it has one.
    """

    axis: Axis
    nominal: float
    ends: tuple[float, float]
    relative: bool = False
    free: bool = False
    step: float = 0.0
    given: Distribution | Identified | None = None

    @property
    def key(self) -> str:
        """Dotted key of the value."""
        return self.axis.key

    @property
    def centre(self) -> float:
        """The coordinate of the nominal value in the cube; 0 for a box without width."""
        low, high = self.ends
        return -low / (high - low) if high > low else 0.0

    def deviation(self, share: float) -> float:
        """The deviation from the nominal value at a coordinate."""
        low, high = self.ends
        return low + (high - low) * share

    def value(self, share: float, design: float | None) -> float:
        """The value (SI) at a coordinate, for the value that the `design` gives it; None: that of the scene."""
        centre = self.nominal if design is None else design
        deviation = self.deviation(share)
        value = centre * (1.0 + deviation) if self.relative else centre + deviation
        return max(round(value / self.step), 0) * self.step if self.step else value

    def frames(self, low: float, high: float) -> int:
        """The number of steps between two coordinates."""
        return round((self.ends[1] - self.ends[0]) / self.step * float(high - low))

    def text(self, low: float = 0.0, high: float = 1.0) -> str:
        """The range between two coordinates as text: "+-2 %", or its two ends."""
        if self.given is not None and (low, high) == (0.0, 1.0):
            return str(self.given)
        if not (self.relative or self.free):
            return " to ".join(map(self.axis.text, sorted([self.value(low, None), self.value(high, None)])))
        scale, unit = (0.01, "%") if self.relative else (self.axis.scale, self.axis.shown_unit)
        first, last = self.deviation(low) / scale, self.deviation(high) / scale
        even = math.isclose(first, -last, rel_tol=1e-9)
        return f"{f'+-{last:.4g}' if even else f'{first:.4g} to {last:.4g}'} {unit}".rstrip()


@dataclass(frozen=True)
class Box:
    """The free values of a design and the uncertain ones of a rig."""

    free: tuple[Axis, ...]
    uncertain: tuple[Uncertain, ...]

    @property
    def keys(self) -> list[str]:
        """The keys of the uncertain values."""
        return [value.key for value in self.uncertain]

    @property
    def centre(self) -> Array:
        """The rig with nominal values [uncertain]; 0 or 1 of a value whose range leaves it out."""
        return np.clip([value.centre for value in self.uncertain], 0.0, 1.0)

    def design(self, x: Sequence[float] | Array) -> dict[str, float]:
        """The free values (SI) of design x [free] by key."""
        values = {}
        for axis, share in zip(self.free, x):
            low, high = axis.values
            values[axis.key] = float(high if share == 1.0 else low + (high - low) * share)
        return values

    def at(self, design: Mapping[str, float]) -> Array:
        """The coordinates x [free] of free values (SI) by key."""
        ends = [(design[axis.key], *axis.values) for axis in self.free]
        return np.array([(value - low) / (high - low) for value, low, high in ends], dtype=np.float64)

    def rig(self, design: Mapping[str, float], u: Sequence[float] | Array) -> dict[str, float]:
        """The uncertain values (SI) of rig u [uncertain] by key, about the values of a `design`."""
        return {value.key: value.value(float(share), design.get(value.key)) for value, share in zip(self.uncertain, u)}

    def draws(self, chance: np.random.Generator, count: int) -> Array:
        """Random rigs [count, uncertain] of the box: as distributed where a distribution is stated, else evenly.

        Those of a tail are moved to the end of the box.
        """
        u = np.clip(chance.random((count, len(self.uncertain))), _EDGE, 1.0 - _EDGE)
        given = {i: value.given for i, value in enumerate(self.uncertain) if value.given is not None}
        if given:
            axes = [self.uncertain[i].axis for i in given]
            first, last = np.array([ends_of(each) for each in given.values()]).T
            low, high = np.array([axis.values for axis in axes]).T
            shares = first + (last - first) * u[:, [*given]]
            values = drawn([*given.values()], [axis.unit for axis in axes], shares)
            u[:, [*given]] = np.clip((values - low) / (high - low), 0.0, 1.0)
        return u


@dataclass(frozen=True)
class Limit:
    """A limit `slope` x + `over` <= 0 of design x [free], in units of the largest sum of its terms over the ranges.

    `text`: as its user states it.
    """

    text: str
    slope: Array
    over: float

    def excess(self, x: Array) -> float:
        """How far a design is beyond the limit; at most 0 if it keeps it."""
        return float(self.slope @ x) + self.over


def ends_of(given: Distribution | Identified, tails: bool = False) -> tuple[float, float]:
    """Return the shares of a distribution that lie below the two ends of the box.

    Parameters that were identified together are drawn with their `tails`, which the box leaves out as well.
    """
    drawn_whole = given.kind in ("uniform", "triangular") or (given.kind == IDENTIFIED and not tails)
    return (0.0, 1.0) if drawn_whole else (TAIL, 1.0 - TAIL)


def values_text(values: Mapping[str, float]) -> str:
    """Return the values (SI) of a rig by key as text."""
    return ", ".join(f"{key} = {value:.6g}" for key, value in values.items())
