"""Measurement of the cost table of a scene, for `rig cost`; and the setting of a run, chosen from the table of this
machine, which is measured first if necessary.

Reference solutions: each method is compared with another one at its finest setting.

    exact            compared with rk4, whose two finest steps are extrapolated to zero (Richardson, order 4)
    dopri5           the same; with rosenbrock at 1e-12 if no step of rk4 is stable, as with stiff friction laws
    all others       compared with exact, or with dopri5 at 1e-12 if the rig is not linear

Each reference is also compared with itself at twice the step. The difference of the two references is the smallest
error that can be resolved. Both are stored in the folder of the scene, named by a hash of scene, sources, method and
its step or tolerance, and used again.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import statistics as statistics_of
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from rig.analysis.motion_measures import (
    TIGHTEST,
    Problem,
    Seen,
    Setting,
    digest,
    eligible,
    errors,
    ladder,
    numbered,
    observe,
    problem,
)
from rig.analysis.pool import Arrays, Progress, Work, carry_out, packed, temporary, unpacked
from rig.analysis.studies.runs import random_parts
from rig.bench.run.simulate import simulate
from rig.effects.noise import Noise
from rig.errors import NumericsError, UsageError
from rig.machine.files import DATA, contents, write_file
from rig.model import assembly
from rig.motion.motion import SEGMENTS
from rig.qualify.cost import timing
from rig.qualify.cost.table import WORST, Row, Table, orders, recommended, student
from rig.qualify.cost.timing import UNKNOWN, Contender, Cost
from rig.quantities import run_length_ns
from rig.record.provenance import provenance
from rig.record.statistics import FRACTION, first_opening, statistics
from rig.scenes.scene import Scene
from rig.stability.report import FILM_LIMIT, RK4_LIMIT, fastest_state

WALL = 4.0  # s, for one run of a reference
_UNSURE = 1e-3  # a reference that differs so much from itself at twice the step is refined
_FURTHER, _FINER = 2, 2.5  # most refinements, and the factor of each
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
    first = Setting(best, TIGHTEST if best == "dopri5" else 0.0)
    judged = _kept(problem, folder, (first,) if best == "exact" else (replace(first, tolerance=1e-11), first), 0)
    steps = ladder("rk4", problem.scene, rate)
    if steps:
        other = _by_rk4(problem, folder, _affordable(problem, steps[-1].step_ns, rate))
    else:
        other = _kept(problem, folder, (Setting("rosenbrock", 1e-11), Setting("rosenbrock", TIGHTEST)), 0)
    stops = judged.seen.fault or other.seen.fault
    return References(judged, other, {"": math.inf} if stops else errors(problem, judged.seen, other.seen))


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
    return _finer(problem, step_ns, max(min(wanted, 0.5 * WALL / spent, _ROOM * step_ns / problem.scene.step_ns), 1.0))


def _finer(problem: Problem, step_ns: int, factor: float) -> int:
    """A divisor of the sample step that is `factor` finer than `step_ns`, or slightly coarser than that."""
    whole = problem.scene.step_ns
    parts = [h for h in range(1, step_ns + 1) if whole % h == 0 and h * factor >= step_ns] if step_ns > 1 else [1]
    return min(parts)


def _kept(problem: Problem, folder: Path | None, runs: tuple[Setting, ...], order: int) -> Reference:
    """The last of `runs`, with its difference from the one before; extrapolated if the method has an order."""
    last = runs[-1]
    name = hashlib.sha256(f"{problem.digest} {problem.kind} {problem.length} {last}".encode()).hexdigest()[:16]
    path = None if folder is None else folder / f"reference-{last.method}-{name}.json"
    if path is not None and path.exists():
        return Reference.from_json(json.loads(contents(path, DATA)))
    seen = [observe(problem, setting, framed=False) for setting in runs]
    apart = errors(problem, seen[0], seen[-1])
    if order and not seen[-1].fault and not seen[0].fault:
        seen[-1] = extrapolated(seen[0], seen[-1], (runs[0].step_ns / last.step_ns) ** order)
    made = Reference(last, seen[-1], apart, name)
    if path is not None:
        write_file(path, json.dumps(made.to_json(), indent=1).encode())
    return made


def extrapolated(coarse: Seen, fine: Seen, ratio: float) -> Seen:
    """Extrapolate two runs to step zero; the error of the coarse one is `ratio` times that of the fine one."""

    def zero(a: float, b: float) -> float:
        return b + (b - a) / (ratio - 1.0)

    values = {name: zero(coarse.values.get(name, math.nan), v) for name, v in fine.values.items()}
    values = {name: v if math.isfinite(v) else fine.values[name] for name, v in values.items()}
    before, after = numbered(coarse.events), numbered(fine.events)
    if before.keys() == after.keys():
        after = {key: zero(before[key], time) for key, time in after.items()}
    events = tuple((time, what) for (what, _), time in after.items())
    return replace(fine, values=values, events=events)


FOLDER = Path("cost")
_MACHINE = ("host", "processor", "cores", "python", "numba")
STARTS = 8
"""Runs of each step of a film; the means of their numbers are compared."""
ONSET = "first opening"
_STEPS = 4  # of a film, beside that of the scene; the last one is the reference
_NOISE = 1e-6  # N/Hz^0.5: makes the runs of a film differ


def trials(
    problem: Problem, settings: Sequence[Setting], workers: int | None = None, progress: Progress | None = None
) -> list[Seen]:
    """Return the measures of each setting. One process for each core by default."""
    work = Work(partial(_trial, problem), settings, problem.scene.name, problem.digest, failed=_failed)
    with temporary(work) as store:
        by_unit = carry_out(work, store, workers, progress)
    return [Seen.from_json(unpacked(by_unit[unit])) for unit in range(work.total)]


def _trial(problem: Problem, setting: Setting) -> Arrays:
    return packed(observe(problem, setting).to_json())


def _failed(_: Setting, why: str) -> Arrays:
    """Measures that say why there are none."""
    return packed(Seen({}, fault=why).to_json())


def folder_of(scene: Scene, root: Path = FOLDER) -> Path:
    """Return the folder of a scene's table."""
    return root / f"{scene.name}-{digest(scene)[:8]}"


def cost(
    scene: Scene, root: Path | None = FOLDER, report: Progress | None = None, rounds: int = timing.ROUNDS
) -> Table:
    """Measure error against compute time of `scene` on this machine.

    `root`: parent of its folder; None keeps nothing. Results are written as they come: an interrupted measurement keeps
    its errors, and its references are used again. Raises rig.errors.NumericsError if the first run stops.
    """
    say = report or (lambda done, total: None)
    if scene.assemble().film is not None:
        return _of_film(scene, root, say, rounds)
    asked = problem(scene)
    folder = None if root is None else folder_of(scene, root)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    able = eligible(asked.system)
    rate = fastest_state(asked.system)
    if not able["rk4"] and not ladder("rk4", scene, rate):
        able["rk4"] = f"a step of at most {RK4_LIMIT / rate:.2g} s is stable, of which a frame has no room for enough"
    methods = [method for method, why in able.items() if not why]
    settings = [setting for method in methods for setting in ladder(method, scene, rate)]
    total, timed_so_far = (1 + rounds) * len(settings) + 2, itertools.count(len(settings) + 2)
    truths = references(asked, rate, "exact" if "exact" in methods else "dopri5", folder)
    if not truths.best.seen.fault and not any(truths.best.seen.values.values()):
        raise UsageError(
            f"{scene.name}: nothing moves from its initial state with actuators held, so there is no error to compare: "
            "give the scene an initial state that moves (the protocol is left out)"
        )
    cost_table = Table(
        scene=scene.name,
        title=scene.title,
        digest=asked.digest,
        kind=asked.kind,
        seconds=asked.seconds,
        frame=scene.frame_ns * 1e-9,
        step=asked.step,
        machine=provenance(scene.seed),
        left_out={method: why for method, why in able.items() if why},
        values=truths.best.seen.values,
    )
    for setting, seen in zip(settings, trials(asked, settings, progress=lambda done, _: say(1 + done, total))):
        truth = truths.of(setting.method)
        fault = seen.fault or (truth.seen.fault and f"no reference: {truth.setting} stops, {truth.seen.fault}")
        by_metric = {} if fault else errors(asked, seen, truth.seen)
        cost_table.rows.append(Row(setting, by_metric, truths.floor, Cost(*4 * [UNKNOWN]), math.nan, seen.steps, fault))
    cost_table.orders = orders(cost_table.rows, asked.seconds)
    if folder is not None:
        cost_table.write(folder)
    cost_table.rows = timed(asked, cost_table.rows, rounds, lambda: say(next(timed_so_far), total))
    if folder is not None:
        cost_table.write(folder)
    return cost_table


def _of_film(scene: Scene, root: Path | None, say: Progress, rounds: int) -> Table:
    """The table of a film of points: steps of kick, by the means of the numbers of `STARTS` runs.

    After the first opening two runs diverge. The error of a step is therefore the difference of its means from those of
    the finest step and half the 95 % interval of this difference, which is the smallest error that can be resolved: the
    part of statistics.
    """
    given = scene
    if all(key.startswith("sensors.") for key in random_parts(scene)):
        scene = replace(scene, parameters=scene.parameters.model_copy(update={"noise": Noise(force=_NOISE)}))
    built, step_ns = scene.assemble(), scene.step_ns
    system, length = built.system(), max((scene.duration_ns or 10**9) // step_ns, 1)
    rate = assembly.fastest(system, float(scene.clock.rk4_step) * 1e-9) * RK4_LIMIT / FILM_LIMIT
    settings = steps_of_film(scene, rate)
    if len(settings) < 2:
        raise UsageError(
            f"{scene.name}: no two steps to compare: with all points stuck the film needs steps of at most "
            f"{RK4_LIMIT / rate:.2g} s, which fill a frame of {scene.frame_ns * 1e-9:g} s; use a shorter clock.frame"
        )
    asked = Problem(scene, built, system, {}, f"statistics of {STARTS} runs of a film", length, length, 0)
    wanted = {ONSET, f"mean {FRACTION}", *(f"rms {name}" for name in asked.quantities)}
    total, timings = STARTS * len(settings) + 1 + rounds * (len(settings) - 1), itertools.count(STARTS * len(settings))
    starts = [replace(setting.applied(scene), seed=scene.seed + i) for setting in settings for i in range(STARTS)]
    work = Work(partial(_statistics, asked.seconds), starts, failed=_failed)
    with temporary(work) as store:
        by_unit = carry_out(work, store, progress=lambda done, _: say(done, total))
    every = [Seen.from_json(unpacked(by_unit[unit])) for unit in range(work.total)]
    runs = [every[i : i + STARTS] for i in range(0, len(every), STARTS)]
    known = [name for name in runs[-1][0].values if name in wanted]
    truths = {name: finest for name in known if (finest := _mean(runs[-1], name))[0] not in (0.0, math.inf)}
    rows = []
    for setting, repeats in zip(settings[:-1], runs):
        fault, off, floors = next((seen.fault for seen in repeats if seen.fault), ""), {}, {}
        for name, (truth, spread) in truths.items():
            mean, own = _mean(repeats, name)
            floors[name] = student(STARTS) * math.hypot(spread, own) / abs(truth)
            off[name] = abs(mean - truth) / abs(truth) + floors[name]
        rows.append(Row(setting, {} if fault else off, floors, Cost(*4 * [UNKNOWN]), math.nan, 0, fault, STARTS))
    cost_table = Table(
        scene=scene.name, title=scene.title, digest=digest(given), kind=asked.kind, seconds=asked.seconds,
        frame=scene.frame_ns * 1e-9, step=asked.step, machine=provenance(scene.seed),
        left_out={method: why for method, why in eligible(system).items() if method != "kick"},
        values={name: truth for name, (truth, _) in truths.items()},
        rows=timed(asked, rows, rounds, lambda: say(next(timings), total)),
    )  # fmt: skip
    if root is not None:
        folder = folder_of(given, root)
        folder.mkdir(parents=True, exist_ok=True)
        cost_table.write(folder)
    return cost_table


def steps_of_film(scene: Scene, rate: float) -> list[Setting]:
    """The steps of kick that are compared, coarse to fine, with that of the scene; the last one is the reference."""
    whole = scene.step_ns
    compared = ladder("kick", scene, rate)[: _STEPS - 1]
    if not compared:
        return []
    if whole not in {scene.clock.substeps(whole) * setting.step_ns for setting in compared}:
        compared.append(Setting("kick", step_ns=int(scene.clock.rk4_step)))
        compared.sort(key=lambda setting: -setting.step_ns)
    least = -(-2 * whole // compared[-1].step_ns)
    finer = (whole // count for count in range(least, whole + 1) if whole % count == 0)
    return [*compared, *(Setting("kick", step_ns=h) for h in islice(finer, 1))]


def _statistics(seconds: float, scene: Scene) -> Arrays:
    """The numbers of one run of a film, from the first opening on."""
    run = simulate(scene, duration_ns=run_length_ns(seconds), audited=False)
    opened = first_opening(run)
    values = {} if opened is None else {ONSET: opened}
    values |= {number.name: number.value for number in statistics(run, opened or 0.0)}
    stopped = "" if run.summary.get("ended") in ("done", None) else str(run.summary["ended"])
    return packed(Seen(values, fault=run.fault.partition("\n")[0] or stopped).to_json())


def _mean(repeats: Sequence[Seen], name: str) -> tuple[float, float]:
    """Mean of a number over the runs, and its standard error; infinite if not every run has the number."""
    values = [seen.values[name] for seen in repeats if name in seen.values]
    if len(values) < len(repeats):
        return math.inf, math.inf
    return statistics_of.fmean(values), statistics_of.stdev(values) / math.sqrt(len(values))


def timed(
    asked: Problem, rows: Sequence[Row], rounds: int = timing.ROUNDS, step: Callable[[], object] = lambda: None
) -> list[Row]:
    """Return the rows with the cost of every setting that completes, all alternating; others with the reason for their
    stop.
    """
    ready = [i for i, row in enumerate(rows) if not row.fault]
    timed_rows = list(rows)
    if not ready:
        return timed_rows
    x = asked.later(rows[ready[-1]].setting)
    step()
    contenders = {}
    for i in ready:
        try:
            contenders[i] = Contender(asked, rows[i].setting, x)
        except NumericsError as error:
            timed_rows[i] = replace(rows[i], fault=error.what)
    for i, result in zip(contenders, timing.measured(list(contenders.values()), rounds, step)):
        if isinstance(result, str):
            timed_rows[i] = replace(rows[i], fault=result)
        else:
            timed_rows[i] = replace(rows[i], cost=result, share=result.p99.value * 1e-3)
    return timed_rows


def chosen(
    scene: Scene,
    accuracy: float | None,
    budget: float | None,
    say: Callable[[str], object],
    root: Path = FOLDER,
    report: Progress | None = None,
) -> Scene:
    """Return `scene` with the recommended method and step; `say` gets a line about any compromise.

    `accuracy`: largest relative error of any measure; `budget`: largest share of a frame at p99. Raises UsageError if
    no setting meets both.
    """
    pick = recommended(table(scene, say, root, report).rows, WORST, accuracy, budget)
    say(pick.text(WORST))
    return pick.setting.applied(scene)


def table(scene: Scene, say: Callable[[str], object], root: Path = FOLDER, report: Progress | None = None) -> Table:
    """Return the cost table of `scene` on this machine, read or measured."""
    folder = folder_of(scene, root)
    here = provenance(scene.seed)
    try:
        cost_table = Table.read(folder)
        if all(cost_table.machine[name] == here[name] for name in _MACHINE) and all(
            row.timed for row in cost_table.rows
        ):
            return cost_table
    except UsageError:
        pass
    say(f"{scene.name}: this machine has no cost table of it yet; measuring one, as rig cost does, into {folder}")
    return cost(scene, root, report)
