"""The points of a contact film: their positions, and the output with the pressure of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FilmPoints:
    """The points of a film: `along` x `across` equal areas of a slider of `length` x `width` [m]."""

    length: float
    width: float
    along: int
    across: int

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the pressure outputs, in order of the lines across the slider from the rear."""
        return tuple(f"pressure_{i}_{j}" for i in range(1, self.along + 1) for j in range(1, self.across + 1))

    @property
    def x(self) -> Array:
        """Positions [m] of the points along the travel, from the slider's middle."""
        return ((np.arange(self.along) + 0.5) / self.along - 0.5) * self.length

    @property
    def y(self) -> Array:
        """Positions [m] of the points across the travel, from the slider's middle."""
        return ((np.arange(self.across) + 0.5) / self.across - 0.5) * self.width

    def maps(self, signals: Mapping[str, Array]) -> Array:
        """Pressures [instant, along, across] in Pa; 0 where a point is open."""
        table = np.stack([signals[name] for name in self.names], axis=-1)
        return table.reshape(*table.shape[:-1], self.along, self.across)
