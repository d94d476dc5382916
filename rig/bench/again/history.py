"""What a new simulation takes from a recording: its scene, and the history of a fork that begins at a checkpoint."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rig.bench.again.agreement import changed_place
from rig.bench.run.experiment import EMERGENCY
from rig.bench.run.runner import Resumption
from rig.errors import LogError
from rig.record.run import Run
from rig.scenes.scene import Scene

# Key of the provenance: the instant up to which the samples of a fork are those of its ancestor.
CHECKPOINT = "checkpoint_ns"

# Kinds of events after which the run goes to the safe state, without further checkpoints.
_ABORTED = ("limit", EMERGENCY)


def recorded_scene(log: Path, run: Run) -> Scene:
    """The scene of the recording `log`. Raises LogError if it or the length of a frame is lost, SceneError if it is not
    of this version.
    """
    if not run.frame_ns:
        raise LogError(f"{log} has lost the description of its run: it can be read, but not simulated again")
    try:
        return Scene.from_json(run.scene_text(), f"{log}, the recorded scene")
    except LogError as fault:
        raise LogError(f"{log}: {fault}") from None


def nearest(run: Run, scene: Scene, tick: int) -> Resumption | None:
    """The last checkpoint before `tick` from which `run` can be continued with the bits of a simulation from 0 on.

    None if there is none, if the sources or the processor are others, or if samples or commands of the run are missing:
    then a simulation from the begin on has to show that it repeats.
    """
    whole = run.sealed and not (run.notes or run.untold or run.summary.get("lost")) and run.mode.size == run.time.size
    if not whole or changed_place(run) or any(event["kind"] in _ABORTED for event in run.plant_events):
        return None
    for at in sorted((at for at in run.checkpoints if at < tick), reverse=True):
        if _all_measured(run, scene, at * run.frame_ns):
            return Resumption(at, run.checkpoints[at], run.measurements)
    return None


def _all_measured(run: Run, scene: Scene, until_ns: int) -> bool:
    """Whether every sensor of the scene has all of its samples before `until_ns` in the recording."""
    for name, sensor in scene.sensors.items():
        count = sensor.instants.count(until_ns)
        if name not in run.measurements:
            return False
        if not np.array_equal(run.measurements[name].t_ns[:count], sensor.instants.at(np.arange(count))):
            return False
    return True


def history_end(run: Run) -> int:
    """Instant up to which the outputs of `run` are those of its ancestor [ns]; -1 if it has no such history."""
    stated = run.provenance.get(CHECKPOINT, "")
    return int(stated) if stated.isdecimal() else -1


def add_history(continued: Run, run: Run, tick: int) -> None:
    """Put the outputs, contacts and checkpoints of `run` up to `tick` before those of `continued`.

    `continued` was simulated from there on: it has one row of outputs at 0, then those after the checkpoint. Outputs of
    a live recording are farther apart.
    """
    now = tick * continued.frame_ns
    old = run.time <= (now + 0.5) * 1e-9
    new = np.arange(1, continued.time.size) * continued.step_ns + now

    continued.time = np.concatenate([run.time[old], new * 1e-9])
    continued.signals = {name: np.concatenate([run.signals[name][old], v[1:]]) for name, v in continued.signals.items()}
    continued.mode = np.concatenate([run.mode[old], continued.mode[1:]])
    contacts = [event for event in run.plant_events if event["kind"] == "contact" and event["t_ns"] <= now]
    continued.events = sorted([*contacts, *continued.events], key=lambda event: int(event["t_ns"]))
    continued.checkpoints = {at: state for at, state in run.checkpoints.items() if at <= tick} | continued.checkpoints
