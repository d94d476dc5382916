"""A client of the bridge: its messages in JSON, its session on the bus, and its seat as a controller.

Messages of topics must not stand in the way of steps: what waits in the buffers of a connection makes every command
old. So few of them are on their way at a time, and fewer while a step is unanswered. An answer to a step shows
that the client has read what was sent before; without steps, its answer to a ping does. In a paced run a step waits
until the client has answered the one before, and is replaced by a newer one.
"""

from __future__ import annotations

import base64
import math
import queue
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from rig import bus
from rig.bus import encode, run_setup
from rig.bus.inbound import read_json
from rig.bus.port import Receiver, Session
from rig.bus.run_setup import Setup
from rig.errors import BusError, RigError, UsageError
from rig.extras import needed
from rig.web import plain_json

DEPTH = 1024
"""Most messages that wait for a client."""
AHEAD = 8
"""Most messages of topics that a client has not read yet, as far as known. # chosen"""
BESIDE = 1
"""The same while a step is unanswered. # chosen"""
SHORTEST_S = 0.02
"""Shortest time after which a step that is not answered is followed by the newest one [s]. # chosen"""
LONGEST_S = 2.0
"""Longest time after which a step that is not answered is followed by the newest one [s]. # chosen"""
REQUESTS = 64
"""Most requests of a client that wait."""
LOOK_S = 0.2
"""Longest time for which a client notices nothing of its end or that of the run [s]."""
_ASK_S = 60.0
"""Longest wait for the answer of a process of the run [s]: it may compile kernels first. # chosen"""
_END_S = 1.0
"""Longest wait for a client that reads what waits for it when the run has ended [s]. # chosen"""


def plain(value: Any) -> Any:
    """A message, or a value in one, as JSON values: bytes as base64, numbers that are not finite as null."""
    if hasattr(value, "DESCRIPTOR"):
        return {field.name: plain(getattr(value, field.name)) for field in value.DESCRIPTOR.fields}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, int | str):
        return value
    values = list(value)
    if values and isinstance(values[0], int | float) and math.isfinite(sum(values)):
        return values
    return [plain(entry) for entry in values]


class Client:
    """One client of the bridge. `answer` gets the messages that it sends.

    `send` takes the text of a message for it; `ping` returns an event that its answer to a ping sets.
    """

    def __init__(self, run: str, send: Callable[[str], object], ping: Callable[[], threading.Event]) -> None:
        self._send = send
        self._ping = ping
        self._stack = ExitStack()
        self._gone = threading.Event()
        self._operator = self._stack.enter_context(bus.join(run, role="operator", name="bridge"))
        self._setup: Setup | None = None
        self._controller: _Admitted | None = None
        self._topics: Receiver | None = None
        self._unread = 0
        self._lost = 0
        self._deadline_s = math.inf
        self._idle = threading.Event()
        self._idle.set()
        self._does = {"subscribe": self._subscribe, "admit": self._admit, "ask": self._ask}
        self._requests: queue.Queue[tuple[str, dict[str, Any], dict[str, Any]]] = queue.Queue(REQUESTS)
        self._start(self._carry_out)

    @property
    def ended(self) -> bool:
        """Whether the run has ended."""
        return self._operator.ended

    def close(self) -> None:
        """Leave the bus: a controller of the client is not present any more."""
        self._gone.set()
        if self._controller is not None:
            self._controller.leave()
        self._stack.close()

    def say(self, **content: Any) -> None:
        """Send a message to the client."""
        self._send(plain_json.text(content))

    def say_end(self) -> None:
        """Tell the client that the run has ended, after what waits for it, and how much it did not get."""
        self._deadline_s = time.monotonic() + _END_S
        self._idle.wait(_END_S + LOOK_S)
        left_out = 0 if self._controller is None else self._controller.left_out
        counts = {"left_out": left_out, "lost": self._lost}
        missing = {name: count for name, count in counts.items() if count}
        self.say(ended=self._operator.run, **missing)

    def answer(self, text: str | bytes) -> None:
        """Take a message of the client: commands at once, requests in their order, each of which is answered."""
        identity: dict[str, Any] = {}
        try:
            body = read_json(text.encode() if isinstance(text, str) else text)
            identity = {"id": body.pop("id")} if "id" in body else {}
            what = str(body.pop("do", None))
            if what == "act":
                self._act(body)
            elif what not in self._does:
                raise UsageError(f'"do" is {what!r:.80}; it can be act, {", ".join(self._does)}')
            else:
                self._requests.put_nowait((what, body, identity))
        except queue.Full:
            self.say(error=f"{REQUESTS} requests wait already; wait for their answers", **identity)
        except (RigError, ValueError) as fault:
            self.say(error=str(fault), **identity)

    def _carry_out(self) -> None:
        """Carry out requests, which may take a minute; meanwhile commands pass."""
        while not self._gone.is_set():
            try:
                what, body, identity = self._requests.get(timeout=LOOK_S)
            except queue.Empty:
                continue
            try:
                answer = self._does[what](body)
            except TypeError:
                keys = ", ".join(body) or "none"
                self.say(error=f"{what}: expected other keys than {keys}; see docs/wire.md", **identity)
            except (RigError, ValueError) as fault:
                self.say(error=str(fault), **identity)
            else:
                self.say(answer=answer, **identity)

    def _described(self) -> Setup:
        if self._setup is None:
            self._setup = run_setup.fetch(self._operator)
        return self._setup

    def _subscribe(self, body: dict[str, Any]) -> dict[str, Any]:
        topics = body.get("topics")
        if not (isinstance(topics, list) and topics and all(isinstance(pattern, str) for pattern in topics)):
            raise UsageError(f'"topics" is {topics!r:.80}; expected a list of patterns, e.g. ["meas/*", "state"]')
        if self._topics is not None:
            raise UsageError("subscribed already; a client subscribes once, to several patterns")
        self._described()  # from here on the session can decode the states
        self._topics = self._operator.subscribe(*topics, depth=DEPTH)
        self._start(self._pass_on)
        return {}

    def _pass_on(self) -> None:
        """Pass on the messages of topics until the client has left, or did not take them in time at the end."""
        receiver = self._topics
        assert receiver is not None
        while not self._gone.is_set():
            if (message := receiver.get(0.0)) is None:
                self._idle.set()
                message = receiver.get(LOOK_S)
                self._idle.clear()
            self._lost = receiver.lost
            if message is None:
                continue
            if not self._has_read():
                self._lost += 1 + len(receiver.drain())
                break
            place = {"topic": message.topic, "seq": message.seq, "t_ns": message.t_ns}
            self.say(**place, message=plain(message.said), lost=self._lost)
        self._idle.set()

    def _has_read(self) -> bool:
        """Wait until the client has read enough to get one more message; False when it is too late."""
        pong: threading.Event | None = None
        while not self._gone.is_set() and time.monotonic() < self._deadline_s:
            controller = self._controller
            waits = controller is not None and controller.waits
            if self._unread < (BESIDE if waits else AHEAD):
                self._unread += 1
                return True
            if waits:
                assert controller is not None
                controller.wait_for_answer(LOOK_S)
                continue
            pong = pong or self._ping()
            if pong.wait(LOOK_S):
                self._unread = 0
                pong = None
        return False

    def _admit(self, body: dict[str, Any]) -> dict[str, Any]:
        if self._controller is not None:
            raise UsageError(f"admitted already, as {self._controller.name}; open another connection for another one")
        name = body.get("controller")
        if not isinstance(name, str):
            raise UsageError(f'"controller" is {name!r:.80}; expected a name')
        if "hears" in body:
            raise UsageError('"hears" is not possible over the bridge; a step has the latest sample of each sensor')
        admitted = self._controller = _Admitted(self._operator.run, name, body, self._described(), self.say)
        self._start(admitted.pump)
        return admitted.granted

    def _act(self, body: dict[str, Any]) -> None:
        if self._controller is None:
            raise UsageError('no controller is admitted on this connection; send {"do": "admit", ...} first')
        self._controller.act(body.get("tick"), body.get("values"))
        self._unread = 0

    def _ask(self, body: dict[str, Any]) -> Any:
        topic = body.get("topic")
        asked = body.get("body", {})
        if not isinstance(topic, str) or not isinstance(asked, dict):
            raise UsageError('expected {"do": "ask", "topic": "param/plant", "body": {...}}')
        return self._operator.ask(topic, asked, _ASK_S)

    def _start(self, pump: Callable[[], None]) -> None:
        def work() -> None:
            with suppress(OSError, BusError, needed("websockets", "web").ConnectionClosed):
                pump()

        threading.Thread(target=work, name="bridge-pump", daemon=True).start()


class _Admitted:
    """A controller of a client: its seat, the steps that it gets, and its last command, for repeated steps.

    `left_out`: steps of a paced run that it did not get, because a newer one had come before it answered.
    """

    def __init__(self, run: str, name: str, body: dict[str, Any], setup: Setup, say: Callable[..., None]) -> None:
        self.name = name
        self.left_out = 0
        self._say = say
        self._paced = setup.paced
        self._session: Session = bus.join(run, role="controller", name=name)
        self._left = threading.Event()
        self._lock = threading.Lock()
        self._answer = threading.Condition(self._lock)
        try:
            self.granted: dict[str, Any] = self._session.ask("cmd/plant", {"do": "admit", **body}, _ASK_S)
            sensors = list(setup.sensors)
            self._reads = [(sensor, sensors.index(sensor)) for sensor in body.get("reads", [])]
            self._count = len(body["drives"])
            self._period_ns = int(body["period_ns"])
            self._steps = self._session.subscribe("step")
            self._publisher = self._session.publisher(f"act/{name}")
            self._frame_ns = setup.frame_ns
            self._tick = -1  # of the last step
            self._t_ns = 0
            self._sent_s = 0.0
            self._answered = -1  # tick of the last answer
            self._command = b""
            self._patience_s = SHORTEST_S
            self._session.announce()
        except BaseException:
            self._session.close()
            raise

    @property
    def waits(self) -> bool:
        """Whether the client has not answered the last step, but still has time for it."""
        return self._tick > self._answered and time.monotonic() < self._sent_s + self._patience_s

    def wait_for_answer(self, timeout: float) -> None:
        """Wait at most `timeout` seconds while `waits`."""
        left = min(self._sent_s + self._patience_s - time.monotonic(), timeout)
        with self._answer:
            self._answer.wait_for(lambda: self._tick <= self._answered or self._left.is_set(), left)

    def pump(self) -> None:
        """Pass on the steps that are due until it has left; answer a repeated step with the same command."""
        while not self._left.is_set():
            message = self._steps.get(LOOK_S)
            if message is None:
                continue
            step = message.said
            if not self._due(step):
                continue
            if self._paced:
                step = self._newest(step)
            with self._lock:
                self._tick = step.tick
                self._t_ns = step.t_ns
                self._command = b""
                self._sent_s = time.monotonic()
            values = {name: plain(step.values[place]) for name, place in self._reads}
            self._say(step={"tick": step.tick, "t_ns": step.t_ns, "values": values, "left_out": self.left_out})

    def _due(self, step: Any) -> bool:
        with self._lock:
            if step.tick == self._tick and self._command:
                self._publisher.put(self._command, self._t_ns)
            return bool(step.tick > self._tick and not step.t_ns % self._period_ns)

    def _newest(self, step: Any) -> Any:
        """The step that is the newest one when the client has answered the last, or has had time enough for that."""
        while self.waits and not self._left.is_set():
            self.wait_for_answer(LOOK_S)
        if self._tick > self._answered:
            self._patience_s = min(2.0 * self._patience_s, LONGEST_S)
        for message in self._steps.drain():
            if self._due(message.said):
                step = message.said
                self.left_out += 1
        return step

    def act(self, tick: Any, values: Any) -> None:
        """Send the command that answers the step of `tick`. Raises UsageError for one that is no command."""
        whole = isinstance(tick, int) and not isinstance(tick, bool)
        numbers = isinstance(values, list) and all(map(_is_number, values))
        if not (whole and numbers and len(values) in (0, self._count)):
            expected = f"[] or {self._count} numbers, one for each actuator"
            raise UsageError(
                f'"tick" is {tick!r:.40}, "values" is {values!r:.80}; expected a whole number, and {expected}'
            )
        with self._lock:
            if not 0 <= tick <= self._tick:
                raise UsageError(f"tick {tick} is that of no step; the last one had {self._tick}")
            command = encode.act(tick, tick * self._frame_ns, [float(number) for number in values])
            self._publisher.put(command, self._t_ns)
            self._answered = max(tick, self._answered)
            if tick == self._tick:
                self._command = command
                took_s = time.monotonic() - self._sent_s
                self._patience_s = min(max(2.0 * took_s, SHORTEST_S), LONGEST_S)
                self._answer.notify_all()

    def leave(self) -> None:
        """Leave the run."""
        self._left.set()
        with self._answer:
            self._answer.notify_all()
        with suppress(BusError):
            self._session.publisher(f"total/{self.name}").put(self._session.totals(), self._t_ns)
        self._session.close()


def _is_number(value: Any) -> bool:
    """Whether a value of a command is a number that is finite as a float."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
