"""The plant of a scene on its own, in motion: without sensors and controllers, every actuator held.

It moves from any state over any time (`carried`), tick by tick (`motion`), or over a stretch with everything recorded
between the ticks (`recorded`). It knows the matrices of its mode sets and the rate of every state in them.

A period is no whole number of ticks: compiled code advances whole ticks, and the last part of a tick, which contains no
event, is integrated here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.records import Loan
from rig.model import energy_forms
from rig.model.assembly import Assembly
from rig.model.formulation import ModeSet
from rig.model.method import chosen
from rig.model.singular import assembled
from rig.model.system import System
from rig.motion.motion import Event, Frames, Motion
from rig.scenes.scene import Scene
from rig.sensors.chain.bank import Bank
from rig.solve import energy_balance
from rig.solve.control_loop import controller_tables
from rig.solve.forces import STATE, no_random_numbers
from rig.solve.frames import Surroundings
from rig.solve.records import CLOSED
from rig.stability.linearisation import (
    explicit_inputs,
    inputs,
    moving_states,
    own_law,
    settled,
    sliding_key,
)

Array = NDArray[np.float64]
TIGHT = 1e-11
"""Tolerance of dop853 and rosenbrock for return maps and their derivatives."""
BLOCK = 16
"""Ticks in one call of a recording rig: the record of all outputs between the ticks holds so many."""
_LONGEST = 16384  # ticks in one call
_PLACES = 9  # of a segment, at which the extremes of an output are looked for
# A period that differs by less, in ticks and as a share of the period, is advanced with the same number of ticks.
_NEAR = 2.5
_SHARE = 0.1
_FINE = 1e-10  # estimated error of steps that are then extrapolated
_MOST = 64  # steps in the rest of a tick
_TERMS = 24  # of the exponential series, over a radian
_AFTER_END = 4  # ticks beyond the end: the state between two of them follows from as many on both sides
_SMOOTH = 1e-8  # of the change of a state: where the inner ticks tell it as well, all of them tell it to 1e-11
_ROUNDED = 1e-14  # of a state
_RESOLVED = 0.1  # radians of the fastest mode in a tick: the same for a contact with memory
_ROUNDING = 1e-3  # ns, of a time
_NOTHING = 1e-12  # of the largest change of a quantity: it is conserved
_NODES = np.arange(2.0 * _AFTER_END)
_APART = _NODES[:, None] - _NODES + np.eye(2 * _AFTER_END)


class Dense:
    """Outputs over a range of time, smooth inside each segment, with jumps only between segments."""

    def __init__(self) -> None:
        self._parts: list[tuple[Array, Array, Array]] = []

    def add(self, offset: float, motion: Motion) -> None:
        """Append the segments of the last call of `advance`, which began at `offset` s."""
        segments = motion.segments
        n = int(segments.count[0])
        self._parts.append((offset + segments.start[:n], segments.length[:n].copy(), segments.coef[:n].copy()))

    @property
    def _whole(self) -> tuple[Array, Array, Array]:
        """Starts [s] and lengths [s] of all segments, and their polynomials [segment, output, power]."""
        if len(self._parts) > 1:
            start, length, coef = zip(*self._parts)
            self._parts = [(np.concatenate(start), np.concatenate(length), np.concatenate(coef))]
        return self._parts[0]

    def at(self, t: float, after: bool) -> Array:
        """Return every output at t [s], just after or just before it."""
        start, length, coef = self._whole
        ends = start + length
        slack = 1e-9 * min(float(length[0]), float(ends[-1]))
        i = min(int(np.searchsorted(ends, t + slack if after else t - slack)), len(ends) - 1)
        u = min(max((t - float(start[i])) / float(length[i]), 0.0), 1.0)
        return np.asarray(np.polynomial.polynomial.polyval(u, coef[i].T), dtype=np.float64)

    def segments(self, output: int) -> tuple[Array, Array, Array]:
        """Return starts [s] and lengths [s] of all segments, and the polynomials [segment, power] of an output
        in them.
        """
        start, length, coef = self._whole
        return start, length, coef[:, output]

    def sampled(self, points: int, outputs: int) -> tuple[Array, Array]:
        """Return times [n] and values [output, n] of the first outputs: `points` of each segment, its ends among
        them.
        """
        start, length, coef = self._whole
        u = np.linspace(0.0, 1.0, points)
        values = coef[:, :outputs] @ np.vander(u, coef.shape[2], increasing=True).T  # [segment, output, point]
        return (start[:, None] + length[:, None] * u).ravel(), np.swapaxes(values, 0, 1).reshape(outputs, -1)

    def extremes(self, output: int) -> tuple[float, float]:
        """Return the lowest and highest value of an output: at ends of segments, or where its polynomial has slope
        zero.
        """
        _, _, coef = self.segments(output)
        values = coef @ np.vander(np.linspace(0.0, 1.0, _PLACES), coef.shape[1], increasing=True).T
        low, high = float(values.min()), float(values.max())
        near = {int(v.argmin()) // _PLACES for v in (values, -values)}
        for i in {j % len(coef) for n in near for j in (n - 1, n, n + 1)}:  # of a period, the ends are neighbours
            level = np.polynomial.Polynomial(coef[i]).deriv().trim().roots()
            level = level[(np.abs(level.imag) < 1e-9) & (level.real >= 0.0) & (level.real <= 1.0)].real
            at_level = np.polynomial.polynomial.polyval(level, coef[i]).tolist()
            low, high = min([low, *at_level]), max([high, *at_level])
        return low, high


@dataclass(frozen=True)
class Recorded:
    """A stretch of a motion: outputs between samples, events with times [s], energy by term [J], states at ticks
    [tick, n].

    `error` of the energy is the residual, relative to the largest term or to the stored energy.
    """

    dense: Dense
    events: list[tuple[float, Event]]
    energy: dict[str, float]
    states: Array


class Interval(NamedTuple):
    """A time between two events [s] with its mode set, and the states at its ticks, which begin at `first`."""

    begin: float
    end: float
    key: int
    first: int
    states: Array


class Carried(NamedTuple):
    """The end of a run: state, mode sets at its start and end, events with times [s].

    `states` [tick, n] and `values` [output, tick], if they are kept. `parts`: of a cycle that is cut.
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

    def intervals(self, step: float, time: float) -> list[Interval]:
        """Split a run of `time` [s], with its states at ticks of `step` [s], at its events."""
        times = [0.0, *(t for t, _ in self.events), time]
        keys = [*(event.before for _, event in self.events), self.key]
        out = []
        for begin, end, key in zip(times, times[1:], keys):
            first = int(np.ceil(begin / step - 1e-9))
            last = int(np.floor(end / step + 1e-9))
            out.append(Interval(begin, end, key, first, self.states[first : last + 1]))
        return out


class FreeRig:
    """The plant of `scene`, without sensors and controllers, every actuator held.

    `start`: a state whose driving states are in force, instead of those of the scene; the motion begins there.
    `method`, `tolerance`, `step_ns`: of the integration, by default those of a run of the scene. With a tolerance the
    method is the one that the scene chooses for it. `read`: outputs whose values are wanted. `dense`: a recording rig,
    which keeps the energy balance, and between the ticks the outputs `read`, by default all and the states. `framed`:
    integrator steps end at the frames of the scene, as in a run, so that states and events have the bits of a run.
    """

    def __init__(
        self,
        scene: Scene,
        assembly: Assembly | None = None,
        start: Array | None = None,
        *,
        method: str = "",
        tolerance: float | None = None,
        step_ns: int = 0,
        read: Sequence[str] = (),
        dense: bool = False,
        framed: bool = False,
    ) -> None:
        self.scene = scene
        self.assembly = scene.assemble() if assembly is None else assembly
        self.system: System = self.assembly.system()
        self._started = start is not None
        if start is not None:
            self.system = replace(self.system, start=start)
            self.__dict__["settled"] = _at_rest(self.system, start)
        self.method = method or chosen(scene.clock.method, self.system, math.inf if tolerance is None else tolerance)
        self.tolerance = scene.clock.tolerance if tolerance is None else tolerance
        self.step_ns = step_ns or scene.step_ns
        self.step = self.step_ns * 1e-9
        self.dense = dense
        self.units = {name: output.unit for name, output in self.assembly.outputs.items()}
        self.outputs = list(dict.fromkeys([*read, *(self.assembly.outputs if dense else ())]))
        self._rows = [self.assembly.outputs[name].row for name in self.outputs]
        self._rows += [{name: 1.0} for name in self.system.names] if dense else []
        self._recorded = (len(read) or len(self._rows)) if dense else 0
        self._frame = scene.frame_ns // scene.step_ns if framed else 0
        self.longest = 1
        if dense:
            self.longest = BLOCK + -BLOCK % self._frame if framed else BLOCK
        self._ticks = -_LONGEST
        self._modes: dict[int, ModeSet] = {}
        self._rates: dict[int, Callable[[Array], Array]] = {}
        self._largest: dict[int, float] = {}
        self._radians: dict[tuple[int, float], list[Array]] = {}
        self._stuck: dict[int, tuple[int, ...]] = {}
        self._conserved: dict[frozenset[int], Array] = {}

    def in_motion(self, start: Array | None = None, step_ns: int = 0, **how: Any) -> Motion:
        """Return a motion of this rig from a state, by default from its start, as the clock of its scene says.

        `step_ns`: another step; `how`: other arguments of Motion.
        """
        clock = self.scene.clock
        step_ns = step_ns or self.step_ns
        longest = how.pop("longest", self.longest)
        limits = self.scene.limits.items() if self.dense else ()
        usual = {
            "outputs": self._rows,
            "read": self._recorded,
            "tolerance": self.tolerance,
            "substeps": clock.substeps(step_ns),
            "smoothing": clock.smoothing,
            "cap": clock.events_per_frame,
            "frame": max(self.scene.frame_ns // step_ns, 1),
            "limit": clock.limit,
            "with_energy": self.dense,
            "bounds": {self.outputs.index(name): limit for name, limit in limits},
            "frames": self._in_frames(min(self._frame, longest)) if self._frame else None,
        }
        system = self.system if start is None else replace(self.system, start=start)
        return Motion(system, step_ns, self.method, longest=longest, **(usual | how))

    def _in_frames(self, steps: int) -> Frames:
        """Frames of `steps` ticks without samples."""
        bank = Bank({}, (), self.scene.frame_ns, self.scene.seed)
        bank.start(np.zeros(0))
        return Frames(steps, Loan(Surroundings(bank.loan.content, controller_tables(), no_random_numbers())))

    @cached_property
    def motion(self) -> Motion:
        """The present motion. It begins at `start`, without one with the structure at rest."""
        return self.in_motion(None if self._started else self.settled)

    def driven_by(self, x: Array) -> FreeRig:
        """Return the same rig with the driving states of x in force; both advance the same motion."""
        other = copy(self)
        other.__dict__["motion"] = self.motion
        other.system = replace(self.system, start=x)
        other.__dict__["settled"] = _at_rest(self.system, x)
        return other

    def commanded(self, start: Array) -> FreeRig:
        """Return the same rig with other values of its commands; both advance the same motion."""
        other = self.driven_by(start)
        if not np.array_equal(self.settled, _at_rest(self.system, self.system.start)):  # a state lags its command
            del other.__dict__["settled"]
        return other

    def replaced(self, assembly: Assembly) -> FreeRig:
        """Return the same rig with other parameters, as which the motion goes on from now."""
        other = FreeRig(
            self.scene,
            assembly,
            method=self.method,
            tolerance=self.tolerance,
            step_ns=self.step_ns,
            read=self.outputs,
        )
        other.__dict__["motion"] = self.motion
        self.motion.replace(self.motion.ready(other.system, other._rows))
        return other

    # mode sets, states, rates

    @cached_property
    def key(self) -> int:
        """The mode set in which every contact slips in the direction of its surface."""
        return sliding_key(self.system)

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

    def stuck(self, key: int) -> tuple[int, ...]:
        """Return the contacts that stick in a mode set."""
        if key not in self._stuck:
            self._stuck[key] = self.system.stuck(key)
        return self._stuck[key]

    def closed(self, key: int, p: int) -> bool:
        """Whether contact p is loaded in a mode set."""
        contacts = zip(self.system.normals, self.system.modes(key)[1])
        return any(normal.patch == p and mode == CLOSED for normal, mode in contacts)

    def conserved(self, keys: frozenset[int]) -> Array:
        """Return rows over the moving states [quantity, i] whose values no motion in these mode sets changes.

        Such as the charge on the electrodes of an open stack.
        """
        if keys not in self._conserved:
            parts = list[Array]()
            for modes in map(self.modes, keys):
                parts += (modes.A, modes.b, modes.landing - np.eye(self.system.n))
            changes = np.hstack(parts)[self.moving]
            largest = np.abs(changes).max(axis=1, keepdims=True)
            largest[largest == 0.0] = 1.0
            _, shares, rows = np.linalg.svd((changes / largest).T)
            self._conserved[keys] = rows[shares <= _NOTHING * shares[0]] / largest[:, 0]
        return self._conserved[keys]

    def rate(self, x: Array, key: int) -> Array:
        """Return dx/dt in a mode set."""
        if key not in self._rates:
            self._rates[key] = self._rate(key)
        return self._rates[key](x)

    def _rate(self, key: int) -> Callable[[Array], Array]:
        """dx/dt in a mode set as a function of x, without what is zero in this one."""
        modes = self.modes(key)
        system = self.system
        contact = own_law(system, modes)
        load = modes.load
        load_t = modes.load_t
        of_states = [product for product in system.products if _of_states(product)]
        if len(of_states) < len(system.products) or system.remembers or load_t.any():
            explicit = explicit_inputs(system, modes, contact) or (lambda x: inputs(system, modes, x, contact)[0])
            return lambda x: np.asarray(modes.A @ x + modes.b @ explicit(x))
        slipping = np.flatnonzero(modes.nonlinear).tolist()
        products = list[list[int]]()
        for product in of_states:
            products.append([factor.index for factor in product.factors])
        columns = modes.b.T

        def rate(x: Array) -> Array:
            out = modes.A @ x
            values = x.tolist()
            for p in slipping:
                T = contact(p, float(system.slip_rows[p] @ x), float(load[p] @ x))[0]
                out += columns[p] * T
            for j, factors in enumerate(products, len(system.patches)):
                out += columns[j] * math.prod([values[i] for i in factors])
            return np.asarray(out)

        return rate

    def within(self, x: Array, key: int, time: float) -> Array:
        """Return state x after `time` [s] in a mode set, forwards or backwards."""
        modes = self.modes(key)
        if not modes.nonlinear.any() and not self.system.products and not self.system.remembers:
            return self._propagated(x, key, time)
        rough = self._stepped(x, key, time, 1)
        pieces = 2
        while True:
            fine = self._stepped(x, key, time, pieces)
            missed = (fine - rough) / 15.0
            if pieces == _MOST or np.all(np.abs(missed) <= _FINE * (np.abs(fine) + np.abs(fine - x))):
                return np.asarray(fine + missed)
            rough = fine
            pieces *= 2

    def _propagated(self, x: Array, key: int, time: float) -> Array:
        """State x after `time` in a linear mode set: exp(A time) x, whole radians of its fastest mode by powers of two
        of the matrix of one.
        """
        A = self.modes(key).A
        rate = self._fastest(key)
        whole = int(rate * abs(time))
        radian = math.copysign(1.0 / rate, time) if whole else 0.0
        x = _exponential(A, x, time - whole * radian)
        powers = self._radians.setdefault((key, radian), [])
        for k in range(whole.bit_length()):
            if k == len(powers):
                powers.append(powers[-1] @ powers[-1] if k else _exponential(A, np.eye(len(A)), radian))
            if whole >> k & 1:
                x = powers[k] @ x
        return x

    def _stepped(self, x: Array, key: int, time: float, pieces: int) -> Array:
        """State x after `time` in so many steps of order 4."""
        h = time / pieces
        for _ in range(pieces):
            a = self.rate(x, key)
            b = self.rate(x + 0.5 * h * a, key)
            c = self.rate(x + 0.5 * h * b, key)
            x = x + h / 6.0 * (a + 2.0 * (b + c) + self.rate(x + h * c, key))
        return x

    # motion from a state

    def carried(
        self, x: Array, time: float, keep: bool = False, ticks: int | None = None, beyond: bool = True
    ) -> Carried:
        """Return the end of a run from x over `time` [s], or over a number of ticks; `keep`: with the states at its
        ticks [tick, n]. `beyond`: the end may follow from ticks beyond it, where they resolve the motion.
        """
        motion = self.motion
        step = self.step
        motion.restart(x)
        first = motion.key
        if ticks is None:
            same = min(_NEAR * step, _SHARE * time)  # further away than that an event may lie between
            ticks = self._ticks if abs(time - self._ticks * step) < same else round(time / step)
            self._ticks = ticks
        else:
            time = ticks * step
        events: list[tuple[float, Event]] = []
        states = [x[None].copy()]
        values = []
        rest = time - ticks * step
        between = beyond and rest != 0.0 and motion.system.linear is False and ticks > _AFTER_END
        more = _AFTER_END if between else 0
        done = 0
        end = x
        key = first
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
        if between:
            sets = motion.mode_sets_of_states[-2 * _AFTER_END :]
            beside = self._interpolated(motion.states[-2 * _AFTER_END :], key, _AFTER_END - 1 + rest / step)
            if beside is None or (sets != sets[0]).any():
                return self.carried(x, time, keep, beyond=False)
            end = beside
        elif rest:
            end = self.within(end, key, rest)
        met = tuple(event for event in events if event[0] <= ticks * step)
        if not keep:
            return Carried(end, first, key, met, end[None], np.zeros((0, 0)))
        series = np.concatenate(values).T if values else np.zeros((len(self.outputs), 0))
        return Carried(end, first, key, met, np.concatenate(states), series)

    def _interpolated(self, states: Array, key: int, place: float) -> Array | None:
        """The state at a place between the middle ones of eight ticks [8, n], by their polynomial.

        None where they do not resolve the motion: without the outermost two the polynomial would tell another state.
        """
        if len(states) < 2 * _AFTER_END:
            return None
        value = _weights(place, 0) @ states
        if self.system.remembers:  # bristles that are faster follow the slip speed
            return value if self._fastest(key) * self.step < _RESOLVED else None
        apart = np.abs(_weights(place - 1.0, 1) @ states[1:-1] - value)
        smooth = _SMOOTH * np.ptp(states, axis=0) + _ROUNDED * np.abs(value)
        return value if (apart <= smooth).all() else None

    def _fastest(self, key: int) -> float:
        """The largest rate [1/s] of a mode set."""
        if key not in self._largest:
            self._largest[key] = float(np.abs(np.linalg.eigvals(self.modes(key).A)).max())
        return self._largest[key]

    # the present motion of a recording rig

    def block(self, ticks: int = BLOCK) -> list[Event]:
        """Step the plant by up to `ticks`; return the events. With frames, stop after a frame that has events."""
        self.motion.advance(min(ticks, self.longest))
        return self.motion.events()

    def recorded(self, time: float) -> Recorded:
        """Step the plant by `time` [s], in whole nanoseconds no less, and record everything."""
        dense = Dense()
        before = self._energy(self.motion)
        whole, rest = divmod(math.ceil(time * 1e9 - _ROUNDING), self.step_ns)
        events: list[tuple[float, Event]] = []
        states = [self.motion.x[None].copy()]
        done = 0
        while done < whole:
            begun = self.motion.tick - done
            met = self.block(min(whole - done, self._frame or whole))  # the record holds one frame
            dense.add(done * self.step, self.motion)
            events += [((e.tick - begun + e.place) * self.step, e) for e in met]
            states.append(self.motion.states.copy())
            done = self.motion.tick - begun
        exchanged = self._energy(self.motion) - before
        if rest:
            end = self.in_motion(self.motion.x.copy(), rest, longest=1)
            before = self._energy(end)
            end.advance(1)
            dense.add(whole * self.step, end)
            events += [((whole * self.step_ns + e.place * rest) * 1e-9, e) for e in end.events()]
            exchanged += self._energy(end) - before
        terms = exchanged[:-1]
        stored = float(exchanged[-1])
        largest = max(float(np.abs(terms).max()), abs(float(before[-1])), 1e-30)
        balance = {"stored": stored, "error": (float(terms @ energy_balance.SIGNS) - stored) / largest}
        energy = energy_forms.by_name(self.system, terms) | balance
        return Recorded(dense, events, energy, np.concatenate(states))

    @staticmethod
    def _energy(motion: Motion) -> Array:
        """The energy terms of a motion so far, and its stored energy behind them [J]."""
        return np.append(motion.terms(), energy_forms.stored(motion.system, motion.x, motion.key))


def _of_states(product: Any) -> bool:
    """Whether all factors of a product of forces are state variables."""
    return all(factor.kind == STATE for factor in product.factors)


def _at_rest(system: System, x: Array) -> Array:
    """A state with its driving states, and the structure at zero."""
    out = x.copy()
    out[: system.one] = 0.0
    return out


def _exponential(A: Array, x: Array, time: float) -> Array:
    """exp(A time) x by its series, for at most a radian."""
    term = x
    for order in range(1, _TERMS):
        term = (time / order) * (A @ term)
        x = x + term
    return x


def _weights(place: float, left_out: int) -> Array:
    """Weights of equidistant values 0, 1, 2, ... for the value at a place between them (Lagrange)."""
    count = 2 * (_AFTER_END - left_out)
    away = np.tile(place - _NODES[:count], (count, 1))
    np.fill_diagonal(away, 1.0)
    return np.asarray(np.prod(away / _APART[:count, :count], axis=1))
