"""A robust design as a work: what is asked for, checked; and its search, whose units a pool computes and a store keeps.

The search is a function of its seed, so that its units come in the same order each time. When the same design is
started again, it reads the results that its folder contains already and continues from there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import scipy

from rig.analysis.pool import Arrays, Progress, Store, Work, digest, pool
from rig.analysis.robust.box import Box, Limit
from rig.analysis.robust.design import AUDIT, FIRST
from rig.analysis.robust.growth import LOOP, MODES, Growth
from rig.analysis.robust.series import checked
from rig.analysis.robust.stated import box, limits, number, two_ends
from rig.analysis.robust.tasks import Computer, Tasks, Units
from rig.analysis.studies.factors import Identified
from rig.analysis.studies.runs import MOST, first_seed
from rig.controllers import controller_class
from rig.errors import Faults, UsageError, WorkerError
from rig.scenes.scene import Scene
from rig.units import brief

TOLERANCE = "tolerance"
_MEASURES = f"{MODES} or {LOOP} to minimise, or {TOLERANCE} or {TOLERANCE}.KEY to maximise"
_BANDS = 'expected two frequencies, "2 kHz:5 kHz"'
_POLISHED = 2500  # rigs that the polish of the designs takes for each free value, about


@dataclass(frozen=True)
class Job:
    """A robust design of `scene`: the values of `box`, the `measure` (modes.growth, loop.growth), the `band` [Hz].

    `tolerance`: the growth is not made small, but the range of this key (or, "", of all keys) large, at which nothing
    grows, or decays with `decay` [1/s]; None: the growth is. `series`: of the components of the design; "": any value.
    """

    scene: Scene
    box: Box
    measure: str
    band: tuple[float, float]
    limits: tuple[Limit, ...]
    tolerance: str | None
    decay: float
    seed: int
    series: str = ""

    @property
    def identity(self) -> list[Any]:
        """What the results depend on, besides scene and sources."""
        limits = [limit.text for limit in self.limits]
        files = [value.given.content for value in self.box.uncertain if isinstance(value.given, Identified)]
        asked = [self.measure, self.band, limits, self.tolerance, self.decay, self.seed, AUDIT, self.series]
        return [self.box, *asked, *files, scipy.__version__]

    @property
    def target(self) -> float:
        """The largest growth [1/s] that a tolerance allows."""
        return -self.decay

    @property
    def number(self) -> int | None:
        """Number of the uncertain value whose tolerance is searched; None: all."""
        keys = [value.key for value in self.box.uncertain]
        return keys.index(self.tolerance) if self.tolerance else None

    @property
    def expected(self) -> int:
        """Number of rigs that the search takes, about."""
        designs = 2 * FIRST + 2 * _POLISHED * len(self.box.free)
        return 2 * AUDIT + designs * (1 if self.tolerance is None else 6)

    @property
    def work(self) -> Work:
        """Its units as a work (rig.analysis.pool)."""
        return Work(_Unit(self), range(MOST), self.scene.name, digest(self.scene, repr(self.identity)))

    def grown(self) -> Growth:
        """The growth of its rigs."""
        return Growth(self.scene, self.box, self.measure, self.band)


class _Unit:
    """Computes one unit of a job; each process assembles rigs of its own."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._computer: Computer | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {"_job": self._job, "_computer": None}

    def __call__(self, unit: int, *given: float) -> Arrays:
        """Return the result of a unit, for the numbers that it is given."""
        if self._computer is None:
            self._computer = Computer(self._job.grown(), self._job.limits)
        return self._computer(given)


def prepared(
    scene: Scene,
    over: Mapping[str, Any],
    against: Mapping[str, Any],
    minimise: Any = None,
    maximise: Any = None,
    band: Any = None,
    limit: Iterable[str] | None = None,
    decay: Any = None,
    seed: int | None = None,
    series: str | None = None,
) -> Job:
    """Return a checked design of `scene`; see `rig.optimise`. Raises SceneError, UsageError with every fault."""
    if not against:
        raise UsageError(
            "band, limit, decay, series and prove belong to a design against what is not known of the rig; state that "
            "as well: "
            '--against "friction.mu=+-2 %"'
        )
    faults = Faults()
    stated = faults(lambda: box(scene, over, against), None)
    values = stated or Box((), ())
    nothing: tuple[str, str | None] = (MODES, None)
    measure, key = faults(lambda: _measure(scene, values, minimise, maximise), nothing)
    within = faults(lambda: _band(band), (0.0, math.inf))
    kept: tuple[Limit, ...] = () if stated is None else faults(lambda: limits(values, limit or ()), ())
    least = faults(lambda: _decay(decay, key), 0.0)
    first = faults(lambda: first_seed(scene, seed), 0)
    components = "" if stated is None else faults(lambda: checked(series, values), "")
    if components and key is not None:
        faults.found.append(
            "series: a design at the edge of a tolerance holds with no other values; state the tolerance with "
            "--against and minimise the growth"
        )
    if not faults.found:
        faults.found += _useless(scene, values, measure)
        faults.found += _no_tolerance(values, key)
    faults.raise_found()
    return Job(scene, values, measure, within, kept, key, least, first, components)


def _measure(scene: Scene, values: Box, minimise: Any, maximise: Any) -> tuple[str, str | None]:
    """The growth that counts, and of a tolerance its key. Raises UsageError."""
    given = [each for each in (minimise, maximise) if each is not None]
    if len(given) != 1:
        raise UsageError(f"state one measure: {_MEASURES}")
    if minimise in (MODES, LOOP):
        return str(minimise), None
    name, _, key = str(maximise).partition(".") if isinstance(maximise, str) else ("", "", "")
    if name != TOLERANCE:
        what = "minimise" if maximise is None else "maximise"
        raise UsageError(f"{what} {brief(given[0])}: no growth of a rig against uncertain values; expected {_MEASURES}")
    known = [value.key for value in values.uncertain]
    if key and known and key not in known:
        raise UsageError(f"maximise {maximise}: {key} is not uncertain; --against {key}=... states its range")
    linear = bool(scene.controllers) and all(_is_linear(section) for section in scene.controllers.values())
    return LOOP if linear else MODES, key


def _is_linear(section: Any) -> bool:
    return hasattr(controller_class(section), "linear")


def _band(given: Any) -> tuple[float, float]:
    """The band [Hz]. Raises UsageError."""
    if given is None:
        return 0.0, math.inf
    try:
        low, high, _ = two_ends(given, "Hz", _BANDS)
    except ValueError as fault:
        raise UsageError(f"band {brief(given)}: {fault}") from None
    if not 0.0 <= low < high:
        raise UsageError(f"band {brief(given)}: from {low:g} Hz to {high:g} Hz; it must rise, from 0 Hz or more")
    return low, high


def _decay(given: Any, key: str | None) -> float:
    """The least decay [1/s] of a tolerance. Raises UsageError."""
    if given is None:
        return 0.0
    if key is None:
        raise UsageError("decay: belongs to a tolerance (--maximise tolerance); a growth is made as small as possible")
    try:
        decay = number(given, "1/s")
    except ValueError as fault:
        raise UsageError(f"decay: {fault}") from None
    if decay < 0.0:
        raise UsageError(f"decay = {decay:g} 1/s: must be at least 0")
    return decay


def _useless(scene: Scene, values: Box, measure: str) -> list[str]:
    """Keys of controllers in a measure of the plant alone, which they cannot change."""
    keys = [axis.key for axis in values.free] + [value.key for value in values.uncertain]
    of_controllers = [key for key in dict.fromkeys(keys) if key.startswith("controllers.")]
    if measure == LOOP and not scene.controllers:
        return [f"{LOOP}: {scene.name} has no controller that closes a loop; minimise {MODES}"]
    if measure == LOOP or not of_controllers:
        return []
    return [f"{', '.join(of_controllers)}: changes no mode of the plant alone ({MODES}); minimise {LOOP}"]


def _no_tolerance(values: Box, key: str | None) -> list[str]:
    """Ranges that cannot be made wider or narrower about their nominal value."""
    faults = []
    for value in values.uncertain if key is not None else ():
        if key and value.key != key:
            continue
        if not value.ends[0] < value.ends[1]:
            faults.append(f"against {value.key}: its range has no width, so that no factor of it is a tolerance")
        elif not 0.0 <= value.centre <= 1.0:
            at = value.axis.text(value.nominal)
            faults.append(f"against {value.key}: its range leaves out the value of the scene, {at}, which it is about")
    return faults


@contextmanager
def opened(
    job: Job,
    root: Path,
    workers: int | None = None,
    progress: Progress | None = None,
    cluster: str = "",
    first: int = 0,
) -> Iterator[tuple[Tasks, Path]]:
    """Open the units of a job, from number `first` on, and their folder.

    Raises UsageError, WorkerError as a study does; what is finished stays.
    """
    units = job.work
    store = Store.of(units, root)
    say = progress or (lambda done, total: None)
    with store.open(units), pool(units, store, workers, MOST, cluster=cluster) as processes:
        rows = store.load()

        def carry_out(asked: Units) -> list[Arrays]:
            todo = {unit: given for unit, given in asked.items() if unit not in rows}
            rigs = sum(map(tasks.rigs, todo.values()))

            def show(done: int) -> None:
                ready = tasks.count + rigs * done // len(todo)
                say(ready, max(job.expected, ready + 1))

            if todo:
                processes.compute(todo, show)
                rows.update(store.load(min(todo)))
            if processes.failed:
                raise WorkerError(f"{next(iter(processes.failed.values()))}{store.kept}")
            return [rows.pop(unit) for unit in asked]

        tasks = Tasks(job.grown(), job.limits, carry_out, first)
        yield tasks, store.folder
