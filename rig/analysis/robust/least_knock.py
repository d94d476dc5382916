"""The least knock from which a rig does not come back to sliding.

Whole runs, with controllers in the process of the run, are tried with knocks to both sides, from small to large. A rig
has come back once its distance from sliding is that of half of the smallest knock tried. Between the last knock from
which it comes back and the first from which it does not, the least knock is found by bisection. Without controllers the
unstable cycle that is followed from a Hopf point gives the same number exactly (rig.analysis.branches.threshold).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rig import design
from rig.analysis.branches import HOPF, Threshold, branches
from rig.analysis.branches import job as follow
from rig.analysis.cycles.cycle import Rest
from rig.analysis.pool import Arrays, packed
from rig.analysis.robust.growth import Growth, NoSliding
from rig.analysis.robust.knocked import Case
from rig.bench.run.simulate import begun, carry_on
from rig.controllers import restored
from rig.errors import NumericsError, RigError
from rig.stability.linearisation import sliding_key, steady

SIZES = tuple(2.0**k for k in range(-4, 7))
"""Knocks that are tried first, in units of the one at which a contact stops or opens."""
EXACT = 1e-3
"""Of the least knock: where the bisection ends."""
EXPECTED = 2 * len(SIZES) + 10
"""Whole runs of a case, about."""
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


class Whole:
    """Computes whole runs of `cases`: a pool hands it the number of a case and the size of a knock."""

    def __init__(self, cases: Sequence[Case]) -> None:
        self._cases = [replace(case) for case in cases]  # without what they have computed of themselves

    def __call__(self, unit: int, case: float, size: float) -> Arrays:
        """Return why the rig does not come back, packed; "" if it does."""
        return packed(away(self._cases[int(case)], size))


def lasting(case: Case) -> float:
    """Return the length of a whole run [s]; NaN for a decay that takes too long."""
    seconds = LASTING / abs(case.mode.rate.real)
    return seconds if seconds * case.mode.hertz < _LONGEST else math.nan


def away(case: Case, size: float) -> str:
    """Return why a rig does not come back to sliding after a knock of `size` (in its units), in a whole run; "" if it
    does.
    """
    seconds = lasting(case)
    scene = case.knocked(size, seconds)
    own = design.described(scene)
    controllers = {name: restored(described) for name, described in own.items()}
    experiment, working = begun(scene, controllers, round(seconds * 1e9))
    runner = experiment.runner
    system = runner.motion.system
    sliding = steady(system, sliding_key(system))
    first = len(system.coordinates)
    least = sliding.x.copy()
    least[first : 2 * first] += SIZES[0] * case.unit * np.linalg.solve(system.mass, system.strike)
    rest = Rest(sliding, least)
    piece = max(round(seconds / _PIECES * 1e9 / scene.frame_ns), 1)
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


Ends = tuple[float, float, str]
"""The largest size from which a rig comes back, the smallest from which it does not, and why."""
Search = Generator[float, str, Ends]
"""Asks for sizes of knocks, gets why the rig does not come back ("" if it does)."""


def tried(sign: float) -> Search:
    """Try knocks of all `SIZES` to one side."""
    low = 0.0
    for size in SIZES:
        why = yield sign * size
        if why:
            return low, size, why
        low = size
    return low, math.inf, ""


def halved(sign: float, low: float, high: float, why: str) -> Search:
    """Halve the range of sizes from `low`, from which the rig comes back, to `high`."""
    while high - low > EXACT * high:
        middle = math.sqrt(low * high)
        answer = yield sign * middle
        if answer:
            high, why = middle, answer
        else:
            low = middle
    return low, high, why


Ask = Callable[[Sequence[tuple[int, float]]], list[str]]
"""Carries out whole runs of cases (number, size of the knock), and returns why each does not come back."""


def searched(searches: Mapping[tuple[int, float], Search], ask: Ask) -> dict[tuple[int, float], Ends]:
    """Carry out searches, by case and side, beside each other."""
    found: dict[tuple[int, float], Ends] = {}
    waiting = {way: next(search) for way, search in searches.items()}
    while waiting:
        answers = ask([(case, size) for (case, _), size in waiting.items()])
        asked, waiting = list(waiting), {}
        for way, answer in zip(asked, answers):
            try:
                waiting[way] = searches[way].send(answer)
            except StopIteration as ended:
                found[way] = ended.value
    return found


def least_knocks(
    growth: Growth, cases: Sequence[Case], ask: Ask, root: Path, watch: Callable[[str], object]
) -> list[Least]:
    """Return the least knock of each case. `root`: the folder of branches; `watch` gets what is done with them."""
    known = {i: least for i, case in enumerate(cases) if (least := without(case)) is not None}
    ways = [(i, side) for i in range(len(cases)) if i not in known for side in _SIDES]
    found = searched({way: tried(way[1]) for way in ways}, ask)
    first: dict[int, Ends] = {}
    branch: dict[int, str] = {}
    for i, case in enumerate(cases):
        if i in known:
            continue
        first[i] = min((found[i, side] for side in _SIDES), key=_high)
        least = _of_tries(case, first[i])
        if least is None and not case.scene.controllers and first[i][2] == VIBRATES:
            size, branch[i] = by_branches(growth, case, root, watch)
            low, high, _ = first[i]
            if low * (1.0 - _SAME) <= abs(size) / case.unit <= high * (1.0 + _SAME):
                least = Least(size, size, branch[i])
        if least is not None:
            known[i] = least
    rest = [way for way in ways if way[0] not in known and found[way][0] < first[way[0]][1]]
    halves = searched({way: halved(way[1], *found[way]) for way in rest}, ask)
    for i, case in enumerate(cases):
        if i not in known:
            side = min((way[1] for way in rest if way[0] == i), key=lambda side: halves[i, side][1])
            low, high, why = halves[i, side]
            how = "; ".join(filter(None, (f"bisection of whole runs; beyond it {why}", branch.get(i, ""))))
            known[i] = Least(side * case.unit * low, side * case.unit * high, how)
    return [known[i] for i in range(len(cases))]


def _high(ends: Ends) -> float:
    return ends[1]


def _of_tries(case: Case, ends: Ends) -> Least | None:
    """What knocks of all `SIZES` show by themselves: that there is no least knock, or that it cannot be found."""
    low, high, why = ends
    if not math.isfinite(high):
        return _none(f"none: it comes back from every knock up to {SIZES[-1] * case.unit:.4g} N s")
    if not low:
        return _none(f"not found: after {SIZES[0] * case.unit:.4g} N s, {lasting(case):.4g} s later, {why}")
    return None


def _none(how: str) -> Least:
    return Least(math.nan, math.nan, how)


def without(case: Case) -> Least | None:
    """Why a case has no least knock that could be searched; None if it may have one."""
    if not case.unit:
        return _none("not found: its plant states no place for a knock")
    if case.mode.rate.real >= 0.0:
        return Least(0.0, 0.0, "sliding is not stable, so that the rig leaves it without a knock")
    if math.isnan(lasting(case)):
        return _none("not found: small motions decay too slowly to wait for")
    return None


def by_branches(growth: Growth, case: Case, root: Path, watch: Callable[[str], object]) -> tuple[float, str]:
    """Return the least knock [N s] from the unstable cycle of a plant without controllers; NaN, and why there is none.

    The cycle is followed from the nearest value of an uncertain one at which sliding loses its stability.
    """
    ways = []
    for value in growth.box.uncertain:
        end = _loses(growth, case, value.key)
        if end is not None:
            own = case.values[value.key]
            ways.append((abs(end / own - 1.0), value.key, own, end))
    if not ways:
        return math.nan, "no uncertain value leads to a loss of stability, from which a branch begins"
    _, key, own, end = min(ways)
    low, high = sorted((own - (_BEYOND - 1.0) * (end - own), own + _BEYOND * (end - own)))
    watch(f"{case.name}: follows the unstable cycle along {key}")
    try:
        followed = branches(follow(case.scene, f"{key}={low!r}:{high!r}", starts=(HOPF,)), root)
        knocks = [knock for knock in Threshold(followed, own).knocks() if not knock.back and knock.confirmed]
    except RigError as fault:
        return math.nan, f"no unstable cycle is known along {key}: {fault}"
    if not knocks:
        return math.nan, f"the unstable cycle along {key} has no knock that leads to it"
    return min((knock.size for knock in knocks), key=abs), f"unstable cycle along {key}"


def _loses(growth: Growth, case: Case, key: str) -> float | None:
    """The value (SI) of a key nearest to that of a case at which sliding is not stable; None: none is near."""
    own = case.values[key]
    for k in range(1, _AWAY + 1):
        for value in (own * (1.0 + k * _STEP), own * (1.0 - k * _STEP)):
            try:
                matrix = growth.matrix_of({}, {**case.values, key: value})
            except NoSliding:
                continue
            if max(matrix.spectrum.real) > 0.0:
                return value
    return None
