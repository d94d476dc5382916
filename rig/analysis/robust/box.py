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

from rig.analysis.studies.factors import Distribution, Identified
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

    def value(self, share: float, design: float | None) -> float:
        """The value (SI) at a coordinate, for the value that the `design` gives it; None: that of the scene."""
        centre = self.nominal if design is None else design
        low, high = self.ends
        deviation = low + (high - low) * share
        value = centre * (1.0 + deviation) if self.relative else centre + deviation
        return max(round(value / self.step), 0) * self.step if self.step else value

    def shares(self, values: Array) -> Array:
        """The coordinates of drawn values (SI), those of a tail moved to the end of the box."""
        low, high = self.axis.values
        return np.clip((values - low) / (high - low), 0.0, 1.0)

    def text(self, low: float = 0.0, high: float = 1.0) -> str:
        """The range between two coordinates as text: "+-2 %", or its two ends."""
        if self.given is not None and (low, high) == (0.0, 1.0):
            return str(self.given)
        if not (self.relative or self.free):
            ends = sorted(self.value(share, None) for share in (low, high))
            return f"{self.axis.text(ends[0])} to {self.axis.text(ends[1])}"
        first, last = (self.ends[0] + (self.ends[1] - self.ends[0]) * share for share in (low, high))
        scale = 0.01 if self.relative else self.axis.scale
        shown = "" if self.axis.shown == "1" else self.axis.shown
        unit = "%" if self.relative else shown
        if math.isclose(first, -last, rel_tol=1e-9):
            return f"+-{last / scale:.4g} {unit}".rstrip()
        return f"{first / scale:.4g} to {last / scale:.4g} {unit}".rstrip()


@dataclass(frozen=True)
class Box:
    """The free values of a design and the uncertain ones of a rig."""

    free: tuple[Axis, ...]
    uncertain: tuple[Uncertain, ...]

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
        return np.array(
            [(design[a.key] - a.values[0]) / (a.values[1] - a.values[0]) for a in self.free], dtype=np.float64
        )

    def rig(self, design: Mapping[str, float], u: Sequence[float] | Array) -> dict[str, float]:
        """The uncertain values (SI) of rig u [uncertain] by key, about the values of a `design`."""
        return {value.key: value.value(float(share), design.get(value.key)) for value, share in zip(self.uncertain, u)}

    def draws(self, chance: np.random.Generator, count: int) -> Array:
        """Random rigs [count, uncertain] of the box: as distributed where a distribution is stated, else evenly."""
        shares = np.clip(chance.random((count, len(self.uncertain))), _EDGE, 1.0 - _EDGE)
        u = shares.copy()
        together: dict[str, list[int]] = {}
        for i, value in enumerate(self.uncertain):
            if isinstance(value.given, Distribution):
                low, high = ends_of(value.given)
                u[:, i] = value.shares(value.given.quantile(low + (high - low) * shares[:, i], value.axis.unit))
            elif isinstance(value.given, Identified):
                together.setdefault(value.given.file, []).append(i)
        for index in together.values():
            joint = [given for i in index if isinstance(given := self.uncertain[i].given, Identified)]
            for i, column in zip(index, Identified.drawn(joint, shares[:, index]).T):
                u[:, i] = self.uncertain[i].shares(column)
        return u


@dataclass(frozen=True)
class Limit:
    """A limit `slope` x + `over` <= 0 of design x [free], in units of the largest sum of its terms over the ranges.

    `text`: as its user states it; `weights` [free] and `bound`: the same in SI, weights * values <= bound.
    """

    text: str
    slope: Array
    over: float
    weights: Array
    bound: float

    def excess(self, x: Array) -> float:
        """How far a design is beyond the limit; at most 0 if it keeps it."""
        return float(self.slope @ x) + self.over


def ends_of(given: Distribution) -> tuple[float, float]:
    """Return the shares of a distribution that lie below the two ends of the box."""
    bounded = given.kind in ("uniform", "triangular")
    return (0.0, 1.0) if bounded else (TAIL, 1.0 - TAIL)
