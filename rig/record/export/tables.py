"""A run as tables: the plant's outputs, the sensors of each rate, the commands of each controller, the events.

A table has one column of times. Outputs of the plant have one table. Sensors of one rate have another, since all of
them sample at the same instants. The commands of a controller have a row for each command that took effect. Rows that a
damaged recording has lost are NaN where another column of the table has them, and absent otherwise.

They are also made as frames of pandas and as a tree of datasets of xarray; both libraries are optional.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.extras import needed
from rig.printable import distinct
from rig.record.contents import actuators, unit_of
from rig.record.export.lower_rate import Lowered, lowered
from rig.record.film_points import numbered
from rig.record.run_data import (
    MEASURED,
    TRUE,
    Integers,
    RunData,
    Samples,
    period,
    signals,
    unknown,
)

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import DataTree


OUTPUTS = "outputs"
EVENTS = "events"
MODE = "mode"
TIME = "time"
_APART = 0.75  # of a period: sensors share a table if no two of its rows are closer


def frames(tables: Iterable[Table]) -> dict[str, DataFrame]:
    """Return each table by name as a frame over the time [s], with the units in `attrs["units"]`.

    Raises rig.errors.UsageError if pandas is not installed.
    """
    pandas = needed("pandas", "data")
    by_name: dict[str, DataFrame] = {}
    for table in tables:
        columns = {column.name: column.values for column in table.columns}
        frame = pandas.DataFrame(columns, index=pandas.Index(table.time, name=TIME))
        frame.attrs["units"] = {column.name: column.unit for column in table.columns}
        by_name[table.name] = frame
    return by_name


def tree(tables: Iterable[Table], facts: Mapping[str, str]) -> DataTree:
    """Return a tree with one dataset for each table over `time` [s].

    `facts` are scalar variables of its root, not attributes: HDF5 limits those to 64 KiB, and a scene may be longer.
    Raises rig.errors.UsageError if xarray is not installed.
    """
    xarray = needed("xarray", "data")
    parts = {"/": xarray.Dataset({name: ((), text) for name, text in facts.items()})}
    for table in tables:
        variables = {column.name: ((TIME,), column.values, _attributes(column)) for column in table.columns}
        whole = {"_FillValue": None}  # CF allows no missing values in a coordinate
        parts[table.name] = xarray.Dataset(variables, {TIME: ((TIME,), table.time, {"units": "s"}, whole)})
    datasets: DataTree = xarray.DataTree.from_dict(parts)
    return datasets


def _attributes(column: Column) -> dict[str, str]:
    attributes = {"units": column.unit, "description": column.about}
    return {name: text for name, text in attributes.items() if text}


@dataclass(frozen=True)
class Column:
    """One column: `values` [n] are floats, integers or texts (objects); `about`: what a name and a unit do not say."""

    name: str
    unit: str
    values: NDArray[Any]
    about: str = ""


@dataclass(frozen=True)
class Table:
    """Columns over times `t_ns` [n]; `channels`: whether they are signals of outputs or sensors."""

    name: str
    t_ns: Integers
    columns: tuple[Column, ...]
    channels: bool = False

    @property
    def time(self) -> NDArray[np.float64]:
        """The times [s]: the floating-point numbers nearest to the whole nanoseconds."""
        return np.asarray(self.t_ns / 1e9)

    @property
    def with_time(self) -> tuple[Column, ...]:
        """The columns after that of the times."""
        return (Column(TIME, "s", self.time), *self.columns)

    @property
    def rate(self) -> float:
        """Rows per second [Hz] of signals; 0 for a table of commands or events, and for less than two rows."""
        step = period(self.t_ns) if self.channels else 0.0
        return 1e9 / step if step else 0.0


@dataclass(frozen=True)
class Tables:
    """The tables of a run; `notes`: what was done to signals to make them, in words."""

    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Table]:
        return iter(self.tables)


@dataclass
class _Chosen:
    """Names of what is exported."""

    outputs: list[str] = field(default_factory=list)
    sensors: list[str] = field(default_factory=list)
    controllers: list[str] = field(default_factory=list)
    mode: bool = False
    events: bool = False


def tables(run: RunData, only: Sequence[str] = (), rate: float | None = None, plain: bool = True) -> Tables:
    """Return the tables of `run`, or of the outputs, sensors and controllers that `only` names.

    `plain`: with names that can be those of files and groups; otherwise with the names of the run.

    `only` takes "events" and "mode" as well, and the common part of the names of a film's points ("pressure"). A name
    that a sensor and an output share is the sensor; `truth/NAME` is the output. `rate` [Hz]: signals recorded at a
    higher rate are filtered and decimated. Raises UsageError with every unknown name, and for an impossible rate.
    """
    chosen = _chosen(run, only)
    times = np.rint(run.time * 1e9).astype(np.int64)
    signals = {TRUE + name: Samples(times, run.signals[name]) for name in chosen.outputs}
    signals |= {MEASURED + name: run.measurements[name] for name in chosen.sensors}
    reduced = Lowered(signals) if rate is None else lowered(signals, rate)
    outputs = {name: reduced.signals[TRUE + name] for name in chosen.outputs}
    sensors = {name: reduced.signals[MEASURED + name] for name in chosen.sensors}
    made = [*_outputs(run, times, outputs, chosen.mode), *_sensors(run, sensors)]
    made += [_commands(run, name) for name in chosen.controllers]
    made += [_events(run)] if chosen.events else []
    named = _distinct(map(_plain, made), (TIME,)) if plain else _distinct(made)
    return Tables(tuple(named), (*_aliased(run, chosen, times), *reduced.notes))


def _aliased(run: RunData, chosen: _Chosen, times: Integers) -> Iterator[str]:
    """A note on outputs that are recorded less often than the plant steps."""
    step = period(times)
    if chosen.outputs and step > run.step_ns * 1.01:
        yield (
            f"outputs of the plant were recorded at {1e9 / step:.6g} Hz and not filtered: vibration above "
            f"{0.5e9 / step:.6g} Hz is aliased; a sensor keeps all of its samples"
        )


def _chosen(run: RunData, only: Sequence[str]) -> _Chosen:
    if not only:
        return _Chosen([*run.signals], [*run.measurements], [*run.commands], bool(run.mode.size), True)
    chosen = _Chosen()
    faults = []
    points = numbered(run.signals)
    for name in dict.fromkeys(only):
        plain = name.removeprefix(MEASURED).removeprefix(TRUE)
        if plain in run.measurements and not name.startswith(TRUE):
            chosen.sensors.append(plain)
        elif plain in run.signals and not name.startswith(MEASURED):
            chosen.outputs.append(plain)
        elif name in run.commands:
            chosen.controllers.append(name)
        elif name in points:
            chosen.outputs += points[name]
        elif name == MODE and run.mode.size:
            chosen.mode = True
        elif name == EVENTS:
            chosen.events = True
        else:
            known = signals(run) | dict.fromkeys([*run.commands, *[MODE] * bool(run.mode.size), EVENTS], "")
            faults.append(str(unknown(name, known)))
    if faults:
        raise UsageError("\n".join(faults))
    return chosen


def _outputs(run: RunData, times: Integers, signals: dict[str, Samples], mode: bool) -> Iterator[Table]:
    if not signals and not mode:
        return
    t_ns = next(iter(signals.values())).t_ns if signals else times
    columns = [Column(name, run.units.get(name, ""), v) for name, (_, v) in signals.items()]
    if mode:
        columns.append(Column(MODE, "", _at(t_ns, times, run.mode), "number of the mode set; -1: not recorded"))
    yield Table(OUTPUTS, t_ns, tuple(columns), channels=True)


def _at(t_ns: Integers, times: Integers, values: Integers) -> Integers:
    """The values at `t_ns` of `times`; -1 where there is none."""
    rows = np.minimum(np.searchsorted(times, t_ns), max(times.size - 1, 0))
    return np.where(times[rows] == t_ns, values[rows], -1) if times.size else values


def _sensors(run: RunData, sensors: dict[str, Samples]) -> Iterator[Table]:
    """One table for the sensors of each rate."""
    groups: list[tuple[float, Integers, list[str]]] = []
    for name, (t_ns, _) in sensors.items():
        step = period(t_ns)
        for i, (other, times, names) in enumerate(groups):
            together = _union(times, t_ns)
            alike = abs(other - step) <= 1e-3 * step and (np.diff(together) >= _APART * step).all()
            if alike:
                groups[i] = (other, together, [*names, name])
                break
        else:
            groups.append((step, t_ns, [name]))
    for step, times, names in groups:
        title = f"sensors_{shown(1e9 / step)}_Hz" if step else "sensors_unknown_rate"
        columns = []
        for name in names:
            values = np.full(times.size, np.nan)
            values[np.searchsorted(times, sensors[name].t_ns)] = sensors[name].v
            columns.append(Column(name, run.units.get(MEASURED + name, ""), values))
        yield Table(title, times, tuple(columns), channels=True)


def _union(times: Integers, other: Integers) -> Integers:
    """Times of either, in order. Sorting takes a quarter of the time of np.union1d here: it hashes even times badly."""
    if np.array_equal(times, other):
        return times
    both = np.sort(np.concatenate((times, other)))
    return both[np.concatenate(([True], np.diff(both) > 0))] if both.size else both


def shown(rate: float) -> str:
    """Return a rate [Hz] as a part of a name, with up to six digits: "1000", "33p3333"."""
    return np.format_float_positional(rate, 6, fractional=False, trim="-").replace(".", "p")


def _commands(run: RunData, name: str) -> Table:
    commands = run.commands[name]
    columns = [
        Column("tick", "", commands.tick, "frame from which the command was in force"),
        Column("answered", "", commands.answered, "frame whose measurements it answers"),
        Column("status", "", commands.status, "0 as sent, 1 clamped or completed, 2 safe values because none came"),
    ]
    width = commands.values.shape[1]
    drives = actuators(run).get(name) or [f"command_{i + 1}" for i in range(width)]  # the recording may not name them
    columns += [Column(drive, unit_of(run, drive), v) for drive, v in zip(drives, commands.values.T)]
    return Table(f"commands_{name}", commands.tick * run.frame_ns, tuple(columns))


def _events(run: RunData) -> Table:
    t_ns = np.array([event["t_ns"] for event in run.events], np.int64)
    ticks = np.array([event["tick"] for event in run.events], np.int64)
    columns = [Column("tick", "", ticks, "frame of the event")]
    for name in ("source", "kind", "text"):
        texts = [event[name].replace("\0", "\ufffd") for event in run.events]
        columns.append(Column(name, "", np.array(texts, object)))
    data = [json.dumps(event["data"]) if event["data"] else "" for event in run.events]
    columns.append(Column("data", "", np.array(data, object)))
    return Table(EVENTS, t_ns, tuple(columns))


def _plain(table: Table) -> Table:
    """The table with names that can be those of files and groups."""
    columns = tuple(replace(column, name=column.name.replace("/", "_")) for column in table.columns)
    return replace(table, name=re.sub(r"\W", "_", table.name), columns=columns)


def _distinct(made: Iterable[Table], taken: tuple[str, ...] = ()) -> Iterator[Table]:
    """The tables; no name stands twice, nor that of a column, which also differs from those that are `taken`."""
    made = list(made)
    names = distinct((table.name for table in made), "{}_{}")
    for name, table in zip(names, made):
        labels = distinct((*taken, *(column.name for column in table.columns)), "{}_{}")[len(taken) :]
        columns = tuple(replace(column, name=label) for label, column in zip(labels, table.columns))
        yield replace(table, name=name, columns=columns)
