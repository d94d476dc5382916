"""The result of a run, simulated in this process or read from a recording.

A run can be written, exported and drawn; its overview is one screen of text, without arrays.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from rig.machine.files import recording_name
from rig.printable import counted
from rig.record.film_points import grouped
from rig.record.run_data import Commands, Integers, Reals, RunData, Samples, period
from rig.results import Column, Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import DataTree


LINES = 12
"""Most outputs, and most sensors, that have a line each."""
WIDTH = 120
"""Most characters of a line."""
_RANGE = (Column("name"), Column("lowest", digits=".6g"), Column("highest", digits=".6g"), Column("unit"))


def overview(run: RunData) -> Iterator[str | Table]:
    """Yield scene, length, timing verdict, controllers, events and damage, outputs and sensors with their ranges."""
    for name, text in _rows(run):
        line = f"{name}: {text}"
        yield line if len(line) <= WIDTH else f"{line[: WIDTH - 4]} ..."
    if not run.measured:
        yield f"\noutputs: {counted(run.time.size, 'row')}{_rate(np.rint(run.time * 1e9).astype(np.int64))}"
        if run.signals:
            yield _outputs(run)
    if run.measurements:
        yield "\nsensors"
        yield _sensors(run)


def _rows(run: RunData) -> Iterator[tuple[str, str]]:
    length = run.span[1] if run.span else 0.0
    if run.measured:
        yield "measurement", f"{run.name}, {length:g} s"
    else:
        yield "run", f"{_scene(run)}, {length:g} s, step {run.step_ns / 1e6:g} ms"
        yield "timing", _timing(run)
    commands = (f"{name}: {counted(sent.tick.size, 'command')}" for name, sent in run.commands.items())
    yield "controllers", ", ".join(commands) or "none"
    kinds = Counter(event["kind"] for event in run.events)
    yield "events", ", ".join(f"{kind} {number}" for kind, number in kinds.items()) or "none"
    if "error" in run.energy:
        yield "energy", f"residual of the balance: {abs(run.energy['error']):.1e} of its largest term"
    for label, text in (("fault", run.fault), ("recovered", run.recovered), ("restarted", run.untold)):
        if text and text != run.damage:
            yield label, text.partition("\n")[0]
    yield "damage", run.damage or "none"


def _scene(run: RunData) -> str:
    try:
        scene = json.loads(run.scene)
    except ValueError:
        return "unknown scene"
    return f"scene {scene.get('name') or scene.get('plant', '')}" if isinstance(scene, dict) else "unknown scene"


def _timing(run: RunData) -> str:
    verdict = run.summary.get("verdict")
    reasons = run.summary.get("reasons", ())
    if verdict is None:
        return "simulated without a clock"
    return f"{verdict}: {', '.join(map(str, reasons))}" if reasons else str(verdict)


def _outputs(run: RunData) -> Table:
    rows = []
    for name, members in grouped(run.signals).items():
        ends = _range([run.signals[member] for member in members])
        rows.append((name, *ends, run.units.get(members[0], ""), len(members) if len(members) > 1 else ""))
    return Table("outputs", (*_RANGE, Column("points", digits=".0f")), rows, LINES)


def _sensors(run: RunData) -> Table:
    rows = []
    for name, (t_ns, v) in run.measurements.items():
        step = period(t_ns)
        unit = run.units.get(f"meas/{name}", "")
        rows.append((name, *_range([v]), unit, v.size, 1e9 / step if step else None))
    return Table("sensors", (*_RANGE, Column("rows", digits=".0f"), Column("rate", "Hz", ".6g")), rows, LINES)


def _range(values: list[Reals]) -> tuple[float, float] | tuple[None, None]:
    """The lowest and the highest value, if there is any."""
    finite = np.concatenate([v[np.isfinite(v)] for v in values])
    return (float(finite.min()), float(finite.max())) if finite.size else (None, None)


def _rate(t_ns: Integers) -> str:
    step = period(t_ns)
    return f" at {1e9 / step:.6g} Hz" if step else ""


__all__ = ["Commands", "Integers", "Reals", "Run", "Samples"]


class Run(RunData, Result):
    """A run: arrays with units, and what is done with them. Printed, it is an overview of one screen."""

    FIGURE: ClassVar = "rig.view.run_figure:figure"

    def to_pandas(self) -> dict[str, DataFrame]:
        """Return one frame for each table: outputs, sensors of each rate, commands of each controller, events.

        Columns have the names of the run. The index is the time [s]; `frame.attrs["units"]` has their units. Raises
        rig.errors.UsageError if pandas is not installed.
        """
        from rig.record.export.tables import frames, tables

        return frames(tables(self, plain=False))

    def to_xarray(self) -> DataTree:
        """Return a tree with one dataset for each table of `to_pandas`, over the coordinate `time` [s].

        Each variable has the attribute `units`. Facts about the run are variables of the root. Raises
        rig.errors.UsageError if xarray is not installed.
        """
        from rig.record.export.files import description
        from rig.record.export.tables import tables, tree

        return tree(tables(self), description(self))

    def plot(self, only: Collection[str] = ()) -> Figure:
        """Return the figure of the run, as `rig simulate --figure` draws it; `savefig` writes it to a file.

        `only`: names of the sensors and outputs that are drawn over time, instead of the plots of the rig. Raises
        rig.errors.UsageError for a name that the run does not have.
        """
        return self._drawn(only)

    def save(self, path: Path | str) -> None:
        """Write the run as a recording (NAME.mcap), over an existing file.

        Raises rig.errors.UsageError for another suffix, OutputError if the file cannot be written.
        """
        from rig.record.save_run import save

        recording_name(Path(path))
        save(self, Path(path))

    def checked(self) -> Self:
        """Return the run itself. Raises its `failure`, which then contains the run, if a controller has stopped it."""
        if self.failure is not None:
            self.failure.run = self
            raise self.failure
        return self

    def shown(self) -> Iterator[str | Table]:
        """Yield the overview."""
        return overview(self)
