"""The audit of a run: which effects changed nothing in it, and which were missing, judged at states of the run.

At up to two dozen states, spread over the run, the rig is assembled with and without an effect. Both rigs are compared
at each state: accelerations a of the coordinates, rates r of the other state variables, contact forces T. The effect's
share is

    max( |M^1/2 (a - a')| / |M^1/2 |a||,  |r - r'| / ||r||,  |T - T'| / |T| )        norms over all these states

where |a| and |r| are the sums of the sizes of their terms, so that the denominator is not zero in steady sliding, where
all forces balance. Two dozen states can miss what happens rarely, so the ticks that limiters were clamped and contacts
were open are counted over the whole run, and a judgement of no influence says how many states it is based on. The share
is not the error of the motion, which `rig explain SCENE --measure` measures by paired
runs; but it needs no second run. An absent effect gets the values of a shipped scene of the same plant. Hardware
(rig.about) is absent on purpose and not judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import hypot, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from rig.model.formulation import ModeSet, assemble
from rig.model.method import as_integrated
from rig.model.system import System
from rig.motion.motion import Motion
from rig.scenes.effects import declared, switches
from rig.scenes.scene import Scene
from rig.scenes.variants import SWITCHED, absent, added, dropped, without
from rig.solve.state_codes import CLOSED, LINEAR, OPEN
from rig.stability.jacobian import inputs, loads, own_law

Array = NDArray[np.float64]
Compared = dict[str, tuple[float, float, float]]
LEAST = 1e-3
"""Share of the forces below which an effect counts as having no influence."""
MOST = 24
"""Most states of a run that are kept."""
_SCATTER = 64
"""Frames by which they are earlier than evenly spaced ones, at most."""
_ROUNDING = 1e-12
_GOLDEN = (sqrt(5.0) - 1.0) / 2.0


class VisitedState(NamedTuple):
    """A state of a run and its mode set."""

    system: System
    key: int
    x: Array


class StateSamples:
    """Keeps states of a run, spread over a run of any length. `due`: the frame of the next one.

    They are not quite evenly spaced: otherwise a dither of 250 Hz is zero at each of them.

    `open`: switches of effects (`shunt.connected`) that have been open all the time. `since`: begin of the run
    [s], or of the part of it that was simulated.
    """

    def __init__(self, scene: Scene, values: Mapping[str, float]) -> None:
        """`values`: input -> its value at the start."""
        self.kept: list[VisitedState] = []
        self.due = self._even = self._every = 1
        self.since = 0.0
        self.open = {key for key in switches(scene.parameters) if values.get(key, SWITCHED) < SWITCHED}

    def begin(self, frame: int, time: float) -> None:
        """Keep states from frame `frame` at `time` [s] on."""
        self.due = self._even = frame + 1
        self.since = time

    def hears(self, name: str, value: Any) -> None:
        """Notice that an input or a parameter now has this value."""
        if name in self.open and value >= SWITCHED:
            self.open.remove(name)

    def look(self, motion: Motion, frame: int, steps: int) -> None:
        """Keep the states that are due; `motion` is at the end of frame `frame`, and a frame has `steps` samples."""
        while self.due <= frame:
            row = motion.kept - 1 - (frame - self.due) * steps - _scattered(self.due, steps)
            if 0 <= row < motion.kept:
                key = motion.mode_sets.sets[int(motion.log.modes[row])].key
                self.kept.append(VisitedState(motion.system, key, motion.log.out[row].copy()))
            if len(self.kept) == MOST:
                self.kept = self.kept[1::2]
                self._every *= 2
            self._even += self._every
            self.due = self._even - _scattered(self._even, min(self._every, _SCATTER))


def _scattered(number: int, room: int) -> int:
    """A whole number from 0 to `room` - 1 that has no period in `number`: multiples of the golden ratio."""
    return int(number * _GOLDEN % 1.0 * room)


@dataclass(frozen=True)
class JudgedEffect:
    """An effect and its `share`; `like`: for an absent effect, the scene from which its values are.

    `open`: for an effect whose switch was never closed in this run, the input that closes it. `states`: number of
    states at which it was judged, `since`: from this time on [s].
    """

    effect: str
    on: bool
    share: float
    states: int
    since: float
    like: str = ""
    open: str = ""

    @property
    def noted(self) -> bool:
        """Whether the user should know: the effect is active without influence, or missing."""
        return self.on != (self.share >= LEAST)

    def text(self) -> str:
        """The judgement as a sentence."""
        name = f'Effect "{self.effect}"'
        if not self.on:
            like = f" as in {self.like}" if self.like else ""
            return f"{name} is absent; with it{like} the forces of this run would differ by {self.share:.1%}"
        if self.open:
            return f"{name} stayed open in this run ({self.open} closes it)"
        if self.share > _ROUNDING:
            few = f"{name} is active but changed the forces of this run by only {self.share:.1g} of their size"
            return f"{few}; for its change of the motion: rig explain SCENE --measure"
        owner = self.effect.removesuffix(" limits")
        if owner != self.effect:
            return f"{name} is active but never influenced this run ({owner} stayed within its range)"
        since = f" from {self.since:g} s on" if self.since else ""
        return f"{name} is active but had no influence on this run, judged at {self.states} of its states{since}"

    def to_json(self) -> dict[str, Any]:
        """The judgement as plain values for JSON."""
        return {**asdict(self), "noted": self.noted, "text": self.text()}


def audit(scene: Scene, witness: StateSamples, motion: Motion) -> list[dict[str, Any]]:
    """Judge every effect that the plant of `scene` can have or not, at the states of `witness`."""
    return [one.to_json() for one in _judged(scene, witness, motion)]


def _judged(scene: Scene, witness: StateSamples, motion: Motion) -> Iterator[JudgedEffect]:
    kept = witness.kept
    if not kept:
        return
    own: dict[int, Compared] = {}
    clamped, judged = _clamped(motion), (len(kept), witness.since)

    def rig_of(variant: Scene) -> System:
        return as_integrated(variant.assemble().system(), motion.integration.method, motion.integration.smoothing)

    for name, keys in dropped(scene).items():
        try:
            other = rig_of(without(scene, keys))
        except (RigError, ValueError):  # the plant needs it, or the method cannot integrate the rig without it
            continue
        rare = clamped.get(name.removesuffix(" limits"), 0.0) if name.endswith(" limits") else _lifted(motion, other)
        switch = next((key for key in witness.open if key.partition(".")[0] == name), "")
        yield JudgedEffect(name, True, max(share(kept, other, own), rare), *judged, open=switch)
    about = declared(scene.parameters)
    for name, keys in absent(scene).items():
        if about[name].hardware:
            continue
        try:
            more, like = added(scene, keys)
            yield JudgedEffect(name, False, share(kept, rig_of(more), own), *judged, like)
        except (RigError, ValueError):  # no scene has values for it, or the method cannot integrate it
            continue


def _clamped(motion: Motion) -> dict[str, float]:
    """Share of the ticks in which each limiter was clamped; the kept states would miss rare clamping."""
    system, tally = motion.system, motion.state.tally.astype(np.float64)
    found = dict.fromkeys((limiter.name for limiter in system.limiters), 0.0)
    for ticks, modes in zip(tally.tolist(), motion.mode_sets.sets):
        for limiter, mode in zip(system.limiters, system.modes(modes.key)[2]):
            found[limiter.name] += ticks / max(float(tally.sum()), 1.0) * (mode != LINEAR)
    return found


def _lifted(motion: Motion, other: System) -> float:
    """Share of the ticks that began with a contact open that always stays closed in the rig `other`."""
    system, tally = motion.system, motion.state.tally.tolist()
    closed = {normal.name for normal in other.normals if not normal.opens}
    lifted = sum(
        ticks
        for ticks, modes in zip(tally, motion.mode_sets.sets)
        if any(mode == OPEN and one.name in closed for one, mode in zip(system.normals, system.modes(modes.key)[1]))
    )
    return float(lifted / max(sum(tally), 1))


def share(kept: Sequence[VisitedState], other: System, own: dict[int, Compared]) -> float:
    """Share by which another rig differs at the states of this one (see the head of this file).

    `own`: values of this rig, by the index of the state; filled here.
    """
    sums: dict[str, list[float]] = {}
    met: dict[tuple[int, int], tuple[ModeSet, ModeSet] | None] = {}
    for i, (system, key, x) in enumerate(kept):
        pair = met.get((id(system), key), ())
        if pair == ():
            pair = met[id(system), key] = _pair(system, other, key)
        if not pair:
            continue
        if i not in own:
            own[i] = _compared_values(system, pair[0], x)
        mine, theirs = own[i], _compared_values(other, pair[1], _carried(system, other, x))
        for name in mine.keys() & theirs.keys():
            group, (value, size, weight) = name.partition(" ")[0], mine[name]
            total = sums.setdefault("a" if group == "a" else name, [0.0, 0.0])
            total[0] = hypot(total[0], sqrt(weight) * (value - theirs[name][0]))
            total[1] = hypot(total[1], sqrt(weight) * size)
    return max((away / size for away, size in sums.values() if size > 0.0), default=0.0)


def _pair(system: System, other: System, key: int) -> tuple[ModeSet, ModeSet] | None:
    """The same mode set in both rigs, as far as the other one has its parts; None if it is singular."""
    names = [[p.name for p in parts] for parts in _parts(system)]
    modes = [dict(zip(n, m)) for n, m in zip(names, system.modes(key))]
    at = [
        [known.get(p.name, CLOSED if kind else 0) for p in parts]
        for kind, (known, parts) in enumerate(zip(modes, _parts(other)))
    ]
    at[1] = [CLOSED if mode == OPEN and not n.opens else mode for mode, n in zip(at[1], other.normals)]
    try:
        return assemble(system, key), assemble(other, other.key(at[0], at[1], at[2], at[3], at[4]))
    except np.linalg.LinAlgError:
        return None


def _parts(system: System) -> tuple[Sequence[Any], ...]:
    return system.patches, system.normals, system.limiters, system.sectors, system.switches


def _carried(system: System, other: System, x: Array) -> Array:
    """The state of the other rig: variables with the same name have the values of `x`, all others start values."""
    known = dict(zip(system.names, x.tolist()))
    return np.array([known.get(name, start) for name, start in zip(other.names, other.start.tolist())])


def _compared_values(system: System, modes: ModeSet, x: Array) -> Compared:
    """(value, size of its terms, weight) of each acceleration, each other rate and each contact force."""
    nq = len(system.coordinates)
    T, _ = inputs(system, modes, x, own_law(system, modes))
    rates = modes.A @ x + modes.b @ T
    sizes = np.abs(modes.A) @ np.abs(x) + np.abs(modes.b) @ np.abs(T)
    found = {
        f"a {name}": (rates[nq + i], sizes[nq + i], system.mass[i, i]) for i, name in enumerate(system.coordinates)
    }
    found |= {f"r {system.names[i]}": (rates[i], sizes[i], 1.0) for i in range(2 * nq, system.n)}
    friction = modes.friction @ x + modes.friction_t @ T
    load, load_t = loads(system, modes)
    pressed = load @ x + load_t @ T
    for patch, force, normal in zip(system.patches, friction.tolist(), pressed.tolist()):
        found[f"T {patch.name}"] = (force, force, 1.0)
        found[f"N {patch.name}"] = (normal, normal, 1.0)
    return found
