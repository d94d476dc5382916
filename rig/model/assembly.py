"""A rig as plants and effects describe it: an Assembly holds rows by name (rig.model.named_rows), outputs and inputs.

`Assembly(...).system()` turns the rows into a System (rig.model.matrices). Outputs are extended rows: they may also
name accelerations and forces. A rig with a film has further states; `refusal` says whether kick supports it, `fastest`
gives its highest frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import PartError
from rig.model.film import Film, at, on
from rig.model.matrices import matrices
from rig.model.named_rows import Row, Rows
from rig.model.system import Bound, System
from rig.picture import Plot

Array = NDArray[np.float64]
_SAME = 1e-6  # relative distance of an eigenvalue computed in two ways
_EXAMINED = 9  # number of examined positions of the slider
Write = Callable[[NDArray[np.float64], Mapping[str, float], float], None]
Role = Literal["", "displacement", "velocity", "drive"]


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
