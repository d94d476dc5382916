"""The operator's desk: what `cmd/plant` and `param/plant` let others do to a running plant.

    cmd/plant     {"do": "begin"}: wait no longer for those who are expected, or "without" one of them ("role name")
                  {"do": "stop" | "pause" | "resume"}
                  {"do": "knock", "impulse": N s}
                  {"do": "connect" | "disconnect", "controller": name}
                  {"do": "admit", "controller": name, "drives": [actuators], "period_ns": ns,
                   "reads": [sensors], "hears": whether it wants every sample of them}
    param/plant   {"get": [keys]} or {"set": {key: value}}: actuators, and parameters of the rig, by their scene keys;
                  {"list": true}: what can be set, with its units
                  The answer tells which of these actuators are `overruled`, and by which controller: a value that was
                  set waits until that one is disconnected, one that was got is in force.

Every answer carries the tick at which it holds.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from rig.bench.hub import Hub
from rig.bench.rig_variant import Wanted
from rig.bus.queries import Later, param_request
from rig.errors import RigError, UsageError
from rig.quantities import si


class Admission(BaseModel):
    """What a controller that the scene does not know says of itself; whether it can be is for the exchange to judge."""

    model_config = ConfigDict(strict=True, extra="forbid")

    do: str
    controller: str
    drives: list[str]
    period_ns: int
    reads: list[str] = []
    hears: bool = False


class Operator:
    """Serves operators; `poll` between the protocol and the commands of a tick."""

    def __init__(self, hub: Hub) -> None:
        self.stopped = ""
        """Who asked for the end; empty while nobody did."""
        self.begun = False
        """Whether somebody asked to begin without those who are missing."""
        self.excused: set[str] = set()
        """Who need not be waited for."""
        self.paused = False
        self._hub, self._operation, self._runner = hub, hub.operation, hub.runner
        self._does = {
            "begin": self._begin,
            "stop": self._stop,
            "pause": self._pause,
            "resume": self._pause,
            "knock": self._knock,
            "connect": self._switch,
            "disconnect": self._switch,
        }
        self._param = hub.session.serve("param/plant", self.parameters)
        self.cmd = hub.session.serve("cmd/plant", self.command)

    def poll(self) -> None:
        """Do what was asked since the last tick."""
        self._param.poll()
        self.cmd.poll()

    def close(self) -> None:
        """The run has ended: refuse what was still being built."""
        for server in (self._param, self.cmd):
            server.give_up("the run ended before it was done")

    def parameters(self, body: dict[str, Any]) -> dict[str, Any] | Later:
        """The answer to `param/plant`, or what will give it."""
        return self._answered(body, self._tuned(body))

    def command(self, body: dict[str, Any]) -> dict[str, Any] | Later:
        """The answer to `cmd/plant`, or what will give it."""
        return self._answered(body, self._carried_out(body))

    def _answered(self, body: dict[str, Any], how: Later) -> dict[str, Any] | Later:
        """The answer to a request, or where it takes a while what will give it."""

        def later() -> dict[str, Any] | None:
            found = self._done(body, how)
            return None if found is None else {"tick": self._runner.tick, "t_ns": self._runner.t_ns, **found}

        return later() or later

    def _done(self, body: dict[str, Any], how: Later) -> dict[str, Any] | None:
        """What `how` gives; what makes no sense is refused, whatever it breaks: the run goes on."""
        try:
            return how()
        except RigError:
            raise
        except KeyError as fault:
            raise UsageError(f"{body.get('do', 'the request')!s:.80} needs {fault}") from None
        except Exception as fault:
            raise UsageError(f"{body!r:.200} cannot be done: {type(fault).__name__}: {fault}") from None

    def _rebuilt(self, wanted: Callable[[], list[Wanted]], then: Callable[[], dict[str, Any]]) -> Later:
        """Does `then` at the tick at which the rigs have been built that are `wanted` for it, one after the other.

        In a run that is not paced that is the tick of the request: nobody minds that it takes longer.
        """
        builds = self._operation.builds

        def later() -> dict[str, Any] | None:
            return then() if builds.ready(later, wanted) else None

        return later

    def _tuned(self, body: dict[str, Any]) -> Later:
        tuning, (everything, wanted, changes) = self._operation.tuning, param_request(body)
        if everything:
            units = tuning.tunable()
            values = {key: tuning.value(key) for key in units}
            return lambda: {"values": json.loads(json.dumps(values, default=_plain)), "units": units}

        def now() -> dict[str, Any]:
            return {key: tuning.value(key) for key in wanted}

        def told(values: dict[str, Any]) -> dict[str, Any]:
            found = values | now()
            overruled = {key: owner for key in found if (owner := tuning.exchange.overruler(key))}
            return {"values": json.loads(json.dumps(found, default=_plain)), "overruled": overruled}

        if not changes:  # to set nothing is no event
            return lambda: told({})
        now()  # raises for an unknown key, before anything is changed
        return self._rebuilt(
            lambda: [wanted for wanted in [tuning.wanted(changes)] if wanted],
            lambda: told(tuning.change(changes)),
        )

    def _carried_out(self, body: dict[str, Any]) -> Later:
        what = str(body.get("do"))
        if what == "admit":
            return self._admitted(body)

        def done() -> dict[str, Any]:
            if what not in self._does:
                raise UsageError(f"the plant cannot {what!r:.80}; it can: {', '.join([*self._does, 'admit'])}")
            self._does[what](body)
            return {}

        if what == "disconnect":
            return self._rebuilt(lambda: self._operation.given_back(str(body["controller"])), done)
        return done

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
        impulse = body["impulse"]
        if isinstance(impulse, bool) or not isinstance(impulse, int | float):
            raise UsageError(f"an impulse of {impulse!r:.80} cannot be struck; expected a number [N s]")
        self._operation.knock(si(impulse, "N*s"))

    def _switch(self, body: dict[str, Any]) -> None:
        self._operation.switch(str(body["controller"]), body["do"] == "connect")

    def _admitted(self, body: dict[str, Any]) -> Later:
        """Let a controller of the user's own in; one that was admitted before and has gone holds nothing any more."""
        try:
            asked = Admission.model_validate(body)
        except ValidationError as error:
            faults = [f"{'.'.join(map(str, one['loc'])):.80}: {one['msg']}" for one in error.errors(include_url=False)]
            raise UsageError("\n".join(f"admit: {fault}" for fault in faults)) from None
        hub, operation, name, user = self._hub, self._operation, asked.controller, self.cmd.asker
        told = (name, asked.drives, asked.period_ns, asked.hears)

        def gone() -> list[str]:
            """Who was admitted for one of these actuators, and is not here any more."""
            here, lines = hub.watch.present, operation.exchange.lines
            others = [other for other in lines if other not in operation.scene.controllers and other != name]
            others = [other for other in others if not hub.awaited(other, user)]
            return [o for o in others if ("controller", o) not in here and {*lines[o].drives} & {*asked.drives}]

        def wanted() -> list[Wanted]:
            here = ("controller", name) in hub.watch.present or hub.awaited(name, user)
            if here or name in hub.session.door.reserved:
                raise UsageError(
                    f"the name {name!r:.80} is taken in this run; give the controller another one, or end that one"
                )
            hub.places(asked.reads)  # raises for a sensor that is not there
            return operation.admission(*told, gone())

        def then() -> dict[str, Any]:
            operation.admit(*told, gone())
            hub.admit(name, user)
            if asked.hears:
                hub.hear(asked.reads)
            return {}

        return self._rebuilt(wanted, then)


def _plain(value: Any) -> Any:
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else str(value)
