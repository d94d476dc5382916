"""What each effect of a scene costs, and what its absence changes: paired runs of the plant with and without it.

Controllers and protocol are left out of both, actuators are held where the protocol holds them longest. An effect with
a switch that is open there (a shunt, dither) is measured closed as well.

Cost: all plants take turns, round after round, the plant with every effect twice in each. An effect's cost is the
difference of what rounds come to (rig.qualify.cost.timing). The noise floor is what the plant differs from itself by,
or the 95 % interval of the difference where that is wider; rounds are repeated while it is coarse.

Change: each measure (rig.qualify.cost.measures) with the effect and without it, and their difference as a share of the
larger of both. Where one plant repeats and the other does not, both are compared as motions that do not repeat. Such a
motion may be irregular: then it is run twice, from starts that differ by rounding, and what these two differ by cannot
be told.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rig.bench import pace
from rig.errors import NumericsError, RigError
from rig.qualify.cost.changes import Change, changed
from rig.qualify.cost.problem import held, problem
from rig.qualify.cost.settings import of
from rig.qualify.cost.timing import Contender, Spread, spread
from rig.scenes.effects import declared
from rig.scenes.scene import Scene
from rig.scenes.variants import SWITCHED, dropped, opened, without

ROUNDS = 9
UNKNOWN = Spread(math.nan, math.nan, math.nan)
_BATCHES = 6  # of rounds, at most
_FINE = 0.02  # of a step: a noise floor that is fine enough
_BUSY = 0.5  # of a step: a noise floor above which nothing can be told


NO_CHANCE = "is random: compared runs are without it; runs of other seeds tell what it changes"


@dataclass(frozen=True)
class Paired:
    """One effect: `states` it adds, `tick` [ns] it adds to a sample step, `changes` if it is left out.

    `whole` [ns]: a step of the plant with every effect. `noise` [ns]: costs below it cannot be told here and now.
    `note`: what else is to be known of the two motions. `fault`: why there is no other plant. `switch`: who closes it,
    of an effect that starts open; `closed`: the same effect measured closed, where it has been measured open. `on`: the
    scene names it and the other plant is without it; else the other plant has it added.
    """

    name: str
    states: int = 0
    tick: Spread = UNKNOWN
    noise: float = math.nan
    whole: float = math.nan
    changes: tuple[Change, ...] = field(default=())
    note: str = ""
    fault: str = ""
    switch: str = ""
    closed: Paired | None = None
    on: bool = True

    @property
    def errors(self) -> dict[str, float]:
        """The size of the change of each measure."""
        return {one.measure: one.size for one in self.changes}

    @property
    def worst(self) -> Change | None:
        """The largest change that can be told; None where there is none."""
        told = [one for one in self.changes if one.told]
        return max(told, key=lambda one: one.size, default=None)

    @property
    def measurable(self) -> bool:
        """Whether a cost can be told from the noise of the machine at all."""
        return self.noise <= _BUSY * self.whole

    @property
    def told(self) -> Spread:
        """What a figure shows as the cost: nothing where it cannot be measured."""
        return self.tick if self.measurable else Spread(0.0, 0.0, 0.0)

    def cost(self) -> str:
        """What it costs, in words."""
        if math.isnan(self.whole) or math.isnan(self.tick.value):
            return "not measured"
        if not self.measurable:
            return f"not measurable now: noise {self.noise:.0f} ns"
        if abs(self.tick.value) <= self.noise:
            return f"< {_upwards(self.noise)} ns of {self.whole:.0f} ns"
        return f"{self.tick.value:+.0f} ns of {self.whole:.0f} ns"

    def change(self) -> str:
        """What its absence changes, in words."""
        if self.fault:
            return f"cannot be {'left out alone' if self.on else 'added'}: {self.fault}"
        worst = self.worst
        if worst is not None:
            said = worst.text()
        elif not self.changes:
            said = "" if self.note else "nothing moves with it or without it: there is no measure to compare"
        elif any(one.size > 0.0 for one in self.changes):
            said = "nothing that can be told: the motion is irregular and differs as much from itself"
        else:
            said = "nothing"
        said = "; ".join(filter(None, (said, self.note)))
        if self.closed is None:
            return "; ".join(filter(None, (self.switch and f"{self.switch}, measured closed", said)))
        return f"{self.switch}; measured closed: {self.closed.cost()}, {self.closed.change()}"

    def to_json(self) -> dict[str, Any]:
        """As plain values; what is not known is None."""
        tick = {name: _known(value) for name, value in vars(self.tick).items()}
        return {
            **vars(self),
            "tick": tick,
            "noise": _known(self.noise),
            "whole": _known(self.whole),
            "measurable": self.measurable,
            "changes": [one.to_json() for one in self.changes],
            "errors": {name: _known(size) for name, size in self.errors.items()},
            "closed": None if self.closed is None else self.closed.to_json(),
        }


def _upwards(noise: float) -> str:
    """A bound, rounded up to two digits."""
    digits = 1 - math.floor(math.log10(noise)) if noise > 0.0 else 0
    return f"{math.ceil(noise * 10.0**digits) / 10.0**digits:g}"


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def effects(scene: Scene, rounds: int = ROUNDS, report: Callable[[int, int], object] | None = None) -> list[Paired]:
    """Every effect that `scene` names and that its plant can do without."""
    values = held(scene, scene.assemble())
    base = bare(scene)
    names, about = dropped(base), declared(scene.parameters)
    others: dict[str, Scene] = {}
    found: dict[str, Paired] = {}
    for name, keys in names.items():
        if about[name].random:
            found[name] = Paired(name, fault=NO_CHANCE)
            continue
        try:
            others[name] = without(base, keys)
        except RigError as error:
            found[name] = Paired(name, fault=" ".join(str(error).split()))
    if others:
        found |= {one.name: one for one in compared(base, others, values, rounds, report)}
    for key, who in opened(scene).items():
        name = key.partition(".")[0]
        if name not in others:
            continue
        found[name] = replace(found[name], switch=f"starts open, {who}")
        if values.get(key, 0.0) < SWITCHED and not found[name].fault:
            [closed] = compared(base, {name: others[name]}, {**values, key: 1.0}, rounds)
            found[name] = replace(found[name], closed=closed)
    return [found[name] for name in names]


def bare(scene: Scene) -> Scene:
    """The scene without controllers and protocol."""
    return replace(scene, controllers={}, protocol=())


def compared(
    base: Scene,
    others: Mapping[str, Scene],
    values: Mapping[str, float],
    rounds: int = ROUNDS,
    report: Callable[[int, int], object] | None = None,
) -> Iterator[Paired]:
    """`base` beside each of `others`, by name: what base has more costs, and what its absence changes.

    `values`: of the actuators, where they have them.
    """
    say = report or (lambda done, total: None)
    try:
        whole = problem(base, values)
        contenders = {"": Contender(whole, of(whole.scene, whole.system), whole.later(of(whole.scene, whole.system)))}
    except NumericsError as error:
        yield from (Paired(name, note=f"the plant with it stops: {error.what}") for name in others)
        return
    told: dict[str, Paired] = {}
    for name, scene in others.items():
        try:
            one = problem(scene, values)
            changes, note = changed(whole, one)
            told[name] = Paired(name, whole.system.n - one.system.n, changes=changes, note=note)
            setting = of(one.scene, one.system)
            contenders[name] = Contender(one, setting, one.later(setting))
        except NumericsError as error:
            told[name] = replace(told.get(name, Paired(name)), note=f"without it the plant stops: {error.what}")
        except RigError as error:
            told[name] = Paired(name, fault=str(error).partition("\n")[0])
    ticks = timed(contenders, rounds, say)
    for name, one_of in told.items():
        yield replace(one_of, **cost_of(ticks, name)) if name in ticks else one_of


_AGAIN = "\0again"  # no effect has this name


def timed(
    contenders: Mapping[str, Contender], rounds: int, say: Callable[[int, int], object]
) -> dict[str, list[float]]:
    """Time [ns] of a step of each contender, by round; of the first, named "", a second time as `_AGAIN`."""
    turns = {**contenders, _AGAIN: contenders[""]}
    ticks: dict[str, list[float]] = {name: [] for name in turns}
    with pace.no_garbage():
        for turn in range(_BATCHES * rounds):
            for name in itertools.chain(turns) if turn % 2 else reversed(turns):
                ticks[name].append(turns[name].run() / turns[name].ticks * 1e9)
            if turn < rounds:
                say(turn + 1, rounds)
            if (turn + 1) % rounds == 0 and all(_fine(**cost_of(ticks, name)) for name in contenders if name):
                break
    return ticks


def _fine(tick: Spread, noise: float, whole: float) -> bool:
    return noise <= _FINE * whole


def cost_of(ticks: Mapping[str, list[float]], name: str) -> dict[str, Any]:
    """`tick`, `noise` and `whole` of an effect; the noise is that of the plant beside itself, or of the difference."""
    mine = np.array(ticks[""])

    def difference(other: str) -> Spread:
        pairs = np.column_stack([mine, ticks[other]])
        return spread(pairs, lambda both: float(both[0] - both[1]))

    tick, none = difference(name), difference(_AGAIN)
    noise = max(abs(none.low), abs(none.high), tick.high - tick.value, tick.value - tick.low)
    return {"tick": tick, "noise": noise, "whole": spread(mine, float).value}
