"""A recording in rerun: every sample that was recorded, at the simulated time at which it was published."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.record.run import Run
from rig.view.drawing import Drawing, send

if TYPE_CHECKING:
    import rerun as rr

_ROWS = 1 << 14
_PORTRAIT_NS = 100_000_000


def write_run(run: Run, rec: rr.RecordingStream, drawing: Drawing) -> None:
    """Send a whole run to `rec`."""
    drawing.static(rec)
    t_ns = np.rint(run.time * 1e9).astype(np.int64)
    keys = run.mode if run.mode.size else np.full(t_ns.size, -1, np.int64)
    slices = np.searchsorted(t_ns, np.arange(0, (t_ns[-1] if t_ns.size else 0) + _PORTRAIT_NS, _PORTRAIT_NS)).tolist()
    for begin, end in zip(slices, [*slices[1:], t_ns.size]):
        if begin < end:
            part = {name: v[begin:end] for name, v in run.signals.items()}
            send(rec, drawing.states(t_ns[begin:end], part, keys[begin:end]))
            send(rec, drawing.portrait())
    for name, samples in run.measurements.items():
        for begin in range(0, samples.v.size, _ROWS):
            part_ns, v = samples.t_ns[begin : begin + _ROWS], samples.v[begin : begin + _ROWS]
            send(rec, drawing.measured(name, part_ns, v))
    for name, commands in run.commands.items():
        if commands.tick.size:
            send(rec, drawing.commands(name, commands.tick * run.frame_ns, commands.values))
    send(rec, drawing.events(event for event in run.events if event["kind"] != "contact"))


def drawing_of(run: Run) -> Drawing:
    """The entities of a run."""
    outputs = {name: run.units.get(name, "") for name in run.signals}
    sensors = {name: run.units.get(f"meas/{name}", "") for name in run.measurements}
    return Drawing(run.scene_text(), outputs, sensors)


def view_log(path: Path | str, save: Path | str | None = None, web: bool = False) -> None:
    """Show the recording `path` in rerun: in a window, a browser page, or in the file `save` (.rrd).

    Raises LogError for a file that is no recording. In a browser page it stays until Ctrl-C.
    """
    from rig.record import reader
    from rig.view.viewer import sink

    run = reader.open(path)
    drawing = drawing_of(run)
    with sink(Path(path).stem, drawing, live=False, save=save, web=web) as (rec, shown):
        write_run(run, rec, drawing)
        rec.flush(timeout_sec=60.0)  # all of it, however long it takes
        if shown is not None and web:
            shown.wait()
