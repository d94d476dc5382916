"""The parts of a rig as matrices: patches, normal forces, limiters, sectors, switches, losses (rig.model.system)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.model.friction_law import Law

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Patch:
    """A friction patch: `direction` [coordinate] of the friction force, `surface` speed row [state], and its law.

    `travel` [coordinate]: row of the body's motion in the slip speed; the direction of the force by default.
    """

    name: str
    direction: Array
    surface: Array
    law: Law
    travel: Array | None = None


@dataclass(frozen=True)
class Normal:
    """A normal force N = row x + row_t T + inertia . a of patch number `patch`, acting along `direction`."""

    name: str
    patch: int
    row: Array
    row_t: Array
    direction: Array
    inertia: Array
    opens: bool


@dataclass(frozen=True)
class Bound:
    """The largest absolute value [`unit`] that a scene allows an output, an extended row (rig.model.assembly)."""

    name: str
    row: Mapping[str, float]
    limit: float
    unit: str


@dataclass(frozen=True)
class Limiter:
    """A clamp: the derivative of state `state` gains `gain * min(max(row x, low), high)`.

    Beyond the clamp the network stores `excess` (row x - low or high)^2 / 2 more than it does within.
    """

    name: str
    row: Array
    low: float
    high: float
    state: int
    gain: float
    excess: float = 0.0


@dataclass(frozen=True)
class Change:
    """Changes in a sector: stiffness, damping [coordinate, coordinate], rows of normal forces [normal, n]."""

    stiffness: Array
    damping: Array
    rows: Array


@dataclass(frozen=True)
class Sector:
    """Sectors along a path: for edges[i] <= row x < edges[i + 1] patch `patch` has laws[i], or changes[i] is added.

    The position row x lies in [0, period): `edges` begin with 0, the last sector ends at `period`. When it leaves this
    range, state `turn`, which row contains with factor 1, is shifted by a period. `patch` is -1 if friction stays the
    same.
    """

    name: str
    patch: int
    row: Array
    turn: int
    period: float
    edges: tuple[float, ...]
    laws: tuple[Law, ...] = ()
    changes: tuple[Change, ...] = ()

    def at(self, x: Array) -> int:
        """The sector at state x."""
        place = float(self.row @ x) % self.period
        return sum(place >= edge for edge in self.edges[1:])


@dataclass(frozen=True)
class Position:
    """One position of a switch: the `rates` [owned, n] of the network states that the switch owns.

    `still`: states that are zero in it; the others keep their values when the switch is thrown. `gains`: of limiters,
    by index, if they differ from the limiter's own; 0 takes the limiter out of the network. `store` [n, n]: twice the
    energy that only this position stores, as a form of x.
    """

    name: str
    rates: Array
    still: tuple[int, ...]
    gains: dict[int, float]
    store: Array


@dataclass(frozen=True)
class Switch:
    """A switch of the network: its position is the rounded value of state `state`, which a command writes."""

    name: str
    state: int
    owned: tuple[int, ...]
    positions: tuple[Position, ...]

    def at(self, x: Array) -> int:
        """The position at state x."""
        return min(max(int(x[self.state] + 0.5), 0), len(self.positions) - 1)


@dataclass(frozen=True)
class Loss:
    """A resistor: it dissipates the power conductance * (row x + rate . network rates)^2."""

    conductance: float
    row: Array
    rate: Array
