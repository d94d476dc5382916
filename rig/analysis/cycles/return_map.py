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
"""

from __future__ import annotations

import math
import pickle
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np
from numpy.typing import NDArray

from rig.bench.free_rig import TIGHT, Carried, FreeRig
from rig.errors import NumericsError, RigError
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.motion.motion import Event
from rig.scenes.axis import Axis
from rig.scenes.rooms import assembled as assembled_rig
from rig.scenes.scene import Scene
from rig.solve.records import STICK

Array = NDArray[np.float64]
STEPS = (1e-5, 1e-6, 1e-4)  # of the differences, of the size of each state: the first that is smooth counts
_LARGER = 1e-3  # and no more than this where states are rounded to a large part of their size
_ROUNDED = 10.0  # rounding of a state after a period, in units of its last digit. chosen
_NOISE = 1e-9  # of a derivative, from rounding: the steps that keep it are large enough
TIGHTER = 1e-12
"""Tolerance of motions beside a law without memory, which may be steep: derivatives there lose digits of it."""
_STRAIGHT = 3e-3  # largest bend over the slope in a difference
_SMALLEST = 1e-8  # and the smallest step that it takes
_NO_SLOPE = 1e-300  # of a difference without one
Formula = tuple[tuple[float, float], tuple[float, float]]
_FORMULAS: tuple[
    Formula, ...
] = (  # of differences of second order, (step, weight): central, after and before the point
    ((-1.0, -0.5), (1.0, 0.5)),
    ((1.0, 2.0), (2.0, -0.5)),
    ((-1.0, -2.0), (-2.0, 0.5)),
)
CLOSE = 1e-10
"""Residual of a converged cycle, of the size of each state."""
CLOSEST = 1e-12
"""The same for a cycle that attracts slowly: its distance is the residual over one minus the multiplier."""
CLOSED_TO = 1e-9
"""The same where rounding limits it: no point is accepted beyond."""
_KEPT = 48  # rigs of a family
_ITERATIONS = 12  # most steps of Newton's method
_HALVINGS = 6  # of a step from a guess that may be far away
_INSIDE = 0.25  # of the longest slip: the base is no closer to an event
_BESIDE = 0.33  # of a period without events: the base is no closer to where the slip is slowest
FLAT = 1e-13
"""Singular values below this part of the largest one are zero but for rounding."""


class NoCycle(RigError):
    """Newton's method finds no cycle here."""


class NotSmooth(NoCycle):
    """A run meets other events than the branch, those of `other`: the return map is not smooth here."""

    def __init__(self, what: str, other: Carried | None = None) -> None:
        super().__init__(what)
        self.other = other


def _joined(parts: Sequence[Carried], begins: Sequence[float]) -> Carried:
    """The run over successive parts, which begin at the given times [s]."""
    events: list[tuple[float, Event]] = []
    for begin, part in zip(begins, parts):
        events += [(begin + time, event) for time, event in part.events]
    states = [part.states[:-1] for part in parts[:-1]] + [parts[-1].states]
    values = np.concatenate([part.values for part in parts], axis=1)
    last = parts[-1]
    return Carried(last.x, parts[0].first, last.key, tuple(events), np.concatenate(states), values, tuple(parts))


def word(names: Sequence[str]) -> tuple[str, ...]:
    """Return a cyclic sequence of events from a fixed one of them on."""
    names = tuple(names)
    return min((names[i:] + names[:i] for i in range(len(names))), default=())


class Family:
    """A rig over the parameters `axes`: one free rig for each set of values, of which the last are kept.

    A parameter that is an actuator becomes a state, so that its values need no new matrices.
    """

    def __init__(self, scene: Scene, axes: Sequence[Axis] = (), read: Sequence[str] = ()) -> None:
        self.scene = scene
        self.axes = tuple(axes)
        self.read = tuple(read)
        self._kept: OrderedDict[tuple[float, ...], FreeRig] = OrderedDict()
        self._commanded = self._with_commands()
        self._only: FreeRig | None = None

    @classmethod
    def of(cls, rig: FreeRig) -> Family:
        """Return the family of one rig without parameters."""
        family = cls(rig.scene)
        family._only = rig
        return family

    def rig(self, values: tuple[float, ...]) -> FreeRig:
        """Return the rig with these values. Raises SceneError where the scene refuses them."""
        if self._only is not None:
            return self._only
        if values not in self._kept:
            if len(self._kept) >= _KEPT:
                self._kept.popitem(last=False)
            self._kept[values] = self._made(values)
        self._kept.move_to_end(values)
        return self._kept[values]

    def scene_at(self, values: tuple[float, ...]) -> Scene:
        """Return the scene with these values."""
        return self.scene.with_values({axis.key: value for axis, value in zip(self.axes, values)})

    def _with_commands(self) -> frozenset[str]:
        """The parameters that are actuators with a state of their own, if they act on nothing but that state."""
        if not self.axes:
            return frozenset()
        keys = {axis.key for axis in self.axes}
        assembly = self.assembled(self.scene, keys)
        actuators = {key: assembly.inputs[key] for key in keys if key in assembly.inputs}
        commands = frozenset(key for key, actuator in actuators.items() if actuator.state and not actuator.slope)
        for axis in self.axes:
            if axis.key in commands:
                middle = axis.at(self.scene, 0.5 * (axis.values[0] + axis.values[-1]))
                other = self.assembled(middle, keys).sliding()
                if not same(assembly.sliding(), other):
                    commands -= {axis.key}
        return commands

    def assembled(self, scene: Scene, moved: Iterable[str]) -> Assembly:
        """Return a scene as an assembly in which the actuators `moved` are states."""
        held = {**dict.fromkeys(moved, "held"), **scene.moved}
        return assembled_rig(scene.parameters, scene.frame_ns, held, random=False, limits=scene.limits)

    def _made(self, values: tuple[float, ...]) -> FreeRig:
        for known, rig in self._kept.items():
            if self._commanded and self._fixed(known) == self._fixed(values):
                start = rig.system.start.copy()
                for axis, value in zip(self.axes, values):
                    if axis.key in self._commanded:
                        actuator = rig.assembly.inputs[axis.key]
                        states = [name for name in (actuator.state, actuator.lagging) if name]
                        start[[rig.system.names.index(name) for name in states]] = value
                return rig.commanded(start)
        scene = self.scene_at(values)
        assembly = self.assembled(scene, self._commanded)
        tolerance = TIGHT if assembly.system().remembers else TIGHTER
        return FreeRig(scene, assembly, tolerance=tolerance, read=self.read)

    def _fixed(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """The values that are no commands: they are part of the matrices."""
        return tuple(value for axis, value in zip(self.axes, values) if axis.key not in self._commanded)


def same(a: System, b: System) -> bool:
    """Return whether two systems differ in their start alone; False of laws that are compiled, which tell nothing."""
    try:
        return pickle.dumps(replace(a, start=a.start * 0.0)) == pickle.dumps(replace(b, start=b.start * 0.0))
    except (pickle.PicklingError, AttributeError):  # the latter of a function that is local to another one
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
    function of the rig, for a forced motion. `begins`: tick and mode set at which each part of the period begins, the
    first of them at the base; contacts that stick in it are held. Their states follow each other in u.
    """

    def __init__(
        self,
        family: Family,
        size: Array,
        T0: float,
        P0: float,
        others: tuple[float, ...] = (),
        period: Callable[[FreeRig], float] | None = None,
        phase: float = 0.0,
        begins: tuple[tuple[int, int | None], ...] = ((0, None),),
    ) -> None:
        self.family = family
        self.size = size
        self.T0 = T0
        self.P0 = P0
        self.others = others
        self.period = period
        self.phase = phase
        self.begins = begins
        self.runs = 0  # of the map
        self.steps = 0  # of Newton's method

    def rig(self, u: Array) -> FreeRig:
        """Return the rig at the parameter of u."""
        return self.family.rig((float(u[-1] * self.P0), *self.others))

    def state(self, u: Array, part: int = 0) -> Array:
        """Return all states at u, at the begin of a part."""
        rig = self.rig(u)
        tick, key = self.begins[part]
        x = rig.settled.copy()
        if self.period is not None:
            x = driven(rig, self.phase * u[-2] * self.T0 + tick * rig.step)
        x[rig.moving] = u[:-2].reshape(-1, len(self.size))[part] * self.size
        if key is not None and STICK in rig.system.modes(key)[0]:
            x = rig.modes(key).landing @ x
        return x

    def unknowns(self, x: Array, T: float, p: float) -> Array:
        """Return u."""
        rig = self.family.rig((p, *self.others))
        return np.concatenate([x[rig.moving] / self.size, [T / self.T0, p / self.P0]])

    def end(self, u: Array, keep: bool = False) -> Carried:
        """Return the run of one period from u."""
        self.runs += 1
        parts = [self.part(u, i, keep) for i in range(len(self.begins))]
        if not self.cut:
            return parts[0]
        step = self.rig(u).step
        return _joined(parts, [tick * step for tick in self.ticks])

    @property
    def ticks(self) -> list[int]:
        """The ticks at which the parts begin."""
        return [tick for tick, _ in self.begins]

    @property
    def cut(self) -> bool:
        """Whether the period is in parts."""
        return len(self.begins) > 1

    def part(self, u: Array, number: int, keep: bool = False) -> Carried:
        """Return the run of one part of the period from u."""
        rig = self.rig(u)
        ticks = self.ticks
        x = self.state(u, number)
        if number + 1 < len(ticks):
            return rig.carried(x, 0.0, keep, ticks[number + 1] - ticks[number])
        return rig.carried(x, float(u[-2] * self.T0) - ticks[number] * rig.step, keep)

    def ends(self, u: Array, end: Carried) -> Array:
        """Return the moving states at the end of each part, over their size [part, i]."""
        moving = self.rig(u).moving
        return np.array([part.x[moving] / self.size for part in end.parts or (end,)])

    def scaled(self, size: Array, T0: float, P0: float) -> ReturnMap:
        """Return the same map in other scales."""
        other = copy(self)
        other.size = size
        other.T0 = T0
        other.P0 = P0
        return other

    def at(self, *others: float) -> ReturnMap:
        """Return the map with other values of the further parameters."""
        other = copy(self)
        other.others = others
        return other

    def rate(self, u: Array, x: Array, key: int) -> Array:
        """Return the rates of the moving states [i], over their size, per T0."""
        rig = self.rig(u)
        return rig.rate(x, key)[rig.moving] / self.size * self.T0

    def derivative(
        self, u: Array, end: Carried | None = None, over_p: bool = True, steps: Sequence[float] = STEPS
    ) -> Derivative:
        """Return the derivatives at u. Raises NotSmooth where displaced runs meet other events on both sides."""
        end = self.end(u) if end is None else end
        steps = self._beyond_rounding(u, steps)
        n = len(self.size)
        parts = []
        for number, part in enumerate(end.parts or (end,)):
            f0 = self.rate(u, self.state(u, number), part.first)
            f1 = self.rate(u, part.x, part.key)
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
            of_parameter = np.append(np.zeros(len(u) - 1), 1.0)
            slope = self._column(u, of_parameter, end, steps)
        return Derivative(end, np.array(parts), slope, f1)

    def _beyond_rounding(self, u: Array, steps: Sequence[float]) -> Sequence[float]:
        """Steps of differences, with a larger one before them where a motion is small beside the mean of its states."""
        rounding = np.finfo(float).eps * float(np.abs(u[:-2]).max())
        larger = min(_ROUNDED * rounding / _NOISE, _LARGER)
        return (larger, *steps) if larger > steps[0] else steps

    def _column(
        self, u: Array, direction: Array, end: Carried, steps: Sequence[float], number: int | None = None
    ) -> Array:
        """The derivative of all ends, or of that of one part, over one direction of u."""
        other: Carried | None = None
        left = list(steps)
        while left:
            step = left.pop(0)
            by = step * direction
            for formula in _FORMULAS:
                try:
                    slope, bend = self._difference(u, by, end, formula, number)
                    if bend > _STRAIGHT and step > _SMALLEST:
                        left = [max(0.5 * _STRAIGHT / bend * step, _SMALLEST), *left]
                        break
                    half, _ = self._difference(u, 0.5 * by, end, formula, number)
                    return (8.0 * half - slope) / (3.0 * step)  # of the order 4, to one side of the order 3
                except NotSmooth as error:
                    other = error.other
                except NumericsError:
                    continue
        raise NotSmooth("displaced runs meet other events", other)

    def _difference(
        self, u: Array, by: Array, end: Carried, formula: Formula, number: int | None
    ) -> tuple[Array, float]:
        """The difference of the ends of runs beside u, or of the end of one part, for a displacement `by`, and its bend
        as a share of it. Raises NotSmooth where a run meets other events than `end`, NumericsError.
        """
        base = self.ends(u, end)
        ways: list[Array] = []
        for share, _ in formula:
            beside = self.shifted(u, share * by)
            displaced = self.end(beside) if number is None else self.part(beside, number)
            if displaced.met != end.met:
                whole = displaced if number is None or not self.cut else self.end(beside)
                raise NotSmooth("displaced runs meet other events", whole)
            ways.append(self.ends(u, displaced) - base)
        slope = sum((weight * way for (_, weight), way in zip(formula, ways)), np.zeros_like(base))
        bend = float(np.abs(formula[1][0] * ways[0] - formula[0][0] * ways[1]).max())
        return slope, bend / max(float(np.abs(slope).max()), _NO_SLOPE)

    def shifted(self, u: Array, by: Array) -> Array:
        """Return u + by, with the period of the generator if the motion is forced."""
        out = u + by
        if self.period is not None:
            out[-2] = self.period(self.rig(out)) / self.T0
        return np.asarray(out)

    def residual(self, u: Array, end: Carried, reference: Array, along: Array) -> Array:
        """Return how far the motion is from closing [i], and the phase condition."""
        n = len(self.size)
        phase = along @ (u - reference)[-2 - n : -2] if self.period is None else 0.0
        begins = np.roll(u[:-2].reshape(-1, n), -1, axis=0)
        return np.append(self.ends(u, end) - begins, phase)

    def matrix(self, u: Array, d: Derivative, along: Array) -> Array:
        """Return the derivative of the residual over u [n + 1, n + 2].

        A conserved quantity closes by itself: its equation states that it keeps its value.
        """
        n = len(along)
        count = len(d.parts)
        A = np.zeros((count * n + 1, count * n + 2))
        for i, P in enumerate(d.parts):
            A[i * n : (i + 1) * n, i * n : (i + 1) * n] = P
        A[:-1, :-2] -= np.roll(np.eye(count * n), n, axis=1)
        kept = np.linalg.qr(np.tile(self.conserved(u, d.end), count).T)[0]
        A[:-1, :-2] += kept @ kept.T
        A[:-1, -1] = d.over_p.ravel()
        if self.period is None:
            A[-1 - n : -1, -2] = d.end_rate
            A[-1, -2 - n : -2] = along
        else:
            A[-1, -2] = 1.0
        return A

    def conserved(self, u: Array, end: Carried) -> Array:
        """Return rows over the scaled states [quantity, i] that the motion of a run conserves."""
        keys = frozenset([end.first, end.key, *(event.before for _, event in end.events)])
        return self.rig(u).conserved(keys) * self.size

    def along(self, u: Array) -> Array:
        """Return the direction of the flow at the begin of the last part, of length one."""
        rig = self.rig(u)
        x = self.state(u, -1)
        _, key = self.begins[-1]
        if key is None:
            rig.motion.restart(x)
            key = rig.motion.key
        f = self.rate(u, x, key)
        return np.asarray(f / max(float(np.linalg.norm(f)), 1e-300))

    def better_base(self, u: Array, run: Carried) -> float | None:
        """Return the time [s] by which the base has to move into the longest slip; None if it may stay.

        `run`: over a period from u, with its states.
        """
        rig = self.rig(u)
        T = float(u[-2] * self.T0)
        if not run.events:
            rows = zip(rig.modes(run.key).sigma, rig.system.slip_rows)
            slowest = np.min([sigma * (run.states @ row) for sigma, row in rows], axis=0)
            away = abs(int(slowest.argmin()) / len(slowest) - 0.5)
            return float(slowest.argmax()) * rig.step if away > _BESIDE else None
        first, *inner, last = run.intervals(rig.step, T)
        spans = [(part.begin, part.end, part.key) for part in inner]
        spans.append((last.begin, T + first.end, last.key))
        a, b, _ = min(spans, key=lambda span: (len(rig.stuck(span[2])), span[0] - span[1]))
        base = T if b > T else 0.0
        inside = min(base - a, b - base) if a <= base <= b else 0.0
        return None if inside >= _INSIDE * (b - a) else (0.5 * (a + b)) % T

    def newton(
        self,
        u: Array,
        closing: Closing,
        reference: Array,
        met: tuple[int, tuple[str, ...]] | None = None,
        first: Array | None = None,
        over_p: bool = True,
        halvings: int = 0,
        close: float = CLOSEST,
    ) -> tuple[Array, Carried]:
        """Solve for a cycle near u; `met`: the events that every iterate has to meet.

        `first`: derivative of all equations for the first step. Broyden's formula improves it; where that does not lead
        on, derivatives are computed. `halvings`: of a step that meets other events or comes no closer, from a guess
        that may be far away. `close`: the residual that is small enough. Raises NotSmooth and NoCycle.
        """
        along = self.along(reference)
        M = first
        last = math.inf
        left = halvings
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
                u = self.shifted(before[0], 0.5 * (u - before[0]))
                left -= 1
                continue
            left = halvings
            self.steps += 1
            if size <= close or (size <= CLOSED_TO and size > 0.3 * last):
                return u, end
            if before is not None and M is not None and size <= 0.5 * last:
                du = u - before[0]
                dR = R - before[1]
                M = M + np.outer(dR - M @ du, du) / (du @ du)  # Broyden
            elif before is not None or M is None:
                derivative = self.derivative(u, end, over_p)
                M = np.vstack([self.matrix(u, derivative, along), gradient])
            last = size
            before = (u, R)
            step, *_ = np.linalg.lstsq(M, R, rcond=FLAT)
            u = self.shifted(u, -step)
            if not (math.isfinite(size) and 0.05 < u[-2] / reference[-2] < 5.0):
                raise NoCycle("Newton's method leaves the branch")
        raise NoCycle(f"Newton's method does not converge: {last:.1e}")


def closed(
    family: Family, values: tuple[float, ...], x: Array, period: float, forced: Callable[[FreeRig], float] | None = None
) -> tuple[ReturnMap, Array, Carried]:
    """Close the cycle that passes near state x of the rig with these values and returns after about `period` [s].

    Returns the map with its base in the longest slip, the unknowns, and the run over a period. `forced`: the period of
    the driving states, which are those of the rig at x. Raises NoCycle, NotSmooth.
    """
    rig = family.rig(values)
    p = values[0] if values else 0.0
    run = _up_to(rig, x, period)
    size = sizes(np.ptp(run.states, axis=0), rig)
    map = ReturnMap(family, size, period, abs(p) or 1.0, values[1:], forced, begins=((0, run.first),))
    u = map.unknowns(x, period, p)
    later = map.better_base(u, run)
    if later is not None:
        base = rig.carried(x, 0.0, ticks=round(later / rig.step))
        map.begins = ((0, base.key),)
        if forced is not None:
            map.family = Family.of(rig.driven_by(base.x))
        u = map.unknowns(base.x, period, p)
    closing = parameter(p / map.P0, len(u))
    met = map.end(u).met
    u, end = map.newton(u, closing, u, met, over_p=False, halvings=_HALVINGS, close=CLOSEST)
    whole_ticks = _up_to(rig, map.state(u), float(u[-2] * map.T0))
    if len(whole_ticks.events) != len(end.events):
        raise NoCycle("an event lies in the last part of a tick")
    return map, u, end


def _up_to(rig: FreeRig, x: Array, time: float) -> Carried:
    """The run from x over the whole ticks that cover `time` [s], with its states and the events until then.

    The rest of a tick, which `FreeRig.carried` integrates, may not contain an event; here it may.
    """
    run = rig.carried(x, 0.0, keep=True, ticks=math.ceil(time / rig.step))
    events = [(at, event) for at, event in run.events if at <= time]
    later = run.events[len(events) :]
    return run._replace(events=tuple(events), key=later[0][1].before if later else run.key)


def driven(rig: FreeRig, later: float) -> Array:
    """Return the driving states at the start, with generators `later` s on."""
    x = rig.settled.copy()
    start = rig.system.start
    for a, b, rate in rig.system.generators:
        s = math.sin(rate * later)
        c = math.cos(rate * later)
        x[a] = c * start[a] + s * start[b]
        x[b] = c * start[b] - s * start[a]
    return x


def sizes(span: Array, rig: FreeRig) -> Array:
    """The unit of each moving state: its range `span`, or a small part of the largest range of its kind."""
    out = span.copy()
    nq = len(rig.system.coordinates)
    for kind in (slice(nq), slice(nq, 2 * nq), slice(2 * nq, None)):  # metres, metres per second, volts and the like
        if span[kind].size:
            out[kind] = np.maximum(span[kind], 1e-3 * span[kind].max())
    out = out[rig.moving]
    return np.asarray(np.where(out > 0.0, out, 1.0))


def _apart(a: complex, b: complex) -> float:
    return abs(a - b)


def multipliers(P: Array, driven: bool) -> tuple[tuple[complex, ...], float]:
    """Return the Floquet multipliers, the largest first, without that of the shift along the motion; and how far that
    one is from 1 (NaN: the motion is driven). `P`: [i, i], or of successive parts of a period [part, i, i].

    Those of parts are powers of the eigenvalues of the cyclic matrix of all parts: no product mixes large and small.
    """
    n = P.shape[-1]
    count = P.size // n**2
    cyclic = np.zeros((count * n, count * n))
    for i, part in enumerate(P.reshape(count, n, n)):
        to = (i + 1) % count
        cyclic[to * n : (to + 1) * n, i * n : (i + 1) * n] = part
    left = [complex(v) for v in np.linalg.eigvals(cyclic) ** count]
    order = []
    while left:  # each of them `count` times
        left.sort(key=lambda v: (-abs(v), -v.imag))
        if count > 1:
            left.sort(key=partial(_apart, left[0]))
        order.append(sum(left[:count]) / count)
        left = left[count:]
    if driven:
        return tuple(order), math.nan
    of_shift = min(order, key=lambda v: abs(v - 1.0))
    order.remove(of_shift)
    return tuple(order), abs(of_shift - 1.0)
