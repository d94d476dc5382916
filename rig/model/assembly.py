"""A rig as plants and effects describe it, and its matrices: `Assembly(...).system()` turns rows by name into a System.

An assembly holds rows by name (rig.model.named_rows), outputs and inputs. Outputs are extended rows: they may also name
accelerations and forces. A rig with a film has further states; `refusal` says whether kick supports it, `fastest` gives
its highest frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import PartError, SceneError
from rig.model.film import Film, at, on
from rig.model.friction_law import Law
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
from rig.solve.forces import FRICTION, NORMAL, PRESS, SINE, STATE, VERSINE

Array = NDArray[np.float64]
_SAME = 1e-6  # relative distance of an eigenvalue computed in two ways
_EXAMINED = 9  # number of examined positions of the slider
Write = Callable[[NDArray[np.float64], Mapping[str, float], float], None]
Role = Literal["", "displacement", "velocity", "drive"]


def add_film_states(a: Rows, film: Film) -> None:
    """Add the states of a film to a rig, after all others."""
    if on(a.coordinates[0]) in a.signals:
        return
    driven = a.signals[film.slid]
    speed = sum(rate * a.start.get(state, 0.0) for state, rate in driven.items())
    start = film.start(a.coordinates, a.start, speed)
    for name in film.states(a.coordinates):
        a.signal(name, {}, start[name], "film")
    for name in a.coordinates:
        a.push(name, {on(name): 1.0})
    damped = bool(film.damping.any())
    for point, (stiffness, shear) in enumerate(zip(film.stiffness.tolist(), film.shear.tolist())):
        for kind in ("f", "g")[: film.directions - 1]:
            a.stores.append((1.0 / shear, {at(kind, point): 1.0}))
        if damped:
            a.stores.append((stiffness, {at("c", point): 1.0}))
        else:
            a.stores.append((1.0 / stiffness, {at("P", point): 1.0}))


def refusal(system: System) -> str:
    """The reason why kick does not support this system with a film; "" if it does."""
    if system.limiters or system.sectors or system.switches or system.products:
        return (
            "supports structures, linear networks, a film and command states only: no limits of a drive, load or "
            "amplifier, no switch (shunt.connected moved in a run), no sectors; leave them out, or use at most eight "
            "contacts without a film (structure.film = false)"
        )
    return ""


def with_film_contacts(system: System) -> System:
    """The system whose only contacts are those in the film."""
    return replace(system, patches=(), normals=())


def fastest(system: System, h: float) -> float:
    """The highest angular frequency [rad/s] with every point closed and stuck, over all positions of the slider.

    A damped film at steps of `h` [s] counts as stiffer, by the value of its three-point damping for alternating
    positions.
    """
    film = system.film
    highest = 0.0
    assert film is not None
    stiffness = film.stiffness + 4.0 * film.damping / h
    inverse = np.linalg.inv(np.linalg.cholesky(system.mass))
    places = np.unique(np.linspace(0.0, film.longest, _EXAMINED))
    for place in places.tolist():
        normal, *sticking = film.everywhere(place)
        K = 0.5 * (system.stiffness + system.stiffness.T) + (stiffness * normal) @ normal.T
        K = K + sum((film.shear * row_t) @ row_t.T for row_t in sticking)
        squares = np.linalg.eigvalsh(inverse @ K @ inverse.T)
        highest = max(highest, float(squares[-1]))
    turning = inverse @ (0.5 * (system.damping - system.damping.T)) @ inverse.T
    rates = np.linalg.eigvals(turning)
    return math.sqrt(highest) + float(np.abs(rates).max(initial=0.0)) * bool(turning.any())


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
        rows = [self.row(f"{what} {name}", entries.get(name, {})) for name in of]
        return np.array(rows).reshape(-1, len(self.names))

    def both(self, what: str, entries: Row) -> tuple[Array, Array]:
        """A row over the states, and over the products."""
        out_t = np.zeros(len(self.products))
        for name in entries.keys() & self._later.keys():
            out_t[self._later[name]] = entries[name]
        return self.row(what, {name: value for name, value in entries.items() if name not in self._later}), out_t

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
        return Patch(
            name,
            self.over_coordinates(t),
            self.row(f"surface speed of {name}", surface),
            law,
            None if travel is None else self.over_coordinates(travel),
            tuple(self.index[f"{name}_{state.name}"] for state in law.states),
        )

    def normal(self, name: str, patch: str, row: Row, direction: Row, inertia: Row, opens: bool) -> Normal:
        """A normal force."""
        return Normal(
            name,
            self.patches.index(patch),
            *self.both(f"normal force {name}", row),
            self.over_coordinates(direction),
            self.over_coordinates(inertia),
            opens,
        )

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
        return Position(
            circuit.name,
            self.rows(circuit.name, self.rig.network | circuit.rates, owned),
            tuple(self.index[name] for name in circuit.still),
            {limiters.index(name): gain for name, gain in circuit.gains.items()},
            self.form(circuit.stores),
        )

    def varied(self, v: Variation) -> Sector:
        """Sectors of a structure that varies along a path."""
        count = len(v.factors)
        edges = tuple(v.period * i / count for i in range(count))
        stiffness = self.rig.summed(v.stiffness, v.blocks, "stiffness")
        damping = self.rig.summed(v.damping, v.blocks, "damping")
        rows = self.rows(v.name, v.rows, [normal[0] for normal in self.rig.normals])
        changes = tuple(Change((e - 1.0) * stiffness, (d - 1.0) * damping, (e - 1.0) * rows) for e, d in v.factors)
        return Sector(v.name, -1, self.row(v.name, v.row), self.index[v.turn], v.period, edges, changes=changes)

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


@dataclass(frozen=True)
class Output:
    """A quantity of the rig that a sensor may read: an extended row and its unit.

    `plot`: the plot in which it is drawn, by default that of its unit. `role`: "displacement" and "velocity" are the
    pair of the phase portrait, by default the first output with its rate of change; "drive" is the speed of a drive,
    which is no vibration. `on_request`: a run has it only if a sensor reads it or a limit of the scene names it.
    """

    row: Row
    unit: str
    plot: Plot | None = None
    role: Role = ""
    on_request: bool = False


def portrait(outputs: Mapping[str, Output]) -> tuple[str, str] | None:
    """The names of displacement and velocity that are declared, else of the first output with its rate of change.

    None if there is no such pair.
    """
    first_of_role: dict[Role, str] = {}
    for name, output in outputs.items():
        first_of_role.setdefault(output.role, name)
    if "displacement" in first_of_role and "velocity" in first_of_role:
        return first_of_role["displacement"], first_of_role["velocity"]
    for name, output in outputs.items():
        rate = {f"{coordinate}'": factor for coordinate, factor in output.row.items()}
        if not rate:
            continue
        for other, shown in outputs.items():
            if dict(shown.row) == rate:
                return name, other
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


class Nodes(NamedTuple):
    """Nodes of a mesh at `xyz` [node, 3] m, and their displacements as `rows` [node, 3, coordinate].

    `faces` [face, 4]: the corners of the outer faces, where they are known; a triangle has one corner twice.
    """

    xyz: Array
    rows: Array
    coordinates: tuple[str, ...]
    faces: NDArray[np.int32]


class Accuracy(NamedTuple):
    """Estimated relative `errors` [i] of the eigenvalues `rates` [i] of a reduced structure, and `notes` about them."""

    rates: NDArray[np.complex128]
    errors: Array
    notes: tuple[str, ...] = ()

    def of(self, rates: NDArray[np.complex128]) -> Array:
        """The error of each of these `rates` (or of its conjugate), NaN where it is not known."""
        upper = rates.real + 1j * np.abs(rates.imag)
        far = np.abs(upper[:, None] - np.append(self.rates, np.inf)[None, :])
        nearest = far.argmin(axis=1)
        known = far[np.arange(rates.size), nearest] <= _SAME * np.abs(rates)
        return np.where(known, np.append(self.errors, np.nan)[nearest], np.nan)


@dataclass
class Assembly(Rows):
    """A rig under construction: its rows, its outputs and inputs. `system()` turns names into matrices.

    `free`: natural frequencies [Hz] of a part of the rig on its own, listed beside those of the rig. `limits`: friction
    coefficients at which the rig reaches a limit of its own, by name. `bounds`: the scene's limits of outputs, by name.
    `accuracy`: of a reduced structure, from the Jacobian [state, state] of its moving states about an equilibrium, and
    whether only errors are wanted, without checks of contact points and damping; `outside`: numbers beyond the range
    that its reduction holds for, a sentence each; `up_to`: frequency [Hz] up to which it holds. `nodes`: of its mesh,
    for mode shapes.
    """

    outputs: dict[str, Output] = field(default_factory=dict)
    inputs: dict[str, Input] = field(default_factory=dict)
    free: dict[str, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    bounds: Mapping[str, float] = field(default_factory=dict)
    accuracy: Callable[[Array, bool], Accuracy] | None = None
    outside: tuple[str, ...] = ()
    up_to: float = math.inf
    nodes: Callable[[], Nodes] | None = None

    def add_memory(self) -> None:
        """Add the internal states of the friction laws as outputs. Raises PartError for the name of another output."""
        for patch, _, _, law, _ in self.patches:
            for state in law.states:
                if (name := f"{patch}_{state.name}") in self.outputs:
                    raise PartError(
                        f"the rig has an output {name!r} already; rename the state {state.name!r} of its law"
                    )
                self.outputs[name] = Output({name: 1.0}, state.unit, Plot())

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
