"""Measurement of the cost table of a scene, for `rig cost`; and the setting of a run, chosen from the table of this
machine, which is measured first if necessary.
"""

from __future__ import annotations

import itertools
import math
import statistics as statistics_of
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path

from rig.analysis.cycles.motion_measures import (
    Problem,
    Seen,
    Setting,
    digest,
    eligible,
    errors,
    ladder,
    observe,
    problem,
)
from rig.analysis.pool import Arrays, Progress, Work, carry_out, packed, temporary, unpacked
from rig.analysis.studies.runs import random_parts
from rig.bench.run.simulate import simulate
from rig.effects.noise import Noise
from rig.errors import NumericsError, UsageError
from rig.model import assembly
from rig.qualify.cost import timing
from rig.qualify.cost.references import references
from rig.qualify.cost.table import WORST, Row, Table, orders, recommended, student
from rig.qualify.cost.timing import UNKNOWN, Contender, Cost
from rig.quantities import run_length_ns
from rig.record.provenance import provenance
from rig.record.statistics import FRACTION, first_opening, statistics
from rig.scenes.scene import Scene
from rig.stability.report import FILM_LIMIT, RK4_LIMIT, fastest_state

FOLDER = Path("cost")
_MACHINE = ("host", "processor", "cores", "python", "numba")
STARTS = 8
"""Runs of each step of a film; the means of their numbers are compared."""
ONSET = "first opening"
_STEPS = 4  # of a film, beside that of the scene; the last one is the reference
_NOISE = 1e-6  # N/Hz^0.5: makes the runs of a film differ
_UNTIMED = Cost(UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN)


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
    settings: list[Setting] = []
    for method in methods:
        settings += ladder(method, scene, rate)
    total = (1 + rounds) * len(settings) + 2
    timed_so_far = itertools.count(len(settings) + 2)
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
    every = trials(asked, settings, progress=lambda done, _: say(1 + done, total))
    for setting, seen in zip(settings, every):
        truth = truths.of(setting.method)
        fault = seen.fault
        if not fault and truth.seen.fault:
            fault = f"no reference: {truth.setting} stops, {truth.seen.fault}"
        by_metric = {} if fault else errors(asked, seen, truth.seen)
        cost_table.rows.append(Row(setting, by_metric, truths.floor, _UNTIMED, math.nan, seen.steps, fault))
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
    asked_scene = scene
    if all(key.startswith("sensors.") for key in random_parts(scene)):
        noisy = scene.parameters.model_copy(update={"noise": Noise(force=_NOISE)})
        scene = replace(scene, parameters=noisy)
    built = scene.assemble()
    system = built.system()
    length = max((scene.duration_ns or 10**9) // scene.step_ns, 1)
    rate = assembly.fastest(system, float(scene.clock.rk4_step) * 1e-9) * RK4_LIMIT / FILM_LIMIT
    settings = steps_of_film(scene, rate)
    if len(settings) < 2:
        raise UsageError(
            f"{scene.name}: no two steps to compare: with all points stuck the film needs steps of at most "
            f"{RK4_LIMIT / rate:.2g} s, which fill a frame of {scene.frame_ns * 1e-9:g} s; use a shorter clock.frame"
        )
    asked = Problem(scene, built, system, {}, f"statistics of {STARTS} runs of a film", length, length, 0)
    total = STARTS * len(settings) + 1 + rounds * (len(settings) - 1)
    timings = itertools.count(STARTS * len(settings))
    starts = []
    for setting in settings:
        once = setting.applied(scene)
        starts += [replace(once, seed=scene.seed + i) for i in range(STARTS)]
    work = Work(partial(_statistics, asked.seconds), starts, failed=_failed)
    with temporary(work) as store:
        by_unit = carry_out(work, store, progress=lambda done, _: say(done, total))
    every = [Seen.from_json(unpacked(by_unit[unit])) for unit in range(work.total)]
    runs = [every[i : i + STARTS] for i in range(0, len(every), STARTS)]
    wanted = {ONSET, f"mean {FRACTION}", *(f"rms {name}" for name in asked.quantities)}
    truths = {}
    for name in runs[-1][0].values:
        if name in wanted:
            mean, deviation = _mean(runs[-1], name)
            if mean not in (0.0, math.inf):
                truths[name] = (mean, deviation)
    rows = [_film_row(setting, repeats, truths) for setting, repeats in zip(settings[:-1], runs)]
    cost_table = Table(
        scene=scene.name,
        title=scene.title,
        digest=digest(asked_scene),
        kind=asked.kind,
        seconds=asked.seconds,
        frame=scene.frame_ns * 1e-9,
        step=asked.step,
        machine=provenance(scene.seed),
        left_out={method: why for method, why in eligible(system).items() if method != "kick"},
        values={name: truth for name, (truth, _) in truths.items()},
        rows=timed(asked, rows, rounds, lambda: say(next(timings), total)),
    )
    if root is not None:
        folder = folder_of(asked_scene, root)
        folder.mkdir(parents=True, exist_ok=True)
        cost_table.write(folder)
    return cost_table


def _film_row(setting: Setting, repeats: Sequence[Seen], truths: dict[str, tuple[float, float]]) -> Row:
    """The row of a step of a film. `truths`: mean and standard error of each number at the finest step."""
    fault = next((seen.fault for seen in repeats if seen.fault), "")
    deviations = {}
    floors = {}
    for name, (truth, spread) in truths.items():
        mean, standard_error = _mean(repeats, name)
        floors[name] = student(STARTS) * math.hypot(spread, standard_error) / abs(truth)
        deviations[name] = abs(mean - truth) / abs(truth) + floors[name]
    return Row(setting, {} if fault else deviations, floors, _UNTIMED, math.nan, 0, fault, STARTS)


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
    this_machine = provenance(scene.seed)
    try:
        cost_table = Table.read(folder)
        measured_here = all(cost_table.machine[name] == this_machine[name] for name in _MACHINE)
        if measured_here and all(row.timed for row in cost_table.rows):
            return cost_table
    except UsageError:
        pass
    say(f"{scene.name}: this machine has no cost table of it yet; measuring one, as rig cost does, into {folder}")
    return cost(scene, root, report)
