"""Controllers that work in the process of the run: each is called at its ticks, and its command is received at once.

A caller may give controllers as objects (`placed`). A system of python-control becomes a table of the scene
(`kind = "lti"`), so that the recording contains it. Any other object takes part as a guest: it is admitted before the
first tick, as a controller that joins a live run, and the recording contains its commands. Both replace a controller of
the same name, and keep the delay of its loop.

For many frames controllers are lent to the compiled loop (rig.solve.control_loop) by `CompiledControllers`. After that
everything is as if each controller had been called from Python: its queue and its counts are up to date. The loop
leaves unusual cases to the exchange at their tick: an actuator that is not a state of the rig, a controller on safe
values, an answer that fails.
"""

from __future__ import annotations

import ctypes
from collections import Counter
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import repeat
from math import inf, nan
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from rig.bench.run.command_queue import AS_SENT, SAFE, CommandQueue
from rig.bench.run.exchange import Playback, PlayedCommands
from rig.bench.run.experiment import Experiment
from rig.controllers.blocks.base import Controller, Values
from rig.controllers.lti import LTI, of_python_control
from rig.controllers.runtime.file import faults_of
from rig.controllers.runtime.loop import NOT_FINITE, Loop, failure
from rig.controllers.runtime.native import Native, Uncompiled
from rig.controllers.runtime.skipped import SkippedSteps
from rig.errors import ControllerLost, DeviceError, SceneError, Untrusted, UsageError
from rig.quantities import details_of
from rig.scenes import checks
from rig.scenes.scene import Scene
from rig.scenes.sections import changes
from rig.solve.control_loop import ROWS

TRIALS = 200
"""Answers of a compiled controller that are compared with Python's before it is used. # chosen"""
WORTH = 500_000
"""Number of answers of one class of controllers in this process that makes compiling worth it: Python takes 1.4 s for
them, the compiler 1 to 3 s. # chosen"""
LOST = "lost"
"""Kind of the event that a controller works no more."""
NEVER = 1 << 62
"""Tick of the next answer of a controller that is lost."""
CALLS: list[Callable[[str], object]] = []
"""Called with the name of each controller before it is called, and with "" when it has answered: whoever waits for this
process learns who ended it."""

_Answer = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
_EXPECTED: Counter[type] = Counter()
_TRIED: set[int] = set()
"""Addresses of compiled controllers whose trials have given the answers of Python in this process."""


class Guest(NamedTuple):
    """A controller that is admitted to a run; `delay_ns`: additional delay of its loop."""

    controller: Controller
    delay_ns: int = 0


def divided(given: Mapping[str, Any], by_name: bool) -> tuple[dict[str, object], dict[str, Any]]:
    """The changes that add the files among `given` to a scene, and the objects among `given`.

    `by_name`: the scene is given by its name, and not loaded yet. Raises UsageError for a file that is none.
    """
    files = {name: object_ for name, object_ in given.items() if isinstance(object_, str | Path)}
    if files and not by_name:
        name, file = next(iter(files.items()))
        raise UsageError(
            f"controller {name}: {file} is a file, and the scene is loaded already; load the scene with it: "
            f'rig.load(SCENE, {{"controllers.{name}.kind": "{file}"}}), or name the scene instead'
        )
    return changes(files), {name: object_ for name, object_ in given.items() if name not in files}


def placed(scene: Scene, given: Mapping[str, Any]) -> tuple[Scene, dict[str, Guest]]:
    """The scene with the linear systems of `given` and without the controllers that guests replace; and the guests.

    Raises UsageError for objects that are no controllers, SceneError for those that do not fit the scene.
    """
    sections: dict[str, LTI] = {}
    guests: dict[str, Guest] = {}
    faults: list[str] = []
    for name, object_ in given.items():
        former = scene.controllers.get(name)
        if type(object_).__module__.partition(".")[0] == "control":
            kept = {} if former is None else former.model_dump(include={"delay", "where"})
            try:
                sections[name] = _linear(object_, kept)
            except ValidationError as error:
                lines = [fault["msg"].removeprefix("Value error, ") for fault in details_of(error)]
                faults += [f"{name}: {line}" for line in lines]
            except ValueError as fault:
                faults.append(f"{name}: {fault}")
        elif isinstance(object_, type):
            faults.append(f"{name}: is the class {object_.__name__}; give an object of it, {object_.__name__}()")
        else:
            faults += [f"{name}: {fault}" for fault in faults_of(object_)]
            guests[name] = Guest(object_, 0 if former is None else former.delay)
    if faults:
        raise UsageError("\n".join(faults))
    if not given:
        return scene, guests
    stay = {name: section for name, section in scene.controllers.items() if name not in guests}
    made = replace(scene, controllers=stay | sections)
    if sections:
        _check(made)
    return made, guests


def _linear(system: Any, kept: Mapping[str, Any]) -> LTI:
    import control

    linear = isinstance(system, control.StateSpace | control.TransferFunction)
    if linear and system.dt == 0 and not isinstance(system.dt, bool):
        raise ValueError(
            "is continuous; control.c2d(system, period, method) discretises it, for example at 1e-3 s by 'tustin'"
        )
    return of_python_control(system, **kept)


def _check(scene: Scene) -> None:
    """Raise SceneError if a controller does not fit the frames, sensors, actuators or protocol of its scene."""
    inputs = scene.assemble().inputs
    wrong = [
        *checks.periods(scene.clock, scene.controllers, {}),
        *checks.wiring(scene.controllers, scene.sensors, inputs, scene.plant),
        *checks.hands_off(scene.protocol, scene.controllers),
    ]
    if wrong:
        raise SceneError(scene.name, [line for _, line in wrong])


def loop_of(name: str, controller: Controller) -> Loop:
    """The loop of a controller, which starts it. Raises ControllerFailed for any exception of its code."""
    for call in CALLS:
        call(name)
    try:
        loop = Loop(controller)
    except (ControllerLost, DeviceError, KeyboardInterrupt, Untrusted):
        raise
    except BaseException as error:
        raise failure(name, 0, error) from error
    for call in CALLS:
        call("")
    return loop


def asked_often(controller: Controller) -> None:
    """Declare that controllers of this class are worth compiling in this process, even for a short run."""
    _EXPECTED[type(controller)] += WORTH


class ControllerInProcess:
    """A controller that works in this process. `due`: tick of its next answer.

    `given`: its answer at this tick, if it was already called; `fault`: the exception that it raised. `survives`: what
    ends this controller and not the run.
    """

    survives: type[Exception] = ControllerLost

    def __init__(self, name: str, loop: Loop, experiment: Experiment) -> None:
        self._take_place(name, experiment)
        self._worth = False
        self._native: Native | None = None
        self._trial = 0
        self.loop = loop
        self.skipped = SkippedSteps()
        """Steps that it did not answer in the recording that is continued."""
        self._journal = experiment.journal
        self.columns = [self._runner.bank.names.index(sensor) for sensor in loop.controller.reads]
        self._tells = hasattr(loop.controller, "take_events")
        self._latest = self._runner.bank.latest.item

    def _take_place(self, name: str, experiment: Experiment) -> None:
        self.name = name
        self.queue = experiment.exchange.queues[name]
        self.due = 0
        self.given: Values | None = None
        self.fault: BaseException | None = None
        self._runner = experiment.runner
        self._receive = experiment.exchange.receive

    def expect(self, answers: int) -> None:
        """Announce the number of answers in this run, which decides whether the controller is compiled."""
        _EXPECTED[type(self.loop.controller)] += answers
        self._worth = _EXPECTED[type(self.loop.controller)] >= WORTH

    def answer(self) -> None:
        """Send a command if one is due at this tick. A controller whose compiled code fails is lost, not the run."""
        try:
            self._answer()
        except self.survives as why:
            self._lose(why)

    def _lose(self, why: Exception) -> None:
        self.due = NEVER
        self.given = None
        self.fault = None
        drives = ", ".join(self.queue.drives)
        text = f"controller {self.name} is lost: {why}; {drives}: the last command is held, then safe values"
        self._journal.note(LOST, text, controller=self.name)

    def _answer(self) -> None:
        tick = self._runner.tick
        if self.fault is not None:
            raise self.fault
        if self.given is None:
            if tick != self.due:
                return
            self.ask(tick)
        values = self.given
        self.given = None
        assert values is not None
        self._receive(self.name, tick, values)

    def ask(self, tick: int) -> Values:
        """Call the controller with the measurements of this tick and return its answer."""
        self.due = tick + self.queue.period
        if self.loop.every_sample:
            hearing = self._runner.hearing_at(tick)
            heard: Any = tuple([hearing.samples(i).tolist() for i in self.columns])
        elif self._runner.meas_links:
            heard = tuple(self._runner.hearing_at(tick).latest[self.columns].tolist())
        else:
            heard = tuple([self._latest(i) for i in self.columns])
        t_ns = tick * self._runner.frame_ns
        self.given = self._called(t_ns, heard)
        if self._trial:
            self._try(t_ns, heard)
        return self.given

    def _called(self, t_ns: int, heard: Any) -> Values:
        """The answer of its code at `t_ns` [ns]. Raises ControllerFailed for any exception of this code."""
        loop = self.loop
        tick = t_ns // self._runner.frame_ns
        first = not self.loop.refused
        if tick in self.skipped.unanswered:
            if tick in self.skipped.arrived:
                loop.skip(heard)
            return ()
        for call in CALLS:
            call(self.name)
        try:
            answer = loop.answer(t_ns, heard)
            told = loop.controller.take_events() if self._tells else ()  # type: ignore[attr-defined]
            for call in CALLS:
                call("")
        except (ControllerLost, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise failure(self.name, t_ns, error) from error
        if first and loop.refused:
            self._journal.note_at(tick, "not finite", NOT_FINITE.format(self.name), controller=self.name)
        for kind, text in told:
            self._journal.note_at(tick, kind, text, controller=self.name)
        return answer

    def native(self) -> Native | None:
        """Its compiled `update`, set to the present state; None unless it has passed the comparison with Python.

        None with impaired links of measurements too: compiled code reads the instruments themselves.
        """
        if self._runner.meas_links:
            return None
        if self._worth and self._native is None:
            self._worth = False
            with suppress(Uncompiled):
                self._native = Native(self.loop.controller, self.loop.state)
                self._trial = 0 if self._native.address in _TRIED else TRIALS
                self._native.resume(self.loop.controller, self.loop.state)
        native = self._native
        usable = native is not None and not self._trial and native.resume(self.loop.controller, self.loop.state)
        return native if usable else None

    def _try(self, t_ns: int, heard: Values) -> None:
        """Compare the compiled `update` with the answer just given; discard it if they differ."""
        native = self._native
        loop = self.loop
        assert native is not None
        self._trial -= 1
        differs = loop.last_input == (t_ns, heard) and not native.reproduces(t_ns, heard, loop.command, loop.state)
        if differs or not native.resume(loop.controller, loop.state):
            self._native = None
            self._trial = 0
        elif not self._trial:
            _TRIED.add(native.address)

    def catch_up(self, tick: int, send: bool = False) -> None:
        """Call the controller for all answers due before `tick`: nobody has used them, because it is disconnected.

        `send`: because recorded commands are played; the exchange keeps the answers that are due after these.
        """
        if self.due < tick:
            try:
                self._catch_up(tick, send)
            except self.survives as why:
                self._lose(why)

    def _catch_up(self, tick: int, send: bool) -> None:
        frame = self._runner.frame_ns
        times = range(self.due * frame, tick * frame, self.queue.period * frame)
        hearing = self._runner.hearing
        recall = hearing.published if self.loop.every_sample else hearing.shown
        heard = [recall(i, times) for i in self.columns]
        for t_ns, values in zip(times, zip(*heard) if heard else repeat(())):
            command = self._called(t_ns, values)
            if send:
                self._receive(self.name, t_ns // frame, command)
        self.due += len(times) * self.queue.period


class CompiledQueue(NamedTuple):
    """A command queue that is lent, its slices of the arrays, and its source: a controller at work or a recording."""

    queue: CommandQueue
    reads: slice
    drives: slice
    controller: ControllerInProcess | None
    native: Native | None
    played: PlayedCommands | None


class CompiledControllers:
    """Lends controllers of `experiment` to the compiled loop while the plant runner computes many frames."""

    def __init__(self, experiment: Experiment) -> None:
        self._exchange = experiment.exchange
        self._runner = experiment.runner
        self._tables = self._runner.controllers
        self._command: Any = self._tables.command.data
        self._clock = self._tables.clock[0]
        self._compiled: list[CompiledQueue] = []
        answers = self._answers()
        next(answers)
        self._asked = _Answer(answers.send)
        self._address = ctypes.cast(self._asked, ctypes.c_void_p).value

    def lend(self, working: Sequence[ControllerInProcess]) -> Collection[str]:
        """Lend all controllers of `working`, or of a recording, that the loop can handle; returns their names.

        The controllers have given the answers due at this tick, and recorded commands of this tick are in force.
        """
        self._tables.clock[0] = self._runner.tick, 0, 0
        for controller in working:
            if (
                controller.queue.values
                and not controller.queue.wanted
                and controller.queue.status != SAFE
                and controller.queue.link is None
            ):
                self._lend(controller.queue, controller, None)
        if isinstance(self._exchange, Playback) and self._exchange.plays:
            for name, played in self._exchange.played.items():
                if name in self._exchange.queues:
                    self._lend(self._exchange.queues[name], None, played)
        return [compiled.queue.name for compiled in self._compiled]

    def _lend(self, queue: CommandQueue, controller: ControllerInProcess | None, played: PlayedCommands | None) -> None:
        c = self._tables
        i = len(self._compiled)
        read, driven = (self._compiled[-1].reads.stop, self._compiled[-1].drives.stop) if i else (0, 0)
        places = [self._runner.plain(drive) for drive in queue.drives]
        fits = i < len(c.controllers) and driven + len(places) <= len(c.command) and len(queue.queue) < ROWS
        if not fits or None in places or not self._exchange.faulty.keys().isdisjoint(queue.drives):
            return
        native = None
        columns: Sequence[int] = () if controller is None else controller.columns
        if controller is not None and read + len(columns) <= len(c.columns):
            native = controller.native()
        reads = slice(read, read + (0 if native is None else len(columns)))
        drives = slice(driven, driven + len(places))
        c.columns[reads] = columns[: reads.stop - read]
        c.place[drives], c.slope[drives] = zip(*places)
        c.force[drives] = [self._exchange.in_force.get(drive, nan) for drive in queue.drives]
        compiled = CompiledQueue(queue, reads, drives, controller, native, played)
        record = c.controllers[i]
        record["hears"] = reads.start
        record["deaf"] = reads.stop
        record["drives"] = drives.start
        record["driven"] = drives.stop
        record["given"] = -1
        record["updates"] = 0
        record["kept"] = 0
        record["clamped"] = 0
        record["oldest"] = 0
        if controller is not None:
            self._lay_working(record, i, compiled, controller)
        else:
            self._lay_played(record, i, compiled)
        self._compiled.append(compiled)
        self._clock["count"] = i + 1

    def _lay_working(self, record: Any, i: int, compiled: CompiledQueue, controller: ControllerInProcess) -> None:
        queue, reads, drives, _, native, _ = compiled
        c = self._tables
        inputs = self._runner.inputs
        c.low[drives] = [inputs[drive].low for drive in queue.drives]
        c.high[drives] = [inputs[drive].high for drive in queue.drives]
        for k, (due, answered, values) in enumerate(queue.queue):
            c.queue[i, k] = due, answered, AS_SENT
            c.queued[k, drives] = values
        record["answer"] = self._address if native is None else native.address
        record["heard_at"] = c.heard.ctypes.data + c.heard.itemsize * reads.start
        record["command_at"] = c.command.ctypes.data + c.command.itemsize * drives.start
        record["memory_at"] = 0 if native is None else native.memory.ctypes.data
        record["period"] = queue.period
        record["delay"] = queue.delay
        record["waiting"] = len(queue.queue)
        record["due"] = controller.due
        record["last"] = queue.last

    def _lay_played(self, record: Any, i: int, compiled: CompiledQueue) -> None:
        c = self._tables
        played = compiled.played
        assert played is not None
        tick, answered, status, values = (column[played.done : played.done + ROWS] for column in played.commands)
        count = len(tick)
        waiting = c.queue[i, :count]
        waiting["tick"] = tick
        waiting["answered"] = answered
        waiting["status"] = status
        c.queued[:count, compiled.drives] = values
        c.low[compiled.drives] = -inf
        c.high[compiled.drives] = inf  # recorded commands are already clamped
        record["answer"] = 0
        record["due"] = -1
        record["waiting"] = count
        record["period"] = NEVER
        record["last"] = 0

    def take_back(self) -> None:
        """Update queues, counts and states of the lent controllers with what the loop has done."""
        c = self._tables
        for i, compiled in enumerate(self._compiled):
            queue = compiled.queue
            record = c.controllers[i]
            drives = compiled.drives
            if compiled.controller is not None:
                self._take_back_working(record, i, compiled, compiled.controller)
            if kept := int(record["kept"]):
                queue.adopt(c.rows[i, :kept], c.values[:kept, drives])
                if compiled.played is not None:
                    compiled.played.done += kept
                for name, value in zip(queue.drives, queue.values):
                    self._exchange.in_force[name] = self._runner.values[name] = value
        self._compiled.clear()
        self._clock["count"] = 0

    def _take_back_working(self, record: Any, i: int, compiled: CompiledQueue, controller: ControllerInProcess) -> None:
        c = self._tables
        queue = compiled.queue
        drives = compiled.drives
        updates = int(record["updates"])
        kept = int(record["kept"])
        if compiled.native is not None:
            controller.due = int(record["due"])
            if updates:
                t_ns = (controller.due - queue.period) * self._runner.frame_ns
                heard = tuple(c.heard[compiled.reads].tolist())
                command = tuple(c.command[drives].tolist())
                controller.loop.adopt(updates, t_ns, heard, compiled.native.state(), command)
        if self._clock["unusual"] and record["given"] == self._clock["tick"]:
            controller.given = tuple(c.command[drives].tolist())
        queue.queue.clear()
        for k in range(int(record["waiting"])):
            at = (int(record["oldest"]) + k) % ROWS
            due, answered, _ = c.queue[i, at].tolist()
            queue.queue.append((due, answered, tuple(c.queued[at, drives].tolist())))
        if kept:
            queue.counts.taken += kept
            queue.counts.clamped += int(record["clamped"])
            queue.counts.oldest = max(queue.counts.oldest, queue.delay)

    def _answers(self) -> Generator[int, int, None]:
        """The callback of the compiled loop: takes the index of the controller that is due; yields 1 if it answered.

        It yields 0 if the exchange must handle the case. It is a generator because Ctrl-C raises where Python resumes
        after compiled code or where a loop repeats, and here both are inside `try`. A function would lose the
        exception, since compiled code does not propagate it.
        """
        result = 0
        i = 0
        while True:
            try:
                while True:
                    i = 0
                    i = yield result
                    result = 0
                    queue, _, drives, controller, _, _ = self._compiled[i]
                    values = controller.ask(int(self._clock["tick"]))  # type: ignore[union-attr]
                    first = drives.start  # type: ignore[union-attr]
                    if len(values) == len(queue.drives):
                        for value in values:
                            self._command[first] = value
                            first += 1
                        controller.given = None  # type: ignore[union-attr]
                        result = 1
            except GeneratorExit:
                return
            except BaseException as fault:
                self._compiled[i].controller.fault = fault  # type: ignore[union-attr]
                result = 0
