"""A controller in operation: its state, the command in force, and the handling of values that are not finite.

The plant's process and a controller's process both run controllers with this class. Therefore a run in one process and
a run over the bus handle a missing sample or a faulty controller in the same way, to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from math import isfinite
from typing import Any

from rig.controllers.blocks.base import Controller, Samples, State, Values, gets_every_sample, is_elsewhere, retune
from rig.errors import ControllerFailed, PartError, RigError, UsageError, kind_and_text
from rig.machine.process import copies, end_copy
from rig.parts import code_of, foreign_fault
from rig.units import brief

NOT_FINITE = "an answer of {} is not finite: it is not sent, and the controller starts again"
"""What is reported the first time."""

_NO_ROW = (dict, set, frozenset, bytes)
"""Types that Python would read as a row of numbers: by their keys, in any order, or byte by byte."""


def _finite(values: Values) -> bool:
    return isfinite(sum(values)) or all(map(isfinite, values))  # the sum alone may overflow


def _unfit(controller: Controller, answer: Any) -> PartError:
    """What to raise for what `update` returned."""
    code = code_of(type(controller))
    what = f"{f'{code.file}: ' if code else ''}{type(controller).__name__}.update"
    if not isinstance(answer, tuple) or len(answer) != 2:
        return PartError(f"{what} returns {brief(answer)}; expected (state, commands)")
    drives = ", ".join(controller.drives)
    return PartError(f"{what} commands {brief(answer[1])}; expected a tuple with one number for each of {drives}")


def failure(name: str, t_ns: int, error: BaseException) -> ControllerFailed:
    """The error for controller `name`, whose code raised `error` at `t_ns` [ns]."""
    if isinstance(error, ControllerFailed):
        return error
    told = str(error) if isinstance(error, RigError) else foreign_fault(error)
    return ControllerFailed(name, t_ns * 1e-9, told or kind_and_text(error))


class Loop:
    """One controller with its state. `command` is the last finite answer, () before the first.

    A controller whose law runs `elsewhere` may have no answer: () instead of a command, and nothing is sent.
    """

    __slots__ = (
        "_waiting",
        "command",
        "controller",
        "every_sample",
        "held",
        "last_input",
        "refused",
        "skipped",
        "state",
        "updates",
    )

    COUNTED = ("updates", "held", "refused", "skipped")
    """Names of `counters`."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.every_sample = gets_every_sample(controller)
        self.state: State = controller.start()
        self.command: Values = ()
        self.last_input: tuple[int, Any] | None = None  # time [ns] and values of the last update
        self.updates = 0
        self.held = 0  # number of ticks without an update, because a value was not finite
        self.refused = 0  # number of answers that were not finite: not sent, and the controller started again
        self.skipped = 0  # number of ticks without an update, because the controller was behind
        self._waiting: list[Samples] = []  # samples of skipped ticks

    def due(self, t_ns: int) -> bool:
        """Whether an update falls on simulated time t_ns."""
        return t_ns % self.controller.period_ns == 0

    def answer(self, t_ns: int, values: Any) -> Values:
        """The command after the measurements of t_ns [ns]: a new one, or the last one if a value is not finite."""
        # A simulation calls this at every tick: the usual case is checked first, without a function call.
        if not (all(map(_finite, values)) if self.every_sample else isfinite(sum(values)) or _finite(values)):
            self.held += 1
            return self.command
        if self._waiting:
            values = self._with_waiting(values)
        controller = self.controller
        before = copies[0]
        try:
            answer = controller.update(self.state, t_ns, values)
        finally:
            end_copy(before)
        try:
            state, command = answer
            if command == () and is_elsewhere(controller):
                self.state = state
                return ()
            if len(command) != len(controller.drives) or (type(command) is not tuple and isinstance(command, _NO_ROW)):
                raise ValueError
            finite = isfinite(sum(command)) or _finite(command)
        except (TypeError, ValueError, OverflowError):  # no tuple, no numbers, or not one for each actuator
            raise _unfit(controller, answer) from None
        if not finite:
            self.refused += 1
            self.state = controller.start()
            return self.command
        self.updates += 1
        self.last_input = (t_ns, values)
        self.state = state
        self.command = command
        return command

    def skip(self, values: Any) -> None:
        """Leave out the update for `values`; a controller of every sample gets them with those of its next update."""
        self.skipped += 1
        if self.every_sample and all(map(_finite, values)):
            self._waiting.append(values)

    def _with_waiting(self, values: Samples) -> Samples:
        """The samples of each sensor that wait, followed by `values`."""
        rows = [*self._waiting, values]
        self._waiting = []
        return tuple([list(chain.from_iterable(samples)) for samples in zip(*rows)])

    def adopt(self, updates: int, t_ns: int, values: Values, state: State, command: Values) -> None:
        """Adopt the result of updates elsewhere: their number, time and values of the last one, state, command."""
        self.updates += updates
        self.last_input = (t_ns, values)
        self.state = state
        self.command = command

    def retune(self, changes: Mapping[str, object]) -> None:
        """Change parameters between two ticks, all or none; the state stays.

        The changed controller is first tried with the last values. Raises UsageError if this fails; the controller then
        continues unchanged.
        """
        old = self.controller
        try:
            tried = retune(old, changes)
            if (tried.reads, tried.drives, tried.period_ns) != (old.reads, old.drives, old.period_ns):
                raise UsageError("its sensors, actuators and period are fixed during a run")
            if self.last_input is not None:
                _, command = answer = tried.update(self.state, *self.last_input)
                if len(command) != len(tried.drives):
                    raise _unfit(tried, answer)
            self.controller = retune(old, changes)  # a new object: the tried one may have stored something
        except UsageError:
            raise
        except KeyboardInterrupt:
            raise
        except BaseException as fault:
            given = ", ".join(f"{key} = {value!s:.80}" for key, value in changes.items())
            raise UsageError(
                f"{type(old).__name__} cannot be retuned to {given or 'its values'}: {kind_and_text(fault)}"
            ) from fault

    def end(self) -> None:
        """Let a controller on other hardware release it."""
        if is_elsewhere(self.controller):
            self.controller.close()  # type: ignore[attr-defined]

    def counters(self) -> dict[str, int]:
        """Numbers of updates, of ticks with a held command, of refused answers, and of skipped ticks.

        And the counts that the controller itself keeps, as `Loop.names_of` lists them.
        """
        own = getattr(self.controller, "counts", {}) if is_elsewhere(self.controller) else {}
        return {name: getattr(self, name) for name in self.COUNTED} | own

    @classmethod
    def names_of(cls, controller: Controller | type) -> tuple[str, ...]:
        """Names of the `counters` of this controller, or of those of this class."""
        own: tuple[str, ...] = getattr(controller, "COUNTED", ()) if is_elsewhere(controller) else ()
        return (*cls.COUNTED, *own)
