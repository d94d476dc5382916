"""The matrices of a rig from its rows by name: `matrices` turns Rows (rig.model.named_rows) into a System."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.model.friction_law import Law
from rig.model.named_rows import Circuit, Part, Row, Rows, Variation
from rig.model.products import Factor, Product
from rig.model.system import Change, Limiter, Loss, Normal, Patch, Position, Sector, Switch, System
from rig.solve.forces import FRICTION, NORMAL, PRESS, SINE, STATE, VERSINE

Array = NDArray[np.float64]


class _Names:
    """The states and products of a rig by name, and the faults of the rows that name others."""

    def __init__(self, a: Rows) -> None:
        self.rig = a
        self.names = a.names
        self.index = {name: i for i, name in enumerate(self.names)}
        self.patches = [patch[0] for patch in a.patches]
        self.products = self._products()
        self._later = {product.name: j for j, product in enumerate(self.products)}
        self.faults: list[str] = []

    def row(self, what: str, entries: Row) -> Array:
        """A row over the states; `what`: to name it in a fault."""
        out = np.zeros(len(self.names))
        for name, value in entries.items():
            if name in self.index:
                out[self.index[name]] += value
            else:
                self.faults.append(f"{what} names the unknown state {name!r}; known: {', '.join(self.names)}")
        return out

    def rows(self, what: str, entries: Mapping[str, Row], of: Iterable[str]) -> Array:
        """The rows of these parts, one below the other; none where a part has no entries."""
        rows = []
        for name in of:
            rows.append(self.row(f"{what} {name}", entries.get(name, {})))
        return np.array(rows).reshape(-1, len(self.names))

    def both(self, what: str, entries: Row) -> tuple[Array, Array]:
        """A row over the states, and over the products."""
        out_t = np.zeros(len(self.products))
        for name in entries.keys() & self._later.keys():
            out_t[self._later[name]] = entries[name]
        over_states = {name: value for name, value in entries.items() if name not in self._later}
        return self.row(what, over_states), out_t

    def over_coordinates(self, entries: Row) -> Array:
        """A row over the coordinates."""
        return np.array([entries.get(c, 0.0) for c in self.rig.coordinates])

    def form(self, stores: Iterable[tuple[float, Row]]) -> Array:
        """Twice a stored energy as a form over the states."""
        out = np.zeros((len(self.names), len(self.names)))
        for coefficient, entries in stores:
            over_x = self.row("stored energy", entries)
            out += coefficient * np.outer(over_x, over_x)
        return out

    def loss(self, conductance: float, entries: Row) -> Loss:
        """A resistor, whose row may name rates of the network."""
        rates = {f"{name}'": i for i, name in enumerate(self.rig.network)}
        rate = np.zeros(len(rates))
        for name in entries.keys() & rates.keys():
            rate[rates[name]] = entries[name]
        over_states = {name: value for name, value in entries.items() if name not in rates}
        return Loss(conductance, self.row("loss", over_states), rate)

    def patch(self, name: str, t: Row, surface: Row, law: Law, travel: Row | None) -> Patch:
        """A friction contact."""
        direction = self.over_coordinates(t)
        speed = self.row(f"surface speed of {name}", surface)
        along = None if travel is None else self.over_coordinates(travel)
        memory = tuple(self.index[f"{name}_{state.name}"] for state in law.states)
        return Patch(name, direction, speed, law, along, memory)

    def normal(self, name: str, patch: str, row: Row, direction: Row, inertia: Row, opens: bool) -> Normal:
        """A normal force."""
        p = self.patches.index(patch)
        over_x, over_t = self.both(f"normal force {name}", row)
        along = self.over_coordinates(direction)
        accelerations = self.over_coordinates(inertia)
        return Normal(name, p, over_x, over_t, along, accelerations, opens)

    def limiter(self, name: str, row: Row, low: float, high: float, signal: str, gain: float, excess: float) -> Limiter:
        """A clamp of the network."""
        return Limiter(name, self.row(f"limiter {name}", row), low, high, self.index[signal], gain, excess)

    def sector(
        self, name: str, patch: str, row: Row, turn: str, period: float, edges: tuple[float, ...], laws: tuple[Law, ...]
    ) -> Sector:
        """Sectors of a contact whose friction varies along a path."""
        p = self.patches.index(patch)
        return Sector(name, p, self.row(f"sector {name}", row), self.index[turn], period, edges, laws)

    def switch(self, name: str, signal: str, circuits: tuple[Circuit, ...]) -> Switch:
        """A switch, which owns the network states whose rates differ between its positions."""
        switched = {state for circuit in circuits for state in circuit.rates}
        owned = [state for state in self.rig.network if state in switched]
        places = tuple(self.index[state] for state in owned)
        positions = tuple(self._position(circuit, owned) for circuit in circuits)
        return Switch(name, self.index[signal], places, positions)

    def _position(self, circuit: Circuit, owned: Sequence[str]) -> Position:
        limiters = [limiter[0] for limiter in self.rig.limiters]
        rates = self.rows(circuit.name, self.rig.network | circuit.rates, owned)
        still = tuple(self.index[name] for name in circuit.still)
        gains = {limiters.index(name): gain for name, gain in circuit.gains.items()}
        return Position(circuit.name, rates, still, gains, self.form(circuit.stores))

    def varied(self, v: Variation) -> Sector:
        """Sectors of a structure that varies along a path."""
        count = len(v.factors)
        edges = tuple(v.period * i / count for i in range(count))
        stiffness = self.rig.summed(v.stiffness, v.blocks, "stiffness")
        damping = self.rig.summed(v.damping, v.blocks, "damping")
        normals = [normal[0] for normal in self.rig.normals]
        rows = self.rows(v.name, v.rows, normals)
        changes = []
        for e, d in v.factors:
            changes.append(Change((e - 1.0) * stiffness, (d - 1.0) * damping, (e - 1.0) * rows))
        position = self.row(v.name, v.row)
        return Sector(v.name, -1, position, self.index[v.turn], v.period, edges, changes=tuple(changes))

    def _products(self) -> tuple[Product, ...]:
        """The products in the order of their levels. Raises KeyError for an unknown factor."""
        normals = [k[0] for k in self.rig.normals]
        kinds = {"sin": SINE, "cos-1": VERSINE, "press": PRESS}

        def factor(part: Part) -> Factor:
            if not isinstance(part, str):
                angle = np.zeros(len(self.names))
                for name, value in part[1].items():
                    angle[self.index[name]] += value
                return Factor(kinds[part[0]], 0, angle)
            if part.startswith("N:"):
                return Factor(NORMAL, normals.index(part[2:]))
            if part.startswith("T:"):
                return Factor(FRICTION, self.patches.index(part[2:]))
            return Factor(STATE, self.index[part])

        products = [Product(name, tuple(map(factor, parts))) for name, parts in self.rig.products.items()]
        return tuple(sorted(products, key=lambda product: product.level))


def matrices(a: Rows) -> System:
    """The system of these rows. Raises SceneError if a row names an unknown state."""
    by_name = _Names(a)
    nq = len(a.coordinates)
    n = len(by_name.index)
    pushed = [by_name.both(f"force on {c}", a.force.get(c, {})) for c in a.coordinates]
    system = System(
        names=tuple(by_name.names),
        coordinates=tuple(a.coordinates),
        mass=a.matrix("mass"),
        damping=a.matrix("damping"),
        stiffness=a.matrix("stiffness"),
        force=np.array([over_x for over_x, _ in pushed]).reshape(nq, n),
        force_t=np.array([over_t for _, over_t in pushed]).reshape(nq, len(by_name.products)),
        coupling=by_name.rows("coupling", a.coupling, a.coordinates),
        store=by_name.form(a.stores),
        losses=tuple(by_name.loss(*entry) for entry in a.losses),
        network=by_name.rows("network", a.network, a.network),
        signals=by_name.rows("signal", a.signals, a.signals),
        patches=tuple(by_name.patch(*entry) for entry in a.patches),
        normals=tuple(by_name.normal(*entry) for entry in a.normals),
        limiters=tuple(by_name.limiter(*entry) for entry in a.limiters),
        sectors=(*(by_name.sector(*entry) for entry in a.sectors), *map(by_name.varied, a.variations)),
        switches=tuple(by_name.switch(*entry) for entry in a.switches),
        products=by_name.products,
        judges=tuple(a.judges),
        strike=by_name.over_coordinates(a.strike),
        kept={name: by_name.row(f"what {name} keeps", r) for name, r in a.keep.items()},
        start=np.array([a.start.get(name, 0.0) for name in by_name.names]),
        film=a.film,
    )
    for sector in system.sectors:
        patch = system.patches[sector.patch]
        states = patch.law.states
        if any(law.states != states for law in sector.laws):
            names = ", ".join(state.name for state in states)
            by_name.faults.append(
                f"sectors of {patch.name}: their laws have other internal states than that of the contact "
                f"({names or 'none'}); give laws with the same states"
            )
    if by_name.faults:
        raise SceneError(a.title or "assembly", by_name.faults)
    return system
