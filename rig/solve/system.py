"""A rig as matrices and rows: structure, friction patches, normal forces, limiters, sectors, products; its mode sets.

State  x = [q, v, network, signals]. What is not linear in x are the inputs T = [friction forces, products]: the force
of a patch under a law over speed, and products of states such as x y, cos(k phi) - 1 or N sin(k phi). Rows that end in
`_t` are over T.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.solve.laws import Law
from rig.solve.products import Product

Array = NDArray[np.float64]

SLIP_PLUS, SLIP_MINUS, STICK = range(3)
CLOSED, OPEN = range(2)
LINEAR, LOW, HIGH = range(3)

# kinds of guards: what happens when the guard falls through zero
G_SLIP, G_RELEASE_PLUS, G_RELEASE_MINUS, G_OPEN, G_CLOSE = range(5)
G_LIMIT_LOW, G_LIMIT_HIGH, G_LIMIT_BACK, G_NEXT, G_PREVIOUS = range(5, 10)
GUARD_NAMES = (
    "slip ends",
    "releases +",
    "releases -",
    "opens",
    "closes",
    "clamps low",
    "clamps high",
    "unclamps",
    "enters the next",
    "enters the one before",
)


@dataclass(frozen=True)
class Patch:
    """A friction patch: `direction` [coordinate] of the friction force, `surface` speed row [state], its law.

    `travel` [coordinate]: what the slip speed counts of the body's motion; the direction of the force by default.
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
class Limiter:
    """A clamp: the derivative of state `state` gains `gain * min(max(row x, low), high)`."""

    name: str
    row: Array
    low: float
    high: float
    state: int
    gain: float


@dataclass(frozen=True)
class Sector:
    """Material of different friction along the path of a patch: `laws[i]` where edges[i] <= row x < edges[i + 1].

    The place row x lives in [0, period): `edges` begin with 0, the last sector ends at `period`. Where it leaves that
    range, state `turn` is moved by a period, which row must count fully.
    """

    name: str
    patch: int
    row: Array
    turn: int
    period: float
    edges: tuple[float, ...]
    laws: tuple[Law, ...]

    def at(self, x: Array) -> int:
        """The sector at state x."""
        place = float(self.row @ x) % self.period
        return sum(place >= edge for edge in self.edges[1:])


@dataclass(frozen=True)
class System:
    """A rig as matrices over x = [q, v, network, signals]; the first signal is the constant one.

    force [coordinate, state], force_t [coordinate, product].
    """

    names: tuple[str, ...]
    coordinates: tuple[str, ...]
    mass: Array
    damping: Array
    stiffness: Array
    force: Array
    force_t: Array
    network: Array
    signals: Array
    patches: tuple[Patch, ...]
    normals: tuple[Normal, ...]
    limiters: tuple[Limiter, ...]
    sectors: tuple[Sector, ...]
    products: tuple[Product, ...]
    start: Array
    slip_rows: Array = field(init=False)

    def __post_init__(self) -> None:
        nq = len(self.coordinates)
        rows = np.array([p.surface for p in self.patches]).reshape(-1, self.n)
        for i, patch in enumerate(self.patches):
            rows[i, nq : 2 * nq] -= patch.direction if patch.travel is None else patch.travel
        object.__setattr__(self, "slip_rows", rows)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.names)

    @property
    def one(self) -> int:
        """Index of the constant signal."""
        return 2 * len(self.coordinates) + len(self.network)

    @property
    def inputs(self) -> int:
        """Number of inputs T: patches and products."""
        return len(self.patches) + len(self.products)

    @property
    def linear(self) -> bool:
        """Whether the motion is linear in every mode set, so that exact propagation serves it."""
        over_speed = any(not law.constant for p in range(len(self.patches)) for law in self.laws(p))
        return not self.products and not over_speed

    def laws(self, p: int) -> tuple[Law, ...]:
        """The laws that patch p may meet: its own, or those of its sectors."""
        return next((s.laws for s in self.sectors if s.patch == p), (self.patches[p].law,))

    @property
    def radices(self) -> list[int]:
        """Number of modes of each patch, normal, limiter and sector, in the order of the key."""
        fixed = [3] * len(self.patches) + [2] * len(self.normals) + [3] * len(self.limiters)
        return fixed + [len(s.laws) for s in self.sectors]

    @property
    def keys(self) -> int:
        """Number of mode sets."""
        return int(np.prod(self.radices, dtype=np.int64))

    def key(
        self, patches: Sequence[int], normals: Sequence[int], limiters: Sequence[int], sectors: Sequence[int] = ()
    ) -> int:
        """Mixed-radix number of a mode set; without `sectors`, those of the start."""
        where = sectors or [sector.at(self.start) for sector in self.sectors]
        key, base = 0, 1
        for mode, radix in zip((*patches, *normals, *limiters, *where), self.radices, strict=True):
            key += int(mode) * base
            base *= radix
        return key

    def modes(self, key: int) -> tuple[list[int], list[int], list[int], list[int]]:
        """The mode set of a number: modes of patches, normals, limiters, sectors."""
        modes = []
        for radix in self.radices:
            modes.append(key % radix)
            key //= radix
        out = []
        for count in (len(self.patches), len(self.normals), len(self.limiters), len(self.sectors)):
            out.append(modes[:count])
            modes = modes[count:]
        return out[0], out[1], out[2], out[3]

    def law(self, p: int, sectors: Sequence[int]) -> Law:
        """The law of patch p where the sectors are these."""
        for sector, where in zip(self.sectors, sectors):
            if sector.patch == p:
                return sector.laws[where]
        return self.patches[p].law

    def describe(self, key: int) -> str:
        """The mode set in words, e.g. "contact slip+"."""
        patches, normals, limiters, sectors = self.modes(key)
        words = [f"{p.name} {('slip+', 'slip-', 'stick')[m]}" for p, m in zip(self.patches, patches)]
        words += [f"{k.name} open" for k, m in zip(self.normals, normals) if m == OPEN]
        words += [f"{x.name} {('', 'low', 'high')[m]}" for x, m in zip(self.limiters, limiters) if m]
        words += [f"{s.name} {m + 1}" for s, m in zip(self.sectors, sectors)]
        return ", ".join(words) or "free"

    def happens(self, kind: int, owner: int) -> str:
        """What happens when a guard of that kind falls, in words, e.g. "contact releases +"."""
        firsts = ((G_NEXT, self.sectors), (G_LIMIT_LOW, self.limiters), (G_OPEN, self.normals), (G_SLIP, self.patches))
        owners: Sequence[Any] = next(parts for first, parts in firsts if kind >= first)
        return f"{owners[owner].name} {GUARD_NAMES[kind]}"
