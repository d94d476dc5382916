"""The rig as a linear plant for control design: linearised about steady sliding, from actuators to outputs.

    dx' = A dx + B du        dy = C dx + D du        u: commands of the actuators, y: outputs of the rig

The matrices are those of the simulation. A quantity that is neither commanded nor moving is not a state. The linear
form of a controller (rig.controllers.blocks.design.Linear) is checked, and becomes matrices too:

    xi+ = A xi + b y,   u = c xi + d y              y: the measurement, u: the command

A sampled control loop around the linearised rig, exactly discretised: controller, sensor, delay, sample and hold.

Over a period L, the longer of the controller's and its sensor's, the loop is linear between instants known beforehand:

    sample    y = gain (direct c x + filter), taken `delay` of the sensor before it is published
    update    xi, u = controller(xi, y), the controller's own arithmetic without its limits
    command   takes effect `delay` of the loop later, held until the next

so one period maps z = [rig, filter, command in effect, commands and samples under way, xi] by a matrix:

    z(k+1) = F z(k) + G y'(k),   y(k) = H z(k)         open where the controller reads: closed with y' = y

Eigenvalues of F + G H are exp(lambda L), equal to those of the simulation for motions within all limits, without noise.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.design import Feedback, Linear
from rig.errors import PartError
from rig.model import film
from rig.model.assembly import Assembly
from rig.model.energy_forms import store
from rig.model.formulation import signal_rows
from rig.model.named_rows import Row
from rig.parts import calling, file_of
from rig.sensors.chain.front_end import FrontEnd
from rig.stability.linearisation import Steady, inputs, own_law
from rig.units import brief

Array = NDArray[np.float64]


def linear_form(controller: Feedback) -> Linear:
    """The linear form of a controller. Raises PartError if it fails, or is not one; ValueError unless the controller
    reads one sensor and drives one actuator.
    """
    for word, names in (("reads", controller.reads), ("drives", controller.drives)):
        if len(names) != 1:
            given = ", ".join(names) or "nothing"
            raise ValueError(f"{word}: {given}; a linear form needs one sensor and one actuator")
    module = sys.modules[type(controller).__module__]
    with calling(module):
        form = controller.linear()
    if not isinstance(form, Linear):
        expected = "a rig.controllers.blocks.design.Linear"
        raise PartError(f"{file_of(module)}: linear gives {brief(form)}; expected {expected}")
    parameters = getattr(type(getattr(controller, "section", None)), "model_fields", {})
    if form.gain and form.gain not in parameters:
        known = ", ".join(parameters) or "there are none"
        raise PartError(f"{file_of(module)}: linear names the gain {brief(form.gain)}; its parameters: {known}")
    return form


def arithmetic(controller: Feedback) -> tuple[Array, Array, Array, float]:
    """The matrices A, b, c, d of a controller, from its own linear update. Raises as `linear_form`."""
    form = linear_form(controller)
    module = sys.modules[type(controller).__module__]

    def step(xi: Array, y: float) -> tuple[Array, float]:
        with calling(module):
            after, u = form.step(xi.tolist(), y)
            stepped = np.array(after, dtype=float), float(u)
        if stepped[0].shape != (form.states,) or not np.isfinite([*stepped[0], stepped[1]]).all():
            expected = f"({form.states} states, command), all finite"
            raise PartError(f"{file_of(module)}: the step of linear gives {brief((after, u))}; expected {expected}")
        return stepped

    count = form.states
    b, d = step(np.zeros(count), 1.0)
    A = np.zeros((count, count))
    c = np.zeros(count)
    for i, unit in enumerate(np.eye(count)):
        A[:, i], c[i] = step(unit, 0.0)
    seen = c != 0.0
    for _ in range(count):  # drop states without influence on commands, e.g. the copy for a prediction over zero time
        seen |= np.any(A[seen] != 0.0, axis=0)
    return A[np.ix_(seen, seen)], b[seen], c[seen], d


@dataclass(frozen=True)
class Plant:
    """A linear plant: matrices, names of their rows and columns, and the `equilibrium` [state] to which x is relative.

    `energy`: the form of `energy_form` over the states.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    equilibrium: Array
    energy: Array


def linear(assembly: Assembly, at: Steady) -> Plant:
    """Linearise the rig about the equilibrium `at`; actuators that are not states of this assembly are left out."""
    system = at.system
    driven = {name: actuator.state for name, actuator in assembly.inputs.items() if actuator.state}
    given = np.array([system.names.index(state) for state in driven.values()], dtype=np.int64)
    kept = np.zeros(system.n, dtype=bool)
    kept[at.moving] = kept[given] = True
    for _ in range(system.n):
        kept |= np.any(at.A[:, kept] != 0.0, axis=1)
    kept[given] = kept[system.one] = False
    if assembly.film is not None and not assembly.film.travel:  # nothing depends on how far the surface has slid
        kept[system.names.index(assembly.film.slid)] = False
    x = np.flatnonzero(kept)
    closed = _closed(assembly)
    rows = [_over(output.row, closed) for output in assembly.outputs.values()]
    over_x, over_t = signal_rows(system, at.modes, rows)
    _, slopes = inputs(system, at.modes, at.x, own_law(system, at.modes))
    out = over_x + over_t @ slopes
    return Plant(
        A=at.A[np.ix_(x, x)],
        B=at.A[np.ix_(x, given)],
        C=out[:, x],
        D=out[:, given],
        states=tuple(system.names[i] for i in x),
        inputs=tuple(driven),
        outputs=tuple(assembly.outputs),
        equilibrium=at.x[x],
        energy=energy_form(at)[np.ix_(x, x)],
    )


def _closed(assembly: Assembly) -> dict[str, Row]:
    """The states of a film as rows over its contacts while every point is closed and slips; counts do not change."""
    if assembly.film is None:
        return {}
    normals = {name: patch for name, patch, *_ in assembly.normals}
    rows: dict[str, Row] = {state: {} for state in assembly.film.states(list(assembly.coordinates))}
    rows |= {film.at("P", i): {f"N:{name}": 1.0} for i, name in enumerate(normals)}
    rows |= {film.at("w", i): {f"w:{patch}": 1.0} for i, patch in enumerate(normals.values())}
    rows[film.over("normal")] = {f"N:{name}": 1.0 for name in normals}
    rows[film.over("friction")] = {f"T:{patch}": 1.0 for patch in normals.values()}
    return rows


def _over(row: Row, closed: dict[str, Row]) -> Row:
    """A row with the states of a film replaced."""
    out: Row = {}
    for name, value in row.items():
        for part, factor in closed.get(name, {name: 1.0}).items():
            out[part] = out.get(part, 0.0) + value * factor
    return out


def energy_form(at: Steady) -> Array:
    """Return the energy as a quadratic form of x [n, n]: twice the structure's kinetic energy, and that of each network
    state.
    """
    system = at.system
    nq = len(system.coordinates)
    form = np.zeros((system.n, system.n))
    form[nq : 2 * nq, nq : 2 * nq] = system.mass
    network = range(2 * nq, system.one)
    form[network, network] = np.abs(store(system, at.modes.key)[network, network])
    return form


@dataclass(frozen=True)
class Sampled:
    """The loop cut at its measurement; `period` L [s], `states`: names of z, of which the first `own` belong to the
    rig.
    """

    F: Array
    G: Array
    H: Array
    period: float
    states: tuple[str, ...]
    own: int

    def closed(self, gain: float = 1.0) -> Array:
        """Return the matrix of one period with `gain` times the controller's own gain."""
        return self.F + gain * np.outer(self.G, self.H)


def sampled(
    plant: Plant, feedback: Feedback, reads: str, end: FrontEnd, delay_ns: int, newer: int | None = 0
) -> Sampled:
    """Discretise the loop of `feedback` through its drive and the front end of its sensor on output `reads`.

    `newer`: which command takes effect, counted in periods from the one whose delay is over; None: none does, and the
    actuator holds the one before.
    Raises ValueError if neither the period of the sensor nor that of the controller is a multiple of the other, and for
    a sensor with echoes.
    """
    period = common_period(feedback, end)
    return _Period(plant, feedback, plant.outputs.index(reads), end, delay_ns, period, newer).sampled()


def common_period(feedback: Feedback, end: FrontEnd) -> int:
    """The period of a loop [ns], the longer one of its controller's and its sensor's.

    Raises ValueError if neither is a multiple of the other, and for a sensor with echoes.
    """
    if end.echoes:
        raise ValueError(
            "sensor: has echoes, which the model of a loop does not contain; paths = [] in its table removes them"
        )
    own = feedback.period_ns
    between = end.period_ns
    if own < between:
        period = round(between)
        fits = end.instants.even and period % own == 0
    else:
        period = own
        fits = end.instants.fit(own)
    if not fits:
        near = " or ".join(f"{1e9 / p:g} Hz" for p in _near(own, between))
        raise ValueError(
            f"period: {own / 1e6:g} ms and the {between / 1e6:g} ms between samples are not multiples of each other, "
            f"so that the loop has no common period. It has one if the sensor samples at {near}"
        )
    return period


def _near(own: int, between: float) -> list[float]:
    """The sample periods [ns] next to `between` that have a common period with a controller of period `own` [ns]."""
    many = between > own
    ratio = between / own if many else own / between
    return [own * n if many else own / n for n in (math.ceil(ratio), math.floor(ratio))]


class _Period:
    """One period of the loop, instant by instant. Every quantity is a row over [z at the beginning, y']."""

    def __init__(
        self,
        plant: Plant,
        feedback: Feedback,
        reads: int,
        end: FrontEnd,
        delay_ns: int,
        period: int,
        newer: int | None,
    ) -> None:
        self.end = end
        self.period = period
        self.own = len(plant.states)
        self.newer = newer
        drive = plant.inputs.index(feedback.drives[0])
        self.A, self.B, self.reading = _with_front_end(plant, drive, reads, end)
        self.controller = arithmetic(feedback)
        updates = range(0, period, feedback.period_ns)
        late = [divmod(at + delay_ns, period) for at in updates]  # (periods later, instant) at which a command acts
        self.wait_sample = -(-end.delay_ns // period)
        self.at_sample = -end.delay_ns % period
        n = len(self.A)
        queued = sum(wait for wait, _ in late)
        states = [*plant.states, *(f"sensor {i}" for i in range(n - len(plant.states))), "command"]
        states += [f"command under way {i}" for i in range(queued)]
        states += [f"sample under way {i}" for i in range(self.wait_sample)]
        states += [f"controller {i}" for i in range(len(self.controller[0]))]
        self.states = tuple(states)
        self.rows = np.eye(len(states), len(states) + 1)
        self.x = slice(0, n)
        self.u = n
        places = np.cumsum([n + 1, *(wait for wait, _ in late)]).tolist()
        self.queues = [slice(a, b) for a, b in pairwise(places)]
        self.samples = slice(places[-1], places[-1] + self.wait_sample)
        self.xi = slice(self.samples.stop, len(states))
        self.outside = np.eye(len(states) + 1)[-1]
        self.taken = self.published = np.zeros(len(states) + 1)
        self.answers = [np.zeros(0)] * len(late)
        happens: list[tuple[int, int, Callable[[], None]]] = [(self.at_sample, 0, self._sample), (0, 1, self._publish)]
        happens += [(at, 2, partial(self._update, k)) for k, at in enumerate(updates)]
        happens += [(at, 3, partial(self._command, k, wait)) for k, (wait, at) in enumerate(late)]
        if end.averages:
            happens += [((self.at_sample - round(end.period_ns)) % period, 4, self._reset)]
        self.actions = sorted(happens, key=lambda action: action[:2])

    def sampled(self) -> Sampled:
        """Return the loop after one period."""
        now = 0
        for at, _, act in self.actions:
            self._flow(at - now)
            act()
            now = at
        self._flow(self.period - now)
        for line, newest in [*zip(self.queues, self.answers), (self.samples, self.taken)]:
            if line.stop > line.start:  # commands and samples under way move up by one place
                self.rows[line] = np.vstack([self.rows[line][1:], newest])
        return Sampled(
            self.rows[:, :-1], self.rows[:, -1], self.published[:-1], self.period * 1e-9, self.states, self.own
        )

    def _flow(self, ns: int) -> None:
        from scipy.linalg import expm

        if ns:
            n = len(self.A)
            both = np.zeros((n + 1, n + 1))
            both[:n, :n] = self.A
            both[:n, n] = self.B
            self.rows[: n + 1] = expm(both * (ns * 1e-9)) @ self.rows[: n + 1]

    def _sample(self) -> None:
        self.taken = self.reading @ self.rows[: len(self.A) + 1]

    def _publish(self) -> None:
        self.published = self.rows[self.samples][0].copy() if self.wait_sample else self.taken

    def _update(self, k: int) -> None:
        A, b, c, d = self.controller
        xi = self.rows[self.xi]
        self.answers[k] = c @ xi + d * self.outside
        self.rows[self.xi] = A @ xi + np.outer(b, self.outside)

    def _command(self, k: int, wait: int) -> None:
        if self.newer is not None:
            self.rows[self.u] = self.rows[self.queues[k]][self.newer] if wait > self.newer else self.answers[k]

    def _reset(self) -> None:
        self.rows[len(self.A) - 1] = 0.0


def _with_front_end(plant: Plant, drive: int, reads: int, end: FrontEnd) -> tuple[Array, Array, Array]:
    """The rig with the filter of its sensor and one input; and the measurement as a row over its states and
    that input.
    """
    n = len(plant.A)
    c = plant.C[reads]
    d = plant.D[reads, drive]
    blocks, out = filter_blocks(end)
    size = n + len(out)
    A = np.zeros((size, size))
    B = np.zeros(size)
    A[:n, :n] = plant.A
    B[:n] = plant.B[:, drive]
    at = n
    for block in blocks:
        A[at : at + len(block), at : at + len(block)] = block
        A[at, :n] = c
        B[at] = d
        at += len(block)
    direct = 0.0 if end.averages else end.direct
    return A, B, end.gain * np.concatenate([direct * c, out, [direct * d]])


def filter_blocks(end: FrontEnd) -> tuple[list[Array], list[float]]:
    """Return the filter of a front end: the matrix of each pole, whose first state the output drives, and the row of
    the measurement over these states.
    """
    blocks: list[Array] = []
    out: list[float] = []
    for pole, residue in zip(end.poles, end.residues):
        pair = 2.0 if pole.imag else 1.0
        if pole.imag:
            real = np.array([[pole.real, -pole.imag], [pole.imag, pole.real]])
        else:
            real = np.array([[pole.real]])
        blocks.append(real)
        out += [pair * residue.real, -pair * residue.imag][: len(real)]
    if end.averages:
        blocks.append(np.zeros((1, 1)))
        out.append(1e9 / end.period_ns)
    return blocks, out
