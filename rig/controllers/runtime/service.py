"""Events of a controller on the bus, and the answers to requests for its parameters."""

from __future__ import annotations

import json
import traceback
from collections.abc import Mapping
from typing import Any

from rig.bus import messages
from rig.bus.port import Session
from rig.bus.queries import param_request
from rig.controllers.blocks.base import parameters, tunable
from rig.controllers.runtime.loop import Loop
from rig.errors import ControllerFailed, UsageError
from rig.units import refuse_unusual


class Service:
    """Events and parameters of the controller in `loop`. `tick`, `t_ns`: those of the last step that it received."""

    def __init__(self, session: Session, loop: Loop) -> None:
        self.session = session
        self.loop = loop
        self.tick = -1
        self.t_ns = 0
        self.events = session.publisher(f"event/{session.name}")
        self.server = session.serve(f"param/{session.name}", self.answer_request)

    def answer_request(self, body: dict[str, Any]) -> dict[str, Any]:
        """Get or set parameters; a set is applied as a whole or refused, and takes effect at the next step."""
        everything, keys, changes = param_request(body)
        if everything:
            units = tunable(self.loop.controller)
            now = parameters(self.loop.controller)
            return {"values": {key: now[key] for key in units}, "units": units}
        values = parameters(self.loop.controller)
        if unknown := [key for key in keys if key not in values]:
            raise UsageError(f"no parameter is called {', '.join(unknown):.80}; there are {', '.join(values)}")
        if changes:
            try:
                refuse_unusual(changes, tunable(self.loop.controller))
                self.loop.retune(changes)
            except UsageError as fault:
                self.publish("refused", f"{self.session.name} keeps its parameters: {fault}", {})
                raise
            self.changed(changes, self.tick)
            values = parameters(self.loop.controller)
        return {"values": {key: values[key] for key in keys or values}, "counters": self.loop.counters()}

    def changed(self, changes: Mapping[str, object], after_tick: int) -> None:
        """Publish that parameters have changed after this tick."""
        text = ", ".join(f"{key} = {value!s:.80}" for key, value in changes.items())
        self.publish("parameter", text, {"set": dict(changes), "after_tick": after_tick})

    def publish(self, kind: str, text: str, data: Mapping[str, object]) -> None:
        """Publish an event."""
        event = messages.TYPES["Event"](
            t_ns=self.t_ns,
            tick=max(self.tick, 0),
            source=self.session.name,
            kind=kind,
            text=text,
            data=json.dumps(data),
        )
        self.events.put(event.SerializeToString(), self.t_ns)

    def held(self) -> None:
        """Publish that a value was missing or not finite."""
        self.publish("held", f"a sample that {self.session.name} reads is missing or not a finite number", {})

    def failed(self, failure: ControllerFailed) -> None:
        """Publish that the controller has raised the exception that is being handled, with its traceback."""
        self.publish("fault", str(failure), {"trace": traceback.format_exc()})

    def leave(self) -> None:
        """Publish the final counters and the total of messages."""
        self.publish("left", f"{self.session.name} has left", self.loop.counters())
        self.session.publisher(f"total/{self.session.name}").put(self.session.totals(), self.t_ns)
