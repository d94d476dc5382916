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


def no_random_numbers() -> RandomNumbers:
    """The record for a rig without a random input."""
    return RandomNumbers(np.array([-1, 0]), np.zeros(0))


@inner
def used_up(random_numbers: Any) -> bool:
    """Whether no number is left for another frame."""
    return random_numbers.at[PLACE] >= 0 and random_numbers.at[DRAWN] == random_numbers.numbers.shape[0]  # type: ignore[no-any-return]


@inner
def write_next_number(random_numbers: Any, x: Any) -> None:
    """Write the next number to the state that holds it; keep that state if no number is left."""
    if random_numbers.at[PLACE] >= 0 and not used_up(random_numbers):
        x[random_numbers.at[PLACE]] = random_numbers.numbers[random_numbers.at[DRAWN]]
        random_numbers.at[DRAWN] += 1
