"""The result of a run, simulated in this process or read from a recording.

A run can be written, exported and drawn; its overview is one screen of text, without arrays.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from rig.machine.files import recording_name
from rig.printable import counted
from rig.record.film_points import grouped
from rig.record.run_data import Commands, Integers, Reals, RunData, Samples, period
from rig.results import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import DataTree


LINES = 12
"""Most outputs, and most sensors, that have a line each."""
WIDTH = 120
"""Most characters of a line."""
_LABEL = 40  # widest column of names


def overview(run: RunData) -> str:
    """Return scene, length, timing verdict, outputs and sensors with their ranges, controllers, events and damage.

    All texts begin in one column, so that the notebook shows them as one table.
    """
    rows = [*_rows(run)]
    label = min(max(len(name) for name, _ in rows), _LABEL)
    lines = (f"{name:<{label}}  {text}".rstrip() for name, text in rows)
    return "\n".join(line if len(line) <= WIDTH else f"{line[: WIDTH - 4]} ..." for line in lines)


def _rows(run: RunData) -> Iterator[tuple[str, str]]:
    length = run.span[1] if run.span else 0.0
    if run.measured:
        yield "measurement", f"{run.name}, {length:g} s"
    else:
        yield "run", f"{_scene(run)}, {length:g} s, step {run.step_ns / 1e6:g} ms"
        yield "timing", _timing(run)
        yield "outputs", f"{counted(run.time.size, 'row')}{_rate(np.rint(run.time * 1e9).astype(np.int64))}"
        yield from _some(_outputs(run), len(grouped(run.signals)))
    if run.measurements:
        yield "sensors", str(len(run.measurements))
        yield from _some(_sensors(run), len(run.measurements))
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


def _some(rows: Iterator[tuple[str, str]], count: int) -> Iterator[tuple[str, str]]:
    yield from islice(rows, LINES)
    if count > LINES:
        yield f"  and {count - LINES} more", ""


def _outputs(run: RunData) -> Iterator[tuple[str, str]]:
    for name, members in grouped(run.signals).items():
        unit = run.units.get(members[0], "") + (f" at {len(members)} points" if len(members) > 1 else "")
        yield f"  {name}", f"{_range([run.signals[member] for member in members])} {unit}"


def _sensors(run: RunData) -> Iterator[tuple[str, str]]:
    for name, (t_ns, v) in run.measurements.items():
        unit = run.units.get(f"meas/{name}", "")
        rows = counted(v.size, "row")
        yield f"  {name}", f"{_range([v])} {unit}, {rows}{_rate(t_ns)}"


def _range(values: list[Reals]) -> str:
    finite = [v[np.isfinite(v)] for v in values]
    known = [v for v in finite if v.size]
    if not known:
        return "no value"
    return f"{min(v.min() for v in known):.6g} .. {max(v.max() for v in known):.6g}"


def _rate(t_ns: Integers) -> str:
    step = period(t_ns)
    return f" at {1e9 / step:.6g} Hz" if step else ""


__all__ = ["Commands", "Integers", "Reals", "Run", "Samples"]


class Run(RunData, Result):
    """A run: arrays with units, and what is done with them. Printed, it is an overview of one screen."""

    FIGURE: ClassVar = "rig.view.run_figure:figure"

    def to_pandas(self) -> dict[str, DataFrame]:
        """Return one frame for each table: outputs, sensors of each rate, commands of each controller, events.

        The index is the time [s]; `frame.attrs["units"]` has the unit of each column. Raises rig.errors.UsageError if
        pandas is not installed.
        """
        from rig.record.export.tables import frames, tables

        return frames(tables(self))

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

    def text(self) -> str:
        """Return the overview as text."""
        return overview(self)
