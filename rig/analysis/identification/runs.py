"""The recordings that parameters are fitted to, with what is known of each, and the file that lists them.

    scene = "belt"
    [free]                                             what is fitted: key -> FROM:TO
    "friction.mu_static" = "0.1:1"
    "body.damping" = "0:5 N*s/m"
    [laws.coulomb]                                     optional: other friction laws, with what is fitted of them
    "friction.mu_static" = "0.1:1"
    "friction.mu_kinetic" = "0.05:1"

    [[run]]
    file = "slow.mcap"                                 a recording, or a file that rig import reads
    skip = "1 s"
    set = {"drive.speed" = "50 mm/s", "load.force" = "16 N"}
    [run.columns]
    laser = {reads = "displacement", offset = "free"}  a column and the output of the plant that it measures

A column has `scale` ("1.793e-3 m" for one unit of the column) where the file states no unit or another quantity. Its
offset is that of the plant (none), "free" (one value for all runs), or "run" (one value for each record); `per_run =
["level"]` means "run" for all columns. `sensor`: the instrument of the scene whose filter the column has passed.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from rig.analysis.recorded.series import Series, series
from rig.errors import Faults, RigError, SceneError, UsageError
from rig.laws import LAWS, class_of, laws_of
from rig.model.assembly import Assembly
from rig.quantities import details_of, whole
from rig.record.imports.channel_map import ChannelMap
from rig.record.imports.import_run import import_files
from rig.record.reader import open as read_recording
from rig.record.run import Reals, Run
from rig.scenes import sections, source
from rig.scenes.axis import numbers, unknown
from rig.scenes.belief import varied
from rig.scenes.faults import near
from rig.scenes.scene import Scene
from rig.units import brief, conversion, parted, same_unit, si, si_unit, with_units

# Offset of a column
NONE = "none"
FREE = "free"
RUN = "run"
# What is read of a hold
MEAN = "mean"
LARGEST = "largest"
# Kinds of runs
TRANSIENT = "transient"
RESPONSE = "response"
MOTIONS = ("m", "m/s", "rad", "rad/s")
"""Units of outputs without jumps: an acceleration or a force may jump where a motion ends."""
KINDS = ("cycles", TRANSIENT, RESPONSE, "growth", "stages")
_RUN = ("file", "name", "time", "rate", "skip", "end", "set", "columns", "fit", "kind")
_COLUMN = ("reads", "scale", "offset", "sensor", "feature")
_FILE = ("scene", "free", "laws", "per_run", "run", "starts", "seed")


@dataclass(frozen=True)
class Column:
    """What a column of a recording measured: samples `v` [n] in `unit` of the output, at `rate` [Hz] from `start` [s].

    `offset`: NONE, FREE or RUN. Missing samples are NaN.
    """

    name: str
    output: str
    unit: str
    offset: str
    sensor: str
    start: float
    rate: float
    v: Reals
    feature: str = MEAN
    """What is read of each hold of a protocol, in a run of the kind stages: MEAN or LARGEST."""

    @property
    def t(self) -> Reals:
        """Times of the samples [s]."""
        return np.asarray(self.start + np.arange(self.v.size) / self.rate)

    def on(self, other: Column) -> Reals:
        """The samples about their mean at the times of another column."""
        known = np.isfinite(self.v)
        v = np.interp(other.t, self.t[known], self.v[known])
        return np.asarray(v - v.mean())


@dataclass(frozen=True)
class Measured:
    """A recording as a run of the rig with known `settings` (dotted key -> SI). `fitted`: false if it is predicted."""

    name: str
    kind: str
    settings: dict[str, float]
    columns: tuple[Column, ...]
    fitted: bool = True
    input: Column | None = None
    """Of a response: the column that measures an actuator."""

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return max(column.v.size / column.rate for column in self.columns)


@dataclass(frozen=True)
class Free:
    """A parameter that is fitted from `low` to `high` (SI): in its logarithm, or as it is where the range contains 0.

    `stated`: the value of the scene, where the fit begins.
    """

    key: str
    unit: str
    low: float
    high: float
    stated: float

    @property
    def log(self) -> bool:
        """Whether the logarithm is fitted."""
        return self.low > 0.0

    @property
    def size(self) -> float:
        """The unit of a parameter that is fitted as it is."""
        return 1.0 if self.log else (abs(self.stated) or 0.1 * (self.high - self.low))

    def coordinate(self, value: float) -> float:
        """What is fitted, for a value in SI."""
        return math.log(value) if self.log else value / self.size

    def value(self, coordinate: float) -> float:
        """The value in SI."""
        return math.exp(coordinate) if self.log else coordinate * self.size

    @property
    def ends(self) -> tuple[float, float]:
        """The range of what is fitted."""
        return self.coordinate(self.low), self.coordinate(self.high)


@dataclass(frozen=True)
class Law:
    """A friction law to fit: the scene with it, and what is free."""

    name: str
    scene: Scene
    free: tuple[Free, ...]


@dataclass(frozen=True)
class Task:
    """What is to be identified: the scene, the laws, the runs, and what else the file says."""

    scene: Scene
    laws: tuple[Law, ...]
    runs: tuple[Measured, ...]
    where: str
    starts: int = 4
    seed: int = 1


def read(path: Path) -> dict[str, Any]:
    """The tables of a runs file, with files relative to its folder. Raises SceneError, UsageError with every fault."""
    raw = source.tree(path)
    faults = [f"{path}: {key}: unknown; {near(key, _FILE)}" for key in raw if key not in _FILE]
    entries = raw.get("run")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        faults.append(f"{path}: no [[run]]: each recording is a table [[run]] with file, set and columns")
    laws = raw.get("laws", {})
    if not isinstance(raw.get("free", {}), dict):
        faults.append(f'{path}: free: expected a table [free] with "KEY" = "FROM:TO"')
    tables = isinstance(laws, dict) and all(isinstance(law, dict) for law in laws.values())
    if not tables and not isinstance(laws, list):
        faults.append(f'{path}: laws: expected names, ["coulomb", "stribeck"], or tables [laws.NAME] "KEY" = "FROM:TO"')
    if faults:
        raise UsageError("\n".join(faults))
    for entry in raw["run"]:
        if isinstance(entry.get("file"), str) and not Path(entry["file"]).is_absolute():
            entry["file"] = str(path.parent / entry["file"])
    raw["free"] = dict(source.dotted(raw.get("free", {})))
    raw["laws"] = {name: dict(source.dotted(law)) for name, law in laws.items()} if tables else laws
    return raw


def prepared(
    scene: Scene,
    runs: str | Path | Sequence[Mapping[str, Any]],
    free: Mapping[str, Any] | None = None,
    laws: Mapping[str, Mapping[str, Any]] | Iterable[str] | None = None,
    per_run: Iterable[str] | None = None,
    starts: int | None = None,
    seed: int | None = None,
) -> Task:
    """Return what is asked: the runs of a file, or given as the tables of one, with `file` or a `run` of Python.

    What is given counts before what the file says. Raises SceneError, UsageError with every fault.
    """
    raw: dict[str, Any] = {}
    where = "recordings"
    if isinstance(runs, str | Path):
        raw |= read(Path(runs))
        where = str(runs)
    else:
        raw["run"] = list(runs)
    stated = {"free": free, "laws": laws, "per_run": per_run, "starts": starts, "seed": seed}
    raw |= {key: value for key, value in stated.items() if value is not None}
    count = whole("starts", raw.get("starts", 4), 0, 1000)
    first = whole("seed", raw.get("seed", 1), 0, 2**62)
    entries = raw["run"]
    ranges = raw.get("free", {})
    level = raw.get("per_run") or []
    faults = Faults()
    if Path(str(raw.get("scene", scene.name))).stem != scene.name:
        faults.found.append(f"{where}: is for the scene {brief(raw['scene'])}, not for {scene.name}; name that scene")
    scene = replace(scene, limits={})
    asked = raw.get("laws", ())
    of_laws = asked if isinstance(asked, Mapping) else {name: {} for name in asked}
    if of_laws:
        tried = tuple(faults(lambda n=n, k=k: _law(scene, n, ranges, k), None) for n, k in of_laws.items())  # type: ignore[misc]
    else:
        tried = (faults(lambda: Law(_law_name(scene), scene, _free(scene, ranges)), None),)
    if of_laws and None not in tried:
        used = {f.key for law in tried if law is not None for f in law.free}
        unused = [key for key in ranges if key.startswith("friction.") and key not in used]
        faults.found += [f"{key}: none of the laws {', '.join(of_laws)} has it" for key in unused]
    if level not in ([], ["level"], ("level",)):
        faults.found.append(f'per_run = {brief(level)}: only ["level"] is known, an offset of each record')
    measured = [faults(lambda i=i, e=e: _measured(scene, i, e, bool(level)), None) for i, e in enumerate(entries)]  # type: ignore[misc]
    _known_beside_free(tried, measured, faults)
    _told_apart([run for run in measured if run is not None], entries, faults)
    faults.raise_found()
    known = [run for run in measured if run is not None]
    if not any(run.fitted for run in known):
        raise UsageError("no run is fitted: give at least one [[run]] without fit = false")
    laws_to_fit = tuple(law for law in tried if law is not None)
    return Task(scene, laws_to_fit, tuple(known), where, count, first)


def _known_beside_free(laws: Sequence[Law | None], runs: Sequence[Measured | None], faults: Faults) -> None:
    for law in filter(None, laws):
        keys = {free.key for free in law.free}
        for run in filter(None, runs):
            faults.found += [f"{run.name}: {key} is set, and free; leave one out" for key in keys & run.settings.keys()]
        tables = {key.partition(".")[2] for key in keys if key.startswith(("body.", "load."))}
        if {"mass", "stiffness", "force"} <= tables:
            faults.found.append(
                "mass, stiffness and load are all free: only their ratios act on a cycle; state one of them (weigh the "
                "body, or measure the spring)"
            )


def _told_apart(runs: Sequence[Measured], entries: Sequence[Mapping[str, Any]], faults: Faults) -> None:
    """Names are unique, and no sample counts twice: intervals would be too narrow."""
    if len(runs) < len(entries):
        return
    for (a, of), (b, other) in combinations(zip(runs, entries), 2):
        given = of.get("file", of.get("run"))
        again = other.get("file", other.get("run"))
        same = given is again
        if isinstance(given, str | Path) and isinstance(again, str | Path):
            same = same or Path(given).resolve() == Path(again).resolve()
        if same and _overlap(a.columns[0], b.columns[0]):
            faults.found.append(
                f"{a.name}, {b.name}: are the same part of {a.name if isinstance(given, Run) else given}, which would "
                "count twice; leave one out, or use other parts of it (skip, end)"
            )
        elif a.fitted and b.fitted and _copied(a.columns[0], b.columns[0]):
            faults.found.append(
                f"{a.name}, {b.name}: have the same samples of {a.columns[0].output}, which would count twice; leave "
                "one out, or use other parts of the recording (skip, end)"
            )
        elif a.name == b.name:
            faults.found.append(f'{a.name}: is the name of two runs; give each its own, name = "..."')


def _overlap(a: Column, b: Column) -> bool:
    """Whether two columns have common times."""
    return bool(a.t[0] < b.t[-1] and b.t[0] < a.t[-1])


def _copied(a: Column, b: Column) -> bool:
    """Whether two columns have the same samples at their common times."""
    begin = max(a.start, b.start)
    first, second = (column.v[round((begin - column.start) * column.rate) :] for column in (a, b))
    count = min(first.size, second.size)
    return count > 1 and np.array_equal(first[:count], second[:count], equal_nan=True)


def _law_name(scene: Scene) -> str:
    return str(getattr(getattr(scene.parameters, "friction", None), "law", ""))


def _law(scene: Scene, name: str, free: Mapping[str, Any], own: Mapping[str, Any]) -> Law:
    """A law of the scene's plant. Keys of another law in `free` are left out; those of `own` are given for it."""
    ranges = {**free, **own}
    kept = {key: text for key, text in ranges.items() if not key.startswith("friction.")}
    of_law = {key: text for key, text in ranges.items() if key.startswith("friction.")}
    if name == _law_name(scene):
        known = numbers(scene)
        of_law = {key: text for key, text in of_law.items() if key in known or key in own}
        return Law(name, scene, _free(scene, kept | of_law))
    model = type(scene.parameters)
    values = dict[str, Any](law=name)
    section = class_of(values, laws_of(model))
    if section is None:
        raise UsageError(f"law {name}: unknown; {near(str(name), LAWS)}")
    fields = getattr(section, "model_fields", ())
    of_law = {key: text for key, text in of_law.items() if key in own or key[9:] in fields}
    for key, text in of_law.items():
        low, high = _ends(key, text, "")
        stated = scene.values().get(key, (None, ""))[0]
        middle = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
        values[key[9:]] = stated if isinstance(stated, float) and low <= stated <= high else middle
    try:
        parameters = model.model_validate({**sections.dump(scene.parameters), "friction": values})
    except ValidationError as error:
        faults = details_of(error)
        missing = ", ".join(f"friction.{fault['loc'][-1]}" for fault in faults if fault["type"] == "missing")
        what = f"needs {missing}" if missing else faults[0]["msg"]
        raise UsageError(
            f'law {name}: {what}; give the ranges of its keys, [laws.{name}] "friction.KEY" = "FROM:TO"'
        ) from None
    other = replace(scene, parameters=parameters)
    return Law(name, other, _free(other, kept | of_law))


def _ends(key: str, given: Any, unit: str) -> tuple[float, float]:
    """The ends of a range "FROM:TO" or (from, to) in `unit`; "" for the SI unit that the text has."""
    try:
        parts: list[Any] = []
        if isinstance(given, str):
            parts = given.split(":")
        elif isinstance(given, list | tuple):
            parts = list(given)
        if len(parts) != 2:
            raise ValueError('expected a range FROM:TO, such as "0.1:1"')
        if isinstance(given, str):
            parts = with_units([part.strip() for part in parts])
            unit = unit or si_unit(parted(parts[1])[1] or "1")
            parts = [part if parted(part)[1] else float(part) for part in parts]
        low, high = (si(part, unit or "1") for part in parts)
    except (ValueError, TypeError) as fault:
        raise UsageError(f"{key} = {brief(given)}: {fault}") from None
    if not low < high:
        raise UsageError(f"{key} = {brief(given)}: the range must rise")
    return low, high


def _free(scene: Scene, ranges: Mapping[str, Any]) -> tuple[Free, ...]:
    """The free parameters. Raises SceneError with every fault."""
    known = numbers(scene)
    values = scene.values()
    free = []
    faults = []
    for key, given in ranges.items():
        if key not in known:
            faults.append(unknown(str(key), known, scene))
            continue
        try:
            low, high = _ends(key, given, known[key])
            stated = float(values[key][0])
            if not low <= stated <= high:
                raise UsageError(
                    f"{key} = {brief(given)}: the value of the scene, {stated:g}, where the fit begins, is outside"
                )
            if key.partition(".")[0] != "friction":
                for end in (low, high):  # of what the rig allows
                    varied(scene, {key: end})
            free.append(Free(key, known[key], low, high, stated))
        except UsageError as fault:
            faults.append(str(fault))
        except SceneError as error:
            faults += error.faults
    if not ranges:
        faults.append('nothing is free: [free] "friction.mu_static" = "0.1:1"')
    if faults:
        raise SceneError(scene.name, faults)
    return tuple(free)


def _measured(scene: Scene, number: int, entry: Mapping[str, Any], level: bool) -> Measured:
    """One run. Raises UsageError with every fault of it."""
    given = entry.get("file", entry.get("run"))
    name = str(entry.get("name") or (Path(given).stem if isinstance(given, str | Path) else f"run {number + 1}"))
    faults = Faults()
    known = (*_RUN, "run")
    faults.found += [f"{name}: {key}: unknown; {near(key, known)}" for key in entry if key not in known]
    kind = entry.get("kind", "cycles")
    if kind not in KINDS:
        faults.found.append(f"{name}: kind = {brief(kind)}: known: {', '.join(KINDS)}")
    first = _seconds(entry, name, "skip", 0.0, faults)
    last = _seconds(entry, name, "end", math.inf, faults)
    columns = entry.get("columns") or {}
    settings_ = entry.get("set") or {}
    for key, table in (("columns", columns), ("set", settings_)):
        if not isinstance(table, Mapping):
            raise UsageError(f"{name}: {key} = {brief(table)}: expected a table, {key} = {{...}}")
    faults.found += [
        f'{name}: {column}: expected {{reads = "OUTPUT"}}, the output of the plant that it measures'
        for column, table in columns.items()
        if not isinstance(table, Mapping) or not isinstance(table.get("reads"), str)
    ]
    if not isinstance(entry.get("fit", True), bool):
        faults.found.append(f"{name}: fit = {brief(entry['fit'])}: expected true or false")
    settings: dict[str, float] = faults(lambda: _settings(scene, settings_, name), {})
    faults.raise_found()
    run: Run | None = faults(lambda: _recording(given, entry, columns, name), None)
    faults.raise_found()
    assert run is not None
    outputs = scene.assemble()
    columns = columns or _of_sensors(run, name, outputs, kind)
    made: list[Column] = [
        faults(lambda c=c, t=t: _column(run, c, t, outputs, scene, name, first, last, level), None)  # type: ignore[misc]
        for c, t in columns.items()
    ]
    faults.raise_found()
    driven = [column for column in made if column.output in outputs.inputs]
    read = tuple(column for column in made if column not in driven)
    if len(driven) != (kind == RESPONSE) or not read:
        raise UsageError(
            f"{name}: a frequency response (kind = {RESPONSE!r}), and no other run, has one column that reads what "
            f"drives the rig, an actuator ({', '.join(outputs.inputs)}), beside those that read outputs"
        )
    return Measured(name, kind, settings, read, entry.get("fit", True), *driven)


def _seconds(entry: Mapping[str, Any], name: str, key: str, default: float, faults: Faults) -> float:
    try:
        value = si(entry.get(key, default), "s")
        if value >= 0.0:
            return value
        fault: Any = f"is {entry[key]}; expected 0 s or more"
    except ValueError as wrong:
        fault = wrong
    faults.found.append(f"{name}: {key} {fault}")
    return default


def _settings(scene: Scene, given: Mapping[str, Any], name: str) -> dict[str, float]:
    known = numbers(scene)
    values = {}
    faults = []
    for key, value in dict(source.dotted(dict(given))).items() if given else ():
        try:
            if key not in known:
                faults.append(f"{name}: set {unknown(key, known, scene)}")
                continue
            values[key] = si(value, known[key])
        except ValueError as fault:
            faults.append(f"{name}: set {key}: {fault}")
    if faults:
        raise UsageError("\n".join(faults))
    varied(scene, values)
    return values


def _recording(given: Any, entry: Mapping[str, Any], columns: Mapping[str, Any], name: str) -> Run:
    """The recording of a run; a file of another system is imported, its columns with their scales."""
    if isinstance(given, Run):
        return given
    if not isinstance(given, str | Path):
        raise UsageError(f'{name}: file is missing; expected a recording or a measurement, file = "run.mcap"')
    path = Path(given)
    if path.suffix.lower() == ".mcap":
        try:
            return read_recording(path)
        except RigError as fault:
            raise UsageError(f"{path}: {fault}") from None
    if not columns:
        raise UsageError(f'{path}: name its columns, [run.columns] x = {{reads = "displacement", scale = "1 mm"}}')
    scales = [str(table.get("scale", "")) for table in columns.values()]
    texts = {column: f"c{i}, {scales[i]}" if scales[i] else f"c{i}" for i, column in enumerate(columns)}
    names = {column: f"c{i}" for i, column in enumerate(columns)}
    with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder:
        out = Path(folder) / "measured.mcap"
        given_map = ChannelMap(texts, str(entry.get("time", "")), str(entry.get("rate", "")))
        try:
            import_files([path], out, given_map, skip_missing=True)
        except UsageError as fault:  # in the words of this file, not in those of rig import
            text = re.sub(r" = c\d+(, [^:]*)?:", ":", str(fault))
            text = re.sub(r'; add it, such as "c\d.*', '; add scale = "1 mm", that of one unit of it', text)
            text = re.sub(r'"[^"]* = c\d+, ([^"]*)"', r'scale = "\1"', text)
            text = re.sub(r"expected a scale per .*, such as ", "expected ", text)
            text = text.replace("state another one in the map, such as", "state another one, such as")
            text = text.replace('add --time "COLUMN, s" or --rate', 'add time = "COLUMN, s" or rate =')
            raise UsageError(re.sub(r"--rate RATE", 'rate = "2 kHz"', text).replace("--rate", "rate =")) from None
        run = read_recording(out)
    for column, plain in names.items():
        run.measurements[column] = run.measurements.pop(plain)
        run.units[f"meas/{column}"] = run.units.get(f"meas/{plain}", "")
    return run


def _of_sensors(run: Run, name: str, rig: Assembly, kind: str) -> dict[str, dict[str, str]]:
    """The columns of a recording of this product: what its instruments read, of cycles the motions if there are any."""
    if run.measured or not run.scene:
        raise UsageError(f'{name}: say what its columns are, [run.columns] laser = {{reads = "displacement"}}')
    sensors = Scene.from_json(run.scene).sensors
    read = {s: {"reads": section.reads, "sensor": s} for s, section in sensors.items() if s in run.measurements}
    outputs = rig.outputs
    moves = {s: c for s, c in read.items() if c["reads"] in outputs and outputs[c["reads"]].unit in MOTIONS}
    return moves if moves and kind == "cycles" else read


def _column(
    run: Run,
    name: str,
    table: Mapping[str, Any],
    rig: Assembly,
    scene: Scene,
    where: str,
    first: float,
    last: float,
    level: bool,
) -> Column:
    """One column. Raises UsageError."""
    if wrong := [key for key in table if key not in _COLUMN]:
        raise UsageError(f"{where}: {name}.{wrong[0]}: unknown; {near(wrong[0], _COLUMN)}")
    output = table["reads"]
    offset = RUN if level else table.get("offset", NONE)
    known: dict[str, Any] = {**rig.inputs, **rig.outputs}
    if output not in known:
        raise UsageError(f"{where}: {name}: {output} is no output of the {scene.plant}; {near(output, known)}")
    if offset not in (NONE, FREE, RUN):
        raise UsageError(f"{where}: {name}: offset = {brief(offset)}; known: {NONE}, {FREE}, {RUN}")
    sensor = str(table.get("sensor", ""))
    if sensor and sensor not in scene.sensors:
        raise UsageError(f"{where}: {name}: the scene has no sensor {sensor}; {near(sensor, scene.sensors)}")
    try:
        samples: Series = series(run, name, first, last)
    except UsageError as fault:
        raise UsageError(f"{where}: {fault}") from None
    kept = samples.v[np.isfinite(samples.v)]
    if kept.size < 2 or not np.ptp(kept):
        raise UsageError(f"{where}: {name}: {f'is {kept[0]:g} throughout' if kept.size else 'has no finite sample'}")
    unit = known[output].unit
    v = samples.v
    if not same_unit(samples.unit or "1", unit):
        text = str(table.get("scale", ""))
        number, of = parted(text) if text else ("", "")
        conversion_of = getattr(scene.sensors.get(sensor), "conversion", None)
        if not number and conversion_of and same_unit(samples.unit, scene.sensors[sensor].delivers):
            number = repr(conversion_of)
            of = unit
        if not number or not of:
            stated = samples.unit or "no unit"
            per = f"/{samples.unit}" if run.measured and samples.unit not in ("", "1") else ""
            raise UsageError(
                f"{where}: {name} is in {stated}, {output} in {unit}; "
                f'add scale = "1 {unit}{per}", that of one unit of it'
            )
        try:
            factor, shift = conversion(of, unit)
            v = v * float(number) * factor + shift
        except ValueError as fault:
            raise UsageError(f"{where}: {name}: scale {text}: {fault}") from None
    feature = table.get("feature", MEAN)
    if feature not in (MEAN, LARGEST):
        raise UsageError(f"{where}: {name}: feature = {brief(feature)}; known: {MEAN}, {LARGEST}")
    return Column(name, output, unit, offset, sensor, samples.start, samples.rate, v, feature)
