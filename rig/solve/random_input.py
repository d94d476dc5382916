"""A random input: a new number at the begin of every frame, held until the next.

It acts on the rig through a row, like a command. A stuck contact therefore bears it, and the energy balance includes
its work.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inner

PLACE, DRAWN = range(2)  # of Chance.at


class Chance(NamedTuple):
    """Random numbers drawn ahead.

    `at`: PLACE, index of the state that holds the number (-1: none); DRAWN, how many numbers are used up.
    """

    at: NDArray[np.int64]  # [2]
    numbers: NDArray[np.float64]


def none() -> Chance:
    """The record for a rig without a random input."""
    return Chance(np.array([-1, 0]), np.zeros(0))


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
