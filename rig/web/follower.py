"""Follows one run over the bus in a thread, as a viewer: frames for the page, and the commands of its user.

The page gets a description of the run (outputs, plots, colours, contact states, picture) and the values that may change
while the rig runs; these are read once from plant and controllers, then kept up to date.

An actuator that a controller drives is shown as owned: a value that an operator sets for it takes effect when the
controller is disconnected.
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from rig import bus
from rig.bus.port import Session
from rig.bus.run_setup import Setup
from rig.bus.topics import Message
from rig.errors import BusError, RigError, UsageError
from rig.machine.scheduling import stand_back
from rig.model.assembly import Assembly
from rig.quantities import finite
from rig.scenes.scene import Scene
from rig.view import contact
from rig.view.channels import Channels
from rig.view.contact import Contacts
from rig.view.process import TOPICS, fetched
from rig.web.form import drives, entry_of, hands, kind_of, plain, protocol, within
from rig.web.frames import Frame, Frames
from rig.web.picture import MovingPicture
from rig.web.sound import audible

PATIENCE_S = 2.0
"""Longest wait for an answer of a process of the run [s]. # chosen"""
PERIOD_S = 0.045
"""Time between two frames [s]: a little over 20 per second, because waits end late."""
LOOK_S = 1.0
"""Time between two looks at the actuators [s]. # chosen"""
KEPT = 500
"""Number of events that a page which connects later gets. # chosen"""
_BEGUN = ("state", "health")
"""Topics of a run whose first frame has been computed; a paused one has only its health."""
_PHASES = {"paused": "paused", "resumed": "running", "end": "ending"}
"""Kinds of events of the plant -> the phase of the run that begins with them."""
_TELLING = frozenset({"step", "mark", "left", "missing", "pause", "overrun", "safe", "fault"})
"""Kinds of events after which the page is told at once how the run goes."""
_NICE = 5
"""Nice value of the thread: it leaves the processor to the run. # chosen"""
_DEPTH = 1024
"""Most messages that wait for the thread. # chosen"""
_JOIN_S = 30.0
"""Longest wait for the processes of a run that begins [s]: kernels may compile. # chosen"""
_LAST_WORDS_S = 0.3
"""Time for which a run that has ended is heard [s]: its presence ends before its last data arrive. # chosen"""
_ASK_S = 10.0
"""Longest wait for the answer to a command of the user [s]. # chosen"""


def description(
    setup: Setup,
    scene: Scene,
    assembly: Assembly,
    channels: Channels,
    contacts: Sequence[str],
    still: dict[str, Any] | None,
) -> dict[str, Any]:
    """Everything that a page needs in order to read the frames of a run (`rig.web.frames`).

    `contacts`: their names; `still`: the picture without what moves (`rig.web.picture`).
    """
    return {
        "run": setup.run,
        "scene": scene.name,
        "title": scene.title,
        "about": scene.about,
        "frame_s": setup.frame_ns * 1e-9,
        "paced": setup.paced,
        "outputs": [
            {"name": name, "unit": unit, "colour": channels.colours.get(name, "")}
            for name, unit in setup.outputs.items()
        ],
        "sensors": {
            name: _sensor(channels, name, unit, period_ns) for name, (unit, period_ns) in setup.sensors.items()
        },
        "plots": [
            {"title": panel.title, "outputs": list(panel.outputs), "sensors": list(panel.sensors), "place": panel.place}
            for panel in channels.panels
        ],
        "portrait": list(channels.portrait) if channels.portrait else None,
        "modes": [{"name": name, "colour": colour} for name, colour in zip(contact.NAMES, contact.COLOURS)],
        "contacts": list(contacts),
        "controllers": drives(scene),
        "protocol": protocol(scene, assembly),
        "limits": scene.limits,
        "sound": audible(setup),
        "picture": still,
        "hands": {key: hand.words for key, hand in hands(scene).items()},
    }


def _sensor(channels: Channels, name: str, unit: str, period_ns: int) -> dict[str, Any]:
    """What the page is told of a sensor; `reads`: the output that it reads, "" for another one."""
    entry: dict[str, Any] = {
        "unit": unit,
        "period_s": period_ns * 1e-9,
        "colour": channels.colour_of(name),
        "factor": 1.0,
        "reads": "",
    }
    measured = channels.measured.get(name)
    if measured is not None:
        entry["factor"] = measured.factor
        entry["reads"] = measured.reads
    return entry


class LiveValues:
    """Everything that can be tuned in the run of `session`, by dotted key; `inputs`: the actuators of its rig."""

    def __init__(self, session: Session, scene: Scene, inputs: Mapping[str, Any]) -> None:
        self.session = session
        self._scene = scene
        self._inputs = inputs
        self.entries: dict[str, dict[str, Any]] = {}
        """Key -> entry of the form (`rig.web.form.entry_of`), with `of` (plant or controller) and `owner`."""

    def read(self) -> None:
        """Read all values of plant and controllers; of a process that does not answer there are none.

        The ends of a slider come from the value of the scene: a protocol may begin with a rig at rest.
        """
        for process in ("plant", *self._scene.controllers):
            with suppress(BusError):
                self._read(process, self.session.ask(f"param/{process}", {"list": True}, PATIENCE_S))
        self.look()

    def _read(self, process: str, told: Mapping[str, Any]) -> None:
        of_scene = self._scene.values()
        before = "" if process == "plant" else f"controllers.{process}."
        for inner, value in told["values"].items():
            key = before + inner
            actuator = self._inputs.get(key)
            name = key.rpartition(".")[2]
            unit = told["units"][inner]
            usual, _ = of_scene.get(key, (value, unit))
            entry = entry_of(self._scene, key, name, usual, unit, within(self._scene, key, actuator))
            entry |= {**kind_of(self._scene, key, value), "value": value}
            self.entries[key] = {**entry, "of": process, "actuator": actuator is not None, "owner": ""}

    def look(self) -> bool:
        """Read the actuators and who drives them; whether something is new."""
        try:
            told = self.session.ask("param/plant", {"get": list(self._inputs)}, PATIENCE_S)
        except BusError:
            return False
        new = False
        for key, value in told["values"].items():
            entry = self.entries.get(key)
            owner = told["overruled"].get(key, "")
            if entry is not None and (entry["value"], entry["owner"]) != (value, owner):
                entry["value"] = value
                entry["owner"] = owner
                new = True
        return new

    def hear(self, event: Mapping[str, Any]) -> bool:
        """Take over the values of an event `parameter`; whether something is new.

        A process other than the plant can only change values of its own.
        """
        changes = event["data"].get("set")
        if event["kind"] != "parameter" or not isinstance(changes, dict):
            return False
        prefix = "" if event["source"] == "plant" else f"controllers.{event['source']}."
        new = False
        for key, value in changes.items():
            entry = self.entries.get(prefix + key)
            if entry is not None and not entry["owner"] and isinstance(value, int | float | str):
                entry["value"] = value
                new = True
        return new

    def set(self, key: str, value: Any) -> dict[str, Any]:
        """Change a value at the next tick, as `rig live tune` does; returns its owner's answer. Raises BusError."""
        process = self.entries[key]["of"] if key in self.entries else "plant"
        inner = key.removeprefix(f"controllers.{process}.")
        value = plain(value, key)
        answer: dict[str, Any] = self.session.ask(f"param/{process}", {"set": {inner: value}}, _ASK_S)
        return answer


@contextmanager
def _reason() -> Iterator[None]:
    """Turn the refusal of a process of the run into its reason alone: a page need not know who refused."""
    try:
        yield
    except BusError as fault:
        raise UsageError(str(fault).partition(" refused: ")[2] or str(fault)) from None


class Follower:
    """Follows `run` from `start` until it has ended or `stop` is called.

    Called from its thread: `frame(text, events)` with each frame (`Frames.take`); `news(kind, content)` of the kinds

        setup    description of the run          values   its values
        status   how it goes: the plant's answer to the command `status`
        phase    "paused", "running", "ending": it has begun
        summary  the summary of the plant        fault    why it cannot be followed, in words
        left     the last news

    and `arrived(messages)` with everything that has arrived since its last call. `ticket`: that of an operator of a run
    on another host.
    """

    def __init__(
        self,
        run: str,
        frame: Callable[[Frame], object],
        news: Callable[[str, Any], object],
        arrived: Callable[[Sequence[Message]], object] = lambda _: None,
        trust: bool = False,
        ticket: Path | None = None,
    ) -> None:
        self.run = run
        self.events: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._frame = frame
        self._news = news
        self._arrived = arrived
        self._trust = trust
        self._ticket = ticket
        self._operator: Session | None = None
        self._values: LiveValues | None = None
        self._stopped = threading.Event()
        self._changed = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="follower", daemon=True)

    def start(self) -> None:
        """Begin to follow."""
        self._thread.start()

    def outlast(self, wait: float = 2.0) -> None:
        """Wait until it has heard the last words of a run whose processes have ended; at most `wait` seconds."""
        self._thread.join(wait)

    def stop(self, wait: float = 3.0) -> None:
        """Stop following; waits at most `wait` seconds for the thread."""
        self._stopped.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(wait)

    def command(self, body: dict[str, Any]) -> dict[str, Any]:
        """Send a command to the plant (`rig.bench.live.operator_commands`). Raises UsageError for a refusal."""
        impulse = body.get("impulse")
        if isinstance(impulse, str):
            try:
                body = {**body, "impulse": finite(plain(impulse, "impulse"), "N*s")}
            except ValueError as fault:
                raise UsageError(f"the impulse {fault}") from None
        with _reason():
            answer: dict[str, Any] = self._joined().ask("cmd/plant", body, _ASK_S)
        self._changed.set()
        return answer

    def set(self, key: str, value: Any) -> dict[str, Any]:
        """Change a value at the next tick; see `LiveValues.set`."""
        self._joined()
        if self._values is None:
            raise UsageError("the values of the run are not known yet; try again in a second")
        with _reason():
            answer = self._values.set(key, value)
        self._changed.set()
        return answer

    def _joined(self) -> Session:
        if self._operator is None or self._stopped.is_set():
            raise UsageError("the run has not begun, or has ended")
        return self._operator

    def _follow(self) -> None:
        stand_back(_NICE)
        joined = partial(bus.join, self.run if self._ticket is None else None, name="page", ticket=self._ticket)
        role = "viewer" if self._ticket is None else "operator"  # one ticket opens one seat, here that of an operator
        try:
            with (
                joined(role=role, wait=_JOIN_S) as session,
                joined(role="operator") as operator,  # controllers answer operators only
            ):
                heard = session.subscribe(*TOPICS, depth=_DEPTH, polled=True)
                plant = session.watch("plant/*")
                setup = fetched(session, _JOIN_S, self._trust)
                scene = Scene.from_json(setup.scene)
                assembly = scene.assemble()
                system = assembly.system()
                sensors = {name: unit for name, (unit, _) in setup.sensors.items()}
                channels = Channels((scene, assembly), setup.outputs, sensors)
                try:
                    picture = MovingPicture.of(scene, assembly, system, channels.colours)
                    still = None if picture is None else picture.still
                except Exception:  # of a drawer that came with a plant of the user; the form has told it
                    picture = still = None
                frames = Frames(setup, system, picture)
                self._news("setup", description(setup, scene, assembly, channels, Contacts(system).names, still))
                values = LiveValues(operator, scene, assembly.inputs)
                if role == "viewer":
                    session.announce()
                self._operator = operator
                try:
                    plant.wait_for("plant", "plant", _JOIN_S)
                    self._listen(session, heard, plant, frames, values)
                finally:
                    self._operator = None
        except RigError as fault:
            self._news("fault", str(fault))
        finally:
            self._news("left", None)

    def _listen(self, session: Session, heard: Any, plant: Any, frames: Frames, values: LiveValues) -> None:
        looked = -LOOK_S
        until = 0.0  # end of the last words; 0 while the run goes on
        due = time.monotonic()
        while not self._stopped.is_set() and not (until and time.monotonic() > until):
            begin = time.monotonic()
            arrived = heard.drain()
            self._arrived(arrived)
            for message in arrived:
                counted = session.role == "viewer"  # the plant collects the totals of all that have a seat
                if counted and message.topic == "total/plant":
                    session.publisher(f"total/{session.name}").put(session.totals(), message.t_ns)
                if message.topic == "event/plant" and message.said.kind == "verdict":
                    self._news("summary", json.loads(message.said.data))
            events = frames.add(message for message in arrived if not message.topic.startswith("total/"))
            self.events.extend(events)
            new = bool([event for event in events if values.hear(event)])
            self._hear(events)
            if self._values is None and any(message.topic in _BEGUN for message in arrived):
                values.read()
                self._values = values
                new = True
            elif self._values is not None and (self._changed.is_set() or begin - looked > LOOK_S) and not until:
                self._changed.clear()
                new = values.look() or new
                looked = begin
                with suppress(BusError):  # the run ends, or its plant is busy: the next look tells it
                    self._news("status", values.session.ask("cmd/plant", {"do": "status"}, PATIENCE_S))
            if new:
                self._news("values", list(values.entries.values()))
            frame = frames.take(heard.lost)
            if frame is not None:
                self._frame(frame)
            if not until and not session.goes_on(plant):
                until = time.monotonic() + _LAST_WORDS_S  # presence changes arrive before data
                if gone := session.gone:
                    self._news("fault", gone)
            due = max(due + PERIOD_S, time.monotonic() + 0.005)
            self._stopped.wait(due - time.monotonic())

    def _hear(self, events: Sequence[Mapping[str, Any]]) -> None:
        """Tell the phases of the run that events begin, and remember to tell how it goes."""
        for event in events:
            if event["source"] == "plant" and event["kind"] in _PHASES:
                self._news("phase", _PHASES[event["kind"]])
            if event["kind"] in _TELLING:
                self._changed.set()
