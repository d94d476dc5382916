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

_AT_REST = 1e-3  # share of the energy of balanced forces below which a motion counts as rest


class CurrentState(NamedTuple):
    """A motion at one instant: its system, its state x [n], the key of its mode set, and the tables of its kernels."""

    system: System
    x: Array
    key: int
    tables: Tables

    def stored(self) -> float:
        """The energy of structure and network [J]."""
        return energy_forms.stored(self.system, self.x, self.key)

    def spring_energy(self) -> float:
        """The energy of the springs of the contacts [J]."""
        return kick_tables.spring_energy(self.system, self.x)

    def kick_work(self) -> float:
        """The work of the kicks on these springs, with the present matrices [J]."""
        flow = self.tables.kick
        return float(flow.spring[0]) if flow is not None else 0.0


class Balance:
    """The energy balance since the start [J]. `impulses`: energy that writes supplied to the structure at once.

    `sprung`: the contacts are springs on which kicks act. `kept`: whether there is one.
    """

    def __init__(self, start: CurrentState, sprung: bool, kept: bool) -> None:
        self.first = start.stored() if kept else 0.0
        self.impulses = 0.0
        self.sprung = sprung
        self._given = (
            start.spring_energy() - start.kick_work() if sprung else 0.0
        )  # plus later supplies other than by kicks

    @property
    def numbers(self) -> Array:
        """What was stored at the start, and the impulses since [J]; for contacts without springs that is all."""
        return np.array([self.first, self.impulses])

    @numbers.setter
    def numbers(self, values: Array) -> None:
        self.first, self.impulses = values.tolist()

    def pause(self, now: CurrentState) -> None:
        """Begin a change of state or system: energy that the springs gain until `go_on` is not work of the kicks."""
        if self.sprung:
            self._given += now.kick_work() - now.spring_energy()

    def go_on(self, now: CurrentState) -> None:
        """End a change that `pause` began."""
        if self.sprung:
            self._given += now.spring_energy() - now.kick_work()

    def residual(self, now: CurrentState, terms: Array) -> dict[str, float] | None:
        """The energy error of the springs, `energy` [J], and its `share`; None if there are no springs.

        `energy` is the energy of the springs minus the energy supplied to them. The share refers to the largest of:
        energy of structure, energy of springs, work of contacts and dampers.
        """
        if not self.sprung:
            return None
        off = now.spring_energy() - self._given - now.kick_work()
        balance = energy_forms.by_name(now.system, terms)
        sizes = [abs(balance[name]) for name in ("damper", "forces", "normal")]
        sizes += [self.first, now.stored(), now.spring_energy()]
        return {"energy": off, "share": abs(off) / max(*sizes, 1e-30)}

    @np.errstate(over="ignore", invalid="ignore")  # a state may overflow; the run reports that
    def report(self, now: CurrentState, terms: Array, edges: float) -> dict[str, float]:
        """The terms by name [J], and `error`: the residual relative to the largest term or store.

        `edges` [J]: energy supplied by changes of stiffness at the edges of sectors. At rest all of these are rounding.
        The scale is then a share of the work of the present forces from the unloaded place of the structure to here.
        """
        stored = now.stored() - self.first
        jumps = self.impulses + edges
        x, system = np.abs(now.x), now.system
        held = float(x[: len(system.coordinates)] @ np.abs(system.force) @ x)
        largest = max(float(np.abs(terms).max()), abs(stored), abs(self.first), _AT_REST * held, 1e-30)
        out = energy_forms.by_name(now.system, terms)
        if now.system.varies:
            out["edges"] = edges
        out |= {"impulses": self.impulses, "stored": stored}
        out["error"] = (float(terms @ energy_balance.SIGNS) + jumps - stored) / largest
        return out
