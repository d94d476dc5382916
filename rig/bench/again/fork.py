"""Continues a recording from one of its instants, with other values from there on.

Up to the instant the recording is simulated again: its commands and the actions of operators take effect at their
recorded ticks, and the controllers see the measurements. So plant, sensors, noise, controllers and protocol are in the
state in which they were. At the instant the new values take effect, as if an operator had set them; from there on the
controllers command. The samples before the instant must agree with the recording.

If the recording contains a checkpoint before the instant (rig.bench.run.checkpoint), only what follows it is simulated
again, with the same bits, and the samples before it are those of the recording (rig.bench.again.history).

The run that results begins at 0 and holds this history. Therefore it is verified like any other recording.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from rig import controllers, design
from rig.bench.again.agreement import ELSEWHERE, agreement, changed_place, duration_ns, pairs, unknown
from rig.bench.again.compared_board import compared
from rig.bench.again.history import CHECKPOINT, add_history, nearest, recorded_scene
from rig.bench.run.builds import GOES_ON, WAITS
from rig.bench.run.experiment import FORK, PLANT, Experiment, divided
from rig.bench.run.journal import OPERATOR
from rig.bench.run.runner import Resumption
from rig.bench.run.simulate import Recorded, Stop, begun, simulate
from rig.controllers import controller_class
from rig.controllers.blocks.base import Controller, is_elsewhere, retune, tunable
from rig.controllers.runtime.skipped import KIND, SkippedSteps
from rig.errors import LogError, RigError, UsageError
from rig.printable import counted
from rig.record import reader
from rig.record.provenance import provenance
from rig.record.run import Run
from rig.scenes.faults import near, shortened
from rig.scenes.merged import OWN
from rig.scenes.scene import Scene
from rig.sensors.stream import streams


def fork(
    log: Path,
    at: float | None = None,
    changes: Mapping[str, Any] | None = None,
    duration_ns: int | None = None,
    stop: Stop | None = None,
    recorded: bool = False,
) -> Run:
    """Continue the recording `log` from `at` [s] (None: its end) with other values, for `duration_ns` or its protocol.

    `changes`: dotted key -> value with unit, of the rig or of a controller (controllers.NAME.KEY). The instant is the
    nearest frame. `stop`: see `simulate`. `recorded`: controllers on other hardware command what they have commanded in
    the recording, up to its end; streams always repeat theirs. Raises UsageError for values that cannot change in the
    middle of a run and for an instant outside of the recording, LogError for a recording that does not repeat here.
    """
    changes = changes or {}
    run = reader.open(log)
    scene = recorded_scene(log, run)
    if run.begin_ns:
        begin = f"{run.begin_ns * 1e-9:g} s"
        raise UsageError(
            f"{log}: is a window of a run, from {begin} on: the state at its begin is not recorded, so it "
            "cannot be continued; continue a recording that begins at 0 s"
        )
    tick = _tick(log, run, at)
    boards = _boards(log, scene, recorded)
    end = scene.duration_ns if duration_ns is None else tick * run.frame_ns + duration_ns
    real = [*boards, *streams(scene.sensors)]
    if real:
        end = _within(log, run, tick, duration_ns, real[0])
    if end is None or end <= tick * run.frame_ns:
        begin = f"{tick * run.frame_ns * 1e-9:g} s"
        raise UsageError(f"{log}: its protocol has no steps after {begin}; state a duration, e.g. --duration 10")
    with log.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    now = tick * run.frame_ns
    origin: dict[str, str | int] = {"ancestor": log.name, "ancestor_sha256": digest, "instant_ns": now}
    described = design.described(scene)
    acting = {name: controllers.restored(described[name]) for name in described if name not in boards}
    _check(begun(scene, acting, measured={})[0], acting, changes)
    asked: list[str] = []

    def ask() -> str:
        reason = "" if stop is None else stop()
        if reason:
            asked.append(reason)
        return asked[-1] if asked else ""

    text = f"continues {log.name} from {now * 1e-9:g} s"
    events = [*_events_before(run, tick), _action(FORK, tick, now, text, origin)]
    events += [_action("parameter", tick, now, "", {"set": changes})] if changes else []

    def continued(resumption: Resumption | None) -> Run:
        skipped = _skipped_before(run, tick)
        history = Recorded(run.commands, events, tick, resumption, skipped, boards, run.measurements)
        try:
            continuation = simulate(scene, None, end, history, None if stop is None else ask)
        except LogError as fault:
            raise LogError(f"{log}: {fault}") from None
        if resumption is not None:
            add_history(continuation, run, resumption.tick)
        reached = round(float(continuation.time[-1]) * 1e9)
        if reached <= tick * run.frame_ns and not asked:
            why = continuation.fault.partition("\n")[0] or continuation.summary["ended"]
            raise UsageError(f"{log}: its run ended at {reached * 1e-9:g} s ({why}); name an instant before")
        _repeats(log, run, continuation, scene, min(reached, tick * run.frame_ns) * 1e-9)
        return continuation

    result: Run | None = None
    if (resumption := nearest(run, scene, tick)) is not None:
        with suppress(RigError, ValueError, KeyError):  # the simulation from the begin on says what is wrong
            result = continued(resumption)
            origin[CHECKPOINT] = resumption.tick * run.frame_ns
    result = result or continued(None)
    for name in boards:
        kind, text = compared(run, scene, name, tick)
        result.events += [{**_action(kind, tick, now, text, {}), "data": {"controller": name}}] if text else []
    result.events.sort(key=lambda event: int(event["t_ns"]))
    result.provenance = provenance(scene.seed) | {key: str(value) for key, value in origin.items()}
    return result


def _boards(log: Path, scene: Scene, recorded: bool) -> list[str]:
    """The controllers on other hardware, if their recorded commands may be taken. Raises UsageError."""
    boards = [name for name, section in scene.controllers.items() if is_elsewhere(controller_class(section))]
    if boards and not recorded:
        raise UsageError(
            f"{log}: {', '.join(boards)} ran on a board, whose memory of that instant is not recorded, so it cannot "
            "continue there; with --recorded it commands what it has commanded in the recording, up to its end"
        )
    if recorded and not boards:
        raise UsageError(f"{log}: --recorded: no controller of this recording ran on a board")
    return boards


def _within(log: Path, run: Run, tick: int, length_ns: int | None, name: str) -> int:
    """The end of a continuation by what board or stream `name` has sent [ns]. Raises UsageError for a later one."""
    begin_ns = tick * run.frame_ns
    last_ns = duration_ns(run)
    if length_ns is not None and begin_ns + length_ns > last_ns:
        raise UsageError(
            f"{log}: what the hardware of {name} has sent ends at {last_ns * 1e-9:g} s; from "
            f"{begin_ns * 1e-9:g} s on a duration of at most {(last_ns - begin_ns) * 1e-9:g} s is possible"
        )
    return last_ns if length_ns is None else begin_ns + length_ns


def _tick(log: Path, run: Run, at: float | None) -> int:
    """The frame nearest to an instant [s]. Raises UsageError for one outside of the recording."""
    frames = duration_ns(run) // run.frame_ns if run.frame_ns else 0
    if not frames:
        raise LogError(f"{log}: the recording ends before its first frame; there is nothing to continue")
    if at is None:
        return frames
    place = at * 1e9 / run.frame_ns
    if not 0.5 < place < frames + 0.5:
        length = f"{frames * run.frame_ns * 1e-9:g} s"
        raise UsageError(f"{log}: has no instant {at:g} s; name one after 0 s, up to its end at {length}")
    return round(place)


def _check(experiment: Experiment, acting: Mapping[str, Controller], changes: Mapping[str, Any]) -> None:
    """Raise UsageError or SceneError for changes that a run cannot make."""
    own, rig = divided(changes)
    known = experiment.tuning.tunable()
    given = {**experiment.scene.values(), **dict.fromkeys(OWN)}
    fixed = [key for key in rig if key not in known and (key in given or key.partition(".")[0] in OWN)]
    whole = [".".join(filter(None, ("controllers", name))) for name, values in own.items() if "" in values]
    if fixed or whole:
        rest = [f"controllers.{name}.{key}" for name, controller in acting.items() for key in tunable(controller)]
        faults = [f"{shortened(key)}: {_why_fixed(key)}" for key in fixed]
        faults += [f"{shortened(key)}: name one value of a controller of the scene" for key in whole]
        raise UsageError("\n".join([*faults, f"what can be changed: {', '.join([*known, *rest])}"]))
    for name, values in own.items():
        if name not in acting:
            raise UsageError(f"controllers.{shortened(name)}: there is no such controller; {near(name, acting)}")
        retune(acting[name], values)
    if wanted := experiment.tuning.wanted(rig):
        experiment.runner.variants.build(wanted)


def _why_fixed(key: str) -> str:
    if key.partition(".")[0] != "protocol":
        return "is fixed while the rig runs; a new run can have another value"
    return (
        "its steps go on as they are. For other steps change values one after the other: continue with -p and "
        "--duration, and continue the result from its end. A ramp needs a new run of a scene with these steps (rig new)"
    )


def _events_before(run: Run, tick: int) -> list[dict[str, Any]]:
    """Events before `tick` to repeat, and the ends of waits for matrices that had begun then.

    A controller with its own process has published its changes of parameters itself.
    """
    now = tick * run.frame_ns
    told = [event for event in run.plant_events if event["t_ns"] < now]
    waiting = {event["data"]["action"] for event in told if event["kind"] == WAITS}
    late = (event for event in run.plant_events if event["t_ns"] >= now and event["kind"] == GOES_ON)
    told += [event for event in late if event["data"]["action"] in waiting]
    for event in run.events:
        at, values = (event["data"].get(key) for key in ("after_tick", "set"))
        if event["kind"] != "parameter" or event["source"] not in run.commands:
            continue
        if (
            isinstance(at, int) and isinstance(values, dict) and at + 1 < tick
        ):  # a user's controller may publish anything
            changes = {f"controllers.{event['source']}.{key}": value for key, value in values.items()}
            told.append(_action("parameter", at + 1, (at + 1) * run.frame_ns, event["text"], {"set": changes}))
    return sorted(told, key=lambda event: int(event["t_ns"]))


def _skipped_before(run: Run, tick: int) -> dict[str, SkippedSteps]:
    """Controller -> the steps before `tick` that it did not answer."""
    known: dict[str, list[dict[str, Any]]] = {}
    for event in run.events:
        if event["kind"] == KIND and event["source"] in run.commands:
            known.setdefault(event["source"], []).append(event["data"])
    return {name: SkippedSteps(events).before(tick) for name, events in known.items()}


def _action(kind: str, tick: int, t_ns: int, text: str, data: Mapping[str, Any]) -> dict[str, Any]:
    """An event that the plant carries out for an operator."""
    return {
        "t_ns": t_ns,
        "tick": tick,
        "source": PLANT,
        "kind": kind,
        "text": text,
        "data": {**data, "by": OPERATOR},
    }


def _repeats(log: Path, run: Run, repeated: Run, scene: Scene, until: float) -> None:
    """Raise LogError if the samples of `repeated` before `until` [s] are not those of the recording."""
    if strange := unknown(run, repeated):
        raise LogError(f"{log}: cannot be continued: {'; '.join(strange)}")
    moved = changed_place(run)
    same = agreement(pairs(run, repeated), scene, bool(moved), until)
    remedy = f"name an earlier instant; rig verify {log} gives details"
    if same.first and (not moved or same.deviation > ELSEWHERE):
        elsewhere = f" (recorded elsewhere: other {', '.join(moved)})" if moved else ""
        raise LogError(f"{log}: does not repeat up to {until:g} s: {same.first}{elsewhere}; {remedy}")
    for name, (t_ns, _) in run.measurements.items():
        counts = [int(np.searchsorted(times, until * 1e9 - 0.5)) for times in (t_ns, repeated.measurements[name].t_ns)]
        if missing := counts[1] - counts[0]:
            which = "missing" if missing > 0 else "there more than once"
            raise LogError(
                f"{log}: {counted(abs(missing), 'sample')} of {name} before {until:g} s are {which}, so it "
                f"is not certain that they repeat; {remedy}"
            )
