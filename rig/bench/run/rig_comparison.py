"""Comparison of the rigs of a run with other rigs, at the same states: accelerations, rates and forces.

At each state accelerations a of the coordinates, rates r of the other state variables, contact forces T, and the
largest friction S that a stuck contact can bear are compared. The share by which the rigs differ is

    max( |M^1/2 (a - a')| / |M^1/2 |a||,  |r - r'| / ||r||,  |T - T'| / |T|,  |S - S'| / |S| )

with norms over all these states, where the denominator is the larger one of both rigs. |a| and |r| are the sums of the
sizes of their terms, so that it is not zero in steady sliding, where all forces balance. Contacts are in the same mode
set, except where one would leave it in the other rig.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from math import hypot, inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.bench.run.driving_history import Variant, clamped
from rig.model.assembly import Input
from rig.model.formulation import ModeSet, assemble
from rig.model.system import System
from rig.scenes.scene import Scene
from rig.solve.records import CLOSED, HIGH, LINEAR, LOW, OPEN, SLIP_MINUS, SLIP_PLUS, STICK
from rig.stability.linearisation import inputs, linearised, own_law

Array = NDArray[np.float64]

Compared = dict[str, tuple[float, float, float]]
"""Name -> value, size of its terms, weight."""
_MARGIN = 1e-9
"""Share by which a guard is beyond zero where a contact has left its mode."""
_LATER = 0.05
"""Share of the largest slip speed of the run. # chosen. A change below it that reverses a slip only shifts an event."""
_ROUNDS = 3
"""Most times that contacts of another rig are looked at, and steps of Newton's method."""


class VisitedState(NamedTuple):
    """A state of a run and its mode set, at tick `tick`; `scene`: of the rig there."""

    system: System
    key: int
    x: Array
    scene: Scene
    tick: int = 0


class Forces(NamedTuple):
    """The inputs T at a state, the friction force of each patch, each normal force, the load of each patch [N]."""

    T: Array
    friction: Array
    normal: Array
    load: Array


class Comparison:
    """Compares the states `kept` of a run with the same states of other rigs. Mode sets are assembled once."""

    def __init__(self, kept: Sequence[VisitedState]) -> None:
        self._kept = kept
        self._fastest: dict[str, float] = {}
        for visited in kept:
            for name, (speed, _) in _slips(visited.system, visited.key, visited.x).items():
                self._fastest[name] = max(self._fastest.get(name, 0.0), abs(speed))
        self._modes: dict[tuple[int, int], tuple[System, ModeSet | None]] = {}  # an id is unique as long as it is kept
        self._own: dict[int, tuple[Compared, Collection[tuple[int, str]]]] = {}

    def share(self, variant: Variant, added_states: Callable[[int], Mapping[str, float]] = lambda _: {}) -> float:
        """Share by which the rigs `variant` differ from those of the run at its states (see the head of this module).

        `added_states`: values of driving states that the run does not have, at a tick.
        """
        sums: dict[str, list[float]] = {}
        for i, visited in enumerate(self._kept):
            modes = self.modes(visited.system, visited.key)
            if modes is None:
                continue
            if i not in self._own:
                at = visited.system, modes, visited.x, forces_at(visited.system, modes, visited.x)
                self._own[i] = _compared_values(*at), _departures(*at)
            mine, departing = self._own[i]
            other = self._counterpart(visited, departing, *variant(visited.scene), added_states(visited.tick))
            if other is None:
                continue
            theirs = _compared_values(*other)
            for name, (value, size, weight) in mine.items():  # in their order: the last digit of a sum hangs on it
                if name not in theirs:
                    continue
                group = name.partition(" ")[0]
                value_there, size_there, _ = theirs[name]
                total = sums.setdefault("a" if group == "a" else name, [0.0, 0.0, 0.0])
                for j, part in enumerate((value - value_there, size, size_there)):
                    total[j] = hypot(total[j], sqrt(weight) * part)
        return max((away / max(sizes) for away, *sizes in sums.values() if max(sizes) > 0.0), default=0.0)

    def inertia(self) -> float:
        """The norm of the inertia forces over that of all forces on the coordinates, over the states."""
        inertia = forces = 0.0
        for visited in self._kept:
            modes = self.modes(visited.system, visited.key)
            if modes is None:
                continue
            values = _compared_values(visited.system, modes, visited.x, forces_at(visited.system, modes, visited.x))
            for name, (value, size, weight) in values.items():
                if name.startswith("a "):
                    inertia += weight * value * value
                    forces += weight * size * size
        return sqrt(inertia / forces) if forces else 0.0

    def modes(self, system: System, key: int) -> ModeSet | None:
        """The mode set `key` of `system`; None if it is singular."""
        if (id(system), key) not in self._modes:
            try:
                self._modes[id(system), key] = system, assemble(system, key)
            except np.linalg.LinAlgError:
                self._modes[id(system), key] = system, None
        return self._modes[id(system), key][1]

    def _counterpart(
        self,
        visited: VisitedState,
        departing: Collection[tuple[int, str]],
        other: System,
        inputs: Mapping[str, Input],
        more: Mapping[str, float],
    ) -> tuple[System, ModeSet, Array, Forces] | None:
        """The other rig, its mode set, state and forces: what both have is as visited, as far as it can be.

        The other rig is in another mode set where a contact would leave its own, and where the visited rig does not;
        a slip that reverses because it changes by little does so in the visited rig too, a moment later.
        Structure and network that only the other rig has are in equilibrium. `departing`: parts that cannot be in
        their mode in the visited rig.
        """
        x = _carried(visited, other, inputs, more)
        excused = {*departing}
        at = _same_mode_set(visited, other, x)
        slips = _slips(visited.system, visited.key, visited.x)
        for name, (speed, mode) in _slips(other, other.key(*at), x).items():
            before, _ = slips.get(name, (inf, mode))
            if mode != STICK and abs(speed - before) <= _LATER * self._fastest.get(name, 0.0):
                excused.add((0, name))
        for _ in range(_ROUNDS):
            there = self.modes(other, other.key(*at))
            if there is None:
                return None
            x = _in_equilibrium(visited.system, other, there, x)
            forces = forces_at(other, there, x)
            departing = _departures(other, there, x, forces)
            departures = {part: mode for part, mode in departing.items() if part not in excused}
            if not departures:
                return other, there, x, forces
            excused |= departures.keys()
            for kind, parts in enumerate(_parts(other)):
                at[kind] = [departures.get((kind, part.name), mode) for part, mode in zip(parts, at[kind])]
        there = self.modes(other, other.key(*at))
        return None if there is None else (other, there, x, forces_at(other, there, x))


def _slips(system: System, key: int, x: Array) -> dict[str, tuple[float, int]]:
    """The slip speed [m/s] and the mode of every patch."""
    speeds = (system.slip_rows @ x).tolist()
    modes = system.modes(key)[0]
    return {patch.name: (speed, mode) for patch, speed, mode in zip(system.patches, speeds, modes)}


def _same_mode_set(visited: VisitedState, other: System, x: Array) -> list[list[int]]:
    """The modes of the parts of another rig at its state x: those visited, else as x has them."""
    known = map(_by_name, _parts(visited.system), visited.system.modes(visited.key))
    patches, normals, limiters, sectors, switches = map(_with_modes, _parts(other), known)
    return [
        [SLIP_PLUS if mode is None else mode for _, mode in patches],
        [mode if mode is not None and normal.opens else CLOSED for normal, mode in normals],
        [_limited(limiter, x) if mode is None else mode for limiter, mode in limiters],
        [sector.at(x) if mode is None else mode for sector, mode in sectors],
        [switch.at(x) if mode is None else mode for switch, mode in switches],
    ]


def _parts(system: System) -> tuple[Sequence[Any], ...]:
    return system.patches, system.normals, system.limiters, system.sectors, system.switches


def _by_name(parts: Sequence[Any], modes: Sequence[int]) -> dict[str, int]:
    return {part.name: mode for part, mode in zip(parts, modes)}


def _with_modes(parts: Sequence[Any], modes: Mapping[str, int]) -> list[tuple[Any, int | None]]:
    """Each part with its mode in another rig; None if that rig does not have it."""
    return [(part, modes.get(part.name)) for part in parts]


def _limited(limiter: Any, x: Array) -> int:
    """The mode of a limiter at the state x."""
    value = float(limiter.row @ x)
    if value < limiter.low:
        return LOW
    return HIGH if value > limiter.high else LINEAR


def _carried(visited: VisitedState, other: System, inputs: Mapping[str, Input], more: Mapping[str, float]) -> Array:
    """The state of the other rig: as visited, commands within its ranges; else of `more`, else start values."""
    known = dict(zip(visited.system.names, visited.x.tolist()))
    known = {name: float(value) for name, value in clamped(known, inputs).items()} | dict(more)
    return np.array([known.get(name, start) for name, start in zip(other.names, other.start.tolist())])


def _in_equilibrium(system: System, other: System, modes: ModeSet, x: Array) -> Array:
    """`x` with those states of structure and network that `system` does not have at rest, in equilibrium."""
    nq = len(other.coordinates)
    lacking = [i for i in range(other.one) if other.names[i] not in system.names]
    if not lacking:
        return x
    x = x.copy()
    rows = [i for i in lacking if i >= nq]
    free = [i for i in lacking if i < nq or i >= 2 * nq]
    x[[i for i in lacking if nq <= i < 2 * nq]] = 0.0
    for _ in range(_ROUNDS):
        A, T, _ = linearised(other, modes, x, own_law(other, modes))
        rates = (modes.A @ x + modes.b @ T)[rows]
        x[free] -= np.linalg.lstsq(A[np.ix_(rows, free)], rates, rcond=None)[0]
    return x


def forces_at(system: System, modes: ModeSet, x: Array) -> Forces:
    """The forces at the state x, in the mode set `modes`."""
    T, _ = inputs(system, modes, x, own_law(system, modes))
    friction = modes.friction @ x + modes.friction_t @ T
    normal = modes.normal @ x + modes.normal_t @ T
    load = modes.load @ x + modes.load_t @ T
    return Forces(T, friction, normal, load)


def _departures(system: System, modes: ModeSet, x: Array, forces: Forces) -> dict[tuple[int, str], int]:
    """Parts that cannot be in their mode at x -> the mode they take. A part: 0 and a patch, 1 and a normal force."""
    patches, normals, *_ = system.modes(modes.key)
    _, friction, normal, load = forces
    speed = system.slip_rows @ x
    scale = np.abs(system.slip_rows) @ np.abs(x)
    departures = {}
    for p, (patch, mode) in enumerate(zip(system.patches, patches)):
        most = system.law(p, modes.key).towards(friction[p]).static * load[p]
        if mode == STICK and load[p] > 0.0 and abs(friction[p]) > (1.0 + _MARGIN) * most:
            departures[0, patch.name] = SLIP_PLUS if friction[p] > 0.0 else SLIP_MINUS
        elif modes.sigma[p] * speed[p] < -_MARGIN * scale[p]:
            departures[0, patch.name] = SLIP_MINUS if mode == SLIP_PLUS else SLIP_PLUS
    size = np.abs(modes.normal) @ np.abs(x)
    for k, (contact, mode) in enumerate(zip(system.normals, normals)):
        if contact.opens and mode == CLOSED and normal[k] < -_MARGIN * size[k]:
            departures[1, contact.name] = OPEN
    return departures


def _compared_values(system: System, modes: ModeSet, x: Array, forces: Forces) -> Compared:
    """(value, size of its terms, weight) of each acceleration, each other rate and each contact force."""
    nq = len(system.coordinates)
    T, friction, _, load = forces
    rates = modes.A @ x + modes.b @ T
    sizes = np.abs(modes.A) @ np.abs(x) + np.abs(modes.b) @ np.abs(T)
    compared = {}
    for i, name in enumerate(system.coordinates):
        compared[f"a {name}"] = (rates[nq + i], sizes[nq + i], system.mass[i, i])
    for i in range(2 * nq, system.n):
        compared[f"r {system.names[i]}"] = (rates[i], sizes[i], 1.0)
    for patch, force, normal in zip(system.patches, friction.tolist(), load.tolist()):
        compared[f"T {patch.name}"] = (force, force, 1.0)
        compared[f"N {patch.name}"] = (normal, normal, 1.0)
    patches = system.modes(modes.key)[0]
    for p, (patch, mode) in enumerate(zip(system.patches, patches)):
        if mode == STICK:
            most = system.law(p, modes.key).towards(friction[p]).static * float(load[p])
            compared[f"S {patch.name}"] = (most, most, 1.0)
    return compared
