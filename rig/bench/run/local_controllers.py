"""Controllers that work in the process of the run: each is called at its ticks, and its command is received at once.

A caller may give controllers as objects (`placed`). A system of python-control becomes a table of the scene
(`kind = "lti"`), so that the recording contains it. Any other object takes part as a guest: it is admitted before the
first tick, as a controller that joins a live run, and the recording contains its commands. Both replace a controller of
the same name, and keep the delay of its loop.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from rig.bench.run.experiment import Experiment
from rig.controllers.blocks.base import Controller, Values
from rig.controllers.lti import LTI, of_python_control
from rig.controllers.runtime.file import faults_of
from rig.controllers.runtime.loop import NOT_FINITE, Loop, failure
from rig.controllers.runtime.native import Native, Untranslatable
from rig.errors import ControllerLost, SceneError, Untrusted, UsageError
from rig.scenes import checks
from rig.scenes.scene import Scene
from rig.scenes.sections import changes


class Guest(NamedTuple):
    """A controller that is admitted to a run; `delay_ns`: additional delay of its loop."""

    controller: Controller
    delay_ns: int = 0


def divided(given: Mapping[str, Any], by_name: bool) -> tuple[dict[str, object], dict[str, Any]]:
    """The changes that add the files among `given` to a scene, and the objects among `given`.

    `by_name`: the scene is given by its name, and not loaded yet. Raises UsageError for a file that is none.
    """
    files = {name: one for name, one in given.items() if isinstance(one, str | Path)}
    if files and not by_name:
        name, file = next(iter(files.items()))
        raise UsageError(
            f"controller {name}: {file} is a file, and the scene is loaded already; load the scene with it: "
            f'rig.load(SCENE, {{"controllers.{name}.kind": "{file}"}}), or name the scene instead'
        )
    return changes(files), {name: one for name, one in given.items() if name not in files}


def placed(scene: Scene, given: Mapping[str, Any]) -> tuple[Scene, dict[str, Guest]]:
    """The scene with the linear systems of `given` and without the controllers that guests replace; and the guests.

    Raises UsageError for objects that are no controllers, SceneError for those that do not fit the scene.
    """
    sections: dict[str, LTI] = {}
    guests: dict[str, Guest] = {}
    faults: list[str] = []
    for name, one in given.items():
        former = scene.controllers.get(name)
        if type(one).__module__.partition(".")[0] == "control":
            kept = {} if former is None else former.model_dump(include={"delay", "where"})
            try:
                sections[name] = _linear(one, kept)
            except ValidationError as error:
                lines = [one["msg"].removeprefix("Value error, ") for one in error.errors(include_url=False)]
                faults += [f"{name}: {line}" for line in lines]
            except ValueError as fault:
                faults.append(f"{name}: {fault}")
        elif isinstance(one, type):
            faults.append(f"{name}: is the class {one.__name__}; give an object of it, {one.__name__}()")
        else:
            faults += [f"{name}: {fault}" for fault in faults_of(one)]
            guests[name] = Guest(one, 0 if former is None else former.delay)
    if faults:
        raise UsageError("\n".join(faults))
    if not given:
        return scene, guests
    stay = {name: one for name, one in scene.controllers.items() if name not in guests}
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
    found = [
        *checks.periods(scene.clock, scene.controllers, {}),
        *checks.wiring(scene.controllers, scene.sensors, inputs, scene.plant),
        *checks.hands_off(scene.protocol, scene.controllers),
    ]
    if found:
        raise SceneError(scene.name, [line for _, line in found])


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
_EXPECTED: Counter[type] = Counter()
_TRIED: set[int] = set()
"""Addresses of compiled controllers that have passed this comparison in this process."""


def loop_of(name: str, controller: Controller) -> Loop:
    """The loop of a controller, which starts it. Raises ControllerFailed for any exception of its code."""
    for call in CALLS:
        call(name)
    try:
        loop = Loop(controller)
    except (ControllerLost, Untrusted):
        raise
    except (Exception, SystemExit) as error:
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
        self._journal = experiment.journal
        self.columns = [self._runner.bank.names.index(sensor) for sensor in loop.controller.reads]
        self._speaks = hasattr(loop.controller, "take_messages")
        self._latest = self._runner.bank.latest.item

    def _take_place(self, name: str, experiment: Experiment) -> None:
        self.name, self.queue = name, experiment.exchange.queues[name]
        self.due = 0
        self.given: Values | None = None
        self.fault: BaseException | None = None
        self._runner, self._receive = experiment.runner, experiment.exchange.receive

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
        self.due, self.given, self.fault = NEVER, None, None
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
        values, self.given = self.given, None
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
        loop, tick, first = self.loop, t_ns // self._runner.frame_ns, not self.loop.refused
        for call in CALLS:
            call(self.name)
        try:
            answer = loop.answer(t_ns, heard)
            said = loop.controller.take_messages() if self._speaks else ()  # type: ignore[attr-defined]
            for call in CALLS:
                call("")
        except ControllerLost:
            raise
        except (Exception, SystemExit) as error:
            raise failure(self.name, t_ns, error) from error
        if first and loop.refused:
            self._journal.note_at(tick, "not finite", NOT_FINITE.format(self.name), controller=self.name)
        for text in said:
            self._journal.note_at(tick, "log", text, controller=self.name)
        return answer

    def native(self) -> Native | None:
        """Its compiled `update`, set to the present state; None unless it has passed the comparison with Python.

        None with impaired links of measurements too: compiled code reads the instruments themselves.
        """
        if self._runner.meas_links:
            return None
        if self._worth and self._native is None:
            self._worth = False
            with suppress(Untranslatable):
                self._native = Native(self.loop.controller, self.loop.state)
                self._trial = 0 if self._native.address in _TRIED else TRIALS
                self._native.resume(self.loop.controller, self.loop.state)
        native = self._native
        usable = native is not None and not self._trial and native.resume(self.loop.controller, self.loop.state)
        return native if usable else None

    def _try(self, t_ns: int, heard: Values) -> None:
        """Compare the compiled `update` with the answer just given; discard it if they differ."""
        native, loop = self._native, self.loop
        assert native is not None
        self._trial -= 1
        differs = loop.last_input == (t_ns, heard) and not native.reproduces(t_ns, heard, loop.command, loop.state)
        if differs or not native.resume(loop.controller, loop.state):
            self._native, self._trial = None, 0
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
