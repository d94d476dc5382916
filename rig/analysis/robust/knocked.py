"""Rigs of a design that begin at steady sliding and are knocked, and the least knock from which they do not come back.

A case is a design with the nominal rig or with its worst one. If its growth is that of closed loops, its controllers
act and are designed for the scene with the values of the design: they are not told of the errors of the rig. If it is
that of the plant alone, controllers are left out. The unit of a knock is the impulse after which the linear motion
would just stop a contact or open it.

For the least knock whole runs, with controllers in the process of the run, are tried with knocks to both sides, from
small to large. A rig has come back once its distance from sliding is that of half of the smallest knock tried. Between
the last knock from which it comes back and the first from which it does not, the least knock is found by bisection.
Without controllers the unstable cycle that is followed from a Hopf point gives the same number exactly
(rig.analysis.branches.threshold).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from rig import design
from rig.analysis.branches import HOPF, Threshold, branches
from rig.analysis.branches import job as follow
from rig.analysis.cycles.cycle import Rest
from rig.analysis.linear.modes import at_rest
from rig.analysis.pool import Arrays, packed
from rig.analysis.robust.envelope import Mode, of_rates
from rig.analysis.robust.growth import Growth
from rig.analysis.robust.search import SCENE, Findings
from rig.bench.run.simulate import begun, carry_on
from rig.controllers import restored
from rig.errors import NumericsError, RigError, SceneError
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.protocol import Hold, Knock
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, inputs, own_law, sliding_key, steady

Array = NDArray[np.float64]
_STEPS = 2000  # in which the largest amplitude of a linear motion after a knock is looked for
SIZES = tuple(2.0**k for k in range(-4, 7))
"""Knocks that are tried first, in units of the one at which a contact stops or opens."""
EXACT = 1e-3
"""Of the least knock: where the bisection ends."""
VIBRATES = "it does not come to rest in sliding"
"""Why a rig that stays in its run and within its limits is not back."""
LASTING = 30.0
"""Time constants of the decay of small motions, after which a rig that is not back does not come back."""
_LONGEST = 2e5  # periods: a decay that takes longer is not waited for
_BACK = 0.5  # of the distance of the smallest knock
_PIECES = 400  # in a run, after each of which its distance is looked at,
_STAYS = 12  # and in how many of them in a row it is near: within a vibration the distance varies
_AWAY = 40  # steps of a parameter, away from the value of the rig, in which sliding may lose its stability,
_STEP = 0.05  # of the value each
_BEYOND = 1.1  # of the way to where it does: the range of a branch
_SAME = 0.02  # of a knock
_SIDES = (1.0, -1.0)


@dataclass(frozen=True)
class Case:
    """A `design` with its `rig`: nominal or worst. `scene`: begins at steady sliding, and has no protocol.

    `values`: of design and rig (SI) by key. `mode`: the one whose growth counts.
    """

    design: str
    rig: str
    scene: Scene
    values: dict[str, float]
    mode: Mode

    @property
    def name(self) -> str:
        """Design and rig in words."""
        return f"{self.design}, {self.rig} rig"

    @cached_property
    def rest(self) -> tuple[Assembly, Steady]:
        """The plant and its steady sliding."""
        return at_rest(self.scene)

    @cached_property
    def running(self) -> System:
        """The plant as a run has it."""
        return self.scene.assemble().system()

    @cached_property
    def unit(self) -> float:
        """The impulse [N s] after which a linear motion just stops a contact or opens it; 0: no place for a knock."""
        return _unit(self.rest[1])

    @cached_property
    def offset(self) -> float:
        """How far its start is from sliding, as a share of the way at which a contact stops or opens."""
        at = self.rest[1]
        away = at.system.start - at.x
        away[2 * len(at.system.coordinates) :] = 0.0
        return float(np.abs(_contact_rows(at) @ away).max(initial=0.0))

    @property
    def lasting(self) -> float:
        """The length of a whole run [s]; NaN for a decay that takes too long."""
        seconds = LASTING / abs(self.mode.rate.real)
        return seconds if seconds * self.mode.hertz < _LONGEST else math.nan

    def knocked(self, size: float, seconds: float) -> Scene:
        """The scene with a knock of `size` (in its units) at the begin of a run of `seconds`."""
        knock = Knock(step="knock", impulse=size * self.unit)
        return replace(self.scene, protocol=(knock, Hold(step="hold", time=seconds)))


def cases(growth: Growth, found: Findings) -> Iterator[Case]:
    """Yield the robust design and the nominal optimum with the nominal and the worst rig, as far as these slide."""
    box = growth.box
    for entry in (entry for entry in found.entries if entry.name != SCENE):
        own = box.design(entry.x)
        for rig, u in (("nominal", box.centre), ("worst", entry.worst.u[0])):
            values = box.rig(own, u)
            rate, hertz = growth.value(entry.x, u)
            if math.isfinite(rate):
                scene = growth.rig(own, values) if growth.closed else growth.designed(own).with_values(values)
                mode = of_rates(growth.matrix(entry.x, u).spectrum, rate, hertz)
                name = entry.name if box.free else SCENE
                yield Case(name, rig, at_sliding(_alone(scene, growth.closed)), {**own, **values}, mode)


def _alone(scene: Scene, closed: bool) -> Scene:
    """The scene without its protocol and the faults of its parts, with loops that are closed from the begin."""
    controllers: dict[str, Any] = {}
    for name, section in scene.controllers.items() if closed else ():
        at_once = "enable_at" in type(section).model_fields
        controllers[name] = section.model_copy(update={"enable_at": 0}) if at_once else section
    believed = scene.believed if closed else {}
    clock = scene.clock.model_copy(update={"unstable": "run"})
    return replace(scene, controllers=controllers, believed=believed, clock=clock, protocol=(), faults={})


def at_sliding(scene: Scene) -> Scene:
    """Return the scene with the values `start.*` that begin a run nearest to steady sliding.

    Its controllers are still designed for the start that it had.
    """
    values = {key: value for key, (value, _) in scene.values().items()}
    own = {key: value for key, value in values.items() if key.startswith("start.") and isinstance(value, float)}
    at = at_rest(scene)[1]
    count = 2 * len(at.system.coordinates)
    begins = at.system.start[:count]
    columns: dict[str, Array] = {}
    for key, value in own.items():
        try:
            columns[key] = at_rest(scene.with_values({key: value + 1.0}))[1].system.start[:count] - begins
        except SceneError:  # a start that the scene does not take
            continue
    if not columns:
        return scene
    changes, *_ = np.linalg.lstsq(np.column_stack([*columns.values()]), at.x[:count] - begins, rcond=None)
    made = scene.with_values({key: own[key] + change for key, change in zip(columns, changes.tolist())})
    if not scene.controllers or scene.redesign:
        return made
    return replace(made, believed={**{key: own[key] for key in columns}, **scene.believed})


def _contact_rows(at: Steady) -> Array:
    """Rows over the states whose value is 1 or -1 where a contact stops or opens [row, state]."""
    system = at.system
    slope = inputs(system, at.modes, at.x, own_law(system, at.modes))[1]
    load = at.modes.load + at.modes.load_t @ slope
    slips = at.speed != 0.0
    pressed = at.load > 0.0
    return np.vstack([system.slip_rows[slips] / at.speed[slips, None], load[pressed] / at.load[pressed, None]])


def _struck(system: System) -> Array:
    """The change of the state [state] by a knock of 1 N s."""
    first = len(system.coordinates)
    x = np.zeros(system.n)
    x[first : 2 * first] = np.linalg.solve(system.mass, system.strike)
    return x


def _unit(at: Steady) -> float:
    """See `Case.unit`: the largest amplitude within a period of the slowest mode, before the plant grows by itself."""
    if not at.system.strike.any():
        return 0.0
    x = _struck(at.system)
    growth = float(at.eigenvalues()[0].real)
    slowest = at.time_scales()[1]
    step = expm(at.A * (min(slowest, 1.0 / growth if growth > 0.0 else math.inf) / _STEPS))
    rows = _contact_rows(at)
    largest = 0.0
    for _ in range(_STEPS):
        largest = max(largest, float(np.abs(rows @ x).max(initial=0.0)))
        x = step @ x
    return 1.0 / largest if largest else 0.0


class Least(NamedTuple):
    """The least knock: the rig comes back from `low`, not from `high` [N s]; NaN: from every one, or it is not known.

    `how` it was found, or why there is none.
    """

    low: float
    high: float
    how: str

    @property
    def size(self) -> float:
        """The knock [N s]; NaN without one."""
        return 0.5 * (self.low + self.high) if math.isfinite(self.high) else math.nan


class Ends(NamedTuple):
    """The largest size from which a rig comes back, the smallest from which it does not, and why."""

    low: float
    high: float
    why: str


class Knocks:
    """Computes ends of the least knocks of `cases`: a pool hands it the number of a case, a side and the ends between
    which it is halved; without them all `SIZES` are tried.
    """

    def __init__(self, cases: Sequence[Case]) -> None:
        self._cases = [replace(case) for case in cases]  # without what they have computed of themselves

    def __call__(self, unit: int, case: float, side: float, *ends: float) -> Arrays:
        """Return the ends, packed."""
        knocked = self._cases[int(case)]
        return packed(halved(knocked, side, *ends) if ends else tried(knocked, side))


def tried(case: Case, side: float) -> Ends:
    """Try knocks of all `SIZES` to one side."""
    low = 0.0
    for size in SIZES:
        why = away(case, side * size)
        if why:
            return Ends(low, size, why)
        low = size
    return Ends(low, math.inf, "")


def halved(case: Case, side: float, low: float, high: float) -> Ends:
    """Halve the range of sizes from `low`, from which the rig comes back, to `high`."""
    why = ""
    while high - low > EXACT * high:
        middle = math.sqrt(low * high)
        answer = away(case, side * middle)
        if answer:
            high, why = middle, answer
        else:
            low = middle
    return Ends(low, high, why)


def away(case: Case, size: float) -> str:
    """Return why a rig does not come back to sliding after a knock of `size` (in its units), in a whole run; "" if it
    does.
    """
    scene = case.knocked(size, case.lasting)
    controllers = {name: restored(described) for name, described in design.described(scene).items()}
    experiment, working = begun(scene, controllers, round(case.lasting * 1e9))
    runner = experiment.runner
    system = runner.motion.system
    sliding = steady(system, sliding_key(system))
    rest = Rest(sliding, sliding.x + SIZES[0] * case.unit * _struck(system))
    piece = max(round(case.lasting / _PIECES * 1e9 / scene.frame_ns), 1)
    stays = 0
    try:
        while experiment.begin():
            carry_on(experiment, working, min(experiment.until(), runner.tick + piece))
            if experiment.aborted:
                return f"a limit of the scene ends the run ({experiment.aborted})"
            stays = stays + 1 if rest.share(runner.motion.x) <= _BACK else 0
            if stays >= _STAYS:
                return ""
    except NumericsError as fault:
        return f"the run diverges ({fault})"
    finally:
        for asked in working:
            asked.loop.end()
    return VIBRATES


Ask = Callable[[Sequence[tuple[float, ...]]], list[Ends]]
"""Computes units of `Knocks`."""


def least_knocks(
    growth: Growth, cases: Sequence[Case], ask: Ask, root: Path, watch: Callable[[str], object]
) -> list[Least]:
    """Return the least knock of each case. `root`: the folder of branches; `watch` gets what is done with them."""
    least = {i: without(case) for i, case in enumerate(cases)}
    ways = [(i, side) for i, known in least.items() if known is None for side in _SIDES]
    found = dict(zip(ways, ask(ways)))
    notes: dict[int, str] = {}
    rest: list[tuple[float, ...]] = []
    for i in [i for i, known in least.items() if known is None]:
        first = min((found[i, side] for side in _SIDES), key=_high)
        least[i], notes[i] = _of_tries(growth, cases[i], first, root, watch)
        if least[i] is None:
            rest += [(i, side, *found[i, side][:2]) for side in _SIDES if found[i, side].low < first.high]
    halves = list(zip(rest, ask(rest)))
    for i in [i for i, known in least.items() if known is None]:
        (_, side, *_), ends = min((way for way in halves if way[0][0] == i), key=lambda way: way[1].high)
        beyond = f"bisection of whole runs; beyond it {ends.why or found[i, side].why}"
        unit = side * cases[i].unit
        least[i] = Least(unit * ends.low, unit * ends.high, "; ".join(filter(None, (beyond, notes[i]))))
    return [known for known in least.values() if known is not None]


def _high(ends: Ends) -> float:
    return ends.high


def _of_tries(
    growth: Growth, case: Case, ends: Ends, root: Path, watch: Callable[[str], object]
) -> tuple[Least | None, str]:
    """The least knock, if knocks of all `SIZES` or an unstable cycle show it; and a note on the cycle."""
    if not math.isfinite(ends.high):
        return _none(f"none: it comes back from every knock up to {SIZES[-1] * case.unit:.4g} N s"), ""
    if not ends.low:
        return _none(f"not found: after {SIZES[0] * case.unit:.4g} N s, {case.lasting:.4g} s later, {ends.why}"), ""
    if case.scene.controllers or ends.why != VIBRATES:
        return None, ""
    size, how = by_branches(growth, case, root, watch)
    if ends.low * (1.0 - _SAME) <= abs(size) / case.unit <= ends.high * (1.0 + _SAME):
        return Least(size, size, how), how
    return None, how


def _none(how: str) -> Least:
    return Least(math.nan, math.nan, how)


def without(case: Case) -> Least | None:
    """Why a case has no least knock that could be searched; None if it may have one."""
    if not case.unit:
        return _none("not found: its plant states no place for a knock")
    if case.mode.rate.real >= 0.0:
        return Least(0.0, 0.0, "sliding is not stable, so that the rig leaves it without a knock")
    if math.isnan(case.lasting):
        return _none("not found: small motions decay too slowly to wait for")
    return None


def by_branches(growth: Growth, case: Case, root: Path, watch: Callable[[str], object]) -> tuple[float, str]:
    """Return the least knock [N s] from the unstable cycle of a plant without controllers; NaN, and why there is none.

    The cycle is followed from the nearest value of an uncertain one at which sliding loses its stability.
    """
    ends = {key: end for key in growth.box.keys for end in _loses(growth, case, key)}
    ways = [(abs(end / case.values[key] - 1.0), key, end) for key, end in ends.items()]
    if not ways:
        return math.nan, "no uncertain value leads to a loss of stability, from which a branch begins"
    _, key, end = min(ways)
    own = case.values[key]
    low, high = sorted((own - (_BEYOND - 1.0) * (end - own), own + _BEYOND * (end - own)))
    watch(f"{case.name}: follows the unstable cycle along {key}")
    try:
        followed = branches(follow(case.scene, f"{key}={low!r}:{high!r}", starts=(HOPF,)), root)
        knocks = [knock.size for knock in Threshold(followed, own).knocks() if not knock.back and knock.confirmed]
    except RigError as fault:
        return math.nan, f"no unstable cycle is known along {key}: {fault}"
    if not knocks:
        return math.nan, f"the unstable cycle along {key} has no knock that leads to it"
    return min(knocks, key=abs), f"unstable cycle along {key}"


def _loses(growth: Growth, case: Case, key: str) -> Iterator[float]:
    """Yield the value (SI) of a key nearest to that of a case at which sliding is not stable, if one is near."""
    steps = [side * k * _STEP for k in range(1, _AWAY + 1) for side in _SIDES]
    for value in (case.values[key] * (1.0 + step) for step in steps):
        spectrum = growth.matrix_of({}, {**case.values, key: value}).spectrum
        if spectrum.real.max(initial=0.0) > 0.0:
            yield value
            return
