"""Cost of each effect of a scene, and the change without it: paired runs of the plant with and without the effect.

Controllers and protocol are left out of both, and actuators stay where the protocol holds them longest. An effect with
a switch that is open there (a shunt, dither) is measured closed as well.

Cost: all plants alternate, round by round, and the plant with every effect runs twice in each round. The cost of an
effect is the difference of the compute times (rig.qualify.cost.timing). The noise floor is the difference of the plant
from itself, or the 95 % interval of the cost if that is wider. Rounds are repeated while the noise floor is too coarse.

Change: each measure (rig.analysis.cycles.motion_measures) with the effect and without it, and their difference as a
share of the larger of both. Where one plant repeats and the other does not, both are compared as motions that do not
repeat. Such a motion may be irregular: then it is run twice, from starts that differ by rounding, and smaller changes
than the difference of these two runs are not significant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.motion_measures import SLOW, Problem, Seen, held, observe, of, problem
from rig.analysis.pool import Progress
from rig.errors import NumericsError, RigError
from rig.machine.process import no_garbage
from rig.qualify.cost.timing import QUIET, UNKNOWN, Contender, Spread
from rig.scenes.scene import Scene
from rig.scenes.variants import SWITCHED, declared, dropped, opened, without

Array = NDArray[np.float64]
ROUNDS = 9
"""Default number of rounds in a batch: in each of them all plants alternate."""
NO_CHANCE = "is random: compared runs leave it out; run other seeds to see its influence"
KINDS = {"cycle": "a limit cycle", "vibration": "a vibration that does not repeat", "smooth": "no events"}
_UNITS = {
    "period": "s",
    "energy per cycle": "J",
    "frequency": "Hz",
    "growth rate": "1/s",
    "friction power": "W",
}
_NUDGE = 1e-9  # relative change of a start that reveals an irregular motion
_LEAST_NUDGE = 1e-12  # added to it: a start may be zero
_LEAST = 1e-9  # share of a measure that no run resolves
_SIGNIFICANT = 2.0  # a change counts above this multiple of the difference between two runs of an irregular motion
_DRAWS = 100  # of the rounds, for an interval
_BATCHES = 6  # most batches of rounds
_FINE = 0.02  # of a step: a noise floor below this is fine enough
_BUSY = 0.5  # of a step: above this noise floor nothing is measurable
_AGAIN = "\0again"  # no effect has this name


@dataclass(frozen=True)
class Change:
    """A measure of the plant with an effect and without it, in `unit`; None if the measure does not exist.

    `size`: their difference as a share of the larger of both (for stick shares the difference), 1 if only one plant has
    the measure, 0 below the resolution of the runs (their tolerance, 1e-9 without one). `floor`: the same for two runs
    of the plant with the effect whose starts differ by rounding.
    """

    measure: str
    unit: str
    whole: float | None
    less: float | None
    size: float
    floor: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether the change is significant: neither zero nor the irregularity of the motion itself."""
        return self.size > _SIGNIFICANT * self.floor

    def text(self) -> str:
        """Return the report as text."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.whole is None or self.less is None:
            only = self.less if self.whole is None else self.whole
            return f"{self.measure} {only:.4g}{unit} only {'without' if self.whole is None else 'with'} it"
        size = f"{100.0 * self.size:.2g}" if self.size < 0.095 else f"{100.0 * self.size:.0f}"
        digits = next((d for d in range(4, 17) if f"{self.whole:.{d}g}" != f"{self.less:.{d}g}"), 4)
        whole, less = (f"{number:.{digits}g}{unit}" for number in (self.whole, self.less))
        return f"{self.measure} {whole}, without it {less} ({size} %)"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {**vars(self), "significant": self.significant}


def changed(whole: Problem, less: Problem) -> tuple[tuple[Change, ...], str]:
    """Compare the measures of `whole` and `less`; return changes, and notes on the two motions."""
    notes = [] if whole.kind == less.kind else [f"{KINDS[whole.kind]} with it, {KINDS[less.kind]} without it"]
    notes += [
        f"{which} it {variant.leaves}" for which, variant in (("with", whole), ("without", less)) if variant.leaves
    ]
    if not (whole.kind == less.kind == "cycle"):
        whole, less = _alike(whole, less)
    truth, seen = (observe(p, of(p.scene, p.system)) for p in (whole, less))
    for which, observed in (("with", truth), ("without", seen)):
        notes += [f"{which} it the plant stops: {observed.fault}"] if observed.fault else []
    if truth.fault or seen.fault:
        return (), "; ".join(notes)
    floors = irregular(whole, truth) if whole.kind == "vibration" else {}
    resolved = max(_LEAST, *(of(p.scene, p.system).tolerance for p in (whole, less)))
    gone = whole.assembly.outputs.keys() - less.assembly.outputs.keys()
    changes = []
    for name in dict.fromkeys((*truth.values, *seen.values)):
        output = name.partition(" ")[2]
        if output not in gone:
            unit = _UNITS[name] if name in _UNITS else getattr(whole.assembly.outputs.get(output), "unit", "1")
            size = _apart(name, truth, seen)
            change = Change(
                measure=name,
                unit=unit,
                whole=truth.values.get(name),
                less=seen.values.get(name),
                size=size if size > resolved else 0.0,
                floor=floors.get(name, 0.0),
            )
            changes.append(change)
    return tuple(changes), "; ".join(notes)


def _alike(whole: Problem, less: Problem) -> tuple[Problem, Problem]:
    """Both treated as motions that do not repeat, over the same time."""
    frame = whole.scene.frame_ns // whole.scene.step_ns
    length = (min if whole.leaves or less.leaves else max)(whole.length, less.length)
    window = max(min(length, whole.window), min(length, less.window), length // 3) // frame * frame
    return tuple(replace(p, kind="vibration", length=length, window=window) for p in (whole, less))  # type: ignore[return-value]


def _apart(name: str, seen: Seen, other: Seen) -> float:
    """Difference of a measure between two runs (see `Change`)."""
    a = seen.values.get(name)
    b = other.values.get(name)
    if a is None or b is None:
        return 1.0
    larger = max(abs(a), abs(b))
    if name.startswith("stick share"):
        larger = 1.0
    if name == "growth rate":
        larger = max(larger, SLOW * 2.0 * math.pi * seen.values.get("frequency", 0.0))
    return abs(a - b) / larger if larger > 0.0 else 0.0


def irregular(problem: Problem, seen: Seen) -> dict[str, float]:
    """By measure, the difference between a run and one whose start differs by rounding: large if the motion is
    chaotic.
    """
    structure = 2 * len(problem.system.coordinates)
    start = problem.system.start.copy()
    start[:structure] += _NUDGE * start[:structure] + _LEAST_NUDGE
    other = observe(replace(problem, system=replace(problem.system, start=start)), of(problem.scene, problem.system))
    return {name: _apart(name, seen, other) for name in seen.values}


@dataclass(frozen=True)
class Paired:
    """The measurement of one effect: `states` it adds, `tick` [ns] it adds to a sample step, `changes` if it is left
    out.

    `whole` [ns]: a step of the plant with every effect. `noise` [ns]: smaller costs are not measurable now. `note`:
    remarks on the two motions. `fault`: why there is no plant without it. `switch`: who closes an effect that starts
    open; `closed`: the same effect measured closed, if it was measured open. `on`: the scene has the effect and the
    other plant is without it; else the other plant has it added. `why`: it is on or absent.
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
    why: str = "the scene names it"

    @property
    def errors(self) -> dict[str, float]:
        """The size of the change of each measure."""
        return {change.measure: change.size for change in self.changes}

    @property
    def worst(self) -> Change | None:
        """The largest significant change; None if there is none."""
        significant = [change for change in self.changes if change.significant]
        return max(significant, key=lambda change: change.size, default=None)

    @property
    def timed(self) -> bool:
        """Whether its cost was measured."""
        return not math.isnan(self.tick.value)

    @property
    def measurable(self) -> bool:
        """Whether a cost can be separated from the noise of the machine at all."""
        return self.noise <= _BUSY * self.whole

    @property
    def shown_cost(self) -> Spread:
        """The cost in a figure: zero if it is not measurable."""
        return self.tick if self.measurable else Spread(0.0, 0.0, 0.0)

    def cost(self) -> str:
        """Return the cost in words."""
        if not self.timed:
            return "not measured"
        if not self.measurable:
            return f"not measurable now: noise {self.noise:.0f} ns"
        if abs(self.tick.value) <= self.noise:
            return f"< {_upwards(self.noise)} ns of {self.whole:.0f} ns"
        return f"{self.tick.value:+.0f} ns of {self.whole:.0f} ns"

    def change(self) -> str:
        """Return the change without the effect in words."""
        if self.fault:
            return f"cannot be {'left out alone' if self.on else 'added'}: {self.fault}"
        worst = self.worst
        if worst is not None:
            text = worst.text()
        elif not self.changes:
            text = "" if self.note else "nothing moves with or without it, so that nothing can be compared"
        elif any(change.size > 0.0 for change in self.changes):
            text = "no significant change: the motion is irregular, and two runs of it differ as much"
        else:
            text = "nothing"
        text = "; ".join(filter(None, (text, self.note)))
        if self.closed is None:
            return "; ".join(filter(None, (self.switch and f"{self.switch}, measured closed", text)))
        return f"{self.switch}; measured closed: {self.closed.cost()}, {self.closed.change()}"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; unknown values are None."""
        tick = {name: _known(value) for name, value in vars(self.tick).items()}
        return {
            **vars(self),
            "tick": tick,
            "noise": _known(self.noise),
            "whole": _known(self.whole),
            "measurable": self.measurable,
            "changes": [change.to_json() for change in self.changes],
            "errors": {name: _known(size) for name, size in self.errors.items()},
            "closed": None if self.closed is None else self.closed.to_json(),
        }


def _upwards(noise: float) -> str:
    """A bound, rounded up to two digits."""
    digits = 1 - math.floor(math.log10(noise)) if noise > 0.0 else 0
    return f"{math.ceil(noise * 10.0**digits) / 10.0**digits:g}"


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def effects(scene: Scene, rounds: int = ROUNDS, report: Progress | None = None) -> list[Paired]:
    """Measure every effect that `scene` names and that its plant can do without."""
    values = held(scene, scene.assemble())
    base = bare(scene)
    names = dropped(base)
    about = declared(scene.parameters)
    others: dict[str, Scene] = {}
    by_effect: dict[str, Paired] = {}
    for name, keys in names.items():
        if about[name].random:
            by_effect[name] = Paired(name, fault=NO_CHANCE)
            continue
        try:
            others[name] = without(base, keys)
        except RigError as error:
            by_effect[name] = Paired(name, fault=" ".join(str(error).split()))
    if others:
        by_effect |= {paired.name: paired for paired in compared(base, others, values, rounds, report)}
    for key, who in opened(scene).items():
        name = key.partition(".")[0]
        if name not in others:
            continue
        by_effect[name] = replace(by_effect[name], switch=f"starts open, {who}")
        if values.get(key, 0.0) < SWITCHED and not by_effect[name].fault:
            [closed] = compared(base, {name: others[name]}, {**values, key: 1.0}, rounds)
            by_effect[name] = replace(by_effect[name], closed=closed)
    return [by_effect[name] for name in names]


def bare(scene: Scene) -> Scene:
    """Return the scene without controllers and protocol."""
    return replace(scene, controllers={}, protocol=())


def compared(
    base: Scene,
    others: Mapping[str, Scene],
    values: Mapping[str, float],
    rounds: int = ROUNDS,
    report: Progress | None = None,
) -> Iterator[Paired]:
    """Compare `base` with each of `others`, by name: the additional cost of base, and the change without it.

    `values`: of the actuators, if the plants have them.
    """
    try:
        whole = problem(base, values)
        contenders = {"": _contender(whole)}
    except NumericsError as error:
        yield from (Paired(name, note=f"the plant with it stops: {error.what}") for name in others)
        return
    pairs: dict[str, Paired] = {}
    for name, scene in others.items():
        try:
            lesser = problem(scene, values)
            changes, note = changed(whole, lesser)
            pairs[name] = Paired(name, whole.system.n - lesser.system.n, changes=changes, note=note)
            contenders[name] = _contender(lesser)
        except NumericsError as error:
            pairs[name] = replace(pairs.get(name, Paired(name)), note=f"without it the plant stops: {error.what}")
        except RigError as error:
            pairs[name] = Paired(name, fault=str(error).partition("\n")[0])
    ticks = timed(contenders, rounds, report)
    for name, paired in pairs.items():
        yield replace(paired, **cost_of(ticks, name)) if name in ticks else paired


def _contender(asked: Problem) -> Contender:
    """The plant of a problem with the setting of its scene, where the window begins."""
    setting = of(asked.scene, asked.system)
    return Contender(asked, setting, asked.later(setting))


def timed(contenders: Mapping[str, Contender], rounds: int, report: Progress | None) -> dict[str, list[float]]:
    """Time [ns] of a step of each contender, by round; the first, named "", is timed a second time as `_AGAIN`."""
    turns = {**contenders, _AGAIN: contenders[""]}
    ticks: dict[str, list[float]] = {name: [] for name in turns}
    with no_garbage():
        for turn in range(_BATCHES * rounds):
            for name in list(turns)[:: 1 if turn % 2 else -1]:
                ticks[name].append(turns[name].run() / turns[name].ticks * 1e9)
            if report is not None and turn < rounds:
                report(turn + 1, rounds)
            if (turn + 1) % rounds == 0:
                costs = [cost_of(ticks, name) for name in contenders if name]
                if all(cost["noise"] <= _FINE * cost["whole"] for cost in costs):
                    break
    return ticks


def cost_of(ticks: Mapping[str, list[float]], name: str) -> dict[str, Any]:
    """Return `tick`, `noise` and `whole` of an effect; the noise is that of the plant against itself, or of the
    difference.
    """
    tick, none = (_difference(np.column_stack([ticks[""], ticks[other]])) for other in (name, _AGAIN))
    noise = max(abs(none.low), abs(none.high), tick.high - tick.value, tick.value - tick.low)
    return {"tick": tick, "noise": noise, "whole": float(_quiet(np.array(ticks[""])))}


def _difference(rounds: Array) -> Spread:
    """The difference of two times, [round, 2], with its interval by resampling the rounds.

    Quantiles of few resampled rounds are biased, so the interval is extended to the difference itself if necessary.
    """

    def difference(times: Array) -> float:
        return float(-np.diff(_quiet(times))[0])

    value = difference(rounds)
    draws = np.random.default_rng(0).integers(len(rounds), size=(_DRAWS, len(rounds)))
    resampled = [difference(rounds[draw]) for draw in draws]
    low, high = np.quantile(resampled, (0.025, 0.975)).tolist()
    return Spread(value, min(low, value), max(high, value))


def _quiet(rounds: Array) -> Array:
    """The lower quartile over the rounds: other work on the machine makes rounds longer, never shorter."""
    return np.asarray(np.quantile(rounds, QUIET, axis=0, method="lower"))
