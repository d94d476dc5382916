"""Commands of operators: what other processes can do to a running plant through `cmd/plant` and `param/plant`.

    cmd/plant     {"do": "begin"}: stop waiting for expected processes, or for the one in "without" ("role name")
                  {"do": "stop" | "pause" | "resume"}; to the last two the answer states whether they "changed" anything
                  {"do": "step", "frames": number}: compute frames of a paused run; by default one
                  {"do": "emergency"}: actuators to their safe values at once; half a second later the run ends
                  {"do": "knock", "impulse": N s}
                  {"do": "connect" | "disconnect", "controller": name}
                  {"do": "status"}: changes nothing; the answer has the timing verdict so far ("" if not paced), its
                  reasons, the number of protocol steps that have begun, with repeats unrolled, "paused", "pace"
                  {"do": "admit", "controller": name, "drives": [actuators], "period_ns": ns,
                   "reads": [sensors], "hears": whether it wants every sample of them}
    param/plant   {"get": [keys]} or {"set": {key: value}}: actuators and parameters of the rig, by their scene keys;
                  {"list": true}: everything that can be set, with units
                  `overruled` in the answer names the actuators that a controller commands, and this controller. A value
                  set for such an actuator takes effect when the controller is disconnected; a value read is in force.

Every answer contains the tick at which it is valid.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from rig.bench.live.hub import Hub
from rig.bench.run.rig_variants import Wanted
from rig.bus.queries import Later, param_request
from rig.errors import RigError, UsageError
from rig.quantities import faults_of
from rig.units import converts, refuse_unusual, si

# Commands that a run in its safe state refuses, as it refuses changes of actuators and parameters.
MOVES = frozenset({"knock", "connect", "disconnect", "admit"})
MOST_STEPS = 10_000  # most single steps of one request


class Admission(BaseModel):
    """What a controller outside the scene states about itself; the exchange decides on its admission."""

    model_config = ConfigDict(strict=True, extra="forbid")

    do: str
    controller: str
    drives: list[str]
    period_ns: int
    reads: list[str] = []
    hears: bool = False


class Operator:
    """Answers operators; `poll` it between the protocol and the commands of a tick."""

    def __init__(self, hub: Hub) -> None:
        self.stopped = ""
        """Why the run shall stop; empty while no operator has asked for it."""
        self.begun = False
        """Whether an operator asked to begin without missing processes."""
        self.excused: set[str] = set()
        """Processes ("role name") for which the plant need not wait."""
        self.paused = False
        self.status: Callable[[], dict[str, Any]] = dict
        """How the run goes: the answer to `status`."""
        self.steps = 0
        """Frames that a paused run shall compute; each is a batch of frames if the plant computes several at once."""
        self._hub = hub
        self._experiment = hub.experiment
        self._runner = hub.runner
        self._does: dict[str, Callable[[dict[str, Any]], dict[str, Any] | None]] = {
            "begin": self._begin,
            "stop": self._stop,
            "pause": self._pause,
            "resume": self._pause,
            "step": self._step,
            "emergency": self._emergency,
            "knock": self._knock,
            "connect": self._switch,
            "disconnect": self._switch,
            "status": lambda _: self.status(),
        }
        self._param = hub.session.serve("param/plant", self.parameters)
        self.cmd = hub.session.serve("cmd/plant", self.command)

    def poll(self) -> None:
        """Carry out the requests that arrived since the last tick."""
        self._param.poll()
        self.cmd.poll()

    def close(self) -> None:
        """At the end of the run: refuse requests whose rigs were still being built."""
        for server in (self._param, self.cmd):
            server.give_up("the run ended before it was done")

    def parameters(self, body: dict[str, Any]) -> dict[str, Any] | Later:
        """The answer to `param/plant`, or a function that returns it later."""
        return self._answered(body, self._tuned(body))

    def command(self, body: dict[str, Any]) -> dict[str, Any] | Later:
        """The answer to `cmd/plant`, or a function that returns it later."""
        return self._answered(body, self._carried_out(body))

    def _answered(self, body: dict[str, Any], how: Later) -> dict[str, Any] | Later:
        """The answer to a request or, if it takes time, a function that returns it later."""

        def later() -> dict[str, Any] | None:
            answer = self._done(body, how)
            return None if answer is None else {"tick": self._runner.tick, "t_ns": self._runner.t_ns, **answer}

        return later() or later

    def _done(self, body: dict[str, Any], how: Later) -> dict[str, Any] | None:
        """Call `how`; any exception becomes a refusal, so that a senseless request cannot end the run."""
        try:
            if self._experiment.aborted and (body.get("set") or body.get("do") in MOVES):
                raise UsageError(f"the run is in its safe state and ends: {self._experiment.aborted}")
            return how()
        except RigError:
            raise
        except KeyError as fault:
            raise UsageError(f"{body.get('do', 'the request')!s:.80} needs {fault}") from None
        except Exception as fault:
            raise UsageError(f"{body!r:.200} cannot be done: {type(fault).__name__}: {fault}") from None

    def _rebuilt(self, wanted: Callable[[], list[Wanted]], then: Callable[[], dict[str, Any]]) -> Later:
        """A function that calls `then` at the tick at which all rigs of `wanted` are built.

        In a run without pacing that is the tick of the request, because frames may take longer there.
        """
        builds = self._experiment.builds

        def later() -> dict[str, Any] | None:
            return then() if builds.ready(later, wanted) else None

        return later

    def _tuned(self, body: dict[str, Any]) -> Later:
        tuning = self._experiment.tuning
        everything, wanted, changes = param_request(body)
        if everything:
            units = tuning.tunable()
            values = {key: tuning.value(key) for key in units}
            return lambda: {"values": json.loads(json.dumps(values, default=_plain)), "units": units}

        def now() -> dict[str, Any]:
            return {key: tuning.value(key) for key in wanted}

        def answer(values: dict[str, Any]) -> dict[str, Any]:
            present = values | now()
            overruled = {key: owner for key in present if (owner := tuning.exchange.overruler(key))}
            return {"values": json.loads(json.dumps(present, default=_plain)), "overruled": overruled}

        if not changes:  # an empty change is not an event
            return lambda: answer({})
        now()  # raises for an unknown key, before anything is changed
        if any(converts(value, "") for value in changes.values()):
            refuse_unusual(changes, tuning.tunable())
        return self._rebuilt(
            lambda: [wanted for wanted in [tuning.wanted(changes)] if wanted],
            lambda: answer(tuning.change(changes)),
        )

    def _carried_out(self, body: dict[str, Any]) -> Later:
        what = str(body.get("do"))
        if what == "admit":
            return self._admitted(body)

        def done() -> dict[str, Any]:
            if what not in self._does:
                raise UsageError(f"the plant cannot {what!r:.80}; it can: {', '.join([*self._does, 'admit'])}")
            return self._does[what](body) or {}

        if what == "disconnect":
            return self._rebuilt(lambda: self._experiment.given_back(str(body["controller"])), done)
        return done

    def _begin(self, body: dict[str, Any]) -> None:
        if (who := body.get("without")) is not None:
            self.excused.add(str(who))
        else:
            self.begun = True

    def _stop(self, _: dict[str, Any]) -> None:
        self.stopped = "stopped by an operator"

    def _pause(self, body: dict[str, Any]) -> dict[str, Any]:
        on = body["do"] == "pause"
        before = self.paused
        if on != before:
            self.paused = on
            self.steps = 0
            self._experiment.journal.note("paused" if on else "resumed", "paused" if on else "goes on")
        return {"changed": on != before}

    def _step(self, body: dict[str, Any]) -> None:
        frames = body.get("frames", 1)
        if isinstance(frames, bool) or not isinstance(frames, int) or not 1 <= frames <= MOST_STEPS:
            raise UsageError(f'"frames" is {frames!r:.80}; expected a whole number from 1 to {MOST_STEPS}')
        if not self.paused:
            raise UsageError("the run is not paused; pause it first, then single steps are possible")
        self.steps += frames
        self._experiment.journal.note("single_step", f"{frames} single step{'s' * (frames > 1)}")

    def _emergency(self, _: dict[str, Any]) -> None:
        self._experiment.emergency()
        if self.paused:  # the run-down of the drive needs the clock
            self._pause({"do": "resume"})

    def _knock(self, body: dict[str, Any]) -> None:
        impulse = body["impulse"]
        if isinstance(impulse, bool) or not isinstance(impulse, int | float):
            raise UsageError(f'"impulse" is {impulse!r:.80}; expected a number [N s]')
        self._experiment.knock(si(impulse, "N*s"))

    def _switch(self, body: dict[str, Any]) -> None:
        self._experiment.switch(str(body["controller"]), body["do"] == "connect")

    def _admitted(self, body: dict[str, Any]) -> Later:
        """Admit a controller of the user. Controllers that were admitted before and have left lose their actuators."""
        try:
            asked = Admission.model_validate(body)
        except ValidationError as error:
            faults = [f"{key:.80}: {fault}" for key, fault, _ in faults_of(error)]
            raise UsageError("\n".join(f"admit: {fault}" for fault in faults)) from None
        hub = self._hub
        experiment = self._experiment
        name = asked.controller
        user = self.cmd.asker
        arguments = (name, asked.drives, asked.period_ns, asked.hears)

        def gone() -> list[str]:
            """Controllers that were admitted for one of these actuators and are no longer present."""
            here = hub.watch.present
            queues = experiment.exchange.queues
            others = [other for other in queues if other not in experiment.scene.controllers and other != name]
            others = [other for other in others if not hub.commands.awaited(other, user)]
            return [o for o in others if ("controller", o) not in here and {*queues[o].drives} & {*asked.drives}]

        def wanted() -> list[Wanted]:
            here = ("controller", name) in hub.watch.present or hub.commands.awaited(name, user)
            if here or name in hub.session.inbound.reserved:
                raise UsageError(
                    f"the name {name!r:.80} is taken in this run; choose another one, or end that controller"
                )
            hub.places(asked.reads)  # raises for a sensor that is not there
            return experiment.admission(*arguments, gone())

        def then() -> dict[str, Any]:
            experiment.admit(*arguments, gone())
            hub.commands.admit(name, user)
            if asked.hears:
                hub.hear(asked.reads)
            return {}

        return self._rebuilt(wanted, then)


def _plain(value: Any) -> Any:
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else str(value)
