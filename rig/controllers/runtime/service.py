"""What a controller says on the bus beside its commands, and the answers on its topic of parameters."""

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
from rig.errors import UsageError


class Service:
    """The events and parameters of the controller at work in `loop`. `tick`, `t_ns`: of the last step it has heard."""

    def __init__(self, session: Session, loop: Loop) -> None:
        self.session, self.loop = session, loop
        self.tick, self.t_ns = -1, 0
        self.events = session.publisher(f"event/{session.name}")
        self.server = session.serve(f"param/{session.name}", self.asked)

    def asked(self, body: dict[str, Any]) -> dict[str, Any]:
        """Get or set parameters; a set is whole or not at all, and in force from the next step on."""
        everything, keys, changes = param_request(body)
        if everything:
            units, now = tunable(self.loop.controller), parameters(self.loop.controller)
            return {"values": {key: now[key] for key in units}, "units": units}
        values = parameters(self.loop.controller)
        if unknown := [key for key in keys if key not in values]:
            raise UsageError(f"no parameter is called {', '.join(unknown):.80}; there are {', '.join(values)}")
        if changes:
            try:
                self.loop.retune(changes)
            except UsageError as fault:
                self.tell("refused", f"{self.session.name} keeps its parameters: {fault}", {})
                raise
            text = ", ".join(f"{key} = {value!s:.80}" for key, value in changes.items())
            self.tell("parameter", text, {"set": changes, "after_tick": self.tick})
            values = parameters(self.loop.controller)
        return {"values": {key: values[key] for key in keys or values}, "counters": self.loop.counters()}

    def tell(self, kind: str, text: str, data: Mapping[str, object]) -> None:
        """Say what happened."""
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
        """Say that a value was missing."""
        self.tell("held", f"a sample that {self.session.name} reads is missing or no number", {})

    def failed(self, error: Exception) -> None:
        """Say that the controller has raised `error`, which is being handled."""
        self.tell("fault", f"{type(error).__name__}: {error}", {"trace": traceback.format_exc()})

    def leave(self) -> None:
        """The last words: what was counted."""
        self.tell("left", f"{self.session.name} has left", self.loop.counters())
        self.session.publisher(f"total/{self.session.name}").put(self.session.totals(), self.t_ns)
