"""A rig as plants and effects describe it: rows by name, its outputs, its inputs.

Outputs are extended rows: they may also name accelerations and forces (rig.model.named_rows).

A system with a film of points: its additional states, whether kick supports it, and its highest frequency.

Turns rows by name into matrices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.errors import SceneError
from rig.model.film import Film, at, on, over
from rig.model.named_rows import Circuit, Part, Row, Rows, Variation
from rig.model.system import (
    Bound,
    Change,
    Factor,
    Limiter,
    Loss,
    Normal,
    Patch,
    Position,
    Product,
    Sector,
    Switch,
    System,
)
from rig.picture import Plot
from rig.solve.film_steps import SUMS
from rig.solve.forces import FRICTION, NORMAL, PRESS, SINE, STATE, VERSINE

_EXAMINED = 9  # number of examined positions of the slider


def add_film_states(a: Rows, film: Film) -> None:
    """Add the states of a film to a rig, after all others."""
    if on(a.coordinates[0]) in a.signals:
        return
    for name in a.coordinates:
        a.signal(on(name), {}, 0.0, "film")
        a.push(name, {on(name): 1.0})
    for name in SUMS:
        a.signal(over(name), {}, 0.0, "film")
    for kept in film.of_points():
        for point in range(film.points):
            a.signal(at(kept, point), {}, 0.0, "film")
    for point in range(film.points):
        for kept in ("f", "g")[: film.directions - 1]:
            a.stores.append((1.0 / film.shear, {at(kept, point): 1.0}))
        if film.damping > 0.0:
            a.stores.append((film.stiffness, {at("c", point): 1.0}))
        else:
            a.stores.append((1.0 / film.stiffness, {at("P", point): 1.0}))


def refusal(system: System) -> str:
    """The reason why kick does not support this system with a film; "" if it does."""
    if system.limiters or system.sectors or system.switches or system.products or len(system.network):
        return "supports structures, a film and command states only: no drive or load with both a lag and limits"
    for matrix in (system.mass, system.damping, system.stiffness):
        if np.any(matrix - np.diag(np.diag(matrix))):
            return "needs coordinates that are modes of the structure, coupled by the film alone"
    if np.any(system.force[:, : system.one]):
        return "forces of the structure must come from command states"
    return ""


def with_film_contacts(system: System) -> System:
    """The system whose only contacts are those in the film."""
    return replace(system, patches=(), normals=())


def fastest(system: System, h: float) -> float:
    """The highest angular frequency [rad/s] with every point closed and stuck, over all positions of the slider.

    A damped film at steps of `h` [s] counts as stiffer, by the value of its three-point damping for alternating
    positions.
    """
    film, highest = system.film, 0.0
    assert film is not None
    stiffness = film.stiffness + 4.0 * film.damping / h
    root = 1.0 / np.sqrt(np.diag(system.mass))
    for place in np.linspace(0.0, film.longest, _EXAMINED).tolist():
        normal, *sticking = film.everywhere(place)
        K = system.stiffness + stiffness * (normal @ normal.T) + sum(film.shear * (one @ one.T) for one in sticking)
        highest = max(highest, float(np.linalg.eigvalsh(root[:, None] * K * root)[-1]))
    return math.sqrt(highest)


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


Write = Callable[[NDArray[np.float64], Mapping[str, float], float], None]


Role = Literal["", "displacement", "velocity", "drive"]


@dataclass(frozen=True)
class Output:
    """A quantity of the rig that a sensor may read: an extended row and its unit.

    `plot`: the plot in which it is drawn, by default that of its unit. `role`: "displacement" and "velocity" are the
    pair of the phase portrait, by default the first output with its rate of change; "drive" is the speed of a drive,
    which is no vibration.
    """

    row: Row
    unit: str
    plot: Plot | None = None
    role: Role = ""


def portrait(outputs: Mapping[str, Output]) -> tuple[str, str] | None:
    """The names of displacement and velocity that are declared, else of the first output with its rate of change.

    None if there is no such pair.
    """
    x, v = (next((n for n, one in outputs.items() if one.role == role), "") for role in ("displacement", "velocity"))
    if x and v:
        return x, v
    for name, output in outputs.items():
        rate = {f"{coordinate}'": factor for coordinate, factor in output.row.items()}
        if rate and (found := next((other for other, seen in outputs.items() if dict(seen.row) == rate), "")):
            return name, found
    return None


@dataclass(frozen=True)
class Input:
    """An actuator: its unit, its range, its value at the start and the safe value it takes without commands.

    A command comes into force by writing the state `state`; a ramp also writes `slope`, which is a state too, so that
    no command changes a matrix. `write(x, values, t)` serves inputs that act on several states: `values` holds the
    command of every input, t is the time [s]. An input without any of these changes the scene key of its own name.
    `lagging`: the state that follows the command; at the start of a run it equals the command. `ramped`: what a scene
    needs for a ramp of an input that takes steps only.
    """

    unit: str
    low: float
    high: float
    value: float
    safe: float
    state: str = ""
    slope: str = ""
    write: Write | None = None
    lagging: str = ""
    ramped: str = ""


@dataclass
class Assembly(Rows):
    """A rig under construction: its rows, its outputs and inputs. `system()` turns names into matrices.

    `free`: natural frequencies [Hz] of a part of the rig on its own, listed beside those of the rig. `limits`: friction
    coefficients at which the rig reaches a limit of its own, by name. `bounds`: the scene's limits of outputs, by name.
    """

    outputs: dict[str, Output] = field(default_factory=dict)
    inputs: dict[str, Input] = field(default_factory=dict)
    free: dict[str, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    bounds: Mapping[str, float] = field(default_factory=dict)

    def system(self) -> System:
        """The matrices. Raises SceneError if a row names an unknown state."""
        if self.film is not None:
            add_film_states(self, self.film)
        return self.sliding()

    def sliding(self) -> System:
        """The matrices without the time-dependent states of a film's points: enough for linearisation about sliding."""
        known = [(name, self.outputs[name], limit) for name, limit in self.bounds.items() if name in self.outputs]
        if self.film is not None:  # its forces are not known to linearised equations
            known = [entry for entry in known if entry[1].row.keys() <= {*self.names}]
        bounds = tuple(Bound(name, output.row, limit, output.unit) for name, output, limit in known)
        return replace(matrices(self), bounds=bounds)
