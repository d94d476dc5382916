"""A controller at work: its state, the command in force, and what happens to values that are no numbers.

The plant's own process and a controller's process both run controllers through this class, so that a run in one
process and a run over the bus treat a missing sample or a faulty controller alike, to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from rig.controllers.blocks.base import Controller, State, Values, hears, retune
from rig.errors import UsageError
from rig.quantities import brief


def _finite(values: Values) -> bool:
    return isfinite(sum(values)) or all(map(isfinite, values))  # the sum alone may overflow


def _miscounted(controller: Controller, command: Values) -> UsageError:
    return UsageError(
        f"{type(controller).__name__} answers {brief(command)}, but drives {', '.join(controller.drives)}"
    )


class Loop:
    """One controller with its state. `command` is the last good answer, () before the first."""

    __slots__ = ("command", "controller", "heard", "hears", "held", "refused", "state", "updates")

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.hears = hears(controller)
        self.state: State = controller.start()
        self.command: Values = ()
        self.heard: tuple[int, Any] | None = None  # time [ns] and values of the last update
        self.updates = 0
        self.held = 0  # ticks without an update, because a value was not finite
        self.refused = 0  # answers of the controller that were not finite: not sent, state started afresh

    def due(self, t_ns: int) -> bool:
        """Whether an update falls on simulated time t_ns."""
        return t_ns % self.controller.period_ns == 0

    def answer(self, t_ns: int, values: Any) -> Values:
        """The command after the measurements of t_ns: a new one, or the last one where there is nothing to go by."""
        # Who simulates waits for this at every tick: what is nearly always so is asked first, without a call of ours.
        if not (all(map(_finite, values)) if self.hears else isfinite(sum(values)) or _finite(values)):
            self.held += 1
            return self.command
        controller = self.controller
        state, command = controller.update(self.state, t_ns, values)
        if len(command) != len(controller.drives):
            raise _miscounted(controller, command)
        if not (isfinite(sum(command)) or _finite(command)):
            self.refused += 1
            self.state = controller.start()
            return self.command
        self.updates += 1
        self.heard, self.state, self.command = (t_ns, values), state, command
        return command

    def went_on(self, updates: int, t_ns: int, values: Values, state: State, command: Values) -> None:
        """It was asked elsewhere so many times, at last at t_ns, and has come to `state`."""
        self.updates += updates
        self.heard, self.state, self.command = (t_ns, values), state, command

    def retune(self, changes: Mapping[str, object]) -> None:
        """Change parameters between two ticks; all or, with a UsageError, none. The state stays.

        The changed controller is first tried on the last values. Whatever it breaks is a refusal: it goes on unchanged.
        """
        old = self.controller
        try:
            tried = retune(old, changes)
            if (tried.reads, tried.drives, tried.period_ns) != (old.reads, old.drives, old.period_ns):
                raise UsageError("what it reads and drives, and its period, are fixed while the rig runs")
            if self.heard is not None:
                _, command = tried.update(self.state, *self.heard)
                if len(command) != len(tried.drives):
                    raise _miscounted(tried, command)
            self.controller = retune(old, changes)  # another one: what was tried may have kept something
        except UsageError:
            raise
        except Exception as fault:
            told = ", ".join(f"{key} = {value!s:.80}" for key, value in changes.items())
            raise UsageError(
                f"{type(old).__name__} cannot be retuned to {told or 'what it is'}: {type(fault).__name__}: {fault}"
            ) from fault

    def counters(self) -> dict[str, int]:
        """Updates made, ticks held, answers refused."""
        return {"updates": self.updates, "held": self.held, "refused": self.refused}
