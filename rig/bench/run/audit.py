"""The audit of a run: which effects changed nothing in it, and which were missing, judged at states of the run.

At up to two dozen states, spread over the run, and at its end, the rig is assembled with and without an effect. Both
rigs are compared at each state: accelerations a of the coordinates, rates r of the other state variables, contact
forces T, and the largest friction S that a stuck contact can bear. The effect's share is

    max( |M^1/2 (a - a')| / |M^1/2 |a||,  |r - r'| / ||r||,  |T - T'| / |T|,  |S - S'| / |S| )

with norms over all these states, where the denominator is the larger one of both rigs. |a| and |r| are the sums of the
sizes of their terms, so that it is not zero in steady sliding, where all forces balance. The limits of an actuator keep
a rig away from the states that it visits without them, so that forces at these states say nothing: their share is that
of the time in which the command is at a limit, or beyond it without them. An absent effect gets the values of a shipped
scene of the same plant. States that it brings have the values in force: driving states (the speed
behind a lag, the angle of a disc) follow from what drove the rig during the run (rig.bench.run.audit), structure
and network are in equilibrium. Contacts are in the same mode set, except where one would leave it in the other rig.

Two dozen states can miss what happens rarely, so the ticks that contacts were open, and contacts without lift-off
pulled, are counted over the whole run, and a judgement of no influence says how many states it is based
on. The share is not the error of the motion, which `rig explain SCENE --measure` measures by paired runs; but it needs
no second run. Hardware (rig.about) is absent on purpose and not judged.

The rig with the effect does not pass through the states of the run. Where it stays near them, the share is that of a
paired simulation. Three kinds of run do not, and their lines say that these states cannot tell the size
(`unjudged`), unless the share is zero, which holds for any motion:

    a law with memory   the states of the law adapt, so that force and slip speed are not those at equal states
    stick, slip, open   the effect shifts the events in time, or brings the first one
    vibration           the effect shifts its phase, which changes forces by up to twice the share of inertia in them;
                        that may be a third of the effect's share at most

An absent effect may bring states that only drive the rig: the speed behind a lag, the angle of a disc. Each follows

    z' = a z + u(t),    u: a row over the driving states of the run and over limiters

so that its value at any tick follows from what was kept, without a second run. u is linear between two kept ticks, and
z is exact for that. Up to `MOST` ticks are kept, all of them or evenly spaced ones.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import hypot, inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from rig.model.assembly import Input
from rig.model.formulation import ModeSet, assemble
from rig.model.method import as_integrated
from rig.model.system import Normal, System
from rig.motion.motion import Motion
from rig.scenes.scene import Scene
from rig.scenes.variants import SWITCHED, absent, added, declared, dropped, switches, without
from rig.solve.records import CLOSED, HIGH, LINEAR, LOW, OPEN, SLIP_MINUS, SLIP_PLUS, STICK
from rig.stability.linearisation import inputs, linearised, own_law

Array = NDArray[np.float64]
MOST_STATES = 1 << 16
"""Most ticks that are kept; beyond that every second one is dropped."""
_SMALL = 1e-3  # of a h: below this the series of the weights is exact to rounding

Variant = Callable[[Scene], tuple[System, Mapping[str, Input]]]
"""The rig of a scene with an effect more, and its actuators."""

Compared = dict[str, tuple[float, float, float]]
LEAST = 1e-3
"""Share of the forces below which an effect counts as having no influence."""
MOST = 24
"""Most states of a run that are kept."""
_SCATTER = 64
"""Most frames by which a kept state is earlier than evenly spaced ones."""
_ROUNDING = 1e-12  # a smaller share is rounding: some thousand times the relative accuracy of a double. chosen
_MARGIN = 1e-9
"""Share by which a guard is beyond zero where a contact has left its mode."""
_LATER = 0.05
"""Share of the largest slip speed of the run. # chosen. A change below it that reverses a slip only shifts an event."""
_ROUNDS = 3
"""Most times that contacts of another rig are looked at, and steps of Newton's method."""
_GOLDEN = (sqrt(5.0) - 1.0) / 2.0


class Stretch:
    """A part of a run with one rig, `scene` and `system`: driving states [kept tick, state] from tick `first` on."""

    def __init__(self, scene: Scene, system: System, first: int) -> None:
        self.scene = scene
        self.system = system
        self.first = first
        self.count = 0
        self.rows = np.empty((MOST_STATES, system.n - system.one))

    def driving(self, inputs: Mapping[str, Input]) -> dict[str, Array]:
        """Each driving state at the kept ticks; commands are clamped to the ranges of `inputs`."""
        values = dict(zip(self.system.names[self.system.one :], self.rows[: self.count].T))
        return clamped(values, inputs)


class DrivingHistory:
    """Keeps the driving states of a run. `stretches`: one for each rig of the run, in order."""

    def __init__(self) -> None:
        self.stretches: list[Stretch] = []
        self._count = 0
        self._every = 1

    def follow(self, motion: Motion, scene: Scene) -> None:
        """Keep what is in the log of `motion`, which follows what was kept before."""
        first = motion.tick - motion.kept + 1
        every = self._every
        after = -first % every
        taken = motion.log.out[after : motion.kept : every]
        if not len(taken):
            return
        stretch = self.stretches[-1] if self.stretches else None
        if stretch is None or stretch.system is not motion.system:
            stretch = Stretch(scene, motion.system, first + after)
            self.stretches.append(stretch)
        if self._count + len(taken) > MOST_STATES:
            self._thin()
            self.follow(motion, scene)
            return
        stretch.rows[stretch.count : stretch.count + len(taken)] = taken[:, stretch.system.one :]
        stretch.count += len(taken)
        self._count += len(taken)

    def _thin(self) -> None:
        """Drop every second tick."""
        self._every *= 2
        for stretch in self.stretches:
            after = -stretch.first % self._every // (self._every // 2)
            kept = stretch.rows[after : stretch.count : 2].copy()
            stretch.first += after * (self._every // 2)
            stretch.rows[: len(kept)] = kept
            stretch.count = len(kept)
        self._count = sum(stretch.count for stretch in self.stretches)

    def ticks(self, stretch: Stretch) -> Array:
        """The kept ticks of a stretch."""
        return stretch.first + self._every * np.arange(stretch.count, dtype=np.float64)

    def at_limit(self, table: str, variant: Variant | None = None) -> float:
        """The share of the ticks in which a command to an actuator of `table` was at a limit of its range.

        With `variant`, which has limits that the run has not: in which the command was beyond them.
        """
        met = total = 0
        for stretch in self.stretches:
            inputs = variant(stretch.scene)[1] if variant else stretch.scene.assemble().inputs
            values = stretch.driving({})
            for key, actuator in inputs.items():
                if key.partition(".")[0] != table or actuator.state not in values:
                    continue
                command = values[actuator.state]
                inside = np.clip(command, actuator.low, actuator.high)
                away = inside != command if variant else (command <= actuator.low) | (command >= actuator.high)
                met += int(np.count_nonzero(away))
                total += stretch.count
        return met / max(total, 1)

    def added_states(self, step: float, variant: Variant) -> Callable[[int], dict[str, float]] | None:
        """The driving states that `variant` has more than the run, by name, as a function of the tick.

        `step`: of a tick [s]. None if one of them follows from something else than driving states.
        """
        ticks: list[Array] = []
        traces: dict[str, list[Array]] = {}
        last: dict[str, float] = {}
        for stretch in self.stretches:
            system, inputs = variant(stretch.scene)
            time = self.ticks(stretch)
            known = stretch.driving(inputs)
            wanted = [name for name in system.names[system.one :] if name not in known]
            while wanted:
                rates = {name: rate for name in wanted if (rate := _rate(system, name, known)) is not None}
                if not rates:
                    return None
                for name, rate in rates.items():
                    known[name] = _followed(system, name, rate, time * step, last.get(name))
                    traces.setdefault(name, []).append(known[name])
                    wanted.remove(name)
            if len(time):
                ticks.append(time)
                last |= {name: float(trace[-1][-1]) for name, trace in traces.items()}
        if not ticks:
            return None
        at = np.concatenate(ticks)
        values = {name: np.concatenate(trace) for name, trace in traces.items()}
        return lambda tick: {name: float(np.interp(tick, at, trace)) for name, trace in values.items()}


def clamped(values: Mapping[str, Any], inputs: Mapping[str, Input]) -> dict[str, Any]:
    """`values` of states (numbers or arrays), with each command clamped to the range of its actuator."""
    ranges = {actuator.state: (actuator.low, actuator.high) for actuator in inputs.values() if actuator.state}
    return {name: np.clip(v, *ranges[name]) if name in ranges else v for name, v in values.items()}


def _rate(system: System, name: str, known: Mapping[str, Array]) -> Array | None:
    """The values of u of driving state `name` at the ticks of `known`; None if it needs a state that is not known."""
    index = system.names.index(name)
    limiters = [limiter for limiter in system.limiters if limiter.state == index]
    rows = [system.signals[index - system.one], *(limiter.row for limiter in limiters)]
    others = np.delete(np.array(rows), index, axis=1)
    names = [*system.names[:index], *system.names[index + 1 :]]
    if any(names[i] not in known for i in np.flatnonzero(others.any(axis=0))):
        return None
    values = others @ np.array([known.get(state, np.zeros_like(known["one"])) for state in names])
    for limiter, row in zip(limiters, values[1:]):
        values[0] += limiter.gain * np.clip(row, limiter.low, limiter.high)
    return np.asarray(values[0])


def _followed(system: System, name: str, rate: Array, time: Array, start: float | None) -> Array:
    """Values of z at `time` [s] for its `rate` u there.

    Without `start` it has settled at first, or, if it cannot settle, had its start value when the run began.
    """
    index = system.names.index(name)
    a = float(system.signals[index - system.one, index])
    if not len(time):
        return np.zeros(0)
    if start is None:
        start = -rate[0] / a if a < 0.0 else float(system.start[index]) + float(rate[0]) * time[0]
    h = np.diff(time)
    s = a * h
    with np.errstate(invalid="ignore", divide="ignore"):
        whole = np.where(np.abs(s) < _SMALL, 1.0 + s / 2.0 + s * s / 6.0, np.expm1(s) / s)
        slope = np.where(np.abs(s) < _SMALL, 0.5 + s / 6.0 + s * s / 24.0, (np.expm1(s) - s) / (s * s))
    gained = h * (whole * rate[:-1] + slope * np.diff(rate))
    if a == 0.0:
        return np.cumsum(np.concatenate([[float(start)], gained]))

    def values() -> Iterator[float]:
        z = float(start)
        yield z
        for kept, more in zip(np.exp(s).tolist(), gained.tolist()):
            z = kept * z + more
            yield z

    return np.fromiter(values(), np.float64, len(time))


class VisitedState(NamedTuple):
    """A state of a run and its mode set, at tick `tick`; `scene`: of the rig there."""

    system: System
    key: int
    x: Array
    scene: Scene
    tick: int = 0


class Pull:
    """How often and how far a contact that cannot open would have had to: `count` of all ticks, `most` [N]."""

    def __init__(self) -> None:
        self.count = 0
        self.most = 0.0


class StateSamples:
    """Keeps states of a run, spread over a run of any length. `due`: the frame of the next one.

    They are not quite evenly spaced: otherwise a dither of 250 Hz is zero at each of them.

    `history`: what drives the rig. `pulls`: contacts that pulled. `open`: switches of effects (`shunt.connected`) that
    have been open all the time. `since`: begin of the run [s], or of the part of it that was simulated.
    """

    def __init__(self, scene: Scene, values: Mapping[str, float]) -> None:
        """`values`: input -> its value at the start."""
        self.kept: list[VisitedState] = []
        self.due = self._even = self._every = 1
        self.since = 0.0
        self.open = {key for key in switches(scene.parameters) if values.get(key, SWITCHED) < SWITCHED}
        self.history = DrivingHistory()
        about = declared(scene.parameters)
        self._drives = any(not about[name].hardware for name in absent(scene))
        self._drives = self._drives or any(name.endswith(" limits") for name in dropped(scene))
        self.pulls: dict[str, Pull] = {}
        self.ticks = 0
        self._read: tuple[System | None, dict[str, int]] = (None, {})

    def begin(self, frame: int, time: float) -> None:
        """Keep states from frame `frame` at `time` [s] on."""
        self.due = self._even = frame + 1
        self.since = time

    def hears(self, name: str, value: Any) -> None:
        """Notice that an input or a parameter now has this value."""
        if name in self.open and value >= SWITCHED:
            self.open.remove(name)

    def follow(self, motion: Motion, scene: Scene, outputs: Sequence[str]) -> None:
        """Notice what is in the log of `motion`, with these outputs; `scene`: of the present rig."""
        system = motion.system
        if system.film is not None or not motion.kept:
            return
        if self._drives:
            self.history.follow(motion, scene)
        self.ticks += motion.kept
        if self._read[0] is not system:
            self._read = system, _readings(system, scene, outputs)
        if not self._read[1]:
            return
        if motion.kept == 1:  # each frame of a live run: arrays would cost as much as the frame
            now = motion.outputs_now()
            for name, column in self._read[1].items():
                if (force := now.item(column)) < 0.0:
                    self._pulls(name, 1, force)
            return
        values = motion.outputs_at(motion.log.out[: motion.kept], motion.log.modes[: motion.kept])
        for name, column in self._read[1].items():
            forces = values[:, column]
            if pulling := int(np.count_nonzero(forces < 0.0)):
                self._pulls(name, pulling, float(forces.min()))

    def _pulls(self, name: str, ticks: int, force: float) -> None:
        pull = self.pulls.setdefault(name, Pull())
        pull.count += ticks
        pull.most = max(pull.most, -force)

    def pulled(self, comparison: Comparison) -> dict[str, tuple[float, float]]:
        """Contacts that pulled -> the share of the time in which they did, and their largest pull [N].

        Where no output of the plant tells the normal force, the share is that of the kept states.
        """
        shares = {name: (pull.count / self.ticks, pull.most) for name, pull in self.pulls.items()}
        for visited in self.kept:
            modes = comparison.modes(visited.system, visited.key)
            if modes is None:
                continue
            unread = _can_pull(visited.system).keys() - self._read[1].keys()
            if not unread:
                continue
            forces = _forces(visited.system, modes, visited.x).normal.tolist()
            for normal, force in zip(visited.system.normals, forces):
                name = _contact(visited.system, normal)
                if name in unread and force < 0.0:
                    part, most = shares.get(name, (0.0, 0.0))
                    shares[name] = part + 1.0 / len(self.kept), max(most, -force)
        return shares

    def look(self, motion: Motion, scene: Scene, frame: int, steps: int) -> None:
        """Keep the states that are due; `motion` is at the end of frame `frame`, and a frame has `steps` samples."""
        while self.due <= frame:
            row = motion.kept - 1 - (frame - self.due) * steps - _scattered(self.due, steps)
            if 0 <= row < motion.kept:
                key = motion.mode_sets.sets[int(motion.log.modes[row])].key
                tick = motion.tick - (motion.kept - 1 - row)
                self.kept.append(VisitedState(motion.system, key, motion.log.out[row].copy(), scene, tick))
            if len(self.kept) == MOST:
                self.kept = self.kept[1::2]
                self._every *= 2
            self._even += self._every
            self.due = self._even - _scattered(self._even, min(self._every, _SCATTER))


def _contact(system: System, normal: Normal) -> str:
    """The name of a normal force for a user: that of its contact, unless this has several."""
    alone = sum(other.patch == normal.patch for other in system.normals) == 1
    return system.patches[normal.patch].name if alone else normal.name


def _can_pull(system: System) -> dict[str, str]:
    """Normal forces that never open, as named by `_contact` -> the name of their row."""
    return {_contact(system, normal): f"N:{normal.name}" for normal in system.normals if not normal.opens}


def _readings(system: System, scene: Scene, outputs: Sequence[str]) -> dict[str, int]:
    """Normal forces that can pull -> the number of the output that is this force, where there is one."""
    rows = {name: output.row for name, output in scene.assemble().outputs.items() if name in outputs}
    readings = {}
    for contact, force in _can_pull(system).items():
        output = next((name for name, row in rows.items() if row == {force: 1.0}), None)
        if output is not None:
            readings[contact] = list(outputs).index(output)
    return readings


def _scattered(number: int, room: int) -> int:
    """A whole number from 0 to `room` - 1 that has no period in `number`: multiples of the golden ratio."""
    return int(number * _GOLDEN % 1.0 * room)


@dataclass(frozen=True)
class JudgedEffect:
    """An effect and its `share`; `like`: for an absent effect, the scene from which its values are.

    `open`: for an effect whose switch was never closed in this run, the input that closes it. `states`: number of
    states at which it was judged, `since`: from this time on [s]. `contact`: one that lifts off with the absent effect
    and pulled without it, for the share `pulled` of the time and with up to `pull` [N]. `unjudged`: why the share of
    forces says nothing about a simulation with the effect, or without it; "" if it does.
    """

    effect: str
    on: bool
    share: float
    states: int
    since: float
    like: str = ""
    open: str = ""
    contact: str = ""
    pulled: float = 0.0
    pull: float = 0.0
    unjudged: str = ""

    @property
    def noted(self) -> bool:
        """Whether the user should know: the effect is active without influence, or missing."""
        if self.on and self.unjudged:
            return False
        return self.on != (self.share >= LEAST or self.pulled > 0.0)

    def text(self) -> str:
        """The judgement as a sentence."""
        name = f'Effect "{self.effect}"'
        owner = self.effect.removesuffix(" limits")
        if not self.on:
            like = f" as in {self.like}" if self.like else ""
            pulls = f"{self.contact} pulled for {self.pulled:.2%} of the time, with up to {self.pull:.3g} N; "
            differ = f"with it{like} the forces of this run would differ by {self.share:.1%}"
            if self.unjudged:
                values = f" (values as in {self.like})" if self.like else ""
                differ = f"what it would change{values}{self._cannot}"
            if owner != self.effect:
                differ = f"the {owner} was commanded beyond the limits{like} for {self.share:.1%} of the time"
            return f"{name} is absent; {pulls if self.contact else ''}{differ}"
        if self.open:
            return f"{name} stayed open in this run ({self.open} closes it)"
        if owner != self.effect:
            if self.share:
                return f"{name} is active but the {owner} was at a limit for only {self.share:.1g} of the time"
            return f"{name} is active but never influenced this run ({owner} stayed within its range)"
        if self.unjudged:
            return f"{name} is active; what it changed{self._cannot}"
        if self.share > _ROUNDING:
            few = f"{name} is active but changed the forces of this run by only {self.share:.1g} of their size"
            return f"{few}; for its change of the motion: rig explain SCENE --measure"
        since = f" from {self.since:g} s on" if self.since else ""
        return f"{name} is active but had no influence on this run, judged at {self.states} of its states{since}"

    @property
    def _cannot(self) -> str:
        """The end of a sentence that says why there is no judgement, and what to do."""
        remedy = "for its change of the motion: rig explain SCENE --measure"
        return f" cannot be judged from states of this run, because {self.unjudged}; {remedy}"

    def to_json(self) -> dict[str, Any]:
        """The judgement as plain values for JSON."""
        return {**asdict(self), "noted": self.noted, "text": self.text()}


def audit(scene: Scene, witness: StateSamples, motion: Motion) -> list[dict[str, Any]]:
    """Judge every effect that the plant of `scene` can have or not, at the states of `witness`."""
    return [effect.to_json() for effect in _judged(scene, witness, motion)]


def _judged(scene: Scene, witness: StateSamples, motion: Motion) -> Iterator[JudgedEffect]:
    if not witness.kept:
        return
    kept = [*witness.kept, VisitedState(motion.system, motion.key, motion.x.copy(), scene, motion.tick)]
    comparison = Comparison(kept)
    clamped = _clamped(motion)
    judged = (len(kept), witness.since)
    pulls = witness.pulled(comparison)
    reason = _moves_on(motion, kept)
    inertia = comparison.inertia()

    def unjudged(name: str, part: float) -> str:
        """Why the share of forces `part` says nothing; "" for a share of the time, or for no influence at all."""
        if part <= _ROUNDING or name.endswith(" limits"):
            return ""
        vibrates = "the rig vibrates, and the effect shifts the phase" if 2.0 * inertia > part / 3.0 else ""
        return reason or vibrates

    def rigs(change: Callable[[Scene], Scene]) -> Variant:
        known: dict[int, tuple[System, Mapping[str, Input]]] = {}

        def variant(of: Scene) -> tuple[System, Mapping[str, Input]]:
            if id(of) not in known:
                assembly = change(of).assemble()
                integration = motion.integration
                system = as_integrated(assembly.system(), integration.method, integration.smoothing)
                known[id(of)] = system, assembly.inputs
            return known[id(of)]

        return variant

    for name, keys in dropped(scene).items():
        variant = rigs(partial(without, keys=keys))
        owner = name.removesuffix(" limits")
        try:
            other, _ = variant(scene)
            if owner == name:
                part = max(comparison.share(variant), _lifted(motion, other))
            else:
                part = max(clamped.get(owner, 0.0), witness.history.at_limit(owner))
        except (RigError, ValueError):  # the plant needs it, or the method cannot integrate the rig without it
            continue
        switch = next((key for key in witness.open if key.partition(".")[0] == name), "")
        yield JudgedEffect(name, True, part, *judged, open=switch, unjudged=unjudged(name, part))
    about = declared(scene.parameters)
    for name, keys in absent(scene).items():
        if about[name].hardware:
            continue
        try:
            _, like = added(scene, keys)
            variant = rigs(lambda of, keys=keys: added(of, keys)[0])  # type: ignore[misc]
            other, _ = variant(scene)
            if name.endswith(" limits"):
                part = witness.history.at_limit(name.removesuffix(" limits"), variant)
            else:
                more = witness.history.added_states(motion.integration.step_ns * 1e-9, variant)
                if more is None:
                    continue
                part = comparison.share(variant, more)
        except (RigError, ValueError):  # no scene has values for it, or the method cannot integrate it
            continue
        lifts = pulls.keys() & {_contact(other, normal) for normal in other.normals if normal.opens}
        longest = [(patch, *pulls.pop(patch)) for patch in lifts]
        patch, pulled, most = max(longest, key=lambda pull: pull[1], default=("", 0.0, 0.0))
        why = unjudged(name, part) or ("the contact would open" if pulled else "")
        yield JudgedEffect(name, False, part, *judged, like, "", patch, pulled, most, why)
    for patch, (pulled, most) in pulls.items():
        yield JudgedEffect(f"lift-off at {patch}", False, pulled, *judged, "", "", patch, pulled, most)


def _moves_on(motion: Motion, kept: Sequence[VisitedState]) -> str:
    """Why a rig with or without an effect does not stay near the states of the run; "" if it does."""
    system = motion.system
    if remembering := [patch.name for patch in system.patches if patch.memory]:
        return f"the friction law of {', '.join(remembering)} has memory"
    met = [mode_set.key for ticks, mode_set in zip(motion.state.tally.tolist(), motion.mode_sets.sets) if ticks]
    modes = [system.modes(key)[:2] for key in met]
    modes += [visited.system.modes(visited.key)[:2] for visited in kept]
    for kinds, what in zip(zip(*modes), ("stick and slip", "open and close")):
        if any(len(set(of_one)) > 1 for of_one in zip(*kinds)):
            return f"contacts {what}, and the effect shifts when"
    return ""


def _clamped(motion: Motion) -> dict[str, float]:
    """Share of the ticks in which each limiter was clamped; the kept states would miss rare clamping."""
    system = motion.system
    tally = motion.state.tally.astype(np.float64)
    shares = dict.fromkeys((limiter.name for limiter in system.limiters), 0.0)
    for ticks, modes in zip(tally.tolist(), motion.mode_sets.sets):
        for limiter, mode in zip(system.limiters, system.modes(modes.key)[2]):
            shares[limiter.name] += ticks / max(float(tally.sum()), 1.0) * (mode != LINEAR)
    return shares


def _lifted(motion: Motion, other: System) -> float:
    """Share of the ticks that began with a contact open that always stays closed in the rig `other`."""
    system = motion.system
    tally = motion.state.tally.tolist()
    closed = {normal.name for normal in other.normals if not normal.opens}
    lifted = 0
    for ticks, modes in zip(tally, motion.mode_sets.sets):
        contacts = zip(system.normals, system.modes(modes.key)[1])
        if any(mode == OPEN and normal.name in closed for normal, mode in contacts):
            lifted += ticks
    return float(lifted / max(sum(tally), 1))


class _Forces(NamedTuple):
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
        """Share by which the rigs `variant` differ from those of the run at its states (see the head of this file).

        `added_states`: values of driving states that the run does not have, at a tick.
        """
        sums: dict[str, list[float]] = {}
        for i, visited in enumerate(self._kept):
            modes = self.modes(visited.system, visited.key)
            if modes is None:
                continue
            if i not in self._own:
                at = visited.system, modes, visited.x, _forces(visited.system, modes, visited.x)
                self._own[i] = _compared_values(*at), _departures(*at)
            mine, departing = self._own[i]
            other = self._counterpart(visited, departing, *variant(visited.scene), added_states(visited.tick))
            if other is None:
                continue
            theirs = _compared_values(*other)
            for name in mine.keys() & theirs.keys():
                group = name.partition(" ")[0]
                value, size, weight = mine[name]
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
            values = _compared_values(visited.system, modes, visited.x, _forces(visited.system, modes, visited.x))
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
    ) -> tuple[System, ModeSet, Array, _Forces] | None:
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
            forces = _forces(other, there, x)
            departing = _departures(other, there, x, forces)
            departures = {part: mode for part, mode in departing.items() if part not in excused}
            if not departures:
                return other, there, x, forces
            excused |= departures.keys()
            for kind, parts in enumerate(_parts(other)):
                at[kind] = [departures.get((kind, part.name), mode) for part, mode in zip(parts, at[kind])]
        there = self.modes(other, other.key(*at))
        return None if there is None else (other, there, x, _forces(other, there, x))


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


def _forces(system: System, modes: ModeSet, x: Array) -> _Forces:
    T, _ = inputs(system, modes, x, own_law(system, modes))
    friction = modes.friction @ x + modes.friction_t @ T
    normal = modes.normal @ x + modes.normal_t @ T
    load = modes.load @ x + modes.load_t @ T
    return _Forces(T, friction, normal, load)


def _departures(system: System, modes: ModeSet, x: Array, forces: _Forces) -> dict[tuple[int, str], int]:
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


def _compared_values(system: System, modes: ModeSet, x: Array, forces: _Forces) -> Compared:
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
