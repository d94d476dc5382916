"""What a recording says of itself at its begin and its end, read without its messages.

`commanded` makes the commands of controllers channels: one for each actuator, held from frame to frame as the plant
held them.
"""

from __future__ import annotations

import json
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import SeekingReader

from rig.controllers import controller_drives
from rig.errors import LogError
from rig.machine.files import regular
from rig.record import film_points, mcap_file
from rig.record.run_data import Integers, Reals, RunData, Samples
from rig.scenes.rooms import assembled

_ENDS = ("disconnected", "dismissed")

SUFFIX = ".mcap"


def commanded(run: RunData) -> tuple[str, ...]:
    """Return the actuators that controllers of `run` commanded."""
    return tuple(dict.fromkeys(actuator for name in run.commands for actuator in actuators(run).get(name, ())))


def unit_of(run: RunData, actuator: str) -> str:
    """Return the unit of an actuator of the run's scene; "" if the scene has no such actuator."""
    scene = film_points.read(run.scene)
    inputs = assembled(scene.parameters, scene.frame_ns, random=False).inputs if scene else {}
    return inputs[actuator].unit if actuator in inputs else ""


def held(run: RunData, actuator: str) -> Samples:
    """Return the commands to `actuator` in force at every frame (zero-order hold), from the first one on.

    A frame in which no controller commands it is NaN: after the controller was disconnected, up to its next command.
    """
    parts: list[tuple[Integers, Reals]] = []
    for name, driven in actuators(run).items():
        if actuator not in driven:
            continue
        commands = run.commands[name]
        parts.append((commands.tick, commands.values[:, driven.index(actuator)]))
        ends = [e["tick"] for e in run.plant_events if e["kind"] in _ENDS and e["data"].get("controller") == name]
        parts.append((np.array(ends, np.int64), np.full(len(ends), np.nan)))
    tick, values = (np.concatenate(part) for part in zip(*parts))
    order = np.argsort(tick, kind="stable")
    tick = tick[order]
    values = values[order]
    end = round(float(run.time[-1]) * 1e9) // run.frame_ns if run.time.size else int(tick[-1])
    frames = np.arange(tick[0], max(end, int(tick[-1])) + 1)
    return Samples(frames * run.frame_ns, values[np.searchsorted(tick, frames, side="right") - 1])


def actuators(run: RunData) -> dict[str, tuple[str, ...]]:
    """Return the actuators of each controller with commands, of the scene or admitted while it ran.

    None if the recording lost its scene, or its code is not trusted.
    """
    scene = film_points.read(run.scene)
    if scene is None:
        return {}
    drives = {name: controller_drives(section) for name, section in scene.controllers.items()}
    guests = [e["data"] for e in run.plant_events if e["kind"] == "admitted"]
    drives |= {data["controller"]: tuple(data["drives"]) for data in guests}
    return {
        name: driven
        for name, driven in drives.items()
        if name in run.commands and run.commands[name].tick.size and run.commands[name].values.shape[1] == len(driven)
    }


@dataclass(frozen=True)
class Contents:
    """A summary of one recording."""

    scene: str
    """Name of the scene; empty if the recording does not state it."""
    title: str
    began_ns: int
    """The wall clock at simulated time 0, in ns since 1970 (UTC)."""
    seconds: float | None
    """Simulated time [s], of a window its length; None if unknown: it was cut off, or an older version saved it."""
    timing: str
    """Timing verdict, "simulated" for a run that followed no clock, "measured", empty if unknown."""
    messages: int | None
    """None if unknown: it was cut off or is damaged."""
    run: str
    digest: str
    """SHA-256 of the recording, as it states it."""


def contents(path: Path) -> Contents:
    """Read a summary of a recording from its index.

    Raises LogError for a file that cannot be read, is no recording of this project, or was cut off: such a file has no
    index, and `rig.open` reads what it has. The messages are not read, and no damage to them is found.
    """
    try:
        size = regular(path)
        file = path.open("rb")
    except OSError as fault:
        raise LogError(f"{path} cannot be read: {fault.strerror}") from None
    with file:
        return _contents(path, file, size)


def digest(path: Path) -> str:
    """Return the SHA-256 that a recording states of itself; empty if it states none, e.g. because it was cut off."""
    try:
        return contents(path).digest
    except LogError:
        if not os.path.exists(path):
            raise
        return ""


def _contents(path: Path, file: BinaryIO, size: int) -> Contents:
    magic = mcap_file.MAGIC
    try:
        if file.read(len(magic)) != magic:
            raise LogError(f"{path} is not an MCAP file")
        file.seek(max(0, size - len(magic)))
        if size < 2 * len(magic) or file.read() != magic:
            raise LogError(f"{path} was cut off, or a run is writing it: it has no index yet")
        file.seek(0)
        log = SeekingReader(file, record_size_limit=size)
        profile = log.get_header().profile
        summary = log.get_summary()
        if profile != mcap_file.PROFILE:
            raise LogError(f"{path} is an MCAP file of another program (profile {profile!r}), not of friction-rig")
        if summary is None or summary.statistics is None:
            raise LogError(f"{path} has no index; rig recover writes one")
        noted = {record.name: record.metadata for record in log.iter_metadata()}
        scene = next(
            (attachment.data for attachment in log.iter_attachments() if attachment.name == "scene.json"), b"{}"
        )
    except (McapError, OSError, ValueError, EOFError, MemoryError, struct.error) as fault:
        raise LogError(f"{path} is cut off or damaged: {fault or type(fault).__name__}") from None
    mcap_file.refuse_newer(path, noted.get("log", {}))
    described = _json(scene.decode(errors="replace"), {})
    described = described if isinstance(described, dict) else {}
    seconds = _json(noted.get("recording", {}).get("seconds", "null"), None)
    began = _json(noted.get("recording", {}).get("began", "null"), None)
    begin = _json(noted.get("trigger", {}).get("begin", "0"), 0.0)
    run = noted.get("log", {}).get("run", "")
    made = {"saved": "simulated", "measured": "measured"}.get(noted.get("log", {}).get("made", ""), "")
    return Contents(
        scene=run if made == "measured" else str(described.get("name", "")),
        title=str(described.get("title", "")),
        began_ns=began if isinstance(began, int) else summary.statistics.message_start_time,  # as in format 1
        seconds=seconds - begin if isinstance(seconds, float) and isinstance(begin, int | float) else None,
        timing=made or str(_json(noted.get("summary", {}).get("verdict", '""'), "")),
        messages=summary.statistics.message_count,
        run=run,
        digest=noted.get(mcap_file.DIGEST, {}).get("sha256", ""),
    )


def _json(text: str, otherwise: Any) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return otherwise
