"""The energy balance of a motion: its terms, what it stored, and the residual.

The method kick has a second residual. A contact whose force depends on its compression is a spring. Its energy
changes by force times motion. Kicks act at the ends of steps only, so their work differs from this by an error of
second order in the step. The balance of the structure closes with the work of the kicks; the second residual shows
this error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.model import energy_forms, kick_tables
from rig.model.system import System
from rig.model.tables import Tables
from rig.solve import energy_balance

Array = NDArray[np.float64]


class Here(NamedTuple):
    """A motion at an instant: its system, its state x [n], its mode set `key`, and the tables of its kernels."""

    system: System
    x: Array
    key: int
    tables: Tables

    def stored(self) -> float:
        """Energy of structure and network [J]."""
        return energy_forms.stored(self.system, self.x, self.key)

    def held(self) -> float:
        """Energy of the springs of the contacts [J]."""
        return kick_tables.held(self.system, self.x)

    def worked(self) -> float:
        """The work of kicks on these springs with the matrices of now [J]."""
        flow = self.tables.flow
        return float(flow.spring[0]) if flow is not None else 0.0


class Balance:
    """The balance since the start [J]; `impulses`: what writes have given the structure at once.

    `sprung`: the contacts are springs, which kicks act on.
    """

    def __init__(self, start: Here, sprung: bool) -> None:
        self.first = start.stored()
        self.impulses = 0.0
        self.sprung = sprung
        self._given = start.held() - start.worked() if sprung else 0.0  # and since then in other ways than by kicks

    def pause(self, here: Here) -> None:
        """State or system are changed from here on to `go_on`: what that gives the springs is no work of kicks."""
        if self.sprung:
            self._given += here.worked() - here.held()

    def go_on(self, here: Here) -> None:
        """The end of a change."""
        if self.sprung:
            self._given += here.held() - here.worked()

    def residual(self, here: Here, terms: Array) -> dict[str, float] | None:
        """What the springs hold beyond what they were given, `energy` [J]; None where there are none.

        `share`: of the largest energy of the vibration, that is what structure and springs hold, and what contacts and
        dampers have exchanged.
        """
        if not self.sprung:
            return None
        off = here.held() - self._given - here.worked()
        told = energy_forms.by_name(here.system, terms)
        sizes = [abs(told[name]) for name in ("damper", "forces", "normal")]
        sizes += [self.first, here.stored(), here.held()]
        return {"energy": off, "share": abs(off) / max(*sizes, 1e-30)}

    @np.errstate(over="ignore", invalid="ignore")  # of a state that has left the range of numbers: the run says so
    def told(self, here: Here, terms: Array, edges: float) -> dict[str, float]:
        """The terms by name [J], and `error`: the residual relative to the largest term or store.

        `edges` [J]: what came in with the stiffness of other sectors.
        """
        stored = here.stored() - self.first
        jumps = self.impulses + edges
        largest = max(float(np.abs(terms).max()), abs(stored), abs(self.first), 1e-30)
        out = energy_forms.by_name(here.system, terms)
        if here.system.varies:
            out["edges"] = edges
        out |= {"impulses": self.impulses, "stored": stored}
        out["error"] = (float(terms @ energy_balance.SIGNS) + jumps - stored) / largest
        return out
