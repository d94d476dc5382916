"""Rows by name: the form in which plants and effects write a rig down.

State  x = [q, v, network, signals]. A row is a dict from state names to coefficients, e.g. {"one": 20, "dither": 1}.
A coordinate "x" brings the states "x" and "x'"; "x''" is its acceleration, which only outputs may name. The signal
"one" is constant. Outputs may also name, for a contact c, "T:c" (friction force), "N:n" (normal force n), "w:c" (slip
speed). Everything that couples is such a row, so an effect adds rows and nothing else.

What is not linear is a product with a name of its own (`Assembly.product`), which rows of forces, normal forces and
outputs name like a state.

    structure  M a + D v + K q = sum_p t_p T_p + sum_k n_k N_k + F x
    patch p    w_p = V_p - t_p . v          normal k   N_k = r_k x + g_k . a
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.solve.laws import Law
from rig.solve.products import FRICTION, NORMAL, SINE, STATE, VERSINE, Factor, Product
from rig.solve.system import Limiter, Normal, Patch, Sector, System

Row = dict[str, float]
Part = str | tuple[str, Row]
Write = Callable[[NDArray[np.float64], Mapping[str, float], float], None]


@dataclass(frozen=True)
class Output:
    """A quantity of the rig that an instrument may read: an extended row and its unit."""

    row: Row
    unit: str


@dataclass(frozen=True)
class Input:
    """An actuator: its unit, its range, its value in force at the start and the one it takes when left alone.

    A command is put in force by writing the state `state`; a ramp by writing `slope` as well (a state too, so that no
    command changes a matrix). `write(x, values, t)` serves inputs that act on several states: `values` holds what is
    commanded of every input, t is the time [s]. An input without any of these changes the scene key of its own name.
    """

    unit: str
    low: float
    high: float
    value: float
    safe: float
    state: str = ""
    slope: str = ""
    write: Write | None = None


@dataclass
class Assembly:
    """A rig under construction. Plants start it, effects add rows, `system()` turns names into matrices.

    `free`: natural frequencies [Hz] of a part of the rig by itself, told beside those of the rig. `limits`:
    coefficients of friction at which something of it is used up.
    """

    title: str = ""
    coordinates: list[str] = field(default_factory=list)
    mass: dict[tuple[str, str], float] = field(default_factory=dict)
    damping: dict[tuple[str, str], float] = field(default_factory=dict)
    stiffness: dict[tuple[str, str], float] = field(default_factory=dict)
    force: dict[str, Row] = field(default_factory=dict)
    network: dict[str, Row] = field(default_factory=dict)
    signals: dict[str, Row] = field(default_factory=lambda: {"one": {}})
    start: dict[str, float] = field(default_factory=lambda: {"one": 1.0})
    patches: list[tuple[str, Row, Row, Law, Row | None]] = field(default_factory=list)
    normals: list[tuple[str, str, Row, Row, Row, bool]] = field(default_factory=list)
    limiters: list[tuple[str, Row, float, float, str, float]] = field(default_factory=list)
    sectors: list[tuple[str, str, Row, str, float, tuple[float, ...], tuple[Law, ...]]] = field(default_factory=list)
    products: dict[str, tuple[Part, ...]] = field(default_factory=dict)
    outputs: dict[str, Output] = field(default_factory=dict)
    inputs: dict[str, Input] = field(default_factory=dict)
    owners: dict[str, str] = field(default_factory=dict)
    free: dict[str, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)

    def coordinate(self, name: str, mass: float, damping: float = 0.0, stiffness: float = 0.0) -> None:
        """A degree of freedom with its own mass, damper and spring to ground."""
        self.coordinates.append(name)
        self.mass[name, name] = mass
        self.damping[name, name] = damping
        self.stiffness[name, name] = stiffness

    def signal(self, name: str, rate: Row, start: float, owner: str) -> None:
        """A state s with s' = rate; `owner` is the effect it belongs to."""
        self.signals[name] = dict(rate)
        self.start[name] = start
        self.owners[name] = owner

    def push(self, coordinate: str, row: Row) -> None:
        """Add a force row to a coordinate."""
        add(self.force.setdefault(coordinate, {}), row)

    def patch(self, name: str, direction: Row, surface: Row, law: Law, travel: Row | None = None) -> None:
        """A friction patch: `direction` over coordinates, `surface` speed as a row, its friction law.

        `travel`: what the slip speed counts of the body's motion, where that is not the direction of the force.
        """
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
        """A normal force of a patch, N = row x + inertia . a, along `direction`; opens at N = 0 or pulls."""
        self.normals.append((name, patch, dict(row), dict(direction or {}), dict(inertia or {}), opens))

    def product(self, name: str, *factors: Part) -> None:
        """A product for rows to name. Factors: a state, ("sin", row), ("cos-1", row), "N:normal", "T:patch"."""
        self.products[name] = factors

    def sector(
        self, name: str, patch: str, row: Row, turn: str, period: float, edges: tuple[float, ...], laws: tuple[Law, ...]
    ) -> None:
        """Friction by place: `laws[i]` where edges[i] <= row < edges[i + 1], the last up to `period`; edges[0] = 0.

        State `turn`, which `row` counts fully, is moved by a period where the place leaves [0, period).
        """
        self.sectors.append((name, patch, dict(row), turn, period, edges, laws))

    def limit(self, name: str, row: Row, low: float, high: float, signal: str, gain: float) -> None:
        """A clamp: signal' gains `gain * min(max(row x, low), high)`."""
        self.limiters.append((name, dict(row), low, high, signal, gain))

    def surface(self, patch: str) -> Row:
        """The surface speed row of a patch, to add to."""
        return next(entry[2] for entry in self.patches if entry[0] == patch)

    def load(self, normal: str) -> Row:
        """The row of a normal force, to add to."""
        return next(entry[2] for entry in self.normals if entry[0] == normal)

    def inertia(self, normal: str) -> Row:
        """The accelerations in a normal force, over coordinates, to add to."""
        return next(entry[4] for entry in self.normals if entry[0] == normal)

    @property
    def names(self) -> list[str]:
        """State names in the order of x."""
        return [*self.coordinates, *(f"{c}'" for c in self.coordinates), *self.network, *self.signals]

    def system(self) -> System:
        """The matrices. Raises SceneError when a row names an unknown state."""
        names = self.names
        index = {name: i for i, name in enumerate(names)}
        products = self._products(index)
        later = {product.name: j for j, product in enumerate(products)}
        nq, n = len(self.coordinates), len(names)
        faults: list[str] = []

        def row(what: str, entries: Row) -> NDArray[np.float64]:
            out = np.zeros(n)
            for name, value in entries.items():
                if name in index:
                    out[index[name]] += value
                else:
                    faults.append(f"{what} names the unknown state {name!r}; known: {', '.join(names)}")
            return out

        def both(what: str, entries: Row) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            out_t = np.zeros(len(products))
            for name in entries.keys() & later.keys():
                out_t[later[name]] = entries[name]
            return row(what, {name: value for name, value in entries.items() if name not in later}), out_t

        def over_coordinates(entries: Row) -> NDArray[np.float64]:
            return np.array([entries.get(c, 0.0) for c in self.coordinates])

        def square(entries: dict[tuple[str, str], float]) -> NDArray[np.float64]:
            out = np.zeros((nq, nq))
            for (a, b), value in entries.items():
                out[index[a], index[b]] += value
            return out

        patch_names = [p[0] for p in self.patches]
        pushed = [both(f"force on {c}", self.force.get(c, {})) for c in self.coordinates]
        system = System(
            names=tuple(names),
            coordinates=tuple(self.coordinates),
            mass=square(self.mass),
            damping=square(self.damping),
            stiffness=square(self.stiffness),
            force=np.array([over_x for over_x, _ in pushed]).reshape(nq, n),
            force_t=np.array([over_t for _, over_t in pushed]).reshape(nq, len(products)),
            network=np.array([row(f"network {e}", r) for e, r in self.network.items()]).reshape(-1, n),
            signals=np.array([row(f"signal {s}", r) for s, r in self.signals.items()]).reshape(-1, n),
            patches=tuple(
                Patch(
                    name,
                    over_coordinates(t),
                    row(f"surface speed of {name}", surface),
                    law,
                    None if travel is None else over_coordinates(travel),
                )
                for name, t, surface, law, travel in self.patches
            ),
            normals=tuple(
                Normal(
                    name,
                    patch_names.index(patch),
                    *both(f"normal force {name}", r),
                    over_coordinates(d),
                    over_coordinates(g),
                    opens,
                )
                for name, patch, r, d, g, opens in self.normals
            ),
            limiters=tuple(
                Limiter(name, row(f"limiter {name}", r), low, high, index[signal], gain)
                for name, r, low, high, signal, gain in self.limiters
            ),
            sectors=tuple(
                Sector(name, patch_names.index(patch), row(f"sector {name}", r), index[turn], period, edges, laws)
                for name, patch, r, turn, period, edges, laws in self.sectors
            ),
            products=products,
            start=np.array([self.start.get(name, 0.0) for name in names]),
        )
        if faults:
            raise SceneError(self.title or "assembly", faults)
        return system

    def _products(self, index: dict[str, int]) -> tuple[Product, ...]:
        """The products in the order of their levels. Raises KeyError for an unknown factor."""
        patches, normals = [p[0] for p in self.patches], [k[0] for k in self.normals]

        def factor(part: Part) -> Factor:
            if not isinstance(part, str):
                angle = np.zeros(len(index))
                for name, value in part[1].items():
                    angle[index[name]] += value
                return Factor({"sin": SINE, "cos-1": VERSINE}[part[0]], 0, angle)
            if part.startswith("N:"):
                return Factor(NORMAL, normals.index(part[2:]))
            if part.startswith("T:"):
                return Factor(FRICTION, patches.index(part[2:]))
            return Factor(STATE, index[part])

        found = [Product(name, tuple(factor(part) for part in parts)) for name, parts in self.products.items()]
        return tuple(sorted(found, key=lambda product: product.level))


def add(target: Row, row: Row) -> None:
    """Add `row` to `target` in place."""
    for name, value in row.items():
        target[name] = target.get(name, 0.0) + value
