"""Turns rows by name into matrices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.model.named_rows import Circuit, Part, Row, Rows, Variation
from rig.model.product_terms import Factor, Product
from rig.model.system import System
from rig.model.system_parts import Change, Limiter, Loss, Normal, Patch, Position, Sector, Switch
from rig.solve.product_inputs import FRICTION, NORMAL, PRESS, SINE, STATE, VERSINE


def matrices(a: Rows) -> System:
    """The system of these rows. Raises SceneError if a row names an unknown state."""
    names = a.names
    index = {name: i for i, name in enumerate(names)}
    products = _products(a, index)
    later = {product.name: j for j, product in enumerate(products)}
    nq, n = len(a.coordinates), len(names)
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
        return np.array([entries.get(c, 0.0) for c in a.coordinates])

    def square(entries: dict[tuple[str, str], float]) -> NDArray[np.float64]:
        out = np.zeros((nq, nq))
        for (i, j), value in entries.items():
            out[index[i], index[j]] += value
        return out

    def form(stores: Iterable[tuple[float, Row]]) -> NDArray[np.float64]:
        out = np.zeros((n, n))
        for coefficient, entries in stores:
            over_x = row("stored energy", entries)
            out += coefficient * np.outer(over_x, over_x)
        return out

    def loss(conductance: float, entries: Row) -> Loss:
        rates = {f"{name}'": i for i, name in enumerate(a.network)}
        rate = np.zeros(len(rates))
        for name in entries.keys() & rates.keys():
            rate[rates[name]] = entries[name]
        return Loss(conductance, row("loss", {k: v for k, v in entries.items() if k not in rates}), rate)

    def position(circuit: Circuit, owned: Sequence[str]) -> Position:
        rates = [row(f"{circuit.name} {e}", circuit.rates.get(e, a.network[e])) for e in owned]
        limiters = [limiter[0] for limiter in a.limiters]
        return Position(
            circuit.name,
            np.array(rates).reshape(-1, n),
            tuple(index[name] for name in circuit.still),
            {limiters.index(name): gain for name, gain in circuit.gains.items()},
            form(circuit.stores),
        )

    def switch(name: str, signal: str, circuits: tuple[Circuit, ...]) -> Switch:
        owned = [e for e in a.network if any(e in circuit.rates for circuit in circuits)]
        where = tuple(index[e] for e in owned)
        return Switch(name, index[signal], where, tuple(position(circuit, owned) for circuit in circuits))

    def varied(v: Variation) -> Sector:
        count = len(v.factors)
        edges = tuple(v.period * i / count for i in range(count))
        stiffness, damping = square(v.stiffness), square(v.damping)
        rows = np.array([row(v.name, v.rows.get(normal[0], {})) for normal in a.normals]).reshape(-1, n)
        changes = tuple(Change((e - 1.0) * stiffness, (d - 1.0) * damping, (e - 1.0) * rows) for e, d in v.factors)
        return Sector(v.name, -1, row(v.name, v.row), index[v.turn], v.period, edges, changes=changes)

    patch_names = [p[0] for p in a.patches]
    pushed = [both(f"force on {c}", a.force.get(c, {})) for c in a.coordinates]
    system = System(
        names=tuple(names),
        coordinates=tuple(a.coordinates),
        mass=square(a.mass),
        damping=square(a.damping),
        stiffness=square(a.stiffness),
        force=np.array([over_x for over_x, _ in pushed]).reshape(nq, n),
        force_t=np.array([over_t for _, over_t in pushed]).reshape(nq, len(products)),
        coupling=np.array([row(f"coupling {c}", a.coupling.get(c, {})) for c in a.coordinates]).reshape(nq, n),
        store=form(a.stores),
        losses=tuple(loss(*entry) for entry in a.losses),
        network=np.array([row(f"network {e}", r) for e, r in a.network.items()]).reshape(-1, n),
        signals=np.array([row(f"signal {s}", r) for s, r in a.signals.items()]).reshape(-1, n),
        patches=tuple(
            Patch(
                name,
                over_coordinates(t),
                row(f"surface speed of {name}", surface),
                law,
                None if travel is None else over_coordinates(travel),
            )
            for name, t, surface, law, travel in a.patches
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
            for name, patch, r, d, g, opens in a.normals
        ),
        limiters=tuple(
            Limiter(name, row(f"limiter {name}", r), low, high, index[signal], gain, excess)
            for name, r, low, high, signal, gain, excess in a.limiters
        ),
        sectors=(
            *(
                Sector(name, patch_names.index(patch), row(f"sector {name}", r), index[turn], period, edges, laws)
                for name, patch, r, turn, period, edges, laws in a.sectors
            ),
            *(varied(variation) for variation in a.variations),
        ),
        switches=tuple(switch(*entry) for entry in a.switches),
        products=products,
        judges=tuple(a.judges),
        strike=over_coordinates(a.strike),
        kept={name: row(f"what {name} keeps", r) for name, r in a.keep.items()},
        start=np.array([a.start.get(name, 0.0) for name in names]),
        film=a.film,
    )
    if faults:
        raise SceneError(a.title or "assembly", faults)
    return system


def _products(a: Rows, index: dict[str, int]) -> tuple[Product, ...]:
    """The products in the order of their levels. Raises KeyError for an unknown factor."""
    patches, normals = [p[0] for p in a.patches], [k[0] for k in a.normals]

    def factor(part: Part) -> Factor:
        if not isinstance(part, str):
            angle = np.zeros(len(index))
            for name, value in part[1].items():
                angle[index[name]] += value
            return Factor({"sin": SINE, "cos-1": VERSINE, "press": PRESS}[part[0]], 0, angle)
        if part.startswith("N:"):
            return Factor(NORMAL, normals.index(part[2:]))
        if part.startswith("T:"):
            return Factor(FRICTION, patches.index(part[2:]))
        return Factor(STATE, index[part])

    found = [Product(name, tuple(factor(part) for part in parts)) for name, parts in a.products.items()]
    return tuple(sorted(found, key=lambda product: product.level))
