"""Replay of a recording: publishes its messages again and compares the commands of controllers with the recorded ones.

The recorded bytes are published unchanged, those of the plant and those of controllers that do not take part. After
each step, the replay waits for the commands of the controllers that do: at any pace nothing is lost or overtaken, and
a controller that is slower than the pace makes the replay late. A controller joins at the step at which it joined in
the recording, and is replaced where a successor of its name took its place.
"""

from __future__ import annotations

import json
import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rig import controllers
from rig.bus import messages, port, queries, run_setup, topics
from rig.controllers.blocks.base import Controller, gets_every_sample
from rig.controllers.runtime.skipped import SkippedSteps
from rig.errors import BusError, LogError
from rig.machine.scheduling import ANY
from rig.record import curves, reader, recorded_setup
from rig.record.message_scan import Record, Scan
from rig.record.rebuilt_traffic import RebuiltTraffic, sent
from rig.record.recorded_controller import RecordedController
from rig.record.replay_report import Divergence, Replayed, TimingError
from rig.scenes.scene import Scene

PATIENCE_S = 5.0
"""Longest wait for the answer to one step. # chosen"""
_SHOWN_S = 0.1  # between two reports of progress: ten a second
_SLICE_S = 0.02  # longest wait between two looks at queries: 50 a second


class Processes(Protocol):
    """The processes of the controllers that take part."""

    def start(self, name: str) -> None:
        """Start a process of this controller; end the one before it first."""

    def ended(self) -> list[str]:
        """How processes ended that should still run, a sentence each."""


def replay(
    session: port.Session,
    path: Path,
    into: Mapping[str, Controller] | None = None,
    pace: float | None = None,
    wait: float = 10.0,
    progress: Callable[[float], object] = lambda seconds: None,
    *,
    processes: Processes | None = None,
    described: Mapping[str, Any] | None = None,
    initial: Mapping[str, Mapping[str, object]] | None = None,
) -> Replayed:
    """Replay `path` as the hub `session` (`bus.host(scene="replay")`).

    `into`: the controllers that take part, by name: those of the recording, changed ones or others. Each has `wait`
    seconds to join. `pace` is simulated seconds per second of the clock; None is as fast as the controllers answer.
    `described`: descriptions of controllers in place of the recorded ones; `initial`: parameters that a controller is
    asked to change when it has joined. Parameters that were tuned during the run are tuned again at the same tick.

    Raises LogError if the recording has lost the description of its run, BusError if a controller does not join,
    leaves, does not answer a step within 5 s, or refuses a change of its parameters.
    """
    start = recorded_setup.head(path)
    into = into or {}
    setup = recorded_setup.setup_of(start)
    if not setup.frame_ns:
        raise LogError(f"{path} has lost the description of its run: it can be read, but not replayed")
    saved = start.metadata.get("log", {}).get("made") in ("saved", "measured")
    in_plant = [name for name in into if setup.controllers.get(name, {}).get("section", {}).get("where") == "plant"]
    every = _heard(into.values())
    heard = frozenset[str]()
    if saved or in_plant or every:  # needs the code of all controllers
        heard = _heard(map(controllers.restored, filter(None, setup.controllers.values())))
    run = reader.open(path) if saved or in_plant or every - heard else None
    scan = Scan(path)
    rebuilt = None
    if run is not None:
        links = partial(Scene.from_json(setup.scene).links, "meas") if _impaired(setup.scene) else dict
        rebuilt = RebuiltTraffic(run, list(setup.outputs), heard | every, links)
    recorded = {name: RecordedController(name, saved) for name in into}
    decode = reader.Decoder(setup)
    for record in rebuilt if saved and rebuilt else scan:
        content = None if curves.derived(record.topic) else decode(record.topic, record.payload)
        if content is not None:
            for recorded_controller in recorded.values():
                recorded_controller.note(record, content)
    if run is not None:
        for name in in_plant:
            recorded[name].answers = sent(run.commands[name]) if name in run.commands else {}
    refused = decode.refused_text()
    traffic = rebuilt or (r for r in scan if not decode.refused or decode(r.topic, r.payload) is not None)
    skipped = {name: controller.skipped for name, controller in recorded.items() if controller.skipped}
    described = {**setup.controllers, **(described or {})}
    shown = replace(setup, run=session.run, core=ANY, controllers=described, skipped=skipped)
    player = _Replay(session, shown, into, recorded, processes, initial or {}, pace, wait, progress)
    result = player.carry_out(traffic)
    result.fault = "; ".join(filter(None, (run.damage,) if run is not None else (scan.fault, refused)))
    return result


def _impaired(scene: str) -> bool:
    """Whether links are made worse on purpose; not known of a scene that is damaged."""
    try:
        return bool(json.loads(scene)["network"])
    except (ValueError, TypeError, KeyError):
        return False


def _heard(known: Iterable[Controller]) -> frozenset[str]:
    """The sensors of which one of these controllers needs every sample."""
    return frozenset(sensor for controller in known if gets_every_sample(controller) for sensor in controller.reads)


class _Replay:
    def __init__(
        self,
        session: port.Session,
        setup: run_setup.Setup,
        into: Mapping[str, Controller],
        recorded: Mapping[str, RecordedController],
        processes: Processes | None,
        initial: Mapping[str, Mapping[str, object]],
        pace: float | None,
        wait: float,
        progress: Callable[[float], object],
    ) -> None:
        self._session = session
        self._into = into
        self._recorded = recorded
        self._processes = processes
        self._initial = initial
        self._pace = pace
        self._wait = wait
        self._progress = progress
        self._frame_ns = setup.frame_ns
        self._scene = session.serve("scene", lambda body: setup.to_json())
        self._doors = session.serve("cmd/plant", self._admit), session.serve("param/plant", self._fixed)
        self._watch = session.watch("controller/*")
        self._acts: port.Receiver = session.subscribe("act/*")
        self._events = [session.subscribe(f"event/{name}") for name in into]
        self._result = Replayed(compared=dict.fromkeys(into, 0), silent=dict.fromkeys(into, 0))
        self._skipped = {name: SkippedSteps(controller.skipped).unanswered for name, controller in recorded.items()}
        self._begins = {name: list(recorded_controller.begins) for name, recorded_controller in recorded.items()}
        self._changes = {
            name: sorted(recorded_controller.tuned.items()) for name, recorded_controller in recorded.items()
        }
        self._arrivals: Counter[str] = Counter()
        self._starts: Counter[str] = Counter()
        self._open: set[str] = set()
        """Controllers that have not answered the last step yet."""
        self._zero: float | None = None
        """When simulated time 0 is due [s of the monotonic clock]."""
        self._late = array("d")

    def _admit(self, body: dict[str, Any]) -> dict[str, Any]:
        name = body.get("controller")
        if body.get("do") != "admit" or name not in self._into:
            raise BusError(f"a replay does not {body.get('do')} {name or ''}".strip())
        return {}

    def _fixed(self, body: dict[str, Any]) -> dict[str, Any]:
        """The parameters of a plant that is recorded: none."""
        asked = queries.param_request(body)
        if keys := [*asked.changes, *asked.keys]:
            taking_part = ", ".join(self._into) or "none: rig live replay LOG --into NAME starts one"
            raise BusError(
                f"{', '.join(dict.fromkeys(keys))}: this run is a replay, and its plant is recorded. Only controllers "
                f"that take part can be tuned: {taking_part}"
            )
        return {"values": {}, "units": {}}

    def carry_out(self, traffic: Iterable[Record]) -> Replayed:
        self._session.announce()
        result = self._result
        shown = 0.0
        last = -1
        for record in traffic:
            kind, _, name = record.topic.partition("/")
            if curves.derived(record.topic) or kind == "total" or (name in self._into and kind in ("act", "event")):
                continue
            tick = messages.decode("step", record.payload).tick if kind == "step" else -1
            if kind == "step":
                if tick <= last:  # lockstep repeats a step that nobody answered in time
                    continue
                last = tick
                if not result.steps:
                    result.unknown_memory = tuple(name for name in self._into if self._worked_before(name, tick))
                self._prepare(tick)
            timed = topics.of_plant(record.topic)  # others may state any time
            late = self._sleep_until(record.t_ns * 1e-9) if timed else 0.0
            if kind == "step":
                self._late.append(late)
                due = [name for name in self._starts if not record.t_ns % self._into[name].period_ns]
                self._open = {name for name in due if tick not in self._skipped[name]}
            self._session.publisher(record.topic).put(record.payload, record.t_ns)
            result.messages += 1
            if timed:
                result.seconds = max(result.seconds, record.t_ns * 1e-9)
            if kind == "step":
                result.steps += 1
                self._follow(tick)
                if time.monotonic() - shown > _SHOWN_S:
                    shown = time.monotonic()
                    self._progress(result.seconds)
        self._session.publisher("total/plant").put(self._session.totals(), round(result.seconds * 1e9))
        result.not_finite = self._not_finite()
        result.unanswered = sum(
            len(recorded_controller.answers) for recorded_controller in self._recorded.values()
        ) - sum(result.compared.values())
        if self._pace is not None and self._late:
            result.timing = TimingError.of(self._late)
        return result

    def _not_finite(self) -> tuple[str, ...]:
        """What controllers have published about answers that they could not send."""
        lines = list[str]()
        for events in self._events:
            while (message := events.get(0.0)) is not None:
                if message.said.kind == "not finite":
                    lines.append(f"t = {message.said.t_ns * 1e-9:.9g} s: {message.said.text}")
        return tuple(lines)

    def _worked_before(self, name: str, tick: int) -> bool:
        """Whether a controller worked before the first recorded step: it answered the first one that was due."""
        answers = self._recorded[name].answers
        return tick > 0 and bool(answers) and (min(answers) - tick) * self._frame_ns < self._into[name].period_ns

    def _prepare(self, tick: int) -> None:
        """Before a step: start the controllers that joined at it, and change parameters that were changed before it."""
        if joining := [name for name, begins in self._begins.items() if begins and begins[0] <= tick]:
            self._join(joining)
        for name in self._starts:
            changes = self._changes[name]
            while changes and changes[0][0] < tick:
                after, values = changes.pop(0)
                self._tune(name, values, f"that the recording contains after tick {after}")

    def _join(self, names: list[str]) -> None:
        begun = time.monotonic()
        for name in names:
            self._begins[name].pop(0)
            self._starts[name] += 1
            if self._processes is not None:
                self._processes.start(name)
        while missing := [name for name in names if self._arrivals[name] < self._starts[name]]:
            if (self._processes is not None and self._processes.ended()) or time.monotonic() > begun + self._wait:
                raise BusError(
                    f"{', '.join(missing)} did not join the replay {self._session.run} within {self._wait:g} s"
                )
            self._serve(_SLICE_S)
        for name in names:
            if self._initial.get(name):
                self._tune(name, self._initial[name], "of -p")
        if self._zero is not None:
            self._zero += time.monotonic() - begun  # starting a process is no part of the replay

    def _tune(self, name: str, values: Mapping[str, object], which: str) -> None:
        try:
            self._session.ask(f"param/{name}", {"set": dict(values)}, PATIENCE_S)
        except BusError as fault:
            changes = ", ".join(f"{key} = {value}" for key, value in values.items())
            raise BusError(f"{name} did not make the change {which} ({changes}): {fault}") from None

    def _serve(self, timeout: float = 0.0) -> None:
        """Answer queries, and note who joins; wait at most `timeout` [s] for somebody to join or leave."""
        self._scene.poll()
        for door in self._doors:
            door.poll()
        for presence in self._watch.poll(timeout):
            self._arrivals[presence.name] += presence.here

    def _follow(self, tick: int) -> None:
        """After a step: wait until all controllers that it falls due for have answered."""
        self._serve()
        begun = time.monotonic()
        while self._open:
            self._take(tick, _SLICE_S)
            if not self._open:
                return
            self._serve()
            where = f"tick {tick}, t = {tick * self._frame_ns * 1e-9:.9g} s"
            if gone := sorted(name for name in self._open if ("controller", name) not in self._watch.present):
                raise BusError(f"{', '.join(gone)} left at {where}, without an answer to its step")
            if time.monotonic() > begun + PATIENCE_S:
                raise BusError(
                    f"{', '.join(sorted(self._open))} did not answer the step of {where} within {PATIENCE_S:g} s: "
                    "it hangs, or one update takes longer"
                )

    def _sleep_until(self, seconds: float) -> float:
        """Wait until a simulated time [s] is due; return how much later it is then [s]."""
        if self._pace is None:
            return 0.0
        if self._zero is None:
            self._zero = time.monotonic() - seconds / self._pace
        while (left := self._zero + seconds / self._pace - time.monotonic()) > 0.0:
            if left > _SLICE_S:
                self._serve(_SLICE_S / 2)
            else:
                time.sleep(left)
        return -left

    def _take(self, tick: int, timeout: float) -> None:
        while self._open:
            message = self._acts.get(timeout)
            if message is None:
                break
            name = message.topic.partition("/")[2]
            if name in self._open and message.said.tick == tick:
                self._open.remove(name)
                self._compare(name, tick, tuple(message.said.values))

    def _compare(self, name: str, tick: int, answered: tuple[float, ...]) -> None:
        result = self._result
        recorded_controller = self._recorded[name]
        if tick not in recorded_controller.answers:
            result.silent[name] += recorded_controller.silent_at(tick)
            return
        recorded = recorded_controller.answers[tick]
        result.compared[name] += 1
        if result.divergence is None and np.array(recorded).tobytes() != np.array(answered).tobytes():
            time_s = tick * self._frame_ns * 1e-9
            result.divergence = Divergence(f"act/{name}", tick, time_s, recorded, answered)
