"""A client of the bridge: its messages in JSON, its session on the bus, and its seat as a controller."""

from __future__ import annotations

import base64
import json
import math
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from rig import bus
from rig.bus import encode, run_setup
from rig.bus.json_text import read_json
from rig.bus.port import Session
from rig.bus.run_setup import Setup
from rig.errors import BusError, RigError, UsageError
from rig.extras import needed

DEPTH = 1024
"""Most messages that wait for a client."""
LOOK_S = 0.2
"""Longest time for which a client notices nothing of its end or that of the run [s]."""
_ASK_S = 60.0


def plain(value: Any) -> Any:
    """A message, or a value in one, as JSON values: bytes as base64, numbers that are not finite as null."""
    if hasattr(value, "DESCRIPTOR"):
        return {field.name: plain(getattr(value, field.name)) for field in value.DESCRIPTOR.fields}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value if isinstance(value, int | str) else [plain(one) for one in value]


class Client:
    """One client of the bridge. `send` takes the text of a message; `answer` gets those that the client sends."""

    def __init__(self, run: str, send: Callable[[str], object]) -> None:
        self._send, self._stack, self._gone = send, ExitStack(), threading.Event()
        self._operator = self._stack.enter_context(bus.join(run, role="operator", name="bridge"))
        self._setup: Setup | None = None
        self._controller: _Admitted | None = None
        self._subscribed = False
        self._does = {"subscribe": self._subscribe, "admit": self._admit, "act": self._act, "ask": self._ask}

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
        self._send(json.dumps(content, allow_nan=False))

    def answer(self, text: str | bytes) -> None:
        """Carry out a message of the client and answer it, except for commands."""
        identity: dict[str, Any] = {}
        try:
            body = read_json(text.encode() if isinstance(text, str) else text)
            identity = {"id": body.pop("id")} if "id" in body else {}
            what = str(body.pop("do", None))
            if what not in self._does:
                raise UsageError(f'"do" is {what!r:.80}; it can be {", ".join(self._does)}')
            answer = self._does[what](body)
        except TypeError:
            self.say(
                error=f"{what}: expected other keys than {', '.join(body) or 'none'}; see docs/wire.md", **identity
            )
        except (RigError, ValueError) as fault:
            self.say(error=str(fault), **identity)
        else:
            if answer is not None:
                self.say(answer=answer, **identity)

    def _described(self) -> Setup:
        if self._setup is None:
            self._setup = run_setup.fetch(self._operator)
        return self._setup

    def _subscribe(self, body: dict[str, Any]) -> dict[str, Any]:
        topics = body.get("topics")
        if not (isinstance(topics, list) and topics and all(isinstance(one, str) for one in topics)):
            raise UsageError(f'"topics" is {topics!r:.80}; expected a list of patterns, e.g. ["meas/*", "state"]')
        if self._subscribed:
            raise UsageError("subscribed already; a client subscribes once, to several patterns")
        self._described()  # from here on the session can decode the states
        self._subscribed = True
        receiver = self._operator.subscribe(*topics, depth=DEPTH)

        def pump() -> None:
            while not self._gone.is_set():
                if (message := receiver.get(LOOK_S)) is not None:
                    place = {"topic": message.topic, "seq": message.seq, "t_ns": message.t_ns}
                    self.say(**place, message=plain(message.said), lost=receiver.lost)

        self._start(pump)
        return {}

    def _admit(self, body: dict[str, Any]) -> dict[str, Any]:
        if self._controller is not None:
            raise UsageError(f"admitted already, as {self._controller.name}; open another connection for another one")
        name = body.get("controller")
        if not isinstance(name, str):
            raise UsageError(f'"controller" is {name!r:.80}; expected a name')
        if "hears" in body:
            raise UsageError('"hears" is not possible over the bridge; a step has the latest sample of each sensor')
        found = self._controller = _Admitted(self._operator.run, name, body, self._described(), self.say)
        self._start(found.pump)
        return found.granted

    def _act(self, body: dict[str, Any]) -> None:
        if self._controller is None:
            raise UsageError('no controller is admitted on this connection; send {"do": "admit", ...} first')
        self._controller.act(body.get("tick"), body.get("values"))

    def _ask(self, body: dict[str, Any]) -> Any:
        topic, asked = body.get("topic"), body.get("body", {})
        if not isinstance(topic, str) or not isinstance(asked, dict):
            raise UsageError('expected {"do": "ask", "topic": "param/plant", "body": {...}}')
        return self._operator.ask(topic, asked, _ASK_S)

    def _start(self, pump: Callable[[], None]) -> None:
        def work() -> None:
            with suppress(OSError, BusError, needed("websockets", "web").ConnectionClosed):
                pump()

        threading.Thread(target=work, name="bridge-pump", daemon=True).start()


class _Admitted:
    """A controller of a client: its seat, the steps that it gets, and its last command, for repeated steps."""

    def __init__(self, run: str, name: str, body: dict[str, Any], setup: Setup, say: Callable[..., None]) -> None:
        self.name, self._say = name, say
        self._session: Session = bus.join(run, role="controller", name=name)
        self._left, self._lock = threading.Event(), threading.Lock()
        try:
            self.granted: dict[str, Any] = self._session.ask("cmd/plant", {"do": "admit", **body}, _ASK_S)
            self._reads = [(one, list(setup.sensors).index(one)) for one in body.get("reads", [])]
            self._count, self._period = len(body["drives"]), int(body["period_ns"])
            self._steps = self._session.subscribe("step")
            self._publisher = self._session.publisher(f"act/{name}")
            self._tick, self._t_ns, self._frame_ns, self._command = -1, 0, setup.frame_ns, b""
            self._session.announce()
        except BaseException:
            self._session.close()
            raise

    def pump(self) -> None:
        """Pass on the steps that are due until it has left; answer a repeated step with the same command."""
        while not self._left.is_set():
            message = self._steps.get(LOOK_S)
            if message is None:
                continue
            step = message.said
            with self._lock:
                if step.tick <= self._tick:
                    if step.tick == self._tick and self._command:
                        self._publisher.put(self._command, self._t_ns)
                    continue
                if step.t_ns % self._period:
                    continue
                self._tick, self._t_ns, self._command = step.tick, step.t_ns, b""
            values = {name: plain(step.values[place]) for name, place in self._reads}
            self._say(step={"tick": step.tick, "t_ns": step.t_ns, "values": values})

    def act(self, tick: Any, values: Any) -> None:
        """Send the command that answers the step of `tick`. Raises UsageError for one that is no command."""
        whole = isinstance(tick, int) and not isinstance(tick, bool)
        numbers = isinstance(values, list) and all(
            isinstance(one, int | float) and not isinstance(one, bool) for one in values
        )
        if not (whole and numbers and len(values) in (0, self._count)):
            expected = f"[] or {self._count} numbers, one for each actuator"
            raise UsageError(
                f'"tick" is {tick!r:.40}, "values" is {values!r:.80}; expected a whole number, and {expected}'
            )
        with self._lock:
            if not 0 <= tick <= self._tick:
                raise UsageError(f"tick {tick} is that of no step; the last one had {self._tick}")
            command = encode.act(tick, tick * self._frame_ns, [float(one) for one in values])
            self._command = command if tick == self._tick else self._command
            self._publisher.put(command, self._t_ns)

    def leave(self) -> None:
        """Leave the run."""
        self._left.set()
        with suppress(BusError):
            self._session.publisher(f"total/{self.name}").put(self._session.totals(), self._t_ns)
        self._session.close()
