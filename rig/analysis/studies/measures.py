"""The measures of a point: of the limit cycle (rig cycle), of the plant's motion (rig cost), of the whole run, or own.

cycle.NAME      period, frequency, multiplier, energy; amplitude, lowest, highest of an output; stick_share, stick_time
                of a contact: the limit cycle of the plant with actuators held
motion.NAME     period, frequency, growth_rate, friction_power, energy_per_cycle; amplitude, rms of an output;
                stick_share of a contact: the plant from its start with actuators held
                (rig.analysis.cycles.motion_measures); slides: 1 if it comes to slide from its start, 0 if it vibrates
modes.NAME      growth, frequency of the least stable mode of steady sliding; growing: number of modes that grow. With
                them, of a reduced structure, error: the largest estimated relative error of an eigenvalue, and outside:
                1 outside of the range that the reduction holds for, else 0
loop.growth     growth of the least stable mode with all controllers closed, each with what it believes of the rig
run.NAME        rms, mean, lowest, highest, final, amplitude, frequency of an output or sensor; first_opening: the run
                of the scene with its sensors, controllers and protocol
FILE.py:NAME    a function of the Run: returns a number, or a number and its unit

An output or contact is added with a dot, cycle.amplitude.velocity; without one it is the first of the rig.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.cycle import limit_cycle, slides
from rig.analysis.cycles.motion_measures import observe, of, of_cycle, problem
from rig.analysis.linear.all_loops import closed_rates
from rig.analysis.linear.eigenvalue_curves import equilibrium, none
from rig.analysis.linear.modes import dithers
from rig.analysis.pool import Arrays
from rig.analysis.recorded.amplitude import index
from rig.analysis.studies.functions import Function, function_of
from rig.bench.run.simulate import simulate
from rig.errors import NumericsError, RigError, SceneError
from rig.model.assembly import portrait
from rig.quantities import run_length_ns
from rig.record.run import Run
from rig.record.statistics import first_opening
from rig.scenes.faults import near, shortened
from rig.scenes.scene import Scene
from rig.units import brief, si

_CYCLE = {"period": "s", "frequency": "Hz", "multiplier": "1", "energy": "J"}
_MOTION = {
    "period": "s",
    "frequency": "Hz",
    "growth rate": "1/s",
    "friction power": "W",
    "energy per cycle": "J",
}
_MODES = {"growth": "1/s", "frequency": "Hz", "growing": "1"}
_REDUCED = ("error", "outside")  # of the eigenvalues of a reduced structure
_OF_OUTPUT = ("amplitude", "lowest", "highest")
_OF_CONTACT = {"stick_share": "1", "stick_time": "s"}
_HOW: dict[str, Callable[[NDArray[Any]], Any]] = {
    "rms": np.std,
    "mean": np.mean,
    "lowest": np.min,
    "highest": np.max,
    "final": lambda v: v[-1],
}
_OF_RUN = (*_HOW, "amplitude", "frequency")
LOOP = "loop"
SLIDES = "slides"
_LONG = 300  # characters of a reason


@dataclass(frozen=True)
class Measure:
    """A measure: `name` as its user wrote it; `source` (cycle, motion, modes, loop, run; "" for a function), `kind` of
    number, `of` which output, sensor or contact. `unit`: "" if it is known with the value only.
    """

    name: str
    source: str
    kind: str = ""
    of: str = ""
    unit: str = ""
    function: Function | None = None

    @property
    def of_run(self) -> bool:
        """Whether it is a number of the whole run, with protocol, sensors and controllers."""
        return self.source in ("run", "")

    @property
    def has_controllers(self) -> bool:
        """Whether the controllers of the scene act in it."""
        return self.of_run or self.source == LOOP


def measures(scene: Scene, given: Iterable[str | Callable[[Run], Any]]) -> tuple[Measure, ...]:
    """Return the measures of a study by name or function, then the errors of eigenvalues that are among them.

    Raises SceneError with every fault.
    """
    if not isinstance(given, Iterable):
        raise SceneError(scene.name, [f"measure = {brief(given)}: expected a list of names and functions"])
    known = {each.name: each for each in _known(scene)}
    given = list(given)
    wanted = []
    faults = []
    for measure in given:
        if not (callable(measure) or isinstance(measure, str)):
            faults.append(f"measure {measure!r:.60}: expected a name, FILE.py:FUNCTION or a function of a Run")
        elif callable(measure) or ".py:" in measure:
            try:
                function = function_of(measure)
                wanted.append(Measure(function.name, "", function=function))
            except RigError as fault:
                faults.append(f"measure {fault}")
        elif measure in known:
            wanted.append(known[measure])
        else:
            faults.append(f"measure {shortened(measure)}: unknown; {near(measure, known, 'docs/studies.md')}")
    for name, count in sorted(Counter(each.name for each in wanted).items()):
        if count > 1:
            faults.append(f"measure {name}: is given twice")
    if not given:
        faults.append("no measure is given; such as cycle.amplitude, run.rms, or a function of a Run")
    if faults:
        raise SceneError(scene.name, faults)
    if any(each.source == "modes" for each in wanted):
        beside = [f"modes.{kind}" for kind in _REDUCED]
        wanted += [known[name] for name in beside if name in known]
    return tuple(dict.fromkeys(wanted))


def _known(scene: Scene) -> Iterator[Measure]:
    """Every measure of a scene that needs no function."""
    assembly = scene.assemble()
    units = {name: output.unit for name, output in assembly.outputs.items()}
    contacts = [patch.name for patch in assembly.system().patches]
    sensors = {name: section.delivers for name, section in scene.sensors.items()}
    lead = (portrait(assembly.outputs) or ("",))[0] or next(iter(units), "")
    for kind, unit in _CYCLE.items():
        yield Measure(f"cycle.{kind}", "cycle", kind, unit=unit)
    for kind, unit in _MOTION.items():
        yield Measure(f"motion.{kind.replace(' ', '_')}", "motion", kind, unit=unit)
    if contacts:
        yield Measure("motion.slides", "motion", SLIDES, unit="1")
    for kind, unit in (_MODES | dict.fromkeys(_REDUCED if assembly.accuracy else (), "1")).items():
        yield Measure(f"modes.{kind}", "modes", kind, unit=unit)
    if scene.controllers:
        yield Measure("loop.growth", LOOP, "growth", unit="1/s")
    parts: list[tuple[str, str, dict[str, str], str]] = [("cycle", kind, units, lead) for kind in _OF_OUTPUT]
    parts += [("motion", kind, units, lead) for kind in ("amplitude", "rms")]
    parts += [("run", kind, {**sensors, **units}, lead) for kind in _OF_RUN]
    if contacts:
        parts += [("cycle", kind, dict.fromkeys(contacts, unit), contacts[0]) for kind, unit in _OF_CONTACT.items()]
        parts += [("motion", "stick share", dict.fromkeys(contacts, "1"), contacts[0])]
    for source, kind, names, first in parts:
        for name, unit in names.items():
            unit = "Hz" if kind == "frequency" else unit
            text = f"{source}.{kind.replace(' ', '_')}"
            yield Measure(f"{text}.{name}", source, kind, name, unit)
            if name == first:
                yield Measure(text, source, kind, name, unit)
    yield Measure("run.first_opening", "run", "first_opening", unit="s")


def evaluate(scene: Scene, wanted: Sequence[Measure], duration: float | None) -> Arrays:
    """Compute the measures of one point: `values` in their order, with `units`, and the `reason` of those that are
    missing (nan), such as a fault of its simulation.

    `duration` [s] of the run; None: as long as its protocol.
    """
    rows: dict[str, tuple[float, str, str]] = {}
    sources: dict[str, Callable[[Scene, Sequence[Measure]], Iterator[tuple[float, str, str]]]]
    sources = {"cycle": _of_cycle, "motion": _of_motion, "modes": _of_modes, LOOP: _of_loop}
    sources["run"] = partial(_of_run, duration)
    for source, compute in sources.items():
        some = [measure for measure in wanted if (measure.source or "run") == source]
        if not some:
            continue
        try:
            rows |= {measure.name: row for measure, row in zip(some, compute(scene, some))}
        except RigError as fault:
            why = fault.what if isinstance(fault, NumericsError) else " ".join(str(fault).split())
            rows |= {measure.name: (math.nan, measure.unit, why) for measure in some}
    values = []
    units = []
    reasons = []
    for measure in wanted:
        value, unit, why = rows[measure.name]
        values.append(value)
        units.append(unit)
        if not math.isfinite(value):
            reasons.append(why or f"{measure.name} is {value}")
    return as_point(values, units, "; ".join(dict.fromkeys(reasons))[:_LONG])


def as_point(values: Sequence[float], units: Sequence[str], reason: str) -> Arrays:
    """Return the values of a point with units and the reason of missing ones as the result of a unit of work."""
    return {"values": np.array(values), "units": np.array(units), "reason": np.array(reason)}


def one_unit(values: Sequence[float], units: Sequence[str]) -> tuple[NDArray[np.float64], str]:
    """Return the values of a measure at all points in one unit, that of the first value, and this unit.

    nan where the unit does not convert to it.
    """
    unit = next((text for text, value in zip(units, values) if text and math.isfinite(value)), "1")

    def converted(value: float, text: str) -> float:
        if text == unit or not math.isfinite(value):
            return value
        try:
            return si(f"{value!r} {text}", unit)
        except ValueError:
            return math.nan

    return np.array([converted(value, text or "1") for value, text in zip(values, units)]), unit


def _of_cycle(scene: Scene, some: Sequence[Measure]) -> Iterator[tuple[float, str, str]]:
    cycle = limit_cycle(scene)
    for measure in some:
        if not cycle.found:
            yield math.nan, measure.unit, cycle.why
        elif measure.kind in ("lowest", "highest"):
            yield cycle.extremes[measure.of][measure.kind == "highest"], measure.unit, ""
        elif measure.kind == "energy":
            yield cycle.energy["friction"], measure.unit, ""
        else:
            value = getattr(cycle, measure.kind)
            yield float(value[measure.of] if measure.of else value), measure.unit, ""


def _of_motion(scene: Scene, some: Sequence[Measure]) -> Iterator[tuple[float, str, str]]:
    values: dict[str, float] = {}
    fault = ""
    without = ""
    if any(measure.kind != SLIDES for measure in some):
        asked = problem(scene, work=math.inf)
        if asked.period:
            values = of_cycle(asked)
        else:
            seen = observe(asked, of(asked.scene, asked.system))
            values = seen.values
            fault = seen.fault
            without = f", which is a motion of kind {asked.kind}: {asked.why}"
    for measure in some:
        if measure.kind == SLIDES:
            ends, why = slides(scene)
            yield math.nan if ends is None else float(ends), measure.unit, why
            continue
        value = values.get(f"{measure.kind} {measure.of}".strip(), math.nan)
        missing = "" if math.isfinite(value) else f"no {measure.name}{without}"
        yield value, measure.unit, fault or missing


def _of_modes(scene: Scene, some: Sequence[Measure]) -> Iterator[tuple[float, str, str]]:
    spectrum = equilibrium(scene, bool(dithers(scene, "")))
    values: dict[str, float] = {}
    why = spectrum.why or spectrum.note
    if spectrum.counts:
        rates = spectrum.rates
        grow = (rates.real > none(rates)) & (rates.imag >= 0.0)
        values["growth"] = rates[0].real
        values["frequency"] = abs(rates[0].imag) / (2.0 * math.pi)
        values["growing"] = grow.sum()
        if spectrum.errors and any(each.kind == "error" for each in some):
            errors = spectrum.errors()
            if np.isfinite(errors).any():
                values["error"] = np.nanmax(errors)
        values["outside"] = bool(spectrum.outside)
        why = "errors of the eigenvalues are not estimated: the files of the matrices are not there"
    for measure in some:
        value = float(values.get(measure.kind, math.nan))
        yield value, measure.unit, why if math.isnan(value) else ""


def _of_loop(scene: Scene, some: Sequence[Measure]) -> Iterator[tuple[float, str, str]]:
    rates = closed_rates(scene)
    for measure in some:
        yield float(rates[0].real), measure.unit, ""


def _of_run(duration: float | None, scene: Scene, some: Sequence[Measure]) -> Iterator[tuple[float, str, str]]:
    own = any(measure.function is not None for measure in some)  # it may read the summary
    run = simulate(scene, duration_ns=run_length_ns(duration), audited=own)
    stopped = run.fault.partition("\n")[0]
    for measure in some:
        if stopped:
            yield math.nan, measure.unit, stopped
        elif measure.function is not None:
            yield measure.function.value(run if len(some) == 1 else _copied(run))
        elif measure.kind == "first_opening":
            opened = first_opening(run)
            if opened is None:
                yield math.nan, measure.unit, "no point opens"
            else:
                yield opened, measure.unit, ""
        else:
            value, why = _number(run, measure)
            yield value, measure.unit, f"{measure.name}: {why}" if why else ""


def _copied(run: Run) -> Run:
    """The run with arrays of its own: a function may change them in place, and other measures are computed after it."""
    signals = {name: v.copy() for name, v in run.signals.items()}
    measured = {name: samples._replace(v=samples.v.copy()) for name, samples in run.measurements.items()}
    return replace(run, signals=signals, measurements=measured)


def _number(run: Run, measure: Measure) -> tuple[float, str]:
    """A number of an output or a sensor of a run; if it is missing (nan), the reason."""
    samples = run.measurements.get(measure.of)
    v = run.signals[measure.of] if samples is None else samples.v
    if measure.kind in ("amplitude", "frequency"):
        t = run.time if samples is None else np.asarray(samples.t_ns * 1e-9, dtype=np.float64)
        cycles = index(t, v)
        value = cycles.half if measure.kind == "amplitude" else cycles.frequency
        return value, cycles.why if math.isnan(value) else ""
    known = v[np.isfinite(v)]
    if not known.size:
        return math.nan, "no finite sample"
    return float(_HOW[measure.kind](known)), ""
