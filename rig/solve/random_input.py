"""A random input: a new number at the begin of every frame, held until the next.

It acts on the rig through a row, like a command. A sticking contact therefore carries it, and the energy balance
includes its work.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inner

PLACE, DRAWN = range(2)  # of RandomNumbers.at


class RandomNumbers(NamedTuple):
    """Random numbers drawn in advance.

    `at`: PLACE, index of the state that contains the number (-1: none); DRAWN, number of used numbers.
    """

    at: NDArray[np.int64]  # [2]
    numbers: NDArray[np.float64]


def none() -> RandomNumbers:
    """The record for a rig without a random input."""
    return RandomNumbers(np.array([-1, 0]), np.zeros(0))


@inner
def spent(chance: Any) -> bool:
    """Whether no number is left for another frame."""
    return chance.at[PLACE] >= 0 and chance.at[DRAWN] == chance.numbers.shape[0]  # type: ignore[no-any-return]


@inner
def write_next(chance: Any, x: Any) -> None:
    """Write the next number to the state that holds it; keep that state if no number is left."""
    if chance.at[PLACE] >= 0 and not spent(chance):
        x[chance.at[PLACE]] = chance.numbers[chance.at[DRAWN]]
        chance.at[DRAWN] += 1
