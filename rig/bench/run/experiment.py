"""One experiment on a plant runner: everything that happens at a tick between measurement and integration.

It is the same in every mode:

    experiment.open()                      once, before anything is measured: the protocol at tick 0
    experiment.begin()                     carry out what is due at this tick: protocol, limits
    exchange.receive(...)                  answers of the controllers to the measurements of this tick, or older ones
    exchange.take_over()                   put commands into force
    runner.frames(1)                       integrate to the next tick

Actions from outside (an operator changes a parameter or knocks, a user's own controller is admitted) are carried out
between `begin` and `take_over` and recorded with their tick, so that the run can be simulated again.

Actuators and parameters are changed within their allowed ranges (`Tuning`); faults of the scene begin and end at their
ticks (`FaultTimes`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rig.bench.run import actions, protocol
from rig.bench.run.before import DelayWarnings
from rig.bench.run.builds import Builds, PostponedSteps, PreparedRigs
from rig.bench.run.exchange import Exchange
from rig.bench.run.journal import OPERATOR, Journal
from rig.bench.run.rig_variants import Wanted
from rig.bench.run.runner import PlantRunner
from rig.bus.impaired_link import counters
from rig.controllers import controller_drives
from rig.errors import LogError, NumericsError, RigError, UsageError
from rig.quantities import finite
from rig.scenes import belief
from rig.scenes.faults import near, shortened, shown
from rig.scenes.part_faults import ActuatorFault, PartFault, described
from rig.scenes.protocol import Connect, flat
from rig.scenes.scene import Scene
from rig.scenes.sections import values_of
from rig.units import si

# Time in which the drive stops after a limit has ended the experiment. # chosen
RUN_DOWN_NS = 500_000_000
BEGIN = "begin"
FORK = "fork"
PLANT = "plant"
EMERGENCY = "emergency"
FAULT = "fault"
"""Kind of event that says that a fault begins or is over."""

Retune = Callable[[str, dict[str, Any]], None]


class FaultTimes:
    """The begins and ends of the faults of `scene` that are still to come, in order."""

    def __init__(self, scene: Scene, runner: PlantRunner, journal: Journal) -> None:
        self._runner = runner
        self._journal = journal
        units = {name: actuator.unit for name, actuator in runner.inputs.items()}
        units.update(zip(runner.bank.names, runner.bank.units))
        self._words = {name: described(fault, units[fault.part]) for name, fault in scene.faults.items()}
        times = []
        for name, fault in scene.faults.items():
            times.append((fault.at // scene.frame_ns, 1, name, fault))
            if fault.end is not None:
                times.append((fault.end // scene.frame_ns, 0, name, fault))
        self._due: deque[tuple[int, int, str, PartFault]] = deque(sorted(times, key=lambda time: time[:3]))

    @property
    def next(self) -> int | None:
        """The tick of the next begin or end; None if none comes any more."""
        return self._due[0][0] if self._due else None

    def carry_out(self, exchange: Exchange) -> None:
        """Carry out what is due at this tick: a fault that is over first, then those that begin."""
        while self._due and self._due[0][0] <= self._runner.tick:
            _, begins, name, fault = self._due.popleft()
            words = self._words[name]
            text = f"{name}: {words}" if begins else f"{name} is over: {fault.part} is sound again"
            self._journal.note(FAULT, text, fault=name, begins=bool(begins))
            if isinstance(fault, ActuatorFault):
                exchange.switch_fault(fault, bool(begins))

    def never(self) -> list[str]:
        """A line for each fault whose time has not come."""
        frame = self._runner.frame_ns * 1e-9
        end = self._runner.t_ns * 1e-9
        lines = []
        for tick, begins, name, _ in self._due:
            if begins:
                late = f"faults.{name}.at: {tick * frame:g} s is after the end of the run at {end:g} s"
                words = self._words[name]
                lines.append(f"{late}, so this fault never acts ({words}); let it begin earlier or run longer")
        return lines


class Tuning:
    """Changes actuators and parameters of the rig of `runner`, all at one tick; `journal` records the changes."""

    def __init__(self, scene: Scene, runner: PlantRunner, exchange: Exchange, journal: Journal) -> None:
        self.scene = scene
        self.runner = runner
        self.exchange = exchange
        self.journal = journal

    def wanted(self, changes: Mapping[str, Any]) -> Wanted:
        """The variant of the rig that `change` needs for these changes. Raises UsageError with all faults.

        This method refuses changes that are not `tunable`. `change` accepts them, because old recordings contain some.
        """
        actuators, parameters = self._sorted(changes)
        tunable = self.tunable()
        if fixed := [key for key in parameters if key not in tunable]:
            known = f"what can be tuned: {', '.join(tunable)}"
            raise UsageError("\n".join([*(f"{key}: is fixed while the rig runs" for key in fixed), known]))
        return self._wanted(actuators, parameters)

    def needed(self, changes: Mapping[str, Any]) -> Wanted:
        """Like `wanted`, for changes by the protocol, which need not be `tunable`."""
        return self._wanted(*self._sorted(changes))

    def change(self, changes: Mapping[str, Any], by: str = OPERATOR) -> dict[str, Any]:
        """Change actuators and parameters of the rig at this tick and return the new values. Raises RigError.

        Either all changes are made, or none.
        """
        actuators, parameters = self._sorted(changes)
        self.runner.go_on(self._wanted(actuators, parameters))
        for key, number in actuators.items():
            self.exchange.ask(key, number)
        new = {key: self.value(key) for key in parameters} | actuators
        self.journal.note("parameter", ", ".join(f"{k} = {v}" for k, v in new.items()), by=by, set=new)
        return new

    def _wanted(self, actuators: Mapping[str, float], parameters: Mapping[str, Any]) -> Wanted:
        """The variant with command states for these actuators; without a command state a value is a parameter."""
        runner = self.runner
        lacking = self.runner.lacking(actuators)
        matrices = {
            key: value
            for key, value in actuators.items()
            if key not in lacking and runner.rebuilds(key, value) and not self.exchange.overruler(key)
        }
        return Wanted({**parameters, **matrices}, lacking)

    def _sorted(self, changes: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, Any]]:
        """Separate changes of actuators (in SI) and of parameters. Raises UsageError with all faults."""
        inputs = self.runner.inputs
        known = dict(values_of(self.scene.parameters))
        actuators: dict[str, float] = {}
        parameters: dict[str, Any] = {}
        faults = []
        for key, value in changes.items():
            if key not in inputs:
                parameters[key] = value
                if key not in known:
                    faults.append(f"{shortened(key)}: unknown key; {near(key, self.tunable())}")
                continue
            actuator = inputs[key]
            try:
                actuators[key] = si(value, actuator.unit)
            except ValueError as fault:
                faults.append(f"{key} {fault}")
                continue
            if not actuator.low <= actuators[key] <= actuator.high:
                faults.append(f"{key} = {shown(value)}: must be {actuator.low:g} to {actuator.high:g} {actuator.unit}")
        if faults:
            raise UsageError("\n".join(faults))
        return actuators, parameters

    def tunable(self) -> dict[str, str]:
        """Key -> unit of everything that can be changed: actuators, then parameters of the rig."""
        runner = self.runner
        units = {name: actuator.unit for name, actuator in runner.inputs.items()}
        for key, (_, unit) in values_of(runner.scene.parameters):
            if unit and key not in runner.inputs and not key.startswith("start."):
                units[key] = unit
        return units

    def value(self, key: str) -> Any:
        """The present value of an actuator or a parameter of the rig."""
        return self.runner.values[key] if key in self.runner.inputs else self.runner.parameter(key)


def divided(changes: Mapping[str, Any]) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    """Divide changes by dotted key into those of each controller (by its own keys) and those of the rig."""
    own: dict[str, dict[str, Any]] = {}
    rig: dict[str, Any] = {}
    for key, value in changes.items():
        room, _, rest = key.partition(".")
        name, _, inner = rest.partition(".")
        if room == "controllers":
            own.setdefault(name, {})[inner] = value
        else:
            rig[key] = value
    return own, rig


class Experiment:
    """The experiment of `scene` on `runner`. It ends after `duration_ns`, or when its protocol is done.

    `retune(controller, changes)` changes parameters of a controller, wherever it works. `events` are those of a
    recorded run: actions from outside are repeated at the same ticks. Only events of the plant count.
    """

    def __init__(
        self,
        scene: Scene,
        runner: PlantRunner,
        duration_ns: int | None,
        retune: Retune,
        exchange: type[Exchange] = Exchange,
        events: Iterable[Mapping[str, Any]] = (),
    ) -> None:
        journal = Journal(runner.frame_ns, lambda: runner.tick)
        links = scene.links("act", runner.bank.seed)
        commands = exchange(runner, runner.frame_ns, scene.clock.hold_frames, journal, links)
        self.scene = scene
        self.runner = runner
        self.exchange = commands
        self.journal = journal
        self._faults = FaultTimes(scene, runner, self.journal)
        for name, section in scene.controllers.items():
            self.exchange.admit(name, controller_drives(section), section.period, section.delay)
        self._connected_later = {step.controller for step in flat(scene.protocol) if type(step) is Connect}
        for name in self._connected_later & scene.controllers.keys():
            self.exchange.connect(name, False)
        units = dict(zip(runner.bank.names, runner.bank.units))
        self.tuning = Tuning(scene, runner, self.exchange, self.journal)
        self.protocol = protocol.Protocol(scene.protocol, runner.frame_ns, units, runner.inputs)
        self._does: dict[type, Callable[[Any], object]] = {
            actions.Note: lambda note: self.journal.note(note.kind, note.text),
            actions.Apply: lambda to: commands.ask(to.name, to.value),
            actions.Move: lambda move: commands.move(*move),
            actions.Strike: lambda knock: self.knock(knock.impulse, "protocol", knock.duration_ns),
            actions.Release: lambda _: runner.release(),
            actions.Switch: lambda switch: self.switch(switch.controller, switch.on, "protocol"),
            actions.Finish: lambda finish: self.stop(finish.reason),
            actions.Change: self._change,
        }
        self.over = ""
        """Why the experiment has ended; empty while it runs."""
        self.aborted = ""
        """The limit that was exceeded, or the emergency stop; empty otherwise."""
        self._retune = retune
        self._end = None if duration_ns is None else -(-duration_ns // runner.frame_ns)
        length = scene.duration_ns if duration_ns is None else duration_ns
        self.ends = length is not None
        """Whether protocol or duration set an end."""
        self._delay_warnings = DelayWarnings(scene, self.journal)
        if length is not None:
            self._delay_warnings.check(length)
        for line in belief.lines(scene):
            self.journal.note("belief", line)
        reported = [event for event in events if event.get("source", PLANT) == PLANT]  # others may publish anything
        self.builds = Builds(runner)
        self.postponed = PostponedSteps(runner, self.journal, self._wants, self.builds, reported)
        first = next((i for i, event in enumerate(reported) if event["kind"] == BEGIN), 0)
        self._before = deque(event for event in reported[:first] if _by_operator(event))
        self._outside = deque(event for event in reported[first:] if _by_operator(event))

    def prepared_rigs(self) -> PreparedRigs:
        """Build the rigs that protocol and limits will need, and return what builds them again after other changes."""
        return PreparedRigs(self.scene, self.runner, self.protocol, self.builds)

    def knock(self, impulse: float, by: str = OPERATOR, duration_ns: int = 0) -> None:
        """Strike the body at this tick with `impulse` [N s]; with a duration by a half sine of force."""
        try:
            finite(impulse, "N*s")
        except ValueError as fault:
            raise UsageError(f"the body cannot be knocked with an impulse of {impulse:g} N s: it {fault}") from None
        self.runner.knock(impulse, duration_ns)
        within = f" within {duration_ns / 1e9:g} s" if duration_ns else ""
        self.journal.note("knock", f"knock with {impulse:g} N s{within}", by=by, impulse=impulse)

    def switch(self, controller: str, on: bool, by: str = OPERATOR) -> None:
        """Connect or disconnect a controller at this tick."""
        if controller not in self.exchange.queues:
            known = ", ".join(self.exchange.queues) or "none"
            raise UsageError(f"no controller is called {controller:.80}; there are: {known}")
        self.exchange.connect(controller, on)
        word = "connected" if on else "disconnected"
        self.journal.note(word, f"{controller} is {word}", by=by, controller=controller)

    def admission(
        self, controller: str, drives: Sequence[str], period_ns: int, hears: bool = False, gone: Collection[str] = ()
    ) -> list[Wanted]:
        """The rigs that `admit` needs, one after the other. Raises UsageError if this controller cannot be admitted.

        `gone`: controllers that have left, whose actuators it takes.
        """
        if hears and period_ns != self.runner.frame_ns:
            frame = f"{self.runner.frame_ns / 1e6:g} ms"
            raise UsageError(f"{controller:.80} reads every sample, so its period must be one frame, {frame}")
        if controller in self.scene.controllers:
            raise UsageError(f"the scene already has a controller {controller}; give yours another name")
        self.exchange.check(controller, drives, period_ns, gone)
        lacking = self.runner.lacking(drives)
        returned = [wanted for other in gone for wanted in self.given_back(other)]
        return [*returned, *([Wanted({}, lacking)] if lacking else []), *self.given_back(controller)]

    def given_back(self, controller: str) -> list[Wanted]:
        """The rigs that are needed, one after the other, to disconnect a controller."""
        queue = self.exchange.queues.get(controller)
        back = self.exchange.given_back(queue) if queue is not None else {}
        return [Wanted({drive: value}) for drive, value in back.items() if self.runner.rebuilds(drive, value)]

    def admit(
        self,
        controller: str,
        drives: Sequence[str],
        period_ns: int,
        hears: bool = False,
        gone: Collection[str] = (),
        delay_ns: int = 0,
    ) -> None:
        """Admit a controller that is not in the scene; it drives actuators that no other controller drives.

        `gone`: controllers that have left, whose actuators it takes. `delay_ns`: additional delay of its loop. Raises
        UsageError, and then changes nothing.
        """
        variants = self.runner.variants
        variants.keep(variants.build_all(self.admission(controller, drives, period_ns, hears, gone)))
        for other in gone:  # from here on nothing can be refused
            self.dismiss(other)
        self.runner.go_on(Wanted({}, self.runner.lacking(drives)))
        if controller in self.exchange.queues:
            self.exchange.dismiss(controller)
        self.exchange.admit(controller, drives, period_ns, delay_ns)
        text = f"{controller} is admitted and drives {', '.join(drives)}"
        data = {"controller": controller, "drives": list(drives), "period_ns": period_ns}
        data |= {"delay_ns": delay_ns} if delay_ns else {}
        self.journal.note("admitted", text, by=OPERATOR, **data)

    def dismiss(self, controller: str) -> None:
        """Remove a controller that was admitted and has left: its actuators return to the values of the protocol."""
        self.exchange.dismiss(controller)
        self.journal.note("dismissed", f"{controller} is dismissed", by=OPERATOR, controller=controller)

    def open(self) -> None:
        """Carry out what is due at the first tick and needs no measurement, so that it acts on the first samples."""
        while self._before:
            self._repeat(self._before.popleft())
        for name in self.exchange.queues:
            if name in self._connected_later and name not in self.scene.controllers:
                self.exchange.connect(name, False)
        for action in self.protocol.due(0, np.full(len(self.runner.bank.names), np.nan)):
            self._carry_out(action)
        self.runner.start()

    def begin(self) -> bool:
        """Carry out what is due at this tick; whether the experiment continues."""
        runner = self.runner
        tick = runner.tick
        self._faults.carry_out(self.exchange)
        name = "" if self.aborted else runner.beyond()
        if name:
            value = runner.output(name)
            limit = self.scene.limits[name]
            unit = runner.units[name]
            self.abort(f"{name} = {value:.4g} {unit} is beyond its limit of {limit:g} {unit}")
        if not self.aborted:
            for action in self.postponed.due():
                self._carry_out(action)
            for action in self.protocol.due(tick, runner.bank.latest):
                if not self.postponed.has_to_wait(action):
                    self._carry_out(action)
        while self._outside and self._outside[0]["tick"] <= tick:
            self._repeat(self._outside.popleft())
        if self._end is not None:
            if tick >= self._end and not self.over:
                self.over = self.aborted or "done"
        elif self.protocol.done and self.scene.protocol and not self.over:
            self.over = "done"
        return not self.over

    def end(self) -> None:
        """Record what only the end shows: steps that never took effect, and delays as long as the run."""
        self.postponed.end()
        if self.runner.tick:
            self._delay_warnings.check(self.runner.t_ns)
        for text in self._faults.never():
            self.journal.note("warning", text)

    def network(self) -> dict[str, dict[str, int]]:
        """What became of the messages of each impaired link: delayed, lost, duplicated, reordered; {} without one."""
        _ = self.runner.hearing  # up to this tick
        return counters([*self.runner.meas_links.values(), *self.exchange.links.values()])

    def until(self) -> int:
        """The first later tick at which `begin` may have something to do, unless a limit is exceeded before."""
        tick = self.runner.tick
        due = [self._end, None if self.aborted else self.protocol.until(tick)]
        due += [self._faults.next, self.postponed.until(), self._outside[0]["tick"] if self._outside else None]
        return max(min((at for at in due if at is not None), default=tick + 1), tick + 1)

    def emergency(self) -> None:
        """Go to the safe state at this tick at the request of an operator; a second request changes nothing."""
        if not self.aborted:
            self.abort("emergency stop by an operator", EMERGENCY, by=OPERATOR)

    def abort(self, why: str, kind: str = "limit", **data: Any) -> None:
        """Go to the safe state: actuators go to safe values, commands have no more effect, then the run ends."""
        self.aborted = why
        self.journal.note(kind, f"{why}: to the safe state", **data)
        ticks = max(RUN_DOWN_NS // self.runner.frame_ns, 1)
        self.postponed.end()
        self.runner.release()
        self.exchange.give_up(ticks)
        self._end = self.runner.tick + ticks

    def stop(self, why: str = "stopped") -> None:
        """End the experiment at this tick."""
        if not self.over:
            self.over = why
            self.journal.note("stop", why)

    def _repeat(self, event: Mapping[str, Any]) -> None:
        """Carry out a recorded action of an operator. Raises LogError for one that this rig cannot have recorded."""
        data = event["data"]
        kind = event["kind"]
        does: dict[str, Callable[[], object]] = {
            "parameter": lambda: self.change(data["set"]),
            FORK: lambda: self.journal.note(FORK, event["text"], **data),
            "knock": lambda: self.knock(data["impulse"]),
            EMERGENCY: self.emergency,
            "connected": lambda: self.switch(data["controller"], True),
            "disconnected": lambda: self.switch(data["controller"], False),
            "admitted": lambda: self.admit(
                data["controller"], data["drives"], data["period_ns"], delay_ns=data.get("delay_ns", 0)
            ),
            "dismissed": lambda: self.dismiss(data["controller"]),
        }
        try:
            does.get(kind, lambda: None)()
        except NumericsError:
            raise
        except (RigError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as fault:
            why = f"its data lack {fault}" if isinstance(fault, KeyError) else str(fault)
            t = event["tick"] * self.runner.frame_ns * 1e-9
            text = f"the recorded event {event['kind']} of an operator at t = {t:.9g} s cannot be repeated"
            raise LogError(f"{text}: {why}") from None

    def _wants(self, action: actions.Action) -> list[Wanted]:
        """The rigs that an action of the protocol needs, one after the other."""
        if isinstance(action, actions.Switch):
            return [] if action.on else self.given_back(action.controller)
        try:
            if isinstance(action, actions.Change):
                wanted = self.tuning.needed({action.key: action.value})
                return [wanted] if wanted else []
            if isinstance(action, actions.Apply) and not self.exchange.overruler(action.name):
                actuator = self.runner.inputs[action.name]
                value = min(max(action.value, actuator.low), actuator.high)
                return [Wanted({action.name: value})] if self.runner.rebuilds(action.name, value) else []
        except RigError:  # reported when the action is carried out
            pass
        return []

    def _carry_out(self, action: actions.Action) -> None:
        self._does[type(action)](action)

    def change(self, changes: Mapping[str, Any], by: str = OPERATOR) -> None:
        """Change actuators, parameters of the rig and those of controllers (controllers.NAME.KEY) at this tick.

        Raises RigError.
        """
        own, rig = divided(changes)
        for name, values in own.items():
            self._retune(name, values)
            new = {f"controllers.{name}.{key}": value for key, value in values.items()}
            text = ", ".join(f"{k} = {v:g}" if isinstance(v, float) else f"{k} = {v}" for k, v in new.items())
            self.journal.note("parameter", text, by=by, set=new)
        if rig:
            self.tuning.change(rig, by)

    def _change(self, action: actions.Change) -> None:
        try:
            self.change({action.key: action.value}, "protocol")
        except RigError as fault:  # the experiment continues, and the recording contains the refusal
            self.journal.note("refused", f"{action.key} = {action.value:g}: {fault}", by="protocol")

    def progress(self) -> protocol.Progress:
        """Progress of the experiment."""
        progress = self.protocol.progress(self.runner.tick)
        if self._end is None:
            return progress
        left = max(self._end - self.runner.tick, 0)
        phase = "safe state" if self.aborted else progress.phase
        fraction = min(self.runner.tick / self._end, 1.0) if self._end else 1.0
        return progress._replace(phase=phase, fraction=fraction, left_ns=left * self.runner.frame_ns)


def _by_operator(event: Mapping[str, Any]) -> bool:
    return bool(event["data"].get("by") == OPERATOR)
