"""A signal of random numbers: a new one at the begin of every frame, held until the next.

What it does to the rig is a row like that of a command, so that contacts that stick bear it and the energy balance
books it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inner

PLACE, DRAWN = range(2)  # of Chance.at


class Chance(NamedTuple):
    """Numbers drawn ahead. `at`: PLACE, the state that holds the number, -1 without one; DRAWN, numbers used up."""

    at: NDArray[np.int64]  # [2]
    numbers: NDArray[np.float64]


def none() -> Chance:
    """For a rig without such a signal."""
    return Chance(np.array([-1, 0]), np.zeros(0))


@inner
def spent(chance: Any) -> bool:
    """Whether there is no number for another frame."""
    return chance.at[PLACE] >= 0 and chance.at[DRAWN] == chance.numbers.shape[0]  # type: ignore[no-any-return]


@inner
def shake(chance: Any, x: Any) -> None:
    """The signal of state x takes its next number; it stays where there is none."""
    if chance.at[PLACE] >= 0 and not spent(chance):
        x[chance.at[PLACE]] = chance.numbers[chance.at[DRAWN]]
        chance.at[DRAWN] += 1
