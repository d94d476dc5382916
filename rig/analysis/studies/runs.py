"""The points of a study: a grid, at each of its points drawn samples, each of them run with several seeds.

random     independent draws (Monte Carlo)
latin      Latin hypercube: each parameter has one value in each of N equal shares
sobol      Sobol sequence, scrambled: fills the space evenly; N is a power of 2
saltelli   N (d + 2) points from which Sobol indices of d parameters are computed; N is a power of 2

The draws are the same at every point of the grid. Point number k is run with the seed of the study plus k, and is
computed for itself. Recordings of chosen points are simulated again, since a run repeats to the last bit. Source:
Saltelli et al., Comput. Phys. Commun. 181 (2010) 259-270.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.pool import Arrays, Progress, Work, carry_out, digest, temporary
from rig.analysis.pool.cluster import check as check_cluster
from rig.analysis.pool.kernel_shapes import prepare
from rig.analysis.studies.factors import Factor, Identified, drawn, factors
from rig.analysis.studies.measures import LOOP, Measure, as_point, evaluate
from rig.bench.run.simulate import simulate
from rig.errors import Faults, OutputError, RigError, SceneError, UsageError, WorkerError
from rig.machine.files import draft_of
from rig.quantities import run_length_ns, whole
from rig.record.provenance import provenance
from rig.record.save_run import save
from rig.scenes.belief import of_varied, varied
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene
from rig.scenes.variants import optional

Array = NDArray[np.float64]
SAMPLINGS = ("random", "latin", "sobol", "saltelli")
SAMPLES = 64
"""Default number of samples."""
MOST = 10_000_000
"""Largest number of points, of samples, and of repeated runs."""
MOST_SEED = 2**62
"""Largest seed; those of all points then fit in 64 bits."""
_EDGE = 1e-12  # the nearest that a drawn share comes to 0 and 1
SAMPLE = "sample"
"""The dimension of drawn points in the results."""
REPEAT = "repeat"
"""The dimension of repeated runs in the results."""


@dataclass(frozen=True)
class Plan:
    """The points of a study."""

    factors: tuple[Factor, ...]
    samples: int
    sampling: str
    repeat: int
    seed: int
    alike: bool = False
    """Whether all points are run with the same seed."""

    @property
    def grid(self) -> list[Factor]:
        """The parameters with given values."""
        return [factor for factor in self.factors if factor.distribution is None]

    @property
    def drawn(self) -> list[Factor]:
        """The parameters with a distribution."""
        return [factor for factor in self.factors if factor.distribution is not None]

    @property
    def rows(self) -> int:
        """Number of samples at each point of the grid; 1 without a distribution."""
        if not self.drawn:
            return 1
        return self.samples * (len(self.drawn) + 2 if self.sampling == "saltelli" else 1)

    @property
    def dimensions(self) -> dict[str, int]:
        """The dimensions of the results: the keys of the grid, sample, repeat; the last two only where needed."""
        sizes = {factor.key: len(factor.axis.values) for factor in self.grid}
        sizes |= {SAMPLE: self.rows} if self.drawn else {}
        return sizes | ({REPEAT: self.repeat} if self.repeat > 1 else {})

    @property
    def total(self) -> int:
        """Number of points."""
        return math.prod(self.dimensions.values())

    @cached_property
    def shares(self) -> Array:
        """The drawn shares, [sample, drawn parameter], between 0 and 1."""
        from scipy.stats import qmc

        count = len(self.drawn)
        chance = np.random.default_rng(self.seed)
        spread = {"latin": qmc.LatinHypercube, "sobol": qmc.Sobol}.get(self.sampling)
        if spread is not None:
            return np.asarray(spread(count, rng=chance).random(self.samples))
        if self.sampling != "saltelli":
            return chance.random((self.samples, count))
        both = qmc.Sobol(2 * count, bits=64, rng=chance).random(self.samples)
        a, b = both[:, :count], both[:, count:]
        mixed = [np.where(np.arange(count) == column, b, a) for column in range(count)]
        return np.concatenate([a, b, *mixed])

    @cached_property
    def draws(self) -> Array:
        """The drawn values (SI), [sample, drawn parameter]."""
        shares = np.clip(self.shares, _EDGE, 1.0 - _EDGE)  # a normal distribution has no value at 0 and 1
        given = [factor.distribution for factor in self.drawn if factor.distribution is not None]
        return drawn(given, [factor.axis.unit for factor in self.drawn], shares) if given else np.zeros((1, 0))

    def values(self, number: int) -> dict[str, float]:
        """Return the values (SI) of the parameters of a point."""
        *at, sample = np.unravel_index(
            number // self.repeat, (*(len(factor.axis.values) for factor in self.grid), self.rows)
        )
        drawn = {factor.key: factor.axis.values[i] for factor, i in zip(self.grid, at)}
        return drawn | {factor.key: float(self.draws[sample, i]) for i, factor in enumerate(self.drawn)}

    def seed_of(self, number: int) -> int:
        """Return the seed of a point."""
        return self.seed + (0 if self.alike else number)


def plan(
    scene: Scene, over: Mapping[str, Any], samples: int | None, sampling: str, repeat: int, seed: int | None
) -> Plan:
    """Return the plan of a study of `scene`. Raises SceneError, UsageError with every fault."""
    faults = Faults()
    seeds_alone = not over and isinstance(repeat, int) and repeat > 1
    varied: tuple[Factor, ...] = () if seeds_alone else faults(lambda: factors(scene, over), ())
    count = faults(lambda: whole("samples", SAMPLES if samples is None else samples, 1, MOST), 1)
    times = faults(lambda: whole("repeat", repeat, 1, MOST), 1)
    points = Plan(varied, count, sampling, times, faults(lambda: first_seed(scene, seed), 0))
    if sampling not in SAMPLINGS:
        faults.found.append(f"sampling {sampling}: unknown; known: {', '.join(SAMPLINGS)}")
    elif sampling == "saltelli" and any(isinstance(f.distribution, Identified) for f in points.drawn):
        faults.found.append(
            "sampling saltelli: Sobol indices need independent parameters; identified ones are correlated"
        )
    elif sampling in ("sobol", "saltelli") and points.drawn and count & (count - 1):
        near = 2 ** round(math.log2(count))
        faults.found.append(f"samples = {count}: must be a power of 2 for sampling {sampling}, such as {near}")
    if varied and not points.drawn and (samples is not None or sampling != "random"):
        faults.found.append(
            "samples and sampling are for distributions, and no parameter has one, such as normal(0.4, 0.02)"
        )
    if varied and not faults.found and points.total > MOST:
        faults.found.append(f"{points.total} points: must be at most {MOST}")
    faults.raise_found()
    outside = []
    for factor, values in zip(points.drawn, points.draws.T):
        cut = factor.distribution is None or factor.distribution.kind == "uniform"
        try:
            remedy = "" if cut else "; cut the distribution off with low=... and high=..."
            factor.axis.check(scene, sorted({float(values.min()), float(values.max())}), remedy)
        except ValueError as fault:
            outside.append(f"{factor.key}: {factor.distribution} leaves the range of the parameter: {fault}")
    if outside:
        raise SceneError(scene.name, outside)
    return points


def first_seed(scene: Scene, seed: int | None) -> int:
    """Return the seed of the first run; None: that of the scene. Raises UsageError."""
    return whole("seed", scene.seed if seed is None else seed, 0, MOST_SEED)


def check_length(scene: Scene, duration: float | None, of_runs: bool = True) -> None:
    """Raise UsageError for a `duration` [s] that is none, and for runs of a protocol without end if there is none."""
    if run_length_ns(duration) is None and scene.duration_ns is None and of_runs:
        raise UsageError(f"{scene.name} has no protocol that ends; state a duration: --duration 10")


def random_parts(scene: Scene) -> tuple[str, ...]:
    """Return the random parts of `scene`; empty if two seeds give the same run."""
    random = [
        f"{part.key}.{part.about.random}" for part in optional(scene.parameters) if part.given and part.about.random
    ]
    random = [key for key in random if scene.values()[key][0] > 0.0]
    for name, section in scene.sensors.items():
        end = section.front_end()
        random += [f"sensors.{name}.noise"] if end.noise > 0.0 else []
        random += [f"sensors.{name}.dropout_rate"] if end.dropout_rate > 0.0 else []
    return tuple(random)


def check_random(scene: Scene, runs: str) -> None:
    """Raise UsageError for a scene in which nothing is random; `runs`: those that would be the same, in words."""
    if not random_parts(scene):
        raise UsageError(
            f"{scene.name}: nothing in it is random, so that {runs} are the same. Add process noise, a random force at "
            "the place of a knock: -p noise.force=1e-6 (N/Hz^0.5); or add sensor noise: -p sensors.NAME.noise=..."
        )


@dataclass(frozen=True)
class StudyRuns:
    """The points of `plan` of `scene`, with `measures`; each run takes `duration` [s] or as long as its protocol."""

    scene: Scene
    plan: Plan
    measures: tuple[Measure, ...]
    duration: float | None

    @property
    def of_run(self) -> bool:
        """Whether a point is a whole run, with protocol, sensors and controllers."""
        return any(measure.of_run for measure in self.measures)

    @property
    def belief(self) -> list[str]:
        """Lines on what the controllers are told of the rig; empty if no measure has any."""
        acting = any(measure.has_controllers for measure in self.measures)
        return of_varied(self.scene, [factor.key for factor in self.plan.factors]) if acting else []

    @property
    def left_out(self) -> str:
        """Which measures are those of the plant without its controllers, in words; "" if there is none."""
        alone = ", ".join(measure.name for measure in self.measures if not measure.has_controllers)
        text = left_out(self.scene)
        return f"{alone}: {text}" if alone and text else ""

    @property
    def unportable(self) -> str:
        """Names of the measures that other processes cannot load: functions that no file holds."""
        return ", ".join(each.name for each in self.measures if each.function and not each.function.portable)

    @property
    def items(self) -> range:
        """The numbers of the points."""
        return range(self.plan.total)

    @property
    def identity(self) -> list[Any]:
        """What the values of the points depend on, besides scene and sources."""
        return [self.plan, self.duration, *self.measures]

    @property
    def work(self) -> Work:
        """The points as a work (rig.analysis.pool)."""
        hash_ = digest(self.scene, repr(self.identity))
        return Work(self.compute, self.items, self.scene.name, hash_, self.prepare, self.failed)

    def prepare(self) -> None:
        """Compile the kernels. Raises SceneError for a scene whose controllers cannot be designed."""
        scene = self.scene_of(0)
        if any(measure.source not in ("modes", LOOP) for measure in self.measures):
            prepare([scene])
        if self.of_run:
            simulate(scene, duration_ns=scene.frame_ns)

    def scene_of(self, unit: int, *given: float) -> Scene:
        """Return the scene of a point, with the values `given` (SI) or those of the plan. Raises SceneError if it
        refuses the values together.
        """
        values = dict(zip((factor.key for factor in self.plan.factors), given)) or self.plan.values(unit)
        return varied(self.scene, values, self.plan.seed_of(unit))

    def compute(self, unit: int, *given: float) -> Arrays:
        """Compute the measures of a point; a fault of it becomes the reason of missing values."""
        try:
            return evaluate(self.scene_of(unit, *given), self.measures, self.duration)
        except SceneError as fault:
            return self.failed(unit, "; ".join(fault.faults))

    def failed(self, unit: int, why: str) -> Arrays:
        """Return a point without values."""
        units = [measure.unit for measure in self.measures]
        return as_point([math.nan] * len(units), units, why)

    def usable_workers(self, workers: int | None, cluster: str) -> int | None:
        """Return the number of `workers` that compute it. Raises UsageError for a cluster, and for a measure that they
        cannot load.
        """
        if cluster:
            check_cluster(cluster, workers)
        if not self.unportable or (workers == 1 and not cluster):
            return workers
        if workers is not None or cluster:
            raise UsageError(
                f"measure {self.unportable}: worker processes cannot load it; define it at the top level of a .py "
                "file, or compute in this process with one worker"
            )
        return 1


def keep(
    study: StudyRuns, points: Sequence[int], folder: Path, workers: int | None, progress: Progress | None = None
) -> dict[int, Path]:
    """Record the runs of `points` into `folder`; return point -> file. Existing recordings are not made again.

    A run that the scene refuses has none.
    """
    paths = {point: folder / f"{point:06d}.mcap" for point in points}
    missing = tuple(point for point, path in paths.items() if not path.exists())
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        work = Work(partial(_record, study, folder), missing)
        try:
            with temporary(work) as store:
                carry_out(work, store, 1 if study.unportable else workers, progress)
        except (OutputError, WorkerError) as fault:
            raise type(fault)(
                f"{fault}. The values of the study are kept in {folder.parent}; the same command continues"
            ) from None
    return {point: path for point, path in paths.items() if path.exists()}


def _record(study: StudyRuns, folder: Path, point: int) -> Arrays:
    """Simulate a point and record it. Raises OutputError; a run that the scene refuses is not recorded."""
    scene = study.scene_of(point)
    try:
        run = simulate(scene, duration_ns=run_length_ns(study.duration))
    except RigError:
        return {"recorded": np.array(False)}
    run.provenance = provenance(scene.seed)
    path = folder / f"{point:06d}.mcap"
    try:
        with draft_of(path) as draft:
            save(run, draft)
    except OutputError as fault:
        why = str(fault).partition("cannot be written: ")[2].partition(";")[0]
        raise OutputError(f"{path} cannot be written: {why or fault}") from None
    return {"recorded": np.array(True)}
