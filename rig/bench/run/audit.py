"""The audit of a run: which effects changed nothing in it, and which were missing, judged at states of the run.

At up to two dozen states, spread over the run, and at its end, the rig is assembled with and without an effect, and
both rigs are compared (rig.bench.run.rig_comparison): the effect's share is the share by which they differ. The limits
of an actuator keep a rig away from the states that it visits without them, so that forces at these states say nothing:
their share is that of the time in which the command is at a limit, or beyond it without them. An absent effect gets the
values of a shipped scene of the same plant. States that it brings have the values in force: driving states (the speed
behind a lag, the angle of a disc) follow from what drove the rig during the run (rig.bench.run.driving_history),
structure and network are in equilibrium.

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
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bench.run.driving_history import DrivingHistory, Variant
from rig.bench.run.rig_comparison import Comparison, VisitedState, forces_at
from rig.errors import RigError
from rig.model.assembly import Input
from rig.model.method import as_integrated
from rig.model.system import Normal, System
from rig.motion.motion import Motion
from rig.scenes.scene import Scene
from rig.scenes.variants import SWITCHED, absent, added, declared, dropped, switches, without
from rig.solve.records import LINEAR, OPEN

Array = NDArray[np.float64]

LEAST = 1e-3
"""Share of the forces below which an effect counts as having no influence."""
MOST = 24
"""Most states of a run that are kept."""
_SCATTER = 64
"""Most frames by which a kept state is earlier than evenly spaced ones."""
_ROUNDING = 1e-12  # a smaller share is rounding: some thousand times the relative accuracy of a double. chosen
_GOLDEN = (sqrt(5.0) - 1.0) / 2.0


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
            forces = forces_at(visited.system, modes, visited.x).normal.tolist()
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
        variant = rigs(partial(without, keys=keys, at_its_states=True))
        owner = name.removesuffix(" limits")
        try:
            other, _ = variant(scene)
            if owner == name:
                part = max(comparison.share(variant), _lifted(motion, other))
            else:
                part = max(clamped.get(owner, 0.0), witness.history.at_limit(owner))
        except (RigError, ValueError):  # the plant needs it, the method too, or without it states mean other motions
            continue
        switch = next((key for key in witness.open if key.partition(".")[0] == name), "")
        yield JudgedEffect(name, True, part, *judged, open=switch, unjudged=unjudged(name, part))
    about = declared(scene.parameters)
    for name, keys in absent(scene).items():
        if about[name].hardware:
            continue
        try:
            _, like = added(scene, keys, at_its_states=True)
            variant = rigs(lambda of, keys=keys: added(of, keys, at_its_states=True)[0])  # type: ignore[misc]
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
