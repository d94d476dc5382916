"""A whole recording for the page: what a page that had watched the run would know, and the moving picture.

setup     as of a run that is followed (`rig.web.follower.description`)
frame     one frame (`rig.web.frames`) with the extremes of all outputs and measurements, and all events
pictures  {"t": [s], "frames": [what has moved]}, at most `PICTURES`

For a list of recordings, `at_rest` gives one picture without reading the messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rig.bus.run_setup import Setup
from rig.errors import UsageError
from rig.record.reader import open as read
from rig.record.recorded_setup import head, setup_of
from rig.record.run import Run
from rig.scenes.scene import Scene
from rig.structure import model_store
from rig.view.channels import Channels
from rig.view.contact import Contacts, Modes
from rig.view.spans import Spans, joined
from rig.web.follower import description
from rig.web.form import picture
from rig.web.frames import columns, of_sensors
from rig.web.picture import MovingPicture
from rig.web.plain_json import finite

SPANS = 3000
"""Most spans of an output or a sensor. # chosen"""
PICTURES = 600
"""Most pictures. # chosen"""
RATE = 20.0
"""Pictures of a second, at most."""
_UNSHOWN = ("contact", "verdict")
"""Kinds of events that the page does not list: contact states, which a live run does not publish; the summary."""


def recorded(path: Path) -> dict[str, Any]:
    """A recording for the page. Raises UsageError for one without outputs or scene, LogError for one that is none."""
    run = read(path)
    setup = setup_of(head(path))
    if run.measured or run.time.size < 2 or not setup.frame_ns:
        raise UsageError(f"{path.name} contains no states of a rig; its report and its spectrum show what it contains")
    scene = Scene.from_json(run.scene_text())
    assembly = scene.assemble()
    system = assembly.system()
    sensors = {name: unit for name, (unit, _) in setup.sensors.items()}
    channels = Channels((scene, assembly), setup.outputs, sensors)
    contacts = Contacts(system)
    t_ns = _nanoseconds(run.time)
    outputs = {name: run.signals.get(name, np.full(t_ns.size, np.nan)) for name in setup.outputs}
    keys = run.mode if run.mode.size else np.full(t_ns.size, -1, np.int64)
    begins = np.concatenate(([2 * t_ns[0] - t_ns[1]], t_ns[:-1]))
    bits = (1 << contacts.indices(keys)) * bool(run.mode.size)  # none where the modes were not recorded
    frame = {
        "n": 1,
        "t": float(run.time[-1]),
        "lost": 0,
        "rows": columns(_spans(begins, t_ns, np.array([*outputs.values()]), bits)),
        "meas": _measured(run, setup),
        "events": [_event(event) for event in run.events if event["kind"] not in _UNSHOWN],
    }
    still = None
    pictures: dict[str, Any] = {"t": [], "frames": []}
    try:
        moving = MovingPicture.of(scene, assembly, system, channels.colours)
        if moving is not None:
            still = moving.still
            pictures = _pictures(moving, run.time, outputs, Modes(system).indices(keys))
    except Exception:  # of a drawer that came with a plant of the user: curves and events are shown without it
        still = None
    whole: dict[str, Any] = finite(
        {
            "setup": description(setup, scene, assembly, channels, contacts.names, still),
            "frame": frame,
            "pictures": pictures,
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


def _measured(run: Run, setup: Setup) -> dict[str, Any]:
    """The extremes of the samples of each sensor that has some."""
    spans = {}
    for name, (t_ns, values) in run.measurements.items():
        if t_ns.size:
            _, period_ns = setup.sensors[name]
            samples = values[None]
            spans[name] = _spans(t_ns - period_ns, t_ns, samples, np.zeros(samples.shape, np.int64))
    return of_sensors(spans)


def _event(event: Mapping[str, Any]) -> dict[str, Any]:
    """An event of the list, without its data."""
    words = {key: event.get(key, "") for key in ("source", "kind", "text")}
    return {"t": event["t_ns"] * 1e-9, "level": "", **words}


def _pictures(moving: MovingPicture, time: Any, outputs: Mapping[str, Any], modes: Any) -> dict[str, Any]:
    """The frames of the moving picture, each at the end of its part of the run."""
    t_ns = _nanoseconds(time)
    count = int(np.clip((time[-1] - time[0]) * RATE, 2, min(PICTURES, t_ns.size)))
    edges = np.linspace(0, t_ns.size, count + 1).astype(int).tolist()
    times = []
    frames = []
    for begin, end in pairwise(edges):
        signals = {name: values[begin:end] for name, values in outputs.items()}
        frames.append(moving.frame(t_ns[begin:end], signals, modes[begin:end]))
        times.append(float(time[end - 1]))
    return {"t": times, "frames": frames}


def _nanoseconds(time: Any) -> Any:
    return np.rint(time * 1e9).astype(np.int64)


def _spans(begins: Any, ends: Any, values: Any, bits: Any) -> Spans:
    """At most `SPANS` spans of samples, each of which is its own lowest and highest value."""
    return joined(begins, ends, values, values, bits, SPANS)
