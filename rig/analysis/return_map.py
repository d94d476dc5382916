"""The return map of a rig: its motion over one period with exact events, its derivatives, and Newton's method on it.

    phi_T(x; p) = x,   f(x_ref) . (x - x_ref) = 0,   closing equation          n + 2 equations for x (n), T and p

A cycle from which motions depart by orders of magnitude within a period is cut into parts, with unknowns x at the
begin of each of them (multiple shooting): phi_i(x_i; p) = x_(i+1). No part then magnifies a difference by much.

x: the moving states; all others (commands, settled lags) follow from p. The closing equation fixes p, or the distance
along a branch, or a special point. A forced motion has the period of its generator in place of the phase condition.

Derivatives are differences of whole runs that meet the same events. Their error is that of the tolerance, not of the
tolerance over the step, because displaced runs take the same steps; so steps are small. Where one side meets other
events, the other side counts: the map is smooth on each side of a grazing. P f(x) = f(phi_T(x)) holds exactly, so that
directions along the flow are not displaced.

A period is no whole number of ticks: compiled code advances whole ticks, and the last part of a tick, which contains no
event, is integrated here.
"""

from __future__ import annotations

import math
import pickle
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.axis import Axis
from rig.errors import NumericsError, RigError
from rig.model.assembly import Assembly
from rig.model.formulation import ModeSet
from rig.model.method import chosen
from rig.model.singular import assembled
from rig.model.system import System
from rig.motion.motion import Event, Motion
from rig.scenes.rooms import assembled as assembled_rig
from rig.scenes.scene import Scene
from rig.solve.forces import STATE
from rig.solve.records import CLOSED, STICK
from rig.stability.linearisation import inputs, moving_states, own_law, settled, sliding_key

Array = NDArray[np.float64]
TIGHT = 1e-11
"""Tolerance of dop853 and rosenbrock."""
STEPS = (1e-5, 1e-6, 1e-4)  # of the differences, of the size of each state: the first that is smooth counts
_STRAIGHT, _SMALLEST = 3e-3, 1e-8  # largest bend over the slope in a difference; and the smallest step that it takes
_CENTRAL, _AFTER, _BEFORE = ((-1.0, -0.5), (1.0, 0.5)), ((1.0, 2.0), (2.0, -0.5)), ((-1.0, -2.0), (-2.0, 0.5))
CLOSE = 1e-10
"""Residual of a converged cycle, of the size of each state."""
CLOSED_TO = 1e-9
"""The same where rounding limits it: no point is accepted beyond."""
_LONGEST = 16384  # ticks in one call
_KEPT = 48  # rigs of a family
_NEAR = 2.5  # ticks: a period that differs by less is advanced with the same number of them
_FINE, _MOST = 1e-8, 64  # estimated error of steps that are then extrapolated; most steps in the rest of a tick
_AFTER_END = 4  # ticks beyond the end: the state between two of them follows from as many on both sides
_RESOLVED = 0.1  # radians of the fastest mode in a tick: then such an interpolation is exact to 1e-11
_NODES = np.arange(2.0 * _AFTER_END)
_APART = _NODES[:, None] - _NODES + np.eye(2 * _AFTER_END)
_ITERATIONS = 12
FLAT = 1e-13


class NoCycle(RigError):
    """Newton's method finds no cycle here."""


class NotSmooth(NoCycle):
    """A run meets other events than the branch, those of `other`: the return map is not smooth here."""

    def __init__(self, what: str, other: Carried | None = None) -> None:
        super().__init__(what)
        self.other = other


class Carried(NamedTuple):
    """The end of a run: state, mode sets at its start and end, events with times [s].

    `states` [tick, n] and `values` [tick] of the output, if they are kept. `parts`: of a cycle that is cut.
    """

    x: Array
    first: int
    key: int
    events: tuple[tuple[float, Event], ...]
    states: Array
    values: Array
    parts: tuple[Carried, ...] = ()

    @property
    def met(self) -> tuple[int, tuple[str, ...]]:
        """Mode set at the start and events, which are the same where the map is smooth."""
        names = tuple(event.what for _, event in self.events)
        return self.first, names + tuple("a part begins" for a, b in pairwise(self.parts) if a.key != b.first)


def _joined(parts: Sequence[Carried], begins: Sequence[float]) -> Carried:
    """The run over successive parts, which begin at the given times [s]."""
    events: list[tuple[float, Event]] = []
    for begin, part in zip(begins, parts):
        events += [(begin + time, event) for time, event in part.events]
    states = [part.states[:-1] for part in parts[:-1]] + [parts[-1].states]
    values = np.concatenate([part.values for part in parts])
    last = parts[-1]
    return Carried(last.x, parts[0].first, last.key, tuple(events), np.concatenate(states), values, tuple(parts))


def word(names: Sequence[str]) -> tuple[str, ...]:
    """Return a cyclic sequence of events from a fixed one of them on."""
    names = tuple(names)
    return min((names[i:] + names[:i] for i in range(len(names))), default=())


class Flow:
    """One rig with constant parameters, from any state over any time."""

    def __init__(
        self,
        scene: Scene,
        assembly: Assembly | None = None,
        tolerance: float = TIGHT,
        output: str = "",
        start: Array | None = None,
    ) -> None:
        self.scene, self.assembly = scene, scene.assemble() if assembly is None else assembly
        self.system: System = self.assembly.system()
        if start is not None:  # driving states as they are there
            self.system = replace(self.system, start=start)
            self.__dict__["settled"] = _at_rest(self.system, start)
        self.step = scene.step_ns * 1e-9
        self.key = sliding_key(self.system)
        clock = scene.clock
        self.motion = Motion(
            replace(self.system, start=self.settled),
            scene.step_ns,
            chosen(clock.method, self.system, tolerance),
            outputs=[self.assembly.outputs[output].row] if output else None,
            tolerance=tolerance,
            substeps=clock.substeps(scene.step_ns),
            cap=clock.events_per_frame,
            frame=max(scene.frame_ns // scene.step_ns, 1),
            limit=clock.limit,
            longest=1,
            with_energy=False,
        )
        self._ticks = -_LONGEST
        self._modes: dict[int, ModeSet] = {}
        self._rates: dict[int, Callable[[Array], Array]] = {}
        self._fastest: dict[int, float] = {}

    def commanded(self, start: Array) -> Flow:
        """Return the same rig with other values of its commands; both advance the same motion."""
        other = copy(self)
        other.system = replace(self.system, start=start)
        other.__dict__.pop("settled", None)
        if np.array_equal(self.settled, _at_rest(self.system, self.system.start)):  # nothing lags
            other.__dict__["settled"] = _at_rest(self.system, start)
        return other

    @cached_property
    def settled(self) -> Array:
        """Driving states at their steady values, structure at rest."""
        return settled(self.system, self.system.start)

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """The states that a disturbance can change."""
        modes = self.modes(self.key)
        moving = moving_states(self.system, modes.A)
        return moving[np.any(modes.landing[:, moving] != 0.0, axis=0)]  # not the current of an open circuit

    def modes(self, key: int) -> ModeSet:
        """Return a mode set. Raises rig.errors.Singular."""
        if key not in self._modes:
            self._modes[key] = assembled(self.system, key)
        return self._modes[key]

    def rate(self, x: Array, key: int) -> Array:
        """Return dx/dt in mode set `key`."""
        if key not in self._rates:
            self._rates[key] = self._rate(key)
        return self._rates[key](x)

    def _rate(self, key: int) -> Callable[[Array], Array]:
        """dx/dt in a mode set as a function of x, without what is zero in this one."""
        modes, system = self.modes(key), self.system
        contact, load, load_t = own_law(system, modes), modes.load, modes.load_t
        of_states = [product for product in system.products if all(f.kind == STATE for f in product.factors)]
        if len(of_states) < len(system.products) or system.remembers or load_t.any():
            return lambda x: np.asarray(modes.A @ x + modes.b @ inputs(system, modes, x, contact)[0])
        slipping = np.flatnonzero(modes.nonlinear).tolist()
        products = [[f.index for f in product.factors] for product in of_states]
        columns = modes.b.T

        def rate(x: Array) -> Array:
            out, values = modes.A @ x, x.tolist()
            for p in slipping:
                T = contact(p, float(system.slip_rows[p] @ x), float(load[p] @ x))[0]
                out += columns[p] * T
            for j, factors in enumerate(products, len(system.patches)):
                out += columns[j] * math.prod([values[i] for i in factors])
            return np.asarray(out)

        return rate

    def within(self, x: Array, key: int, time: float) -> Array:
        """Return state x after `time` [s] in mode set `key`, forwards or backwards."""
        from scipy.linalg import expm

        modes = self.modes(key)
        if not modes.nonlinear.any() and not self.system.products and not self.system.remembers:
            return np.asarray(expm(modes.A * time) @ x)
        rough, pieces = self._stepped(x, key, time, 1), 2
        while True:
            fine = self._stepped(x, key, time, pieces)
            missed = (fine - rough) / 15.0
            if pieces == _MOST or np.all(np.abs(missed) <= _FINE * (np.abs(fine) + np.abs(fine - x))):
                return np.asarray(fine + missed)
            rough, pieces = fine, 2 * pieces

    def _stepped(self, x: Array, key: int, time: float, pieces: int) -> Array:
        """Return state x after `time` in so many steps of order 4."""
        h = time / pieces
        for _ in range(pieces):
            a = self.rate(x, key)
            b = self.rate(x + 0.5 * h * a, key)
            c = self.rate(x + 0.5 * h * b, key)
            x = x + h / 6.0 * (a + 2.0 * (b + c) + self.rate(x + h * c, key))
        return x

    def carried(self, x: Array, time: float, keep: bool = False, ticks: int | None = None) -> Carried:
        """Return the end of a run from x over `time` [s], or over a number of ticks; `keep`: with the states at its
        ticks [tick, n].
        """
        motion, step = self.motion, self.step
        motion.restart(x)
        first = motion.key
        if ticks is None:
            ticks = self._ticks if abs(time - self._ticks * step) < _NEAR * step else round(time / step)
            self._ticks = ticks
        else:
            time = ticks * step
        events: list[tuple[float, Event]] = []
        states, values = [x[None].copy()], []
        between = motion.system.linear is False and ticks > _AFTER_END
        more = _AFTER_END if between else 0
        done, end, key = 0, x, first
        while done < ticks:
            count = min(_LONGEST, ticks - done)
            motion.advance(count + more if done + count == ticks else count)
            events += [((e.tick + e.place) * step, e) for e in motion.events()]
            if keep:
                states.append(motion.states[:count].copy())
                values.append(motion.outputs_at(motion.states[:count], motion.mode_sets_of_states[:count]))
            end = motion.states[count - 1].copy()
            key = motion.mode_sets.keys[int(motion.mode_sets_of_states[count - 1])]
            done += count
        rest = time - ticks * step
        if rest:
            near = slice(-2 * _AFTER_END, None)
            last, sets = motion.states[near], motion.mode_sets_of_states[near]
            if between and len(last) == 2 * _AFTER_END and (sets == sets[0]).all() and self._slow(key):
                weights = _interpolation(_AFTER_END - 1 + rest / step)
                end = weights @ last
            else:
                end = self.within(end, key, rest)
        met = tuple(event for event in events if event[0] <= ticks * step)
        if not keep:
            return Carried(end, first, key, met, end[None], np.zeros(0))
        outputs = np.concatenate(values).T if values else np.zeros((0, 0))
        series = outputs[0] if len(outputs) else np.zeros(0)
        return Carried(end, first, key, met, np.concatenate(states), series)

    def _slow(self, key: int) -> bool:
        """Whether eight ticks resolve every mode of a mode set."""
        return self._fastest_of(key) * self.step < _RESOLVED

    def _fastest_of(self, key: int) -> float:
        """The largest rate [1/s] of a mode set."""
        if key not in self._fastest:
            self._fastest[key] = float(np.abs(np.linalg.eigvals(self.modes(key).A)).max())
        return self._fastest[key]

    def stuck(self, key: int, p: int) -> bool:
        """Whether contact p sticks in mode set `key`."""
        patches, normals, *_ = self.system.modes(key)
        return patches[p] == STICK and self.closed(key, p, normals)

    def closed(self, key: int, p: int, normals: Sequence[int] = ()) -> bool:
        """Whether contact p is loaded in mode set `key`."""
        modes = normals or self.system.modes(key)[1]
        return any(k.patch == p and mode == CLOSED for k, mode in zip(self.system.normals, modes))


def _at_rest(system: System, x: Array) -> Array:
    """A state with its driving states, and the structure at zero."""
    out = x.copy()
    out[: system.one] = 0.0
    return out


def _interpolation(place: float) -> Array:
    """Weights of equidistant values 0, 1, 2, ... for the value at a place between them (Lagrange)."""
    away = np.tile(place - _NODES, (len(_NODES), 1))
    np.fill_diagonal(away, 1.0)
    return np.asarray(np.prod(away / _APART, axis=1))


class Family:
    """A rig over the parameters `axes`: one flow for each set of values, of which the last are kept.

    A parameter that is an actuator becomes a state, so that its values need no new matrices.
    """

    def __init__(self, scene: Scene, axes: Sequence[Axis] = (), output: str = "") -> None:
        self.scene, self.axes, self.output = scene, tuple(axes), output
        self._kept: OrderedDict[tuple[float, ...], Flow] = OrderedDict()
        self._commanded = self._with_commands()
        self._only: Flow | None = None

    @classmethod
    def of(cls, flow: Flow) -> Family:
        """Return the family of one rig without parameters."""
        family = cls(flow.scene)
        family._only = flow
        return family

    def flow(self, values: tuple[float, ...]) -> Flow:
        """Return the rig with these values. Raises SceneError where the scene refuses them."""
        if self._only is not None:
            return self._only
        if values not in self._kept:
            if len(self._kept) >= _KEPT:
                self._kept.popitem(last=False)
            self._kept[values] = self._made(values)
        self._kept.move_to_end(values)
        return self._kept[values]

    def rig(self, values: tuple[float, ...]) -> Scene:
        """Return the scene with these values."""
        return self.scene.with_values({axis.key: value for axis, value in zip(self.axes, values)})

    def _with_commands(self) -> frozenset[str]:
        """The parameters that are actuators with a state of their own, if they act on nothing but that state."""
        keys = {axis.key for axis in self.axes}
        assembly = self.assembled(self.scene, keys)
        given = {key: assembly.inputs[key] for key in keys if key in assembly.inputs}
        commands = frozenset(key for key, actuator in given.items() if actuator.state and not actuator.slope)
        for axis in self.axes:
            if axis.key in commands:
                other = self.assembled(axis.at(self.scene, 0.5 * (axis.values[0] + axis.values[-1])), keys).sliding()
                if not same(assembly.sliding(), other):
                    commands -= {axis.key}
        return commands

    def assembled(self, scene: Scene, moved: Iterable[str]) -> Assembly:
        """Return a scene as an assembly in which the actuators `moved` are states."""
        held = {**dict.fromkeys(moved, "held"), **scene.moved}
        return assembled_rig(scene.parameters, scene.frame_ns, held, random=False, limits=scene.limits)

    def _made(self, values: tuple[float, ...]) -> Flow:
        fixed = tuple(v for axis, v in zip(self.axes, values) if axis.key not in self._commanded)
        for known, flow in self._kept.items():
            if self._commanded and fixed == tuple(
                v for axis, v in zip(self.axes, known) if axis.key not in self._commanded
            ):
                start = flow.system.start.copy()
                for axis, value in zip(self.axes, values):
                    if axis.key in self._commanded:
                        given = flow.assembly.inputs[axis.key]
                        start[[flow.system.names.index(name) for name in (given.state, given.lagging) if name]] = value
                return flow.commanded(start)
        scene = self.rig(values)
        return Flow(scene, self.assembled(scene, self._commanded), output=self.output)


def same(a: System, b: System) -> bool:
    """Return whether two systems differ in their start alone; False of laws that are compiled, which tell nothing."""
    try:
        return pickle.dumps(replace(a, start=a.start * 0.0)) == pickle.dumps(replace(b, start=b.start * 0.0))
    except pickle.PicklingError:
        return False


@dataclass(frozen=True)
class Derivative:
    """Derivatives of the return map at a point, over the size of each state: those of each part [part, i, i], of all
    ends over p [part, i], and the rates at the end [i].
    """

    end: Carried
    parts: Array
    over_p: Array
    end_rate: Array

    @property
    def P(self) -> Array:
        """The derivative over the whole period [i, i]."""
        return reduce(np.matmul, self.parts[::-1])


Closing = Callable[[Array, Carried], tuple[float, Array]]
"""(unknowns, run) -> value and gradient of the closing equation."""


def parameter(value: float, unknowns: int) -> Closing:
    """Return the closing equation that fixes the parameter, over its scale, at a value."""
    gradient = np.append(np.zeros(unknowns - 1), 1.0)
    return lambda u, _: (float(u[-1]) - value, gradient)


class ReturnMap:
    """The return map of a family of rigs over its first parameter; the unknowns are u = (x / size, T / T0, p / P0).

    `size` [i]: of each moving state. `others`: values of the further parameters. `period`: of the generator as a
    function of the flow, for a forced motion. `key`: mode set of the base point, in which contacts that stick are held.
    `cuts`: ticks and mode sets at which further parts of the period begin; their states follow those of the base in u.
    """

    def __init__(
        self,
        family: Family,
        size: Array,
        T0: float,
        P0: float,
        others: tuple[float, ...] = (),
        period: Callable[[Flow], float] | None = None,
        phase: float = 0.0,
        key: int | None = None,
        cuts: tuple[tuple[int, int], ...] = (),
    ) -> None:
        self.family, self.size, self.T0, self.P0, self.others = family, size, T0, P0, others
        self.period, self.phase, self.key, self.cuts = period, phase, key, cuts
        self.runs = self.steps = 0  # of the map, of Newton's method

    def flow(self, u: Array) -> Flow:
        """Return the rig at the parameter of u."""
        return self.family.flow((float(u[-1] * self.P0), *self.others))

    def state(self, u: Array, part: int = 0) -> Array:
        """Return all states at u, at the begin of a part."""
        flow, n = self.flow(u), len(self.size)
        tick, key = self.cuts[part - 1] if part else (0, self.key)
        x = flow.settled.copy()
        if self.period is not None:
            x = driven(flow, self.phase * u[-2] * self.T0 + tick * flow.step)
        x[flow.moving] = u[part * n : (part + 1) * n] * self.size
        if key is not None and STICK in flow.system.modes(key)[0]:
            x = flow.modes(key).landing @ x
        return x

    def unknowns(self, x: Array, T: float, p: float) -> Array:
        """Return u."""
        flow = self.family.flow((p, *self.others))
        return np.concatenate([x[flow.moving] / self.size, [T / self.T0, p / self.P0]])

    def end(self, u: Array, keep: bool = False) -> Carried:
        """Return the run of one period from u."""
        self.runs += 1
        parts = [self.part(u, i, keep) for i in range(len(self.cuts) + 1)]
        return _joined(parts, [tick * self.flow(u).step for tick in self.ticks]) if self.cuts else parts[0]

    @property
    def ticks(self) -> list[int]:
        """The ticks at which the parts begin."""
        return [0, *(tick for tick, _ in self.cuts)]

    def part(self, u: Array, number: int, keep: bool = False) -> Carried:
        """Return the run of one part of the period from u."""
        flow, ticks, x = self.flow(u), self.ticks, self.state(u, number)
        if number < len(self.cuts):
            return flow.carried(x, 0.0, keep, ticks[number + 1] - ticks[number])
        return flow.carried(x, float(u[-2] * self.T0) - ticks[number] * flow.step, keep)

    def ends(self, u: Array, end: Carried) -> Array:
        """Return the moving states at the end of each part, over their size [part, i]."""
        moving = self.flow(u).moving
        return np.array([part.x[moving] / self.size for part in end.parts or (end,)])

    def scaled(self, size: Array, T0: float, P0: float) -> ReturnMap:
        """Return the same map in other scales."""
        other = copy(self)
        other.size, other.T0, other.P0 = size, T0, P0
        return other

    def at(self, *others: float) -> ReturnMap:
        """Return the map with other values of the further parameters."""
        other = copy(self)
        other.others = others
        return other

    def rate(self, u: Array, x: Array, key: int) -> Array:
        """Return the rates of the moving states [i], over their size, per T0."""
        flow = self.flow(u)
        return flow.rate(x, key)[flow.moving] / self.size * self.T0

    def derivative(
        self, u: Array, end: Carried | None = None, over_p: bool = True, steps: Sequence[float] = STEPS
    ) -> Derivative:
        """Return the derivatives at u. Raises NotSmooth where displaced runs meet other events on both sides."""
        end = self.end(u) if end is None else end
        n, parts = len(self.size), []
        for number, part in enumerate(end.parts or (end,)):
            f0, f1 = self.rate(u, self.state(u, number), part.first), self.rate(u, part.x, part.key)
            across = np.eye(n)
            if self.period is None:
                across = np.linalg.qr(np.column_stack([f0, across]))[0][:, 1:n]
            columns = np.zeros((n, across.shape[1]))
            for j, d in enumerate(across.T):
                direction = np.zeros(len(u))
                direction[number * n : (number + 1) * n] = d
                columns[:, j] = self._column(u, direction, part, steps, number)[0]
            if self.period is None:
                columns = np.column_stack([f1, columns]) @ np.linalg.inv(np.column_stack([f0, across]))
            parts.append(columns)
        slope = np.zeros((len(parts), n))
        if over_p:
            slope = self._column(u, np.append(np.zeros(len(u) - 1), 1.0), end, steps)
        return Derivative(end, np.array(parts), slope, f1)

    def _column(
        self, u: Array, direction: Array, end: Carried, steps: Sequence[float], number: int | None = None
    ) -> Array:
        """The derivative of all ends, or of that of one part, over one direction of u."""

        def run(v: Array) -> Carried:
            return self.end(v) if number is None else self.part(v, number)

        base = self.ends(u, end)
        other: Carried | None = None
        left = list(steps)
        while left:
            step = left.pop(0)
            for formula in (_CENTRAL, _AFTER, _BEFORE):
                ways: list[Array] = []
                for share, _ in formula:
                    beside = self.shifted(u, share * step * direction)
                    try:
                        displaced = run(beside)
                    except NumericsError:
                        break
                    if displaced.met != end.met:
                        other = displaced if number is None or not self.cuts else self.end(beside)
                        break
                    ways.append(self.ends(u, displaced) - base)
                else:
                    slope = sum((weight * way for (_, weight), way in zip(formula, ways)), np.zeros_like(base)) / step
                    bend = float(np.abs(formula[1][0] * ways[0] - formula[0][0] * ways[1]).max())
                    if bend > _STRAIGHT * step * float(np.abs(slope).max()) and step > _SMALLEST:  # too long a step
                        left = [max(0.5 * _STRAIGHT * step**2 * float(np.abs(slope).max()) / bend, _SMALLEST), *left]
                        break
                    return slope
        raise NotSmooth("displaced runs meet other events", other)

    def shifted(self, u: Array, by: Array) -> Array:
        """Return u + by, with the period of the generator if the motion is forced."""
        out = u + by
        if self.period is not None:
            out[-2] = self.period(self.flow(out)) / self.T0
        return np.asarray(out)

    def residual(self, u: Array, end: Carried, reference: Array, along: Array) -> Array:
        """Return how far the motion is from closing [i], and the phase condition."""
        n = len(self.size)
        phase = along @ (u - reference)[-2 - n : -2] if self.period is None else 0.0
        begins = np.roll(u[:-2].reshape(-1, n), -1, axis=0)
        return np.append(self.ends(u, end) - begins, phase)

    def matrix(self, d: Derivative, along: Array) -> Array:
        """Return the derivative of the residual over u [n + 1, n + 2]."""
        n, count = len(along), len(d.parts)
        A = np.zeros((count * n + 1, count * n + 2))
        for i, P in enumerate(d.parts):
            A[i * n : (i + 1) * n, i * n : (i + 1) * n] = P
        A[:-1, :-2] -= np.roll(np.eye(count * n), n, axis=1)
        A[:-1, -1] = d.over_p.ravel()
        if self.period is None:
            A[-1 - n : -1, -2], A[-1, -2 - n : -2] = d.end_rate, along
        else:
            A[-1, -2] = 1.0
        return A

    def along(self, u: Array) -> Array:
        """Return the direction of the flow at the begin of the last part, of length one."""
        flow, x, key = self.flow(u), self.state(u, len(self.cuts)), self.cuts[-1][1] if self.cuts else self.key
        if key is None:
            flow.motion.restart(x)
        f = self.rate(u, x, flow.motion.key if key is None else key)
        return np.asarray(f / max(float(np.linalg.norm(f)), 1e-300))

    def newton(
        self,
        u: Array,
        closing: Closing,
        reference: Array,
        met: tuple[int, tuple[str, ...]] | None = None,
        first: Array | None = None,
        over_p: bool = True,
        halvings: int = 0,
    ) -> tuple[Array, Carried]:
        """Solve for a cycle near u; `met`: the events that every iterate has to meet.

        `first`: derivative of all equations for the first step. Broyden's formula improves it; where that does not lead
        on, derivatives are computed. `halvings`: of a step that meets other events or comes no closer, from a guess
        that may be far away. Raises NotSmooth and NoCycle.
        """
        along = self.along(reference)
        M, last, left = first, math.inf, halvings
        before: tuple[Array, Array] | None = None
        for _ in range(_ITERATIONS + 2 * halvings):
            end = self.end(u)
            other = met is not None and end.met != met
            if other and (not left or before is None):
                raise NotSmooth("the motion meets other events", end)
            value, gradient = closing(u, end)
            R = np.append(self.residual(u, end, reference, along), value)
            size = float(np.linalg.norm(R))
            if before is not None and left and (other or size >= max(last, CLOSED_TO)):
                u, left = self.shifted(before[0], 0.5 * (u - before[0])), left - 1
                continue
            left, self.steps = halvings, self.steps + 1
            if size <= CLOSE or (size <= CLOSED_TO and size > 0.3 * last):
                return u, end
            if before is not None and M is not None and size <= 0.5 * last:
                du, dR = u - before[0], R - before[1]
                M = M + np.outer(dR - M @ du, du) / (du @ du)  # Broyden
            elif before is not None or M is None:
                M = np.vstack([self.matrix(self.derivative(u, end, over_p), along), gradient])
            last, before = size, (u, R)
            u = self.shifted(u, -np.linalg.lstsq(M, R, rcond=FLAT)[0])
            if not (math.isfinite(size) and 0.05 < u[-2] / reference[-2] < 5.0):
                raise NoCycle("Newton's method leaves the branch")
        raise NoCycle(f"Newton's method does not converge: {last:.1e}")


def driven(flow: Flow, later: float) -> Array:
    """Return the driving states at the start, with generators `later` s on."""
    x, start = flow.settled.copy(), flow.system.start
    for a, b, rate in flow.system.generators:
        s, c = math.sin(rate * later), math.cos(rate * later)
        x[a], x[b] = c * start[a] + s * start[b], c * start[b] - s * start[a]
    return x


def sizes(span: Array, flow: Flow) -> Array:
    """The unit of each moving state: its range `span`, or a small part of the largest range of its kind."""
    out, nq = span.copy(), len(flow.system.coordinates)
    for kind in (slice(nq), slice(nq, 2 * nq), slice(2 * nq, None)):  # metres, metres per second, volts and the like
        if span[kind].size:
            out[kind] = np.maximum(span[kind], 1e-3 * span[kind].max())
    out = out[flow.moving]
    return np.asarray(np.where(out > 0.0, out, 1.0))


def _apart(a: complex, b: complex) -> float:
    return abs(a - b)


def multipliers(P: Array, driven: bool) -> tuple[tuple[complex, ...], float]:
    """Return the Floquet multipliers, the largest first, without that of the shift along the motion; and how far that
    one is from 1 (NaN: the motion is driven). `P`: [i, i], or of successive parts of a period [part, i, i].

    Those of parts are powers of the eigenvalues of the cyclic matrix of all parts: no product mixes large and small.
    """
    n, count = P.shape[-1], P.size // P.shape[-1] ** 2
    cyclic = np.zeros((count * n, count * n))
    for i, part in enumerate(P.reshape(count, n, n)):
        to = (i + 1) % count
        cyclic[to * n : (to + 1) * n, i * n : (i + 1) * n] = part
    left, order = [complex(v) for v in np.linalg.eigvals(cyclic) ** count], []
    while left:  # each of them `count` times
        left.sort(key=lambda v: (-abs(v), -v.imag))
        if count > 1:
            left.sort(key=partial(_apart, left[0]))
        order.append(sum(left[:count]) / count)
        left = left[count:]
    if driven:
        return tuple(order), math.nan
    own = min(order, key=lambda v: abs(v - 1.0))
    order.remove(own)
    return tuple(order), abs(own - 1.0)
