"""Reference solutions of a rig: each method is compared with another one at its finest setting.

    exact            compared with rk4, whose two finest steps are extrapolated to zero (Richardson, order 4)
    dopri5           the same; with rosenbrock at 1e-12 if no step of rk4 is stable, as with stiff friction laws
    all others       compared with exact, or with dopri5 at 1e-12 if the rig is not linear

Each reference is also compared with itself at twice the step. The difference of the two references is the smallest
error that can be resolved. Both are stored in the folder of the scene, named by a hash of scene, sources, method and
its step or tolerance, and used again.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rig.analysis.cycles.motion_measures import TIGHTEST, Problem, Seen, Setting, errors, ladder, numbered, observe
from rig.machine.files import DATA, contents, write_file
from rig.motion.motion import SEGMENTS

WALL = 4.0
"""Longest compute time of a run of a reference [s]."""
_TIGHT = 1e-11  # tolerance of the run with which a reference at TIGHTEST is compared
_UNSURE = 1e-3  # a reference that differs so much from itself at twice the step is refined
_FURTHER = 2  # most refinements,
_FINER = 2.5  # and the factor of each
_FINEST = 5e-4  # |lambda| h of the finest step
_ROOM = SEGMENTS // 4  # steps in a tick; half of them in the run for comparison


@dataclass(frozen=True)
class Reference:
    """A reference run. `apart`: by measure, its difference from itself at half the resolution (Richardson)."""

    setting: Setting
    seen: Seen
    apart: dict[str, float]
    hash: str

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {"setting": vars(self.setting), "seen": self.seen.to_json(), "apart": self.apart, "hash": self.hash}

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Reference:
        """Return the reference of `to_json`."""
        return cls(Setting(**raw["setting"]), Seen.from_json(raw["seen"]), raw["apart"], raw["hash"])


@dataclass(frozen=True)
class References:
    """The two references of a problem: `best` by the rig's own best method, `other` by rk4, or by rosenbrock if rk4
    has no stable step. `floor`: their difference.
    """

    best: Reference
    other: Reference
    floor: dict[str, float]

    def of(self, method: str) -> Reference:
        """Return the reference for a method."""
        return self.other if method == self.best.setting.method else self.best


def references(problem: Problem, rate: float, best: str, folder: Path | None) -> References:
    """Return both references, computed or read. `rate` [1/s]: of the fastest state; `best`: "exact" or "dopri5"."""
    if best == "exact":
        judged = _kept(problem, folder, (Setting(best),), 0)
    else:
        judged = _kept(problem, folder, (Setting(best, _TIGHT), Setting(best, TIGHTEST)), 0)
    steps = ladder("rk4", problem.scene, rate)
    if steps:
        other = _by_rk4(problem, folder, _affordable(problem, steps[-1].step_ns, rate))
    else:
        other = _kept(problem, folder, (Setting("rosenbrock", _TIGHT), Setting("rosenbrock", TIGHTEST)), 0)
    if judged.seen.fault or other.seen.fault:
        floor = {"": math.inf}
    else:
        floor = errors(problem, judged.seen, other.seen)
    return References(judged, other, floor)


def _by_rk4(problem: Problem, folder: Path | None, fine: int) -> Reference:
    """Rk4 at the step `fine` [ns], or at finer ones until it agrees with itself."""
    other = _halved(problem, folder, fine)
    for _ in range(_FURTHER):
        room = _ROOM * fine / problem.scene.step_ns
        if max(other.apart.values(), default=0.0) <= _UNSURE or room < _FINER:
            break
        fine = _finer(problem, fine, _FINER)
        other = _halved(problem, folder, fine)
    return other


def _halved(problem: Problem, folder: Path | None, step_ns: int) -> Reference:
    """Rk4 at a step and at half of it."""
    runs = (Setting("rk4", step_ns=step_ns), Setting("rk4", step_ns=_finer(problem, step_ns, 2)))
    return _kept(problem, folder, runs, 4)


def _affordable(problem: Problem, step_ns: int, rate: float) -> int:
    """The finest rk4 step with which a run takes at most `WALL` and that fits into a tick."""
    begin = time.perf_counter()
    observe(problem, Setting("rk4", step_ns=step_ns), framed=False)
    spent = max(time.perf_counter() - begin, 1e-3)
    wanted = rate * step_ns * 1e-9 / _FINEST
    affordable = 0.5 * WALL / spent
    room = _ROOM * step_ns / problem.scene.step_ns
    return _finer(problem, step_ns, max(min(wanted, affordable, room), 1.0))


def _finer(problem: Problem, step_ns: int, factor: float) -> int:
    """A divisor of the sample step that is `factor` finer than `step_ns`, or slightly coarser than that."""
    whole = problem.scene.step_ns
    if step_ns <= 1:
        return 1
    return min(h for h in range(1, step_ns + 1) if whole % h == 0 and h * factor >= step_ns)


def _kept(problem: Problem, folder: Path | None, runs: tuple[Setting, ...], order: int) -> Reference:
    """The last of `runs`, with its difference from the one before; extrapolated if the method has an order."""
    last = runs[-1]
    known = f"{problem.digest} {problem.kind} {problem.length} {last}"
    name = hashlib.sha256(known.encode()).hexdigest()[:16]
    path = None if folder is None else folder / f"reference-{last.method}-{name}.json"
    if path is not None and path.exists():
        return Reference.from_json(json.loads(contents(path, DATA)))
    seen = [observe(problem, setting, framed=False) for setting in runs]
    apart = errors(problem, seen[0], seen[-1])
    if order and not seen[-1].fault and not seen[0].fault:
        seen[-1] = extrapolated(seen[0], seen[-1], (runs[0].step_ns / last.step_ns) ** order)
    reference = Reference(last, seen[-1], apart, name)
    if path is not None:
        write_file(path, json.dumps(reference.to_json(), indent=1).encode())
    return reference


def extrapolated(coarse: Seen, fine: Seen, ratio: float) -> Seen:
    """Extrapolate two runs to step zero; the error of the coarse one is `ratio` times that of the fine one."""

    def zero(a: float, b: float) -> float:
        return b + (b - a) / (ratio - 1.0)

    values = {}
    for name, value in fine.values.items():
        at_zero = zero(coarse.values.get(name, math.nan), value)
        values[name] = at_zero if math.isfinite(at_zero) else value
    coarse_events = numbered(coarse.events)
    times = numbered(fine.events)
    if coarse_events.keys() == times.keys():
        times = {key: zero(coarse_events[key], time) for key, time in times.items()}
    events = tuple((time, what) for (what, _), time in times.items())
    return replace(fine, values=values, events=events)
