"""A measurement beside its simulation: a scene runs under the measured speed and load; both are evaluated alike.

The actuators of the scene follow channels of the measurement (protocol step `follow`); others keep the value of the
scene. Simulated channels are read at the instants of the measured ones and have their names, so that every measure is
computed by the same code with the same settings on both.

    mean, RMS (about the mean)
    strongest frequency of the spectrum, at least half of that of the cycles; RMS in the octave about the measured one
    period, amplitude (half)         medians over the cycles, from event to event
    stick and motion time, breakaway and re-stick force, largest slip speed, share of stick      (stick_slip)

An event is the begin of a slip, or, without `stick`, the passage of the channel through its middle. Pictures are
aligned by events: the first one of both at one time, and cycles over their phase.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.recorded.amplitude import rises
from rig.analysis.recorded.comparison import Measure
from rig.analysis.recorded.density import Density
from rig.analysis.recorded.series import scene_name, series
from rig.analysis.recorded.spectrum import spectrum
from rig.analysis.recorded.stick_slip import StickSlip, stick_slip
from rig.bench.run.simulate import simulate
from rig.errors import Faults, UsageError
from rig.quantities import finite
from rig.record.run import Reals, Run, Samples
from rig.record.run_data import MEASURED, signals, unknown
from rig.record.track import followed, samples
from rig.results import Column, Result, Table
from rig.scenes import checks, rooms
from rig.scenes.protocol import STEPS, Track, flat, recorded
from rig.scenes.scene import Scene
from rig.units import same_unit

_PHASES = 100  # of a cycle, at which cycles are compared
_FEWEST = 3  # cycles
_LOAD = "normal_force"  # the output of plants with a load
_LOBE = 2  # lines of a Hann window beside its middle
_OCTAVE = math.sqrt(2.0)  # from the middle of an octave to its ends
_STILL = 0.01  # times the RMS: a mean below it is zero


class Cycles(NamedTuple):
    """Cycles from event to event: `begins` [n + 1, s], and over phases 0 to 1 the median and outer tenths."""

    begins: Reals
    middle: Reals
    low: Reals
    high: Reals
    amplitude: float
    """Median of half the distance from peak to valley."""

    @property
    def period(self) -> float:
        """Median [s]."""
        return float(np.median(np.diff(self.begins)))


class Pair(NamedTuple):
    """A measured channel and the simulated one at the same instants [n]; cycles None with less than three."""

    channel: str
    simulated_as: str
    unit: str
    t: Reals
    measured: Reals
    simulated: Reals
    cycles: tuple[Cycles, Cycles] | None


@dataclass(frozen=True)
class AgainstScene(Result):
    """The result of `against_scene`. Deviations are of the simulation from the measurement."""

    FIGURE: ClassVar = "rig.analysis.recorded.comparison_figures:against_scene_figure"

    recording: str
    scene: str
    begin: float
    end: float
    followed: Mapping[str, str]
    """Actuator -> channel of the measurement."""
    constant: Mapping[str, tuple[float, str]]
    """Actuator -> value and unit, of those that follow none."""
    measures: tuple[Measure, ...]
    pairs: tuple[Pair, ...]
    stick: tuple[StickSlip, StickSlip] | None
    notes: tuple[str, ...]
    run: Run = field(compare=False)
    """The simulation."""

    def within(self, tolerance: float) -> bool:
        """Whether no measure deviates by more than this share of its measured value."""
        return all(measure.same or abs(measure.percent) <= 100.0 * tolerance for measure in self.measures)

    def facts(self) -> dict[str, Any]:
        """Return what follows what, and the measures."""
        return {
            "recording": self.recording,
            "scene": self.scene,
            "from": self.begin,
            "to": self.end,
            "follows": dict(self.followed),
            "constant": {name: value for name, (value, _) in self.constant.items()},
            "pairs": {pair.channel: pair.simulated_as for pair in self.pairs},
            "measures": [{"percent": measure.percent} for measure in self.measures],  # not rounded
            "notes": list(self.notes),
        }

    def shown(self) -> Iterator[str | Table]:
        """Yield what follows what, and the measures."""
        yield f"{self.recording} against {self.scene}, {self.begin:g} to {self.end:g} s"
        ways = [f"{name} follows {channel}" for name, channel in self.followed.items()]
        ways += [f"{name} is {value:g} {unit}" for name, (value, unit) in self.constant.items()]
        yield from [f"  {', '.join(ways)}"] if ways else []
        yield from (f"  {pair.channel}: simulated as {pair.simulated_as}" for pair in self.pairs)
        yield from (f"  {note}" for note in self.notes)
        columns = (
            Column("channel"),
            Column("measure"),
            Column("measured", digits=".5g"),
            Column("simulated", digits=".5g"),
            Column("unit"),
            Column("percent", digits="+z.3g"),
        )
        rows = [(m.channel, m.name, m.first, m.second, m.unit, round(m.percent, 6)) for m in self.measures]
        yield Table("measures", columns, rows)


def against_scene(
    run: Run,
    scene: Scene,
    begin: float = 0.0,
    end: float = math.inf,
    follow: Mapping[str, str] | None = None,
    pair: Mapping[str, str] | None = None,
    stick: Mapping[str, Any] | None = None,
) -> AgainstScene:
    """Simulate `scene` under the speed and load of the measurement `run`, and compare both from `begin` to `end` [s].

    `follow`: actuator -> channel; by default the speed of the drive and the load follow channels that have the name of
    the actuator (`drive_speed`), of its output or of a sensor of this output. A scene that follows a recording by its
    own protocol keeps it. `pair`: channel -> "SIMULATED" or "SIMULATED, FACTOR", such as "displacement, 168 N/m"; by
    default channels of equal names. `stick`: arguments of `stick_slip`, for its measures. The simulation begins at the
    first sample of the measurement. Raises UsageError.
    """
    if run.span is None:
        raise UsageError("the recording has no samples")
    start, last = run.span
    follows = any(map(recorded, flat(scene.protocol)))
    ways: dict[str, str] = {}
    moved = scene
    duration_ns = None
    if not follows:
        ways = dict(follow) if follow else _default(run, scene)
        moved = replace(scene, protocol=_protocol(run, scene, ways) if ways else ())
        duration_ns = max(round((last - start) * 1e9), scene.frame_ns)
    simulated = simulate(moved, duration_ns=duration_ns)
    notes = [step.file.about.get("note", "") for step in flat(moved.protocol) if recorded(step)]
    notes += [f"the simulation is not complete: {simulated.fault}"] if simulated.fault else []
    begin = max(begin, start)
    end = min(end, start + (simulated.span[1] if simulated.span else 0.0))
    if begin >= end:
        raise UsageError(f"the time span is empty; the recording has {start:g} to {last:g} s")
    pairs = _pairs(run, simulated, pair or {}, set(ways.values()))
    named = [stick.get(role, "") for role in ("velocity", "friction", "drive", "load")] if stick else []
    known = {*pairs, *ways.values(), ""}
    lost = [name for name in named if isinstance(name, str) and name not in known]
    if lost:
        raise UsageError(
            f'{", ".join(lost)}: the simulation has no such channel; pair it: --pair "{lost[0]} = SIMULATED"'
        )
    mirrored = _mirrored(run, simulated, pairs, ways, start)
    slips: tuple[StickSlip, StickSlip] | None = None
    if stick:
        first, second = (stick_slip(of, **stick, first=begin, last=end) for of in (run, mirrored))
        slips = (first, second)
        for which, count in (("measured", first.spikes), ("simulated", second.spikes)):
            if count:
                notes.append(f"{count} samples of the {which} force are replaced (spikes)")
        notes += [f"measured: {doubt}" for doubt in first.doubts]
        notes += [f"simulated: {doubt}" for doubt in second.doubts]
    evaluated = [_evaluated(run, mirrored, name, told, begin, end, slips) for name, (told, _, _) in pairs.items()]
    constant = {name: (i.value, i.unit) for name, i in scene.assemble().inputs.items() if name not in ways}
    measures = [measure for result in evaluated for measure in _measures(run, mirrored, result, begin, end)]
    if slips:
        measures += _stick_measures(*slips)
    return AgainstScene(
        scene_name(run),
        scene.name,
        begin,
        end,
        ways,
        {} if follows else constant,
        tuple(measures),
        tuple(evaluated),
        slips,
        tuple(filter(None, notes)),
        simulated,
    )


def _default(run: Run, scene: Scene) -> dict[str, str]:
    """Which actuators follow which channels, by their names."""
    assembly = scene.assemble()
    known = signals(run)
    ways = dict[str, str]()
    roles = {name: output.role for name, output in assembly.outputs.items()}
    outputs = {"drive.speed": [name for name, role in roles.items() if role == "drive"], "load.force": [_LOAD]}
    for actuator, names in outputs.items():
        sensors = [name for name, sensor in scene.sensors.items() if sensor.reads in names]
        if actuator not in assembly.inputs:
            continue
        unit = assembly.inputs[actuator].unit
        for name in (actuator.replace(".", "_"), *sensors, *names):
            if name in known and same_unit(known[name], unit):
                ways.setdefault(actuator, name)
    return ways


def _protocol(run: Run, scene: Scene, ways: Mapping[str, str]) -> tuple[Any, ...]:
    """The protocol that follows these channels. Raises UsageError."""
    inputs = rooms.assembled(scene.parameters, scene.frame_ns, dict.fromkeys(ways, "ramped")).inputs
    if strange := [name for name in ways if name not in inputs]:
        raise UsageError(f"--follow: no actuator is called {', '.join(strange)}; there are {', '.join(inputs)}")
    try:
        units = {name: inputs[name].unit for name in ways}
        content, about = followed(run, ways, units, None, None, scene.frame_ns)
    except ValueError as fault:
        raise UsageError(f"--follow: {fault}") from None
    step = {"step": "follow", "channels": dict(ways), "file": Track.of("measurement", content, about)}
    steps = STEPS.validate_python([step])
    faults = [line for _, line in (*checks.commanded(steps, inputs), *checks.hands_off(steps, scene.controllers))]
    if faults:
        raise UsageError("\n".join(fault.replace("protocol[1].follow", "--follow") for fault in faults))
    return steps


def _pairs(run: Run, made: Run, given: Mapping[str, str], used: set[str]) -> dict[str, tuple[str, str, float]]:
    """Measured channel -> text of the pair, simulated channel, factor. Raises UsageError with all faults."""
    ours = signals(run)
    theirs = signals(made)
    pairs = dict[str, tuple[str, str, float]]()
    faults = Faults()
    texts = given or {name: name for name in ours if name in theirs and name not in used}
    if not texts:
        raise UsageError(
            f"no channel of the recording ({', '.join(ours)}) has the name of a simulated one ({', '.join(theirs)}); "
            'name them: --pair "CHANNEL = SIMULATED, FACTOR"'
        )

    def read(name: str, text: str) -> tuple[str, str, float]:
        other, _, factor = map(str.strip, text.partition(","))
        if name not in ours:
            raise unknown(name, ours)
        if other not in theirs:
            raise unknown(other, theirs, "run")
        if factor:
            try:
                return text, other, finite(factor, f"({ours[name]})/({theirs[other]})")
            except ValueError as fault:
                raise UsageError(f"--pair {name} = {text}: {fault}") from None
        if not same_unit(ours[name], theirs[other]):
            units = f"{name} is in {ours[name]}, {other} in {theirs[other]}"
            raise UsageError(f"--pair {name} = {text}: {units}; add a factor in ({ours[name]})/({theirs[other]})")
        return text, other, 1.0

    for name, text in texts.items():
        if (pair := faults(partial(read, name, text), None)) is not None:
            pairs[name] = pair
    faults.raise_found()
    return pairs


def _mirrored(
    run: Run, made: Run, pairs: Mapping[str, tuple[str, str, float]], ways: Mapping[str, str], start: float
) -> Run:
    """The simulation as a measurement: channels with the names and instants of `run`; followed ones are those of it."""
    names = signals(run)
    units = dict[str, str]()
    channels = dict[str, Samples]()
    for name in dict.fromkeys((*pairs, *ways.values())):
        measured = samples(run, name, names[name])
        units[MEASURED + name] = names[name]
        if name not in pairs:
            channels[name] = measured
            continue
        _, other, factor = pairs[name]
        simulated = samples(made, other, signals(made)[other])
        t_ns = measured.t_ns - round(start * 1e9)
        inside = t_ns <= simulated.t_ns[-1]
        values = factor * np.interp(t_ns[inside], simulated.t_ns, simulated.v)
        channels[name] = Samples(measured.t_ns[inside], values)
    return Run("", made.step_ns, made.frame_ns, np.empty(0), {}, units, channels, name=scene_name(made), measured=True)


def _evaluated(
    run: Run, mirrored: Run, name: str, told: str, begin: float, end: float, stick: tuple[StickSlip, StickSlip] | None
) -> Pair:
    """Both channels with their cycles."""
    both = [series(of, name, begin, end) for of in (run, mirrored)]
    count = min(channel.v.size for channel in both)
    t = both[0].t[:count]
    first, second = (channel.v[:count] for channel in both)
    of_both = []
    for i, v in enumerate((first, second)):
        known = np.isfinite(v)
        x = np.interp(t, t[known], v[known])
        begins = np.array([slip.begin for slip in stick[i].slips]) if stick else t[rises(x)]
        of_both.append(_cycles(t, x, begins))
    measured, simulated = of_both
    cycles = (measured, simulated) if measured is not None and simulated is not None else None
    return Pair(name, told, both[0].unit, t, first, second, cycles)


def _cycles(t: Reals, x: Reals, begins: Reals) -> Cycles | None:
    """The cycles between events at `begins` [s]; None with less than three."""
    if begins.size <= _FEWEST:
        return None
    phase = np.linspace(0.0, 1.0, _PHASES + 1)
    rows = np.array([np.interp(a + phase * (b - a), t, x) for a, b in pairwise(begins)])
    sizes = [np.ptp(x[(t >= a) & (t <= b)]) for a, b in pairwise(begins)]
    low, middle, high = np.percentile(rows, [10.0, 50.0, 90.0], axis=0)
    return Cycles(begins, middle, low, high, 0.5 * float(np.median(sizes)))


def _measures(run: Run, mirrored: Run, pair: Pair, begin: float, end: float) -> Iterator[Measure]:
    def measure(name: str, unit: str, values: tuple[float, float]) -> Measure:
        return Measure(pair.channel, name, unit, *values)

    both = pair.measured, pair.simulated
    means = [float(np.nanmean(v)) for v in both]
    sizes = [float(np.nanstd(v)) for v in both]
    yield Measure(pair.channel, "mean", pair.unit, means[0], means[1], _STILL * sizes[0])
    yield Measure(pair.channel, "RMS", pair.unit, sizes[0], sizes[1])
    if not all(sizes):
        return
    if pair.cycles:
        yield measure("period", "s", tuple(c.period for c in pair.cycles))  # type: ignore[arg-type]
        yield measure("amplitude", pair.unit, tuple(c.amplitude for c in pair.cycles))  # type: ignore[arg-type]
    try:
        first, second = (spectrum(of, pair.channel, first=begin, last=end).density for of in (run, mirrored))
    except UsageError:  # too short, or a gap in every window
        return
    slowest = 0.5 / pair.cycles[0].period if pair.cycles else 0.0
    strongest = (float(first.f[_line(first, slowest)]), float(second.f[_line(second, slowest)]))
    yield measure("strongest frequency", "Hz", strongest)
    levels = (_octave(first, strongest[0]), _octave(second, strongest[0]))
    yield measure(f"RMS in the octave about {strongest[0]:.4g} Hz", pair.unit, levels)


def _line(density: Density, slowest: float) -> int:
    """The largest line above `slowest` [Hz], and beside the lines of the mean."""
    allowed = (density.f >= slowest) & (np.arange(density.f.size) > _LOBE)
    return int(np.argmax(np.where(allowed, density.s, -1.0)))


def _octave(density: Density, middle: float) -> float:
    """RMS in the octave about a frequency [Hz]."""
    inside = (density.f > middle / _OCTAVE) & (density.f < middle * _OCTAVE)
    return math.sqrt(float(density.s[inside].sum()) * density.step)


def _stick_measures(first: StickSlip, second: StickSlip) -> Iterator[Measure]:
    rows = [
        ("stick time", "stick", "s"),
        ("motion time", "motion", "s"),
        ("largest slip speed", "peak", first.speed_unit),
    ]
    if first.force_unit:
        rows += [("breakaway force", "breakaway", first.force_unit), ("force at the end", "restick", first.force_unit)]
    for told, name, unit in rows:
        yield Measure("contact", told, unit, first.median(name)[0], second.median(name)[0])
    yield Measure("contact", "stick share", "1", first.share, second.share)
    yield Measure("contact", "slips", "1", float(len(first.slips)), float(len(second.slips)))
