"""The cells of the torture test: which runs there are, and their results; the matrix of all cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, Self

from rig.analysis.pool import Arrays, Progress, Work, carry_out, packed, temporary, unpacked
from rig.analysis.pool.kernel_shapes import Shape, prepare, shape
from rig.errors import NumericsError
from rig.model.method import as_integrated, chosen
from rig.printable import counted
from rig.qualify.torture import case as cases
from rig.qualify.torture.case import Case, Watched, changed, watched
from rig.qualify.torture.recorded_run import processes, recording
from rig.qualify.torture.results import FAULTS, CellResult, OutOfTime, RunOutcome, fault, judge, red
from rig.qualify.torture.trial import Trial
from rig.scenes.scene import Scene
from rig.stability.report import stability_report

METHODS = ("exact", "dopri5", "rosenbrock", "rk4", "kick", "smooth")
"""Methods of the solver."""
FINER = 4  # refinement of the step of the reference
TIGHT = 1e-10  # tolerance of the reference
COUNTED = ("ticks", "opened", "trials", "energy", "stuck", "measurements")
NEAR = 0.01  # relative tolerance of a growth rate: the precision of the sources
QUICK = {
    "rk4": (Shape(3, False, True, False), Shape(3, True, True, False), Shape(5, False, True, False)),
    "rosenbrock": (Shape(3, True, False, False, implicit=True), Shape(5, True, False, False, implicit=True)),
    "smooth": (Shape(3, True, False, False), Shape(5, True, False, False)),
}
"""Kernels that these are compiled for in the quick matrix; the full one compiles what it needs."""


@dataclass(frozen=True)
class Cell:
    """One case with one method and step. `default`: the method of the scene, "auto" if it states none.

    `speed`: real-time factor of the plant and its sensors, in processor time; None if no run was measured.
    """

    case: str
    method: str
    step: float
    default: bool
    result: CellResult
    seconds: float
    counts: dict[str, float]
    speed: float | None = None

    @property
    def good(self) -> bool:
        """Whether the default is green; other methods may fail."""
        return not self.default or self.result.colour == "green"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        raw = {**asdict(self), **asdict(self.result), "verdict": None}  # the field of earlier versions
        del raw["result"]
        return raw

    @classmethod
    def of(cls, raw: dict[str, Any]) -> Self:
        """Return the cell of `dataclasses.asdict`."""
        return cls(**{**raw, "result": CellResult(**raw["result"])})


def needed() -> Iterator[Scene]:
    """Yield scenes that together need all kernels of the quick matrix."""
    for name in cases.names():
        case = cases.load(name)
        if case.quick:
            for variant in cases.of_scenes(case, True):
                yield from kernel_scenes(variant, True)


def kernel_scenes(case: Case, quick: bool) -> Iterator[Scene]:
    """The scenes of a case that are not refused."""
    for _, scene in _planned(case, quick):
        system = scene.assemble().system()
        try:
            as_integrated(system, chosen(scene.clock.method, system), scene.clock.smoothing)
        except ValueError:
            continue
        yield scene
    if case.processes:
        yield changed(case)


def _planned(case: Case, quick: bool, methods: Sequence[str] = METHODS) -> Iterator[tuple[str, Watched]]:
    """The methods of a case, each with its scene, step by step; the default is always included."""
    if _by_name(case):
        return
    own = cases.own_method(case)
    for step in case.steps[: 2 if quick else None]:
        system = watched(case, own, step).assemble().system()
        default = chosen(own, system)
        for method in METHODS if default in METHODS else (default, *METHODS):
            if method not in methods and method != default:
                continue
            if method == "kick" and method != default:
                continue  # for a film, which no other method follows
            if method in ("exact", "dopri5") and method != default and (system.linear or not quick):
                continue  # dopri5 leaves what is linear to exact; exact refuses the rest
            if method == "rosenbrock" and system.linear:
                continue
            scene = watched(case, own if method == default else method, step)
            if not quick or method == default or method not in QUICK or shape(scene) in QUICK[method]:
                yield method, scene


def _by_name(case: Case) -> bool:
    return case.expect.growth is not None or case.expect.jams or bool(case.expect.refused)


def cells(case: Case, quick: bool, methods: Sequence[str] = METHODS) -> Iterator[Cell]:
    """Compute the cells of one case, with the default method and with `methods`."""
    until = case.quick_duration if quick and case.quick_duration is not None else case.duration
    seconds = case.seconds if quick else 20.0 * case.seconds
    if _by_name(case):
        yield _alone(case, "report", lambda: _named(case))
    elif case.expect.stops:
        yield _alone(case, "stop", lambda: _stops(case, until, seconds))
    else:
        reference = _reference(case, until, seconds)
        for method, scene in _planned(case, quick, methods):
            yield _cell(case, method, scene, until, seconds, reference)
        if case.processes:
            yield _alone(case, "processes", lambda: processes(case, until))


def _alone(case: Case, kind: str, result: Callable[[], CellResult]) -> Cell:
    """The one cell of a kind that a case has."""
    try:
        of_kind = result()
    except FAULTS as error:
        of_kind = fault(error)
    return Cell(case.name, kind, case.steps[0] * 1e-9, True, of_kind, 0.0, {})


def _named(case: Case) -> CellResult:
    """The result of a case that physics or its step makes unstable: green if the stability report names the reason."""
    expect = case.expect
    scene = watched(case, "auto", case.steps[0])
    system = scene.assemble().system()
    report = stability_report(system, chosen("auto", system), scene.step_ns * 1e-9)
    errors = [finding for finding in report if finding.level == "error"]
    if not errors:
        return red("missed event", "this is physically unstable, and the stability report does not say so")
    named = expect.refused or ("jam" if expect.jams else "")
    for finding in errors:
        if named:
            expected = named in finding.what
        else:
            expected = abs(finding.number / (expect.growth or 1.0) - 1.0) < NEAR
        if expected:
            return CellResult("green", "", f"named: {finding.what}")
    wanted = expect.refused or ("jamming" if expect.jams else f"a growth of {expect.growth:g} 1/s")
    return red("refused", f"{errors[0].what}; expected {wanted}")


def _stops(case: Case, until: int, seconds: float) -> CellResult:
    """The result of a case that must end early: green if the run stops with the expected reason."""
    try:
        Trial(case, watched(case, "auto", case.steps[0]), until, seconds).run()
    except NumericsError as error:
        result = fault(error)
        return CellResult("green", "", f"stopped {result.detail}") if case.expect.stops in error.what else result
    return red("missed event", f"continues where it should stop: {case.expect.stops}")


def _reference(case: Case, until: int, seconds: float) -> RunOutcome | CellResult:
    """A run with a finer step and a tight tolerance, or why there is none."""
    finest = min(case.steps)
    step = finest // FINER if finest % FINER == 0 else finest
    try:
        reference_run = Trial(case, watched(case, "auto", step, TIGHT), until, 4.0 * seconds).run()
    except FAULTS as error:
        result = fault(error)
        return replace(result, detail=f"the reference {result.detail}") if isinstance(error, OutOfTime) else result
    expected = case.expect.events
    if expected is not None and until == case.duration and reference_run.count != expected:
        text = f"the reference has {counted(reference_run.count, 'event')}; {case.expect.source} gives {expected}"
        return red("missed event" if reference_run.count < expected else "chatter", text)
    return reference_run


def _cell(
    case: Case, method: str, scene: Watched, until: int, seconds: float, reference: RunOutcome | CellResult
) -> Cell:
    default = scene.clock.method == cases.own_method(case)
    spent = 0.0
    speed = None
    counts: dict[str, float] = {}
    try:
        if isinstance(reference, CellResult):
            result = reference
        else:
            outcome = Trial(case, scene, until, seconds).run()
            result = judge(case, outcome, reference, scene.step_ns * 1e-9)
            if default and result.colour == "green":
                result = recording(case, scene, until) or result
            spent = outcome.seconds
            simulated = outcome.ticks * scene.step_ns * 1e-9
            speed = simulated / outcome.carrying if simulated else None
            counts = {"events": outcome.count} | {name: getattr(outcome, name) for name in COUNTED}
    except FAULTS as error:
        result = fault(error)
        if isinstance(error, OutOfTime):
            spent = seconds
        if result.reason == "refused" and not default:
            result = replace(result, colour="amber")
    return Cell(case.name, method, scene.step_ns * 1e-9, default, result, spent, counts, speed)


def matrix(
    names: Iterable[str],
    quick: bool,
    report: Callable[[str], object] | None = None,
    progress: Progress | None = None,
    workers: int | None = None,
) -> list[Cell]:
    """Compute all cells of the cases `names`, the reference of each run first.

    Missing kernels are compiled before the first cell; `report` gets a line for each. `progress` counts cases.
    `workers`: processes, one for each core by default.
    """
    variants: list[Case] = []
    for name in names:
        variants += cases.of_scenes(cases.load(name), quick)
    work = Work(partial(_cells, quick), variants)
    prepare((scene for case in variants for scene in kernel_scenes(case, quick)), report)
    with temporary(work) as store:
        by_unit = carry_out(work, store, workers, progress)
    return [Cell.of(raw) for unit in sorted(by_unit) for raw in unpacked(by_unit[unit])]


def _cells(quick: bool, case: Case) -> Arrays:
    return packed([asdict(cell) for cell in cells(case, quick)])
