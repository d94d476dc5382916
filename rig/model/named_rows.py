"""Rows by name: the form in which plants and effects describe a rig.

State  x = [q, v, network, signals]. A row is a dict from state names to coefficients, e.g. {"one": 20, "dither": 1}. A
coordinate "x" has the states "x" and "x'"; "x''" is its acceleration, which only outputs may name. The state "one" is
constant. Outputs may also name, for a contact c, "T:c" (friction force), "N:n" (normal force n), "w:c" (slip speed),
and "c:l", the output of a limiter l. Every coupling is such a row, so an effect only adds rows.

A nonlinear term is a product with a name of its own (`Assembly.product`), which rows of forces, normal forces and
outputs name like a state.

    structure  M a + D v + K q = sum_p t_p T_p + sum_k n_k N_k + F x
    patch p    w_p = V_p - t_p . v          normal k   N_k = r_k x + g_k . a
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.model.film import Film
from rig.model.friction_law import Law
from rig.model.system import Judge

Array = NDArray[np.float64]
Row = dict[str, float]
Part = str | tuple[str, Row]
Of = Literal["mass", "damping", "stiffness"]


class Block(NamedTuple):
    """The matrices [coordinate, coordinate] of the coordinates `names`, which add to the entries by name."""

    names: tuple[str, ...]
    mass: Array
    damping: Array
    stiffness: Array


@dataclass(frozen=True)
class Circuit:
    """One position of a switch, by names: rates of the network states it changes, and states that are zero in it.

    `gains` of limiters and `stores` as in `Assembly`, if they differ in this position.
    """

    name: str
    rates: dict[str, Row]
    still: tuple[str, ...] = ()
    gains: dict[str, float] = field(default_factory=dict)
    stores: tuple[tuple[float, Row], ...] = ()


class Variation(NamedTuple):
    """Equal sectors of one turn in which a structure is stiffer or softer: factors of stiffness and damping."""

    name: str
    row: Row
    turn: str
    period: float
    factors: tuple[tuple[float, float], ...]
    stiffness: dict[tuple[str, str], float]
    damping: dict[tuple[str, str], float]
    rows: dict[str, Row]
    blocks: tuple[Block, ...]


@dataclass
class Rows:
    """The rows of a rig under construction. Plants begin them, effects add to them.

    Network forces on the structure are `coupling`. They exchange energy with the `stores` of the network, c (row x)^2 /
    2 each, and with its `losses`, g (row x)^2 each, whose rows may name rates of network states ("voltage'"). `keep`:
    the quantity that is conserved, in place of a network state, when a parameter changes. `judges` examine the rig
    before a run (rig.stability.report). `struck`: coordinates on which a knock acts, if this is not the sliding
    direction of the first patch. `film`: see rig.model.film. `about`: a line for each owner of states that is no table
    of the scene.
    """

    title: str = ""
    coordinates: list[str] = field(default_factory=list)
    mass: dict[tuple[str, str], float] = field(default_factory=dict)
    damping: dict[tuple[str, str], float] = field(default_factory=dict)
    stiffness: dict[tuple[str, str], float] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    force: dict[str, Row] = field(default_factory=dict)
    coupling: dict[str, Row] = field(default_factory=dict)
    network: dict[str, Row] = field(default_factory=dict)
    stores: list[tuple[float, Row]] = field(default_factory=list)
    losses: list[tuple[float, Row]] = field(default_factory=list)
    switches: list[tuple[str, str, tuple[Circuit, ...]]] = field(default_factory=list)
    keep: dict[str, Row] = field(default_factory=dict)
    judges: list[Judge] = field(default_factory=list)
    signals: dict[str, Row] = field(default_factory=lambda: {"one": {}})
    start: dict[str, float] = field(default_factory=lambda: {"one": 1.0})
    patches: list[tuple[str, Row, Row, Law, Row | None]] = field(default_factory=list)
    normals: list[tuple[str, str, Row, Row, Row, bool]] = field(default_factory=list)
    limiters: list[tuple[str, Row, float, float, str, float, float]] = field(default_factory=list)
    sectors: list[tuple[str, str, Row, str, float, tuple[float, ...], tuple[Law, ...]]] = field(default_factory=list)
    variations: list[Variation] = field(default_factory=list)
    products: dict[str, tuple[Part, ...]] = field(default_factory=dict)
    owners: dict[str, str] = field(default_factory=dict)
    about: dict[str, str] = field(default_factory=dict)
    struck: Row = field(default_factory=dict)
    film: Film | None = None

    def coordinate(self, name: str, mass: float, damping: float = 0.0, stiffness: float = 0.0) -> None:
        """Add a degree of freedom with its own mass, and with a damper and a spring to ground.

        Raises ValueError for a name that a state has already.
        """
        self._new_state(name)
        self.coordinates.append(name)
        self.mass[name, name] = mass
        self.damping[name, name] = damping
        self.stiffness[name, name] = stiffness

    def block(self, names: Iterable[str], mass: Array, damping: Array, stiffness: Array) -> None:
        """Add degrees of freedom with full matrices [coordinate, coordinate].

        Raises ValueError for a name that a state has already, and for a matrix of another shape.
        """
        names = tuple(names)
        for name in names:
            self._new_state(name)
            self.coordinates.append(name)
        matrices = [np.array(matrix, dtype=np.float64) for matrix in (mass, damping, stiffness)]
        for of, matrix in zip(("mass", "damping", "stiffness"), matrices):
            if matrix.shape != (len(names), len(names)):
                raise ValueError(f"{of} has the shape {matrix.shape}; expected ({len(names)}, {len(names)})")
        self.blocks.append(Block(names, *matrices))

    def matrix(self, of: Of) -> Array:
        """The matrix over the coordinates. Raises KeyError for an unknown coordinate."""
        return self.summed(getattr(self, of), self.blocks, of)

    def summed(self, entries: Mapping[tuple[str, str], float], blocks: Iterable[Block], of: Of) -> Array:
        """A matrix over the coordinates, from entries by name and the matrices of blocks."""
        index = {name: i for i, name in enumerate(self.coordinates)}
        out = np.zeros((len(index), len(index)))
        for (i, j), value in entries.items():
            out[index[i], index[j]] += value
        for block in blocks:
            places = [index[name] for name in block.names]
            out[np.ix_(places, places)] += getattr(block, of)
        return out

    def spring(self, extension: Row, stiffness: float, damping: float = 0.0) -> None:
        """Add a spring and a parallel damper. `extension`: as a row over coordinates."""
        if (block := next((block for block in self.blocks if {*block.names} >= extension.keys()), None)) is not None:
            over_block = np.array([extension.get(name, 0.0) for name in block.names])
            block.stiffness[:] += stiffness * np.outer(over_block, over_block)
            block.damping[:] += damping * np.outer(over_block, over_block)
            return
        for i, row in extension.items():
            for j, column in extension.items():
                self.stiffness[i, j] = self.stiffness.get((i, j), 0.0) + stiffness * row * column
                self.damping[i, j] = self.damping.get((i, j), 0.0) + damping * row * column

    def signal(self, name: str, rate: Row, start: float, owner: str, about: str = "") -> None:
        """Add a state s with s' = rate; `owner`, `about`: see `own`. Raises ValueError as `coordinate`."""
        self._new_state(name)
        self.signals[name] = dict(rate)
        self.start[name] = start
        self.own(owner, name, about=about)

    def own(self, owner: str, *states: str, about: str = "") -> None:
        """State to which effect states belong, with a line about it, unless its table declares it (rig.about)."""
        self.owners.update(dict.fromkeys(states, owner))
        if about:
            self.about[owner] = about

    def push(self, coordinate: str, row: Row) -> None:
        """Add a force row to a coordinate."""
        add(self.force.setdefault(coordinate, {}), row)

    def patch(self, name: str, direction: Row, surface: Row, law: Law, travel: Row | None = None) -> None:
        """Add a friction patch: `direction` over coordinates, `surface` speed as a row, and its friction law.

        `travel`: row of the body's motion in the slip speed, if it differs from the direction of the force.
        """
        for state in law.states:
            self._new_state(f"{name}_{state.name}")
            self.network[f"{name}_{state.name}"] = {}
            self.start[f"{name}_{state.name}"] = state.start
        if law.states:
            states = [f"{name}_{state.name}" for state in law.states]
            self.own("friction", *states, about="internal states of the friction law")
        self.patches.append((name, dict(direction), dict(surface), law, travel))

    def normal(
        self,
        name: str,
        patch: str,
        row: Row,
        direction: Row | None = None,
        inertia: Row | None = None,
        opens: bool = True,
    ) -> None:
        """Add a normal force to a patch, N = row x + inertia . a, along `direction`.

        `opens`: it opens at N = 0; otherwise it transmits tension too.
        """
        self.normals.append((name, patch, dict(row), dict(direction or {}), dict(inertia or {}), opens))

    def product(self, name: str, *factors: Part) -> None:
        """Add a product for rows to name.

        Factors: a state, "N:normal", "T:patch", and of a row "sin", "cos-1", "press".
        """
        self.products[name] = factors

    def sector(
        self, name: str, patch: str, row: Row, turn: str, period: float, edges: tuple[float, ...], laws: tuple[Law, ...]
    ) -> None:
        """Add friction by position: `laws[i]` for edges[i] <= row < edges[i + 1], where edges[0] = 0.

        The last sector ends at `period`. State `turn`, which `row` contains with factor 1, is shifted by a period when
        the position leaves [0, period).
        """
        self.sectors.append((name, patch, dict(row), turn, period, edges, laws))

    def vary(self, name: str, row: Row, turn: str, period: float, factors: tuple[tuple[float, float], ...]) -> None:
        """Vary the structure by position, in equal sectors of [0, period).

        `factors`: one pair (stiffness, damping) for each sector. They act on the structure before this call:
        stiffness, damping, and the part of normal forces that depends on coordinates. `turn`: see `sector`.
        """
        rows: dict[str, Row] = {}
        for normal, _, load, *_ in self.normals:
            rows[normal] = {c: value for c, value in load.items() if c in self.coordinates}
        blocks = []
        for block in self.blocks:
            matrices = (matrix.copy() for matrix in block[1:])
            blocks.append(Block(block.names, *matrices))
        structure = dict(self.stiffness), dict(self.damping), rows, tuple(blocks)
        self.variations.append(Variation(name, dict(row), turn, period, factors, *structure))

    def switch(self, name: str, signal: str, circuits: tuple[Circuit, ...]) -> None:
        """Add a switch of the network: the rounded value of `signal` selects one of the circuits."""
        self.switches.append((name, signal, circuits))

    def limit(
        self, name: str, row: Row, low: float, high: float, signal: str, gain: float, excess: float = 0.0
    ) -> None:
        """Add a clamp: the rate of the state `signal` gains `gain * min(max(row x, low), high)`.

        Beyond the clamp the network stores `excess` (row x - low or high)^2 / 2 more.
        """
        self.limiters.append((name, dict(row), low, high, signal, gain, excess))

    def surface(self, patch: str) -> Row:
        """The surface speed row of a patch, for adding to it."""
        return next(entry[2] for entry in self.patches if entry[0] == patch)

    def load(self, normal: str) -> Row:
        """The row of a normal force, for adding to it."""
        return next(entry[2] for entry in self.normals if entry[0] == normal)

    def inertia(self, normal: str) -> Row:
        """The accelerations in a normal force, over coordinates, for adding to them."""
        return next(entry[4] for entry in self.normals if entry[0] == normal)

    def _new_state(self, name: str) -> None:
        if name in self.signals or name in self.network or name in self.coordinates:
            raise ValueError(f"the rig has a state {name!r} already; choose another name")

    @property
    def strike(self) -> Row:
        """The force on each coordinate for a knock of one newton."""
        return self.struck or (self.patches[0][1] if self.patches else {self.coordinates[0]: 1.0})

    @property
    def names(self) -> list[str]:
        """State names in the order of x."""
        return [*self.coordinates, *(f"{c}'" for c in self.coordinates), *self.network, *self.signals]


def add(target: Row, row: Row) -> None:
    """Add `row` to `target` in place."""
    for name, value in row.items():
        target[name] = target.get(name, 0.0) + value
