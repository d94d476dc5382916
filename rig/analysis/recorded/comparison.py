"""Two recordings side by side: values of their scenes, their channels, and physical measures of these.

Signals are compared by `rig.record.compare` at the instants that both recordings have. Measures are computed over the
common time span. If one recording has all instants of the other, measures too are those of the common instants:

mean, RMS (about the mean)        amplitude (half), period, growth rate: of the cycles (rig.analysis.recorded)
stick share: of the instants with a recorded contact state       contact events per second
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.amplitude import growth, index
from rig.analysis.recorded.series import scene_name
from rig.analysis.recorded.stick_speeds import stuck
from rig.errors import RigError, UsageError
from rig.parts import is_binary
from rig.printable import counted
from rig.record.compare import Comparison, Difference, Series, series_of
from rig.record.compare import compare as compare_signals
from rig.record.film_points import read
from rig.record.run import Run
from rig.record.statistics import whole_signals
from rig.results import Column, Result, Table
from rig.view.curves import described

# Parts of a recorded scene on which no result depends, or which only describe where values came from
_PLAIN = ("format", "name", "title", "about", "origins", "models", "parts")
_OPERATOR = "operator"
_LISTED = 20  # most values of the scenes that the text lists
_NAMED = 2  # most values that a label names
_LAST = ("sensors.", "clock.", "seed", "limits.", "protocol")  # named where nothing else differs
_RMS = "RMS"
_GROWTH = "growth rate"
# Measure of a channel -> its unit, in terms of that of the channel
_MEASURES = {"mean": "{}", _RMS: "{}", "amplitude": "{}", "period": "s", _GROWTH: "1/s"}
_STILL = 1e-12  # an RMS below this share of the largest value is the rounding error of a constant. [chosen]
# A vibration whose size changes by less than this share over the time span has no growth rate to compare. [chosen]
_STEADY = 0.01


class Value(NamedTuple):
    """A value of the scenes that differs, as text; "" where a scene does not have it."""

    key: str
    first: str
    second: str


class Measure(NamedTuple):
    """One measure of one channel in both recordings; NaN where a recording does not have it."""

    channel: str
    name: str
    unit: str
    first: float
    second: float
    zero: float = 0.0
    """Size up to which the value counts as zero."""

    @property
    def percent(self) -> float:
        """The difference in percent of the first recording; NaN where that is zero."""
        return 100.0 * (self.second - self.first) / abs(self.first) if abs(self.first) > self.zero else math.nan

    @property
    def same(self) -> bool:
        """Whether both values are equal, both are zero, or neither recording has one."""
        neither = math.isnan(self.first) and math.isnan(self.second)
        return self.first == self.second or neither or max(abs(self.first), abs(self.second)) <= self.zero


@dataclass(frozen=True)
class Compared(Result):
    """The comparison of two recordings over a time span [s]; `tolerance`: a share of the range of each channel."""

    FIGURE: ClassVar = "rig.analysis.recorded.comparison_figures:comparison_figure"

    begin: float
    end: float
    tolerance: float
    values: tuple[Value, ...]
    actions: tuple[str, ...]
    """What operators did in only one of the runs."""
    signals: Comparison
    measures: tuple[Measure, ...]
    notes: tuple[str, ...] = ()
    """Channels with other units, and damage of the recordings."""
    runs: tuple[Run, ...] = field(default=(), compare=False)
    """Both runs."""
    names: tuple[str, ...] = ()
    """Their names, such as those of their files; empty if they have none."""

    @property
    def labels(self) -> tuple[str, str]:
        """What tells the two from each other: their scenes, values that differ, or their names; "A" and "B" if none."""
        names = self._telling_names()
        first, second = names if len({*names}) == 2 else ("", "")
        return f"A: {first}" if first else "A", f"B: {second}" if second else "B"

    def _telling_names(self) -> tuple[str, ...]:
        """Names of the two by their scenes, else by values of these that differ, else those of their files."""
        scenes = tuple(scene_name(run) for run in self.runs)
        if len({*scenes}) == 2:
            return scenes
        differ = self._differing() if len({*scenes}) == 1 and self.values else ()
        return differ if any(differ) else self.names

    def _differing(self) -> tuple[str, ...]:
        """The first values that differ, in words, for each of the two."""
        scene = read(self.runs[0].scene)
        shown = sorted(self.values, key=lambda value: value.key.startswith(_LAST))[:_NAMED]
        values = scene.values() if scene else {}
        units = {key: unit for key, (_, unit) in values.items() if unit != "1"}
        others = len(self.values) - len(shown)
        more = [f"and {others} more"] if others > 0 else []

        def words(value: Value, text: str) -> str:
            return f"{value.key} {text or 'none'} {units.get(value.key, '')}".strip()

        first = [words(value, value.first) for value in shown]
        second = [words(value, value.second) for value in shown]
        return ", ".join([*first, *more]), ", ".join([*second, *more])

    @property
    def agree(self) -> bool:
        """Whether all channels are equal at the common instants, or within the tolerance."""
        return self.signals.agree or self.signals.within(self.tolerance)

    def outcome(self, channel: Difference) -> str:
        """The outcome of one channel: equal, within tolerance, differs; other length if only the time span differs."""
        if channel.beyond and channel.deviation <= self.tolerance:
            return "other length"
        if channel.equal:
            return "equal"
        return "within tolerance" if channel.within(self.tolerance) else "differs"

    def facts(self) -> dict[str, Any]:
        """Return the outcome, and all channels and measures."""
        return {
            "agree": self.agree,
            "identical": self.signals.identical,
            "compared": self.signals.compared,
            "from": self.begin,
            "to": self.end,
            "tolerance": self.tolerance,
            "scene": [record._asdict() for record in self.values],
            "actions": list(self.actions),
            "signals": [{**vars(record), "outcome": self.outcome(record)} for record in self.signals.signals],
            "missing": list(self.signals.missing),
            "measures": [{**record._asdict(), "percent": record.percent} for record in self.measures],
            "notes": list(self.notes),
        }

    def shown(self) -> Iterator[str | Table]:
        """Yield the outcome, the values of the scenes that differ (SI), the channels, the measures that differ."""
        signals = self.signals
        if signals.identical:
            yield f"identical: {counted(signals.compared, 'number')}, bit by bit"
        elif self.agree:
            how = "bit by bit" if signals.agree else f"to {self.tolerance:g} of the range of each channel"
            yield f"agree at all common instants: {counted(signals.compared, 'number')}, {how}"
        else:
            yield f"differ; {counted(signals.compared, 'number')} compared at common instants"
        if not signals.identical:
            yield "A is the first recording, B the second"
        yield from self.labels if self.labels != ("A", "B") else ()
        yield from self.notes
        if self.values:
            yield "scene, values in SI"
            yield Table("scene", [*map(Column, Value._fields)], self.values, _LISTED)
        if self.actions:
            yield "done by operators in one of the runs only"
            yield from (f"  {measure}" for measure in self.actions)
        if not signals.identical:
            yield "channels: largest deviation over the range, at the time worst; first difference; samples in one only"
            yield self._signals()
        for name in signals.missing:
            yield f"{name} is in only one of the two recordings"
        other = [measure for measure in self.measures if not measure.same]
        if other:
            yield f"measures from {self.begin:g} s to {self.end:g} s that differ"
            columns = (
                Column("channel"),
                Column("measure"),
                Column("first", digits=".6g"),
                Column("second", digits=".6g"),
                Column("unit"),
                Column("percent", digits="+.3g"),
            )
            rows = [(m.channel, m.name, m.first, m.second, m.unit, m.percent) for m in other]
            yield Table("differences", columns, rows)
        if self.measures and len(other) < len(self.measures):
            yield f"{len(self.measures) - len(other)} measures are equal"

    def _signals(self) -> Table:
        """The channels: largest deviation, over the range, at the time `worst`; values at the first difference."""
        columns = (
            Column("topic"),
            Column("outcome"),
            Column("deviation", "1", ".3g"),
            Column("worst", "s", ".6g"),
            Column("time", "s", ".9g"),
            Column("first"),
            Column("second"),
            Column("alone", digits=".0f"),
        )
        rows: list[tuple[Any, ...]] = []
        for c in self.signals.signals:
            values = (c.deviation, c.worst, c.time, c.first, c.second) if c.differing else (None,) * 5
            rows.append((c.topic, self.outcome(c), *values, [*c.alone]))
        return Table("signals", columns, rows)


def compare(
    first: Run,
    second: Run,
    begin: float = 0.0,
    end: float = math.inf,
    tolerance: float = 0.0,
    names: tuple[str, ...] = (),
) -> Compared:
    """Compare two runs from `begin` to `end` [s]; `tolerance`: allowed deviation as a share of a channel's range.

    `names`: of the two, such as those of their files, which name them where their scenes are the same.
    Raises UsageError for a tolerance that is negative and for runs without a common time span.
    """
    if not 0.0 <= tolerance < math.inf:
        raise UsageError(f"tolerance {tolerance:g}: must be at least 0, a share of the range, e.g. 1e-6")
    spans = [run.span for run in (first, second) if run.span]
    low = max([begin, *(span[0] for span in spans)])
    high = min([end, *(span[1] for span in spans)])
    if len(spans) < 2 or low > high:
        outputs = ["{:g} to {:g} s".format(*run.span) if run.span else "none" for run in (first, second)]
        asked = f" from {begin:g} s on" if end == math.inf else f" from {begin:g} s to {end:g} s"
        raise UsageError(
            f"the two recordings have no outputs at common times{asked}: A has {outputs[0]}, B {outputs[1]}"
        )
    damage = (f"{which}: {note}" for which, run in (("A", first), ("B", second)) for note in _notes(run))
    return Compared(
        low,
        high,
        tolerance,
        tuple(_values(first, second)),
        tuple(_actions(first, second)),
        compare_signals(first, second, begin, end),
        tuple(_measures(first, second, low, high)),
        (*_other_units(first, second), *damage),
        (first, second),
        names,
    )


def _values(first: Run, second: Run) -> Iterator[Value]:
    ours, two = (_flat(run) for run in (first, second))
    for key in dict.fromkeys([*ours, *two]):
        a = ours.get(key, "")
        b = two.get(key, "")
        if a != b:
            yield Value(key, a, b)


def flattened(content: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted key and value of each value in the JSON of a scene; of a compiled part its file and hash."""
    if is_binary(content):
        yield key, f"{content['file']} (SHA-256 {content['sha256']:.12}...)"
    elif isinstance(content, dict):
        for name, inner in content.items():
            yield from flattened(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(content, list) and any(isinstance(inner, dict | list) for inner in content):
        for number, inner in enumerate(content, 1):
            yield from flattened(inner, f"{key}[{number}]")
    else:
        yield key, content


def _flat(run: Run) -> dict[str, str]:
    """Dotted key -> value as text, of a recorded scene, and the hash of each part from a file; empty if it is lost."""
    told = described(run.scene)
    values = flattened({name: value for name, value in told.items() if name not in _PLAIN})
    texts = {}
    for key, value in values:
        if value is not None:
            text = f"{value:.9g}" if isinstance(value, float) else str(value)
            texts[key.removeprefix("parameters.")] = text
    parts = told.get("parts")
    files = [part for part in parts if isinstance(part, dict)] if isinstance(parts, list) else []
    return texts | {f"source of {part.get('name')}": f"SHA-256 {part.get('sha256')!s:.12}..." for part in files}


def _actions(first: Run, second: Run) -> Iterator[str]:
    """Actions of operators that only one run has, in words."""
    ours = _by_operators(first)
    two = _by_operators(second)
    for which, actions, other in (("A", ours, two), ("B", two, ours)):
        for t_ns, text in actions:
            if (t_ns, text) not in other:
                yield f"{which}: t = {t_ns * 1e-9:g} s: {text}"


def _by_operators(run: Run) -> list[tuple[int, str]]:
    """Time [ns] and text of each action of an operator."""
    return [(e["t_ns"], e["text"]) for e in run.plant_events if e["data"].get("by") == _OPERATOR]


def _measures(first: Run, second: Run, begin: float, end: float) -> Iterator[Measure]:
    ours, two = (series_of(run, begin, end) for run in (first, second))
    names = [*whole_signals(first), *(f"meas/{name}" for name in first.measurements)]
    for name in names:
        if name in two:
            a, b = (_of(series) for series in _alike(ours[name], two[name]))
            unit = first.units.get(name, "")
            size = float(np.nanmax(np.abs(ours[name].values), initial=0.0))
            steady = _STEADY / (end - begin) if end > begin else 0.0
            zeros = {_RMS: _STILL * size, _GROWTH: steady}
            for measure, value in a.items():
                unit_of_measure = _MEASURES[measure].format(unit)
                yield Measure(name, measure, unit_of_measure, value, b[measure], zeros.get(measure, 0.0))
    yield Measure("contact", "stick share", "1", *(_stick(run, begin, end) for run in (first, second)))
    yield Measure("contact", "events", "1/s", *(_events(run, begin, end) for run in (first, second)))


def _alike(ours: Series, two: Series) -> tuple[Series, Series]:
    """Both series at the same instants, if all instants of one are in the other; else as they are."""
    shared, at_one, at_two = np.intersect1d(ours.t_ns, two.t_ns, return_indices=True)
    if not shared.size or shared.size < min(ours.t_ns.size, two.t_ns.size):
        return ours, two
    return Series(shared, ours.values[at_one]), Series(shared, two.values[at_two])


def _of(channel: Series) -> dict[str, float]:
    """The measures of one channel."""
    known = np.isfinite(channel.values)
    t = np.multiply(channel.t_ns[known], 1e-9, dtype=np.float64)
    v = channel.values[known]
    if not v.size:
        return dict.fromkeys(_MEASURES, math.nan)
    cycles = index(t, v)
    size, period = (cycles.half, 1.0 / cycles.frequency) if cycles.cycles else (math.nan, math.nan)
    values = (float(v.mean()), float(v.std()), size, period, growth(t, v))
    return dict(zip(_MEASURES, values))


def _other_units(first: Run, second: Run) -> Iterator[str]:
    """Yield a warning for each channel that has another unit in the other run."""
    for name, unit in first.units.items():
        other = second.units.get(name, unit)
        if other != unit:
            yield f"{name} is in {unit} in A and in {other} in B: what is told of it compares other quantities"


def _notes(run: Run) -> Iterator[str]:
    """The warnings of the run, and why its share of stick is missing."""
    yield from run.notes
    if why := _stuck(run)[1]:
        yield f"the stick share is missing: {why}"


def _stuck(run: Run) -> tuple[NDArray[np.bool_] | None, str]:
    """Whether a loaded contact sticks at each time; None if that is not known, and why if it should be."""
    try:
        return stuck(run) if run.scene else None, ""
    except RigError as fault:  # code that is not trusted, or a scene that this version cannot assemble
        return None, str(fault)


def _stick(run: Run, begin: float, end: float) -> float:
    """The share of the recorded contact states in which a loaded contact sticks; NaN where it is not known."""
    sticks = _stuck(run)[0]
    inside = (run.time >= begin) & (run.time <= end)
    if sticks is None or not inside.any():
        return math.nan
    return float(np.mean(sticks[inside]))


def _events(run: Run, begin: float, end: float) -> float:
    """Contact events per second; NaN if the recording has none, as that of a live run."""
    times = np.array([event["t_ns"] for event in run.plant_events if event["kind"] == "contact"]) * 1e-9
    if not times.size or end <= begin:
        return math.nan
    return float(np.count_nonzero((times >= begin) & (times <= end))) / (end - begin)
