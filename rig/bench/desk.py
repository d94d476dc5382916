"""The operator's desk: what `cmd/plant` and `param/plant` let others do to a running plant.

    cmd/plant     {"do": "begin"}: wait no longer for those who are expected, or "without" one of them ("role name")
                  {"do": "stop" | "pause" | "resume"}
                  {"do": "knock", "impulse": N s}
                  {"do": "connect" | "disconnect", "controller": name}
                  {"do": "admit", "controller": name, "drives": [actuators], "period_ns": ns,
                   "reads": [sensors], "hears": whether it wants every sample of them}
    param/plant   {"get": [keys]} or {"set": {key: value}}: actuators, and parameters of the rig, by their scene keys

Every answer carries the tick at which it holds.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from rig.bench.hub import Hub
from rig.errors import RigError, UsageError


class Admission(BaseModel):
    """What a controller that the scene does not know says of itself; whether it can be is for the exchange to judge."""

    model_config = ConfigDict(strict=True, extra="forbid")

    do: str
    controller: str
    drives: list[str]
    period_ns: int
    reads: list[str] = []
    hears: bool = False


class Desk:
    """Serves operators; `poll` between the protocol and the commands of a tick."""

    def __init__(self, hub: Hub) -> None:
        self.stopped = ""
        """Who asked for the end; empty while nobody did."""
        self.begun = False
        """Whether somebody asked to begin without those who are missing."""
        self.excused: set[str] = set()
        """Who need not be waited for."""
        self.paused = False
        self._hub, self._operation, self._stand = hub, hub.operation, hub.stand
        self._does = {
            "begin": self._begin,
            "stop": self._stop,
            "pause": self._pause,
            "resume": self._pause,
            "knock": self._knock,
            "connect": self._switch,
            "disconnect": self._switch,
            "admit": self._admit,
        }
        self._param = hub.session.serve("param/plant", self._parameters)
        self._cmd = hub.session.serve("cmd/plant", self._command)

    def poll(self) -> None:
        """Do what was asked since the last tick."""
        self._param.poll()
        self._cmd.poll()

    def _parameters(self, body: dict[str, Any]) -> dict[str, Any]:
        return self._done(body, self._tuned)

    def _command(self, body: dict[str, Any]) -> dict[str, Any]:
        return self._done(body, self._carried_out)

    def _done(self, body: dict[str, Any], how: Callable[[dict[str, Any]], dict[str, Any]]) -> dict[str, Any]:
        """The answer to a request; one that makes no sense is refused, whatever it breaks: the run goes on."""
        try:
            found = how(body)
        except RigError:
            raise
        except KeyError as fault:
            raise UsageError(f"{body.get('do', 'the request')} needs {fault}") from None
        except Exception as fault:
            raise UsageError(f"{body!r} cannot be done: {type(fault).__name__}: {fault}") from None
        return {"tick": self._stand.tick, "t_ns": self._stand.t_ns, **found}

    def _tuned(self, body: dict[str, Any]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        if (changes := body.get("set")) is not None:
            values |= self._operation.change(changes)
        for key in body.get("get", ()):
            values[key] = self._operation.value(key)
        return {"values": json.loads(json.dumps(values, default=_plain))}

    def _carried_out(self, body: dict[str, Any]) -> dict[str, Any]:
        what = str(body.get("do"))
        if what not in self._does:
            raise UsageError(f"the plant cannot {what!r}; it can: {', '.join(self._does)}")
        self._does[what](body)
        return {}

    def _begin(self, body: dict[str, Any]) -> None:
        if (who := body.get("without")) is not None:
            self.excused.add(str(who))
        else:
            self.begun = True

    def _stop(self, _: dict[str, Any]) -> None:
        self.stopped = "stopped by an operator"

    def _pause(self, body: dict[str, Any]) -> None:
        on = body["do"] == "pause"
        if on != self.paused:
            self.paused = on
            self._operation.journal.note("paused" if on else "resumed", "paused" if on else "goes on")

    def _knock(self, body: dict[str, Any]) -> None:
        self._operation.knock(float(body["impulse"]))

    def _switch(self, body: dict[str, Any]) -> None:
        self._operation.switch(str(body["controller"]), body["do"] == "connect")

    def _admit(self, body: dict[str, Any]) -> None:
        """Let a controller of the user's own in; one that was admitted before and has gone holds nothing any more."""
        try:
            wanted = Admission.model_validate(body)
        except ValidationError as error:
            faults = [f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors(include_url=False)]
            raise UsageError("\n".join(f"admit: {fault}" for fault in faults)) from None
        name, drives = wanted.controller, wanted.drives
        here, lines = self._hub.watch.present, self._operation.exchange.lines
        if ("controller", name) in here or name in self._hub.session.door.reserved:
            raise UsageError(
                f"the name {name!r:.80} is taken in this run; give the controller another one, or end that one"
            )
        for other in [o for o in lines if o not in self._operation.scene.controllers and o != name]:
            if ("controller", other) not in here and set(lines[other].drives) & set(drives):
                self._operation.dismiss(other)
        if wanted.hears:
            self._hub.hear(wanted.reads)
        self._hub.admit(name)
        self._operation.admit(name, drives, wanted.period_ns, wanted.hears)


def _plain(value: Any) -> Any:
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else str(value)
