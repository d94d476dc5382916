"""One scene simulated with many seeds: the spread of its numbers where randomness matters.

The numbers of one run:

first opening                         of a contact of many points; if there is one, the other numbers begin there
mean, least contact_fraction          range pressure_centre_x
rms OUTPUT, rms meas/SENSOR           about the mean
band meas/SENSOR                      RMS in octaves
amplitude, frequency                  of periodic outputs (rig.analysis.recorded), for rigs without such points
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.pool import Arrays, carry_out, packed, temporary, unpacked
from rig.analysis.recorded.amplitude import index
from rig.analysis.recorded.series import series, vibration
from rig.analysis.recorded.spectrum import welch
from rig.analysis.studies.runs import Plan, StudyRuns, check_length, check_random, random_parts
from rig.bench.run.simulate import simulate
from rig.errors import UsageError
from rig.printable import columns
from rig.quantities import run_length_ns, whole
from rig.record.run import Run
from rig.record.run_data import bridge
from rig.record.statistics import OPENINGS, first_opening, statistics, whole_signals
from rig.results import Result
from rig.scenes.scene import Scene

ONSET = "first opening"
_WINDOW = 1024  # samples of a window of the spectrum
_WINDOWS = 4  # fewest windows
_STILL = 1e-9  # of the size of an output: below this it does not move


class Number(NamedTuple):
    """A number and its unit."""

    value: float
    unit: str


@dataclass(frozen=True)
class Seen:
    """The numbers of one run by name; density `s` of signal `name` at `f` [Hz], empty if the run is too short."""

    seed: int
    seconds: float
    numbers: dict[str, Number]
    name: str = ""
    unit: str = ""
    f: tuple[float, ...] = ()
    s: tuple[float, ...] = ()
    fault: str = ""
    """Why the run stopped: diverged numerics or a limit."""

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self) | {"numbers": {name: list(number) for name, number in self.numbers.items()}}

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Seen:
        """Return the run of `to_json`."""
        numbers = {name: Number(*number) for name, number in raw["numbers"].items()}
        return cls(**{**raw, "numbers": numbers, "f": tuple(raw["f"]), "s": tuple(raw["s"])})


def measure(run: Run, seed: int) -> Seen:
    """Compute the numbers of a run."""
    numbers: dict[str, Number] = {}
    opened, begin = first_opening(run), 0.0
    if opened is not None:
        numbers[ONSET], begin = Number(opened, "s"), opened
    numbers |= {number.name: Number(number.value, number.unit) for number in statistics(run, begin)}
    if OPENINGS not in run.signals:
        for name in whole_signals(run):
            v = run.signals[name]
            if np.ptp(v) > _STILL * float(np.abs(v).max(initial=0.0)) and (cycles := index(run.time, v)).cycles:
                numbers[f"amplitude {name}"] = Number(cycles.half, run.units.get(name, ""))
                numbers[f"frequency {name}"] = Number(cycles.frequency, "Hz")
    name, unit, f, s = _density(run, begin)
    stopped = "" if run.summary.get("ended") in ("done", None) else str(run.summary["ended"])
    return Seen(seed, float(run.time[-1]), numbers, name, unit, f, s, run.fault.partition("\n")[0] or stopped)


def _density(run: Run, begin: float) -> tuple[str, str, tuple[float, ...], tuple[float, ...]]:
    """Name, unit, frequencies [Hz] and power spectral density of the default vibration signal."""
    try:
        signal = series(run, vibration(run), begin)
    except UsageError:  # nothing vibrates, or less than two samples are left
        return "", "", (), ()
    if signal.v.size < _WINDOWS * _WINDOW:
        return "", "", (), ()
    density = welch(bridge(signal.v)[0], signal.rate, _WINDOW)
    return signal.name, signal.unit, tuple(density.f.tolist()), tuple(density.s.tolist())


class Spread(NamedTuple):
    """One number over `runs` runs, in `unit`."""

    name: str
    unit: str
    runs: int
    median: float
    least: float
    greatest: float


@dataclass(frozen=True)
class Repeats(Result):
    """Runs of one scene with `seeds`: its `random` parts, the numbers `seen` in each run, the reason why they `ended`
    early.

    `ended` is empty if every seed was simulated.
    """

    FIGURE: ClassVar = "rig.analysis.figures:repeats_figure"

    scene: str
    random: tuple[str, ...]
    seeds: tuple[int, ...]
    seen: tuple[Seen, ...]
    ended: str = ""

    @property
    def spreads(self) -> tuple[Spread, ...]:
        """The spread of every number, in the order of the first run that has it."""
        units = {name: number.unit for run in self.seen for name, number in run.numbers.items()}
        values = ((name, self.values(name)) for name in units)
        return tuple(Spread(name, units[name], len(v), float(np.median(v)), min(v), max(v)) for name, v in values)

    def values(self, name: str) -> list[float]:
        """Return a number of every run that has it, in the order of the seeds."""
        return [run.numbers[name].value for run in self.seen if name in run.numbers]

    @property
    def opened(self) -> int:
        """Number of runs in which a contact point opened after all were closed."""
        return len(self.values(ONSET))

    def text(self) -> str:
        """Return the report as text."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        count = len(self.seen)
        seeds = f"seeds {self.seeds[0]} to {self.seeds[-1]}"
        done = f"{count} of {len(self.seeds)} runs ({self.ended})" if self.ended else f"{count} runs"
        yield f"{self.scene}: {done}, {seeds}; random: {', '.join(self.random)}"
        if not count:
            return
        chaotic = any("contact_fraction" in name for run in self.seen for name in run.numbers)
        if chaotic:
            yield f"  a contact point opened in {self.opened} of {count} runs"
            if self.opened:
                yield "  the other numbers are from the first opening to the end, where the motion is chaotic"
        for run in self.seen:
            if run.fault:
                yield f"  seed {run.seed} stopped at t = {run.seconds:g} s: {run.fault}"
        yield ""
        rows = [("number", "median", "least", "greatest", "unit", "runs")]
        for s in self.spreads:
            rows.append((s.name, f"{s.median:.5g}", f"{s.least:.5g}", f"{s.greatest:.5g}", s.unit, str(s.runs)))
        yield from columns(rows, "<>>><>")

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "scene": self.scene,
            "random": list(self.random),
            "seeds": list(self.seeds),
            "ended": self.ended,
            "runs": [run.to_json() for run in self.seen],
            "spread": [run._asdict() for run in self.spreads],
        }


@dataclass(frozen=True)
class SeedRuns(StudyRuns):
    """A study of one point, run with many seeds, with all numbers of each run."""

    @property
    def of_run(self) -> bool:
        """A point is a whole run."""
        return True

    def compute(self, unit: int, *given: float) -> Arrays:
        """Compute the numbers of the run with a seed."""
        scene = self.scene_of(unit)
        run = simulate(scene, duration_ns=run_length_ns(self.duration), audited=False)
        return packed(measure(run, scene.seed).to_json())

    def failed(self, unit: int, why: str) -> Arrays:
        """Return a run without numbers."""
        return packed(Seen(self.plan.seed_of(unit), 0.0, {}, fault=why).to_json())


def repeat(
    scene: Scene,
    count: int,
    duration: float | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], object] = lambda done, total: None,
    stop: Callable[[], str] = lambda: "",
) -> Repeats:
    """Simulate `scene` with `count` seeds, its own and the following ones, and return the spread of its numbers.

    `duration` [s]: by default the length of the protocol. `workers`: processes, one for each core by default. `stop`:
    called at least ten times a second; a text from it ends the work and is the reason. Finished runs are reported.
    Raises UsageError for fewer than two runs, and for a scene in which nothing is random; SceneError as a run does.
    """
    if whole("count", count, 0, 10**6) < 2:
        raise UsageError(f"{count} runs have no spread: at least 2 are needed")
    check_random(scene, f"all {count} runs")
    check_length(scene, duration)
    work, ended = SeedRuns(scene, Plan((), 1, "random", count, scene.seed), (), duration).work, ""

    def watch(done: int, total: int) -> None:
        progress(done, total)
        if why := stop():
            raise _Stopped(why)

    with temporary(work) as store:
        try:
            runs = carry_out(work, store, workers, watch, apart=True)
        except _Stopped as stopped:
            runs, ended = store.load(), str(stopped)
    seen = tuple(Seen.from_json(unpacked(runs[unit])) for unit in sorted(runs))
    seeds = tuple(range(scene.seed, scene.seed + count))
    return Repeats(scene.name, random_parts(scene), seeds, seen, ended)


class _Stopped(Exception):
    """The work ends early, for the stated reason."""
