"""A rig as matrices and rows, its parts (patches, normal forces, limiters, sectors, switches) and its mode sets.

State  x = [q, v, network, signals]. Terms that are not linear in x are the inputs T = [friction forces, products]: the
force of a patch with a speed-dependent law, and products of states such as x y, cos(k phi) - 1 or N sin(k phi). Rows
whose name ends in `_t` are over T.

A System knows the keys of its mode sets, the contact states of a key, and both in text. A Finding is a fact about a
system before it runs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import permutations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rig.model.film import Film
from rig.model.friction_law import Law
from rig.model.products import Product
from rig.solve.records import CLOSED, G_LIMIT_LOW, G_NEXT, G_OPEN, G_SLIP, GUARD_NAMES, OPEN, SLIP_MINUS, STICK

Array = NDArray[np.float64]
Level = Literal["info", "warning", "error"]
_FEW = 3  # up to this number, all positions of a switch are prepared
_SPELT = 8  # up to this number, contacts are named one by one
_MOTIONS = ("slip+", "slip-", "stick")


@dataclass(frozen=True)
class Finding:
    """One finding: its level, its text, its number (a growth rate in 1/s for a growth) and the remedy."""

    level: Level
    what: str
    number: float
    remedy: str

    def to_json(self) -> dict[str, object]:
        """The finding as plain values."""
        return dict(vars(self))


@dataclass(frozen=True)
class Patch:
    """A friction patch: `direction` [coordinate] of the friction force, `surface` speed row [state], and its law.

    `travel` [coordinate]: row of the body's motion in the slip speed; the direction of the force by default.
    `memory`: the indices in x of the internal states of its law.
    """

    name: str
    direction: Array
    surface: Array
    law: Law
    travel: Array | None = None
    memory: tuple[int, ...] = ()


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


Judge = Callable[["System", float], Iterable[Finding]]
"""(system, sample step [s]) -> the findings of an effect about it before a run."""


@dataclass(frozen=True)
class System:
    """A rig as matrices over x = [q, v, network, signals]; the first of the signals is the constant one.

    force [coordinate, state], force_t [coordinate, product]. coupling [coordinate, state]: network forces on the
    structure, which exchange energy with the stored energy x.store x / 2 and with the resistors. kept: by name of a
    state, the row of the quantity that is conserved in its place when a parameter changes (the charge instead of the
    voltage). judges: of effects, see rig.stability.report. strike [coordinate]: the force of a knock of one newton.
    film: the travelling contact points, which replace the contacts under the method kick. bounds: of outputs; beyond
    them the scene accepts no equilibrium.
    """

    names: tuple[str, ...]
    coordinates: tuple[str, ...]
    mass: Array
    damping: Array
    stiffness: Array
    force: Array
    force_t: Array
    coupling: Array
    network: Array
    store: Array
    losses: tuple[Loss, ...]
    signals: Array
    patches: tuple[Patch, ...]
    normals: tuple[Normal, ...]
    limiters: tuple[Limiter, ...]
    sectors: tuple[Sector, ...]
    switches: tuple[Switch, ...]
    products: tuple[Product, ...]
    judges: tuple[Judge, ...]
    strike: Array
    kept: dict[str, Array]
    start: Array
    film: Film | None = None
    bounds: tuple[Bound, ...] = ()
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
        """The index of the constant state "one"."""
        return 2 * len(self.coordinates) + len(self.network)

    @cached_property
    def inputs(self) -> int:
        """Number of inputs T: patches, products and rates of laws with memory."""
        return self.rates_from + sum(len(patch.memory) for patch in self.patches)

    @cached_property
    def rates_from(self) -> int:
        """Number of the inputs before the rates of laws with memory."""
        return len(self.patches) + len(self.products)

    def rates(self, p: int) -> range:
        """The inputs that are the rates of the law of patch p."""
        first = self.rates_from + sum(len(patch.memory) for patch in self.patches[:p])
        return range(first, first + len(self.patches[p].memory))

    def places(self, p: int) -> tuple[int, int]:
        """The indices of the first internal state of patch p in x, and of its rate in T; 0 without memory."""
        return min(self.patches[p].memory, default=0), min(self.rates(p), default=0)

    @property
    def remembers(self) -> bool:
        """Whether at least one law has memory."""
        return any(patch.memory for patch in self.patches)

    @property
    def linear(self) -> bool:
        """Whether the equations are linear in every mode set, so that exact propagation supports the system."""
        over_speed = any(not law.constant for p in range(len(self.patches)) for law in self.laws(p))
        return not self.products and not over_speed

    @property
    def varies(self) -> bool:
        """Whether the structure differs between sectors."""
        return any(sector.changes for sector in self.sectors)

    def laws(self, p: int) -> tuple[Law, ...]:
        """The laws that patch p may have: its own, or those of its sectors, for both directions of slip."""
        own = next((s.laws for s in self.sectors if s.patch == p), (self.patches[p].law,))
        return tuple(law for of_place in own for law in of_place.directions)

    @property
    def generators(self) -> list[tuple[int, int, float]]:
        """Undamped generators: states a, b with a' = rate b, b' = -rate a, without other rates, and the rate."""
        pairs = []
        driven = {limiter.state for limiter in self.limiters}
        moving = set((self.one + np.flatnonzero(self.signals.any(axis=1))).tolist())
        for a, b in permutations(moving - driven, 2):
            rate = float(self.signals[a - self.one, b])
            rows = np.zeros((2, self.n))
            rows[0, b] = rate
            rows[1, a] = -rate
            if rate > 0.0 and np.array_equal(self.signals[[a - self.one, b - self.one]], rows):
                pairs.append((a, b, rate))
        return pairs

    @cached_property
    def radices(self) -> list[int]:
        """Number of modes of each patch, normal, limiter, sector and switch, in the order of the key."""
        fixed = [3] * len(self.patches) + [2] * len(self.normals) + [3] * len(self.limiters)
        return fixed + [len(s.edges) for s in self.sectors] + [len(s.positions) for s in self.switches]

    @property
    def keys(self) -> int:
        """Number of mode sets."""
        return math.prod(self.radices)

    def key(
        self,
        patches: Sequence[int],
        normals: Sequence[int],
        limiters: Sequence[int],
        sectors: Sequence[int] = (),
        switches: Sequence[int] = (),
    ) -> int:
        """The key of a mode set, a mixed-radix number; without `sectors` or `switches`, those of the start."""
        where = sectors or [sector.at(self.start) for sector in self.sectors]
        thrown = switches or [switch.at(self.start) for switch in self.switches]
        key = 0
        base = 1
        for mode, radix in zip((*patches, *normals, *limiters, *where, *thrown), self.radices, strict=True):
            key += int(mode) * base
            base *= radix
        return key

    def modes(self, key: int) -> tuple[list[int], list[int], list[int], list[int], list[int]]:
        """The modes of a mode set, from its key: of patches, normal forces, limiters, sectors, switches."""
        known = self._decoded.get(key)
        if known is None:
            parts = []
            rest = key
            radices = iter(self.radices)
            for owners in (self.patches, self.normals, self.limiters, self.sectors, self.switches):
                modes = []
                for radix in itertools.islice(radices, len(owners)):
                    modes.append(rest % radix)
                    rest //= radix
                parts.append(modes)
            known = parts[0], parts[1], parts[2], parts[3], parts[4]
            self._decoded.clear()  # the same key is asked for many times in a row
            self._decoded[key] = known
        return known

    def stuck(self, key: int) -> tuple[int, ...]:
        """The patches that stick in a mode set while a normal force presses them."""
        patches, normals, *_ = self.modes(key)
        loaded = {k.patch for k, mode in zip(self.normals, normals) if mode == CLOSED}
        return tuple(p for p, mode in enumerate(patches) if mode == STICK and p in loaded)

    @cached_property
    def _decoded(self) -> dict[int, tuple[list[int], list[int], list[int], list[int], list[int]]]:
        """The modes of the last key."""
        return {}

    def corresponding_key(self, old: System, key: int, x: Array | None = None) -> int:
        """The key in this system that corresponds to mode set `key` of `old`, a system with the same contacts.

        A limiter that `old` does not have is in its linear range, a switch is in its position at the start. `x`: the
        present state, if sectors may have other edges.
        """
        patches, normals, limiters, sectors, switches = old.modes(key)
        limited = {part.name: mode for part, mode in zip(old.limiters, limiters)}
        thrown = {part.name: mode for part, mode in zip(old.switches, switches)}
        last = [len(sector.edges) - 1 for sector in self.sectors]
        where = list(map(min, sectors, last)) if x is None else [sector.at(x) for sector in self.sectors]
        positions = [min(thrown.get(s.name, s.at(self.start)), len(s.positions) - 1) for s in self.switches]
        clamped = [limited.get(part.name, 0) for part in self.limiters]
        return self.key(patches, normals, clamped, where, positions)

    def law(self, p: int, key: int) -> Law:
        """The law of patch p in mode set `key`: that of its sector and of the direction of slip; in stick forward."""
        patches, _, _, sectors, _ = self.modes(key)
        here = (sector.laws[where] for sector, where in zip(self.sectors, sectors) if sector.patch == p)
        return next(here, self.patches[p].law).towards(-1.0 if patches[p] == SLIP_MINUS else 1.0)

    def change(self, sectors: Sequence[int]) -> Change:
        """The sum of what these sectors add."""
        changes = [s.changes[at] for s, at in zip(self.sectors, sectors) if s.changes]
        if not changes:
            return self._no_change
        sums = []
        for part, none in vars(self._no_change).items():
            sums.append(sum((getattr(change, part) for change in changes), none))
        return Change(*sums)

    @cached_property
    def _no_change(self) -> Change:
        """What no sector adds."""
        nq = len(self.coordinates)
        return Change(np.zeros((nq, nq)), np.zeros((nq, nq)), np.zeros((len(self.normals), self.n)))

    def switched_keys(self, key: int) -> Iterator[int]:
        """The keys of mode set `key` with every position of its switches."""
        patches, normals, limiters, sectors, _ = self.modes(key)
        ways = [range(len(switch.positions)) for switch in self.switches]
        for positions in itertools.product(*ways):
            yield self.key(patches, normals, limiters, sectors, positions)

    def contact_keys(self, key: int) -> Iterator[int]:
        """The keys of mode set `key` with every other combination of modes of patches, normal forces and limiters."""
        *own, sectors, thrown = self.modes(key)
        counts = iter(self.radices)
        ways = []
        for part in own:
            ways.append([range(next(counts)) for _ in part])
        of_patches = itertools.product(*ways[0])
        of_limiters = itertools.product(*ways[2])
        for patches, normals, limiters in itertools.product(of_patches, self._liftings(), of_limiters):
            yield self.key(patches, normals, limiters, sectors, thrown)

    def _liftings(self) -> Iterator[tuple[int, ...]]:
        """The combinations of modes that the normal forces can have."""
        return itertools.product(*((CLOSED, OPEN) if k.opens else (CLOSED,) for k in self.normals))

    def keys_of_turn(self, key: int) -> Iterator[int]:
        """The keys that a turn over all sectors is likely to meet: modes of patches as they are, one contact open.

        If switches have few positions, also the other positions, with all contacts closed.
        """
        patches, _, limiters, _, now = self.modes(key)
        ways = []
        for lifted in self._liftings():
            of = [k.patch for k, mode in zip(self.normals, lifted) if mode == OPEN]
            if len(set(of)) == len(of):
                ways.append((lifted, now))
        few = [range(len(s.positions)) if len(s.positions) <= _FEW else (at,) for s, at in zip(self.switches, now)]
        all_closed = (CLOSED,) * len(self.normals)
        ways += [(all_closed, list(other)) for other in itertools.product(*few) if list(other) != now]
        sectors = [range(len(sector.edges)) for sector in self.sectors]
        for places in itertools.product(*sectors):
            for lifted, thrown in ways:
                yield self.key(patches, lifted, limiters, places, thrown)

    def describe(self, key: int) -> str:
        """The mode set in words, e.g. "contact slip+"."""
        patches, normals, limiters, sectors, switches = self.modes(key)
        words = [f"{p.name} {_MOTIONS[m]}" for p, m in zip(self.patches, patches)]
        if len(patches) > _SPELT:
            words = [f"{n} contacts {word}" for m, word in enumerate(_MOTIONS) if (n := patches.count(m))]
        lifted = [k.name for k, m in zip(self.normals, normals) if m == OPEN]
        if len(lifted) <= _SPELT:
            words += [f"{name} open" for name in lifted]
        else:
            words.append(f"{len(lifted)} contacts open")
        words += [f"{x.name} {('', 'low', 'high')[m]}" for x, m in zip(self.limiters, limiters) if m]
        words += [f"{s.name} {m + 1}" for s, m in zip(self.sectors, sectors)]
        words += [f"{s.name} {s.positions[m].name}" for s, m in zip(self.switches, switches)]
        return ", ".join(words) or "free"

    def event_text(self, kind: int, owner: int) -> str:
        """The event of a guard of that kind, in words, e.g. "contact releases +"."""
        firsts = ((G_NEXT, self.sectors), (G_LIMIT_LOW, self.limiters), (G_OPEN, self.normals), (G_SLIP, self.patches))
        owners: Sequence[Any] = next(parts for first, parts in firsts if kind >= first)
        return f"{owners[owner].name} {GUARD_NAMES[kind]}"
