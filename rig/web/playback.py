"""A whole recording for the page: what a page that had watched the run would know, and the moving picture.

setup     as of a run that is followed (`rig.web.follower.description`)
frame     one frame (`rig.web.frames`) with the extremes of all outputs and measurements, and all events
pictures  {"t": [s], "frames": [what has moved]}, at most `PICTURES`

For a list of recordings, `at_rest` gives one picture without reading the messages.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import UsageError
from rig.record.reader import open as read
from rig.record.recorded_setup import head, setup_of
from rig.scenes.scene import Scene
from rig.structure import model_store
from rig.view.channels import Channels
from rig.view.contact import Contacts, Modes
from rig.view.spans import joined
from rig.web.follower import description
from rig.web.form import picture
from rig.web.frames import columns
from rig.web.picture import MovingPicture
from rig.web.plain_json import finite

SPANS, PICTURES = 3000, 600
"""Most spans of an output or a sensor; most pictures."""
RATE = 20.0
"""Pictures of a second, at most."""


def recorded(path: Path) -> dict[str, Any]:
    """A recording for the page. Raises UsageError for one without outputs or scene, LogError for one that is none."""
    run, setup = read(path), setup_of(head(path))
    if run.measured or run.time.size < 2 or not setup.frame_ns:
        raise UsageError(f"{path.name} contains no states of a rig; its report and its spectrum show what it contains")
    scene = Scene.from_json(run.scene_text())
    assembly = scene.assemble()
    system = assembly.system()
    sensors = {name: unit for name, (unit, _) in setup.sensors.items()}
    channels, contacts = Channels((scene, assembly), setup.outputs, sensors), Contacts(system)
    t_ns, end = np.rint(run.time * 1e9).astype(np.int64), float(run.time[-1])
    outputs = {name: run.signals.get(name, np.full(t_ns.size, np.nan)) for name in setup.outputs}
    keys = run.mode if run.mode.size else np.full(t_ns.size, -1, np.int64)
    begins = np.concatenate(([2 * t_ns[0] - t_ns[1]], t_ns[:-1]))
    bits = (1 << contacts.indices(keys)) * bool(run.mode.size)  # none where the modes were not recorded
    rows = _spans(begins, t_ns, np.array([*outputs.values()]), bits)
    measured = {
        name: {"from": told["from"], "t": told["t"], "low": told["low"][0], "high": told["high"][0]}
        for name, (t, v) in run.measurements.items()
        if t.size and (told := _spans(t - setup.sensors[name][1], t, v[None]))
    }
    events = [
        {"t": e["t_ns"] * 1e-9, "level": "", **{key: e.get(key, "") for key in ("source", "kind", "text")}}
        for e in run.events
        if e["kind"] not in ("contact", "verdict")
    ]
    still, frames, times = None, [], []
    try:
        if (moving := MovingPicture.of(scene, assembly, system, channels.colours)) is not None:
            still, modes = moving.still, Modes(system).indices(keys)
            count = int(np.clip((end - run.time[0]) * RATE, 2, min(PICTURES, t_ns.size)))
            for part in (slice(*pair) for pair in pairwise(np.linspace(0, t_ns.size, count + 1).astype(int).tolist())):
                frames.append(moving.frame(t_ns[part], {k: x[part] for k, x in outputs.items()}, modes[part]))
                times.append(float(run.time[part.stop - 1]))
    except Exception:  # of a drawer that came with a plant of the user: curves and events are shown without it
        still, frames, times = None, [], []
    whole: dict[str, Any] = finite(
        {
            "setup": description(setup, scene, assembly, channels, contacts.names, still),
            "frame": {"n": 1, "t": end, "lost": 0, "rows": rows, "meas": measured, "events": events},
            "pictures": {"t": times, "frames": frames},
        }
    )
    return whole


def at_rest(path: Path) -> dict[str, Any] | None:
    """The picture of the recorded rig before its run (`rig.web.form.picture`); None without a rig. Raises LogError."""
    setup = setup_of(head(path))
    if not setup.scene:
        return None
    for model in setup.models:
        model_store.offer(model)
    scene = Scene.from_json(setup.scene)
    return picture(scene, scene.assemble())


def _spans(begins: Any, ends: Any, values: Any, bits: Any = None) -> dict[str, Any]:
    bits = np.zeros(values.shape, np.int64) if bits is None else bits
    return columns(joined(begins, ends, values, values, bits, SPANS))
