"""Rows of numbers that grow while a run goes on, without a copy of what is written to them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST, MOST = 1 << 12, 1 << 21
"""Limits of the columns for which there is room at first. When it is used up, it is doubled."""


class GrowingRows:
    """An array [row, column] of a type, to which columns are appended. `expected`: about how many.

    New memory costs more than what is written to it: it is touched once if the number is known.
    """

    def __init__(self, rows: int, kind: Any, expected: int) -> None:
        self._whole: NDArray[Any] = np.empty((rows, min(max(expected, LEAST), MOST)), dtype=kind)
        self.count = 0
        """Number of columns so far."""

    def append(self, columns: int) -> tuple[NDArray[Any], int]:
        """Append columns and return the array, which the caller fills, and the first new column."""
        first, self.count = self.count, self.count + columns
        if self.count > self._whole.shape[1]:
            larger = np.empty((len(self._whole), max(2 * self._whole.shape[1], self.count)), dtype=self._whole.dtype)
            larger[:, :first] = self._whole[:, :first]
            self._whole = larger
        return self._whole, first

    def all(self) -> NDArray[Any]:
        """All columns so far: a view, each row of which is contiguous."""
        return self._whole[:, : self.count]
