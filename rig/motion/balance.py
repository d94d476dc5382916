"""The energy balance of a motion: its terms, what it stored, and the residual."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.model import energy_forms
from rig.model.system import System
from rig.solve import energy_balance

Array = NDArray[np.float64]

_AT_REST = 1e-3  # share of the energy of balanced forces below which a motion counts as rest


class CurrentState(NamedTuple):
    """A motion at one instant: its system, its state x [n], the key of its mode set."""

    system: System
    x: Array
    key: int

    def stored(self) -> float:
        """The energy of structure and network [J]."""
        return energy_forms.stored(self.system, self.x, self.key)


class Balance:
    """The energy balance since the start [J]. `impulses`: energy that writes supplied to the structure at once.

    `kept`: whether there is one.
    """

    def __init__(self, start: CurrentState, kept: bool) -> None:
        self.first = start.stored() if kept else 0.0
        self.impulses = 0.0

    @property
    def numbers(self) -> Array:
        """What was stored at the start, and the impulses since [J]."""
        return np.array([self.first, self.impulses])

    @numbers.setter
    def numbers(self, values: Array) -> None:
        self.first, self.impulses = values.tolist()

    @np.errstate(over="ignore", invalid="ignore")  # a state may overflow; the run reports that
    def report(self, now: CurrentState, terms: Array, edges: float) -> dict[str, float]:
        """The terms by name [J], and `error`: the residual relative to the largest term or store.

        `edges` [J]: energy supplied by changes of stiffness at the edges of sectors. At rest all of these are rounding.
        The scale is then a share of the work of the present forces from the unloaded place of the structure to here.
        """
        stored = now.stored() - self.first
        jumps = self.impulses + edges
        x = np.abs(now.x)
        system = now.system
        held = float(x[: len(system.coordinates)] @ np.abs(system.force) @ x)
        largest = max(float(np.abs(terms).max()), abs(stored), abs(self.first), _AT_REST * held, 1e-30)
        out = energy_forms.by_name(now.system, terms)
        if now.system.varies:
            out["edges"] = edges
        out |= {"impulses": self.impulses, "stored": stored}
        out["error"] = (float(terms @ energy_balance.SIGNS) + jumps - stored) / largest
        return out
