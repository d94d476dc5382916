"""Simulated twins of the runs, with process noise of the density that the measured cycles show.

They tell what noise does to a fit. A contact at rest that noise pushes breaks away early, always to the same side, so
that a period without noise would bias the parameters by more than their intervals. What a period leaves of the mean
cycle of a twin is subtracted from what it leaves of the measured cycles, and the fit goes on from there.

The density follows from the scatter of the residual between cycles, which no misfit of the law enters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rig.analysis.cycles.cycle import limit_cycle
from rig.analysis.cycles.cycle_report import Cycle
from rig.analysis.identification.cycles import REPEATS, CycleRun
from rig.analysis.identification.responses import ACCURACY, LONGEST_SETTLING, sampled
from rig.analysis.identification.runs import Measured
from rig.analysis.pool import Arrays
from rig.bench.run.simulate import simulate
from rig.errors import SceneError, UsageError
from rig.record.run import Reals
from rig.scenes.belief import varied
from rig.scenes.scene import Scene

SEED = 4711  # chosen: any will do; fixed, so that a fit repeats
_SETTLES = 0.3  # of the duration of a twin: what is left out before it
_STATED = 1e-4  # of a value of the start, SI: states are linear in them
# Duration of a twin over that of its run; at most so many periods
_SHORT = (4.0, 100.0)
_LONG = (24.0, 500.0)
_TRIAL = 1e-3  # of the load: a first density of process noise [N/Hz^0.5]
_TRIALS = 8  # of the density, at most
_AGREES = 0.2  # logarithm of the ratio of two densities that are the same
_SAMPLES = 2_000_000
"""Most samples of a twin."""
_NONE = 0.05  # of the variance of the noise of a column: a smaller scatter beyond it is no process noise
Twins = Callable[[float, Sequence[float]], list[Arrays | str]]
"""For a density of process noise and a duration of each run: the twins, or why there is none."""


def simulated(scene: Scene, run: Measured, sigma: Reals, density: float, seconds: float, seed: int) -> Measured:
    """A run of a rig as the columns of another one would measure it, without offsets and delays."""
    rate = max(column.rate for column in run.columns)
    noise = {"noise": {"force": density}} if density else {}
    parameters = type(scene.parameters).model_validate({**scene.parameters.model_dump(exclude_none=True), **noise})
    bare = replace(_fine(scene, rate), parameters=parameters, controllers={}, protocol=(), seed=seed)
    twin = simulate(bare, duration_ns=round((1.0 + _SETTLES) * seconds * 1e9), audited=False)
    chance = np.random.default_rng(seed)
    columns = []
    for column, s in zip(run.columns, sigma):
        t = np.arange(_SETTLES * seconds, float(twin.time[-1]), 1.0 / column.rate)
        v = np.interp(t, twin.time, twin.signals[column.output]) + s * chance.standard_normal(t.size)
        columns.append(replace(column, start=float(t[0]), v=v))
    return replace(run, name=f"twin of {run.name}", columns=tuple(columns))


def _fine(scene: Scene, rate: float) -> Scene:
    """The scene with one sensor whose samples are as dense as the columns: the noise is held for a frame as before."""
    for name, sensor in scene.sensors.items():
        frame = 1e9 / scene.frame_ns
        dense = {f"sensors.{name}.rate": frame * math.ceil(rate / frame - 1e-9)}
        try:
            fine = varied(replace(scene, sensors={name: sensor}), dense)
        except SceneError:
            continue
        if fine.step_ns <= 1.001e9 / rate:
            return fine
    return replace(scene, sensors={})


def on_cycle(scene: Scene, cycle: Cycle | None = None) -> Scene:
    """The scene with a start on its limit cycle, as far as its start can be stated: beside it sliding may be stable."""
    cycle = limit_cycle(scene, ACCURACY, LONGEST_SETTLING) if cycle is None else cycle
    values = scene.values()
    keys = [key for key, (value, _) in values.items() if key.startswith("start.") and isinstance(value, float)]
    if not keys or not cycle.found:
        return scene
    stated = np.array([float(values[key][0]) for key in keys])

    def start(values: Reals) -> Reals:
        begun = varied(scene, dict(zip(keys, values.tolist()))).assemble().start
        return np.array([begun.get(name, 0.0) for name in cycle.state])

    try:
        begun = start(stated)
        slopes = np.stack([(start(stated + _STATED * row) - begun) / _STATED for row in np.eye(len(keys))], axis=1)
        on_cycle = np.array([*cycle.state.values()])
        step, *_ = np.linalg.lstsq(slopes, on_cycle - begun, rcond=None)
        return varied(scene, dict(zip(keys, (stated + step).tolist())))
    except SceneError:
        return scene


def mean_left(scene: Scene, run: Measured, density: float, seconds: float, seed: float, *sigma: float) -> Arrays:
    """What the period of a scene leaves of the cycles of a twin, over the noise of its columns.

    The `mean` over the cycles and its `times` from the begin of a cycle [s], by column; `scatter`, the variance about
    it; `count` of the cycles. Raises UsageError where the twin leaves the cycle.
    """
    cycle = limit_cycle(scene, ACCURACY, LONGEST_SETTLING)
    if not cycle.found:
        raise UsageError(cycle.why)
    period = sampled(cycle, scene, run)
    sigmas = np.array(sigma)
    measured = simulated(on_cycle(scene, cycle), run, sigmas, density, seconds, int(seed))
    twin = CycleRun.of(measured, period)
    if abs(math.log(twin.period / period.period)) > REPEATS:
        raise UsageError(f"{run.name}: the twin has a period of {twin.period:.4g} s, not {period.period:.4g} s")
    left = replace(twin, sigma=sigmas).left(period, np.zeros(len(sigmas)))
    mean = left.mean(axis=0)
    ends = np.cumsum([samples.shape[1] for samples in twin.samples])[:-1]
    means = {f"mean{i}": part for i, part in enumerate(np.split(mean, ends))}
    times = {f"times{i}": of_column.mean(axis=0) for i, of_column in enumerate(twin.times)}
    return means | times | {"scatter": np.array(scatter(left)), "count": np.array(len(left))}


def scatter(left: Reals) -> float:
    """The variance of residuals [cycle, value] about their mean over cycles."""
    return float(((left - left.mean(axis=0)) ** 2).sum() / max((len(left) - 1) * left.shape[1], 1))


def expecting(
    evidence: Sequence[CycleRun],
    left: Sequence[Reals],
    twins: Twins,
    density: float,
) -> tuple[list[CycleRun], float] | str:
    """The evidence with what noise adds to the mean of each cycle, and the density of the noise; why there is none.

    `left`: what the fit leaves now. `density`: of a fit before, 0 for none.
    """
    excess = np.array([scatter(r) - 1.0 for r in left])
    if np.median(excess) < _NONE:
        return [*evidence], 0.0

    def asked(length: tuple[float, float], density: float) -> list[Arrays] | str:
        times, periods = length
        durations = []
        for each in evidence:
            most = _SAMPLES / max(column.rate for column in each.run.columns)
            wanted = min(times * each.run.seconds, periods * each.period)
            durations.append(min(max(wanted, each.run.seconds), most))
        answers = twins(density, durations)
        rows = [row for row in answers if not isinstance(row, str)]
        return rows if len(rows) == len(answers) else next(row for row in answers if isinstance(row, str))

    if not density:
        load = max(each.run.settings.get("load.force", 0.0) for each in evidence)
        density = _TRIAL * load or _TRIAL
        for _ in range(_TRIALS):
            rows = asked(_SHORT, density)
            if isinstance(rows, str):  # too much noise for the cycle
                density *= 0.2
                continue
            ratio = _ratio(excess, rows)
            density *= ratio
            if abs(math.log(ratio)) < _AGREES:
                break
    rows = asked(_LONG, density)
    if isinstance(rows, str):
        return rows
    expecting_noise = []
    for each, row in zip(evidence, rows):
        parts = [np.interp(times.mean(axis=0), row[f"times{i}"], row[f"mean{i}"]) for i, times in enumerate(each.times)]
        share = len(each.begins) / float(row["count"])
        expecting_noise.append(replace(each, expected=np.concatenate(parts), share=share))
    return expecting_noise, density * _ratio(excess, rows)


def _ratio(excess: Reals, rows: Sequence[Any]) -> float:
    """By which factor the density of the noise of twins is too small, within a factor of ten."""
    of_twins = np.array([float(row["scatter"]) - 1.0 for row in rows])
    ratios = np.maximum(excess, 0.0) / np.maximum(of_twins, 1e-3)
    return float(np.clip(math.sqrt(float(np.median(ratios))), 0.1, 10.0))
