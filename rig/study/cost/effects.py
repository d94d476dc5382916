"""What each effect of a scene costs, and what error its absence makes: paired runs of the plant with and without it.

Controllers and protocol are left out of both, actuators are held where the protocol holds them longest. All plants take
turns, round after round; the cost is the difference of what rounds come to (rig.study.cost.timing). Errors are those of
rig.study.cost.measures, of the plant without the effect against the plant with it. Where one of them repeats and
the other does not, both are compared as motions that do not repeat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.bench import pace
from rig.errors import RigError
from rig.scenes.scene import Scene
from rig.scenes.variants import dropped, without
from rig.study.cost.measures import errors, observe
from rig.study.cost.problem import Problem, held, problem
from rig.study.cost.settings import of
from rig.study.cost.timing import Contender, Spread, spread

ROUNDS = 9
UNKNOWN = Spread(math.nan, math.nan, math.nan)
_LEAST = 2000  # sample steps in one turn


@dataclass(frozen=True)
class Paired:
    """One effect. `states` it adds, ns it adds to a sample step, errors by measure if it is dropped.

    `whole` [ns]: a step of the plant with every effect. `fault`: why there is no plant without it.
    """

    name: str
    states: int = 0
    tick: Spread = UNKNOWN
    whole: float = math.nan
    errors: Mapping[str, float] | None = None
    fault: str = ""

    @property
    def worst(self) -> tuple[str, float]:
        """The measure with the largest error, and this error."""
        found = self.errors or {"": math.nan}
        name = max(found, key=lambda one: found[one])
        return name, found[name]

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {**vars(self), "tick": vars(self.tick), "errors": dict(self.errors or {})}


def effects(scene: Scene, rounds: int = ROUNDS, report: Callable[[int, int], object] | None = None) -> list[Paired]:
    """Every effect that `scene` names and that its plant can do without."""
    values = held(scene, scene.assemble())
    base = bare(scene)
    names = dropped(base)
    others: dict[str, Scene] = {}
    found: dict[str, Paired] = {}
    for name, keys in names.items():
        try:
            others[name] = without(base, keys)
        except RigError as error:
            found[name] = Paired(name, fault=" ".join(str(error).split()))
    if others:
        found |= {one.name: one for one in compared(base, others, values, rounds, report)}
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
    whole = problem(base, values)
    contenders = {"": _contender(whole)}
    told: dict[str, Paired] = {}
    for name, scene in others.items():
        try:
            one = problem(scene, values)
            told[name] = Paired(name, whole.system.n - one.system.n, errors=apart(whole, one))
            contenders[name] = _contender(one)
        except RigError as error:
            told[name] = Paired(name, fault=str(error).partition("\n")[0])
    ticks: dict[str, list[float]] = {name: [] for name in contenders}
    with pace.no_garbage():
        for turn in range(rounds):
            for name, contender in contenders.items():
                ticks[name].append(contender.run() / contender.ticks * 1e9)
            say(turn + 1, rounds)
    mine = np.array(ticks[""])
    for name, one_of in told.items():
        if one_of.fault:
            yield one_of
        else:
            pairs = np.column_stack([mine, ticks[name]])
            whole_tick = spread(mine, float).value
            yield replace(one_of, tick=spread(pairs, lambda both: float(both[0] - both[1])), whole=whole_tick)


def apart(whole: Problem, less: Problem) -> dict[str, float]:
    """Errors of the motion of `less` against that of `whole`, in the measures that both have."""
    if not (whole.kind == less.kind == "cycle"):
        length = (min if whole.leaves or less.leaves else max)(whole.length, less.length)
        window = max(min(length, whole.window), min(length, less.window), length // 3)
        whole, less = (replace(p, kind="vibration", length=length, window=window) for p in (whole, less))
    truth, seen = (observe(p, of(p.scene, p.system)) for p in (whole, less))
    found = errors(whole, seen, truth)
    found.pop("event times", None)  # two motions that differ: their phases say nothing
    for name in found.keys() - seen.values.keys():
        found[name] = 1.0  # what moves in one of them and rests in the other, or is not there
    return found


def _contender(one: Problem) -> Contender:
    setting = of(one.scene, one.system)
    orbit = one.orbit(setting)
    while orbit.motion.tick < one.length - one.window:
        orbit.block(one.length - one.window - orbit.motion.tick)
    ticks = one.window if one.leaves else max(one.window, _LEAST)
    return Contender(one, setting, orbit.motion.x.copy(), ticks)
