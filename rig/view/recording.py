"""A recording in rerun: everything that was recorded, at the simulated time at which it was published."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.errors import OutputError
from rig.machine.files import draft_of
from rig.machine.process import stopping
from rig.record.run import Integers, Run
from rig.view import curves
from rig.view.curves import Known, known, rate
from rig.view.drawing import Drawing, send

if TYPE_CHECKING:
    import rerun as rr

_ROWS = 1 << 14
_BATCH_NS = 2_000_000_000
"""Simulated time of the rows that are sent at once: each sending costs as much as hundreds of rows."""
_PORTRAIT_NS = 100_000_000
_FLUSH_S = 60.0
_LOOK_S = 0.2


def drawing_of(run: Run) -> Drawing:
    """The entities of a run. Raises LogError if damage to the recording removed the scene."""
    outputs = {name: run.units.get(name, "") for name in run.signals}
    sensors = {name: run.units.get(f"meas/{name}", "") for name in run.measurements}
    shows = known(run)
    apart = "" if shows is Known.ALL else f"{rate(run)} samples/s"
    scene = "" if run.measured else run.scene_text()
    return Drawing(scene, outputs, sensors, apart, shows is Known.ALIAS)


def view_run(
    run: Run,
    name: str,
    *,
    web: bool = False,
    save: Path | str | None = None,
    say: Callable[[str], object] = print,
) -> None:
    """Show a whole run in rerun under `name`, with the window arranged for its rig.

    It is shown in a window, or with `web` on a browser page until Ctrl-C, with `save` in a file (.rrd). Raises LogError
    for a run without its scene and for a file that cannot be written, UsageError without a display,
    rig.errors.Untrusted for parts from files.
    """
    from rig.view import viewer

    drawing = drawing_of(run)
    end = curves.end_of(run)
    if save is not None:
        with (
            draft_of(Path(save)) as draft,
            viewer.sink(name, drawing, until=end, save=draft) as (rec, _),
        ):
            write(run, rec, drawing)
            free = f"{shutil.disk_usage(draft.parent).free >> 20} MiB are free there"
            _flush(rec, f"{save} cannot be written: {free}")
        return
    with viewer.sink(name, drawing, until=end, web=web) as (rec, shown):
        write(run, rec, drawing)
        _flush(rec, "the viewer was closed, or hangs: it does not have the whole run")
        if shown is not None and web:
            say(f"{name} at {shown.page} until Ctrl-C\n{viewer.OPEN_TO}")
            with stopping() as stop:
                while shown.alive and not stop.wait(_LOOK_S):
                    pass


def _flush(rec: rr.RecordingStream, otherwise: str) -> None:
    """Wait until everything is sent: nothing is dropped. Raises OutputError with the text of `otherwise`."""
    try:
        rec.flush(timeout_sec=_FLUSH_S)
    except Exception as fault:  # rerun's own kinds
        raise OutputError(f"{otherwise} ({fault})") from None


def write(run: Run, rec: rr.RecordingStream, drawing: Drawing) -> None:
    """Send outputs, measurements, commands and events of a run to `rec`."""
    drawing.static(rec)
    t_ns = np.rint(run.time * 1e9).astype(np.int64)
    keys = run.mode if run.mode.size else np.full(t_ns.size, -1, np.int64)
    for rows in _parts(t_ns, _BATCH_NS):
        signals = {name: v[rows] for name, v in run.signals.items()}
        send(rec, drawing.states(t_ns[rows], signals, keys[rows]))
    if drawing.pair is not None:
        x, v = (run.signals[name] for name in drawing.pair)
        step_ns = int(np.median(np.diff(t_ns))) if t_ns.size > 1 else run.step_ns
        for rows in _parts(t_ns, _PORTRAIT_NS):
            send(rec, drawing.portrait(t_ns[rows], x[rows], v[rows], keys[rows], step_ns))
    for name, samples in run.measurements.items():
        for begin in range(0, samples.v.size, _ROWS):
            rows = slice(begin, begin + _ROWS)
            send(rec, drawing.measured(name, samples.t_ns[rows], samples.v[rows]))
    for name, commands in run.commands.items():
        if commands.tick.size:
            send(rec, drawing.commands(name, commands.tick * run.frame_ns, commands.values))
    send(rec, drawing.events(event for event in run.events if event["kind"] != "contact"))


def _parts(t_ns: Integers, length_ns: int) -> Iterator[slice]:
    """Slices of times, each within one interval of this length."""
    cuts = np.flatnonzero(np.diff(t_ns // length_ns)) + 1
    ends = [0, *cuts.tolist(), t_ns.size] if t_ns.size else []
    for begin, end in pairwise(ends):
        yield slice(begin, end)
