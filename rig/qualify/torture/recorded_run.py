"""A case of the torture test as a user runs it: with sensors, as a recording that is verified, and as processes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from rig.bench.again.verify import verify
from rig.bench.live.supervise import run as supervise
from rig.bench.run.journal import OPERATOR
from rig.bench.run.simulate import Recorded, simulate
from rig.printable import counted
from rig.qualify.torture.case import Act, Case, Watched, changed
from rig.qualify.torture.results import CellResult, red
from rig.record import reader
from rig.record.compare import compare
from rig.record.run import Run
from rig.scenes.scene import Scene

RECORDED = 4000
"""Most sample steps of a recording, or one frame. # chosen: recording and verifying it take a tenth of a second"""


def recording(case: Case, scene: Watched, until_ns: int) -> CellResult | None:
    """Record the begin of a run, and return what is wrong with its measurements or its file; None: nothing.

    Of the actions of the case, an operator carries out set, change and knock, without ramps. The outputs are those of
    the scene, and its sensors set the sample step. A rig that no scene has is not simulated again from its file.
    """
    user_scene: Scene = replace(scene, contacts=False)
    if not case.rig:
        user_scene = Scene(**{field.name: getattr(scene, field.name) for field in fields(Scene)})
    most = max(RECORDED * user_scene.step_ns // scene.frame_ns, 1)
    length = min(until_ns // scene.frame_ns, most) * scene.frame_ns
    acts = [_event(act, act.at // scene.frame_ns) for act in case.acts if act.do in ("set", "change", "knock")]
    events = sorted((event for event in acts if event["t_ns"] < length), key=lambda event: event["tick"])
    run = simulate(user_scene, {}, length, Recorded({}, events), audited=False)
    if run.fault:
        return red("recording", run.fault.splitlines()[0])
    if faults := [*_unmeasured(run)]:
        return red("recording", faults[0])
    with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder:
        path = Path(folder) / "run.mcap"
        run.save(path)
        if fault := _difference(reader.open(path), run):
            return red("recording", f"the file differs from the run: {fault}")
        faults = [] if case.rig else [*verify(path).faults]
    return red("recording", f"the file is not verified: {faults[0]}") if faults else None


def processes(case: Case, until_ns: int) -> CellResult:
    """Run the scene of a case, with its controllers and protocol, as processes in lockstep and in this process.

    Green if both give the same bits and the recording is verified. Raises BusError on a system without live runs.
    """
    scene = changed(case)
    with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder:
        path = Path(folder) / "run.mcap"
        outcome = supervise(scene, pace=None, lockstep=True, duration=until_ns * 1e-9, out=path, say=lambda line: None)
        if outcome.exit_code or outcome.died:
            return red("recording", "; ".join([*outcome.died, *outcome.summary["reasons"]]))
        log = reader.open(path)
        if fault := _difference(log, simulate(scene, duration_ns=until_ns)):
            return red("recording", f"processes give another result: {fault}")
        if faults := verify(path).faults:
            return red("recording", f"the file is not verified: {faults[0]}")
    parts = f"{counted(len(log.measurements), 'sensor')} and {counted(len(log.commands), 'controller')}"
    return CellResult("green", "", f"{parts} have the same bits as in one process")


def _event(act: Act, tick: int) -> dict[str, Any]:
    """An action as the event of an operator, as a recording contains it."""
    kind = "knock" if act.do == "knock" else "parameter"
    data: dict[str, Any] = {"impulse": act.to} if kind == "knock" else {"set": {act.target: act.to}}
    return {"t_ns": act.at, "tick": tick, "kind": kind, "text": kind, "data": {"by": OPERATOR, **data}}


def _unmeasured(run: Run) -> Iterator[str]:
    """Sensors without a finite measurement at every sample."""
    if not run.measurements:
        yield "the run has no measurements"
    for name, (_, values) in run.measurements.items():
        if not values.size:
            yield f"{name} has no samples"
        elif bad := np.count_nonzero(~np.isfinite(values)):
            yield f"{bad} of {values.size} samples of {name} are not finite"


def _difference(log: Run, run: Run) -> str:
    """The first quantity of which the recording `log` has other bits than `run`; "" if there is none.

    A live run records outputs at its frames, but every sample of a sensor.
    """
    comparison = compare(log, run)
    if comparison.missing:
        return f"only one of them has {', '.join(comparison.missing)}"
    return next((str(d) for d in comparison.differences if not d.equal or d.topic.startswith("meas/")), "")
