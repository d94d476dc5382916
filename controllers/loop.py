"""A controller at work: its state, the command in force, and what happens to values that are no numbers.

The plant's own process and a controller's process both run controllers through this class, so that a run in one
process and a run over the bus treat a missing sample or a faulty controller alike, to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from controllers.base import Controller, State, Values, hears, retune
from rig.errors import UsageError


class Loop:
    """One controller with its state. `command` is the last good answer, () before the first."""

    __slots__ = ("command", "controller", "hears", "held", "refused", "state", "updates")

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.hears = hears(controller)
        self.state: State = controller.start()
        self.command: Values = ()
        self.updates = 0
        self.held = 0  # ticks without an update, because a value was not finite
        self.refused = 0  # answers of the controller that were not finite: not sent, state started afresh

    def due(self, t_ns: int) -> bool:
        """Whether an update falls on simulated time t_ns."""
        return t_ns % self.controller.period_ns == 0

    def answer(self, t_ns: int, values: Any) -> Values:
        """The command after the measurements of t_ns: a new one, or the last one where there is nothing to go by."""
        if not isfinite(sum(map(sum, values)) if self.hears else sum(values)):
            self.held += 1
            return self.command
        state, command = self.controller.update(self.state, t_ns, values)
        if len(command) != len(self.controller.drives):
            drives = ", ".join(self.controller.drives)
            raise UsageError(f"{type(self.controller).__name__} answers {command!r}, but drives {drives}")
        if not isfinite(sum(command)):
            self.refused += 1
            self.state = self.controller.start()
            return self.command
        self.updates += 1
        self.state = state
        self.command = command
        return command

    def retune(self, changes: Mapping[str, object]) -> None:
        """Change parameters between two ticks; all or, with a UsageError, none. The state stays."""
        self.controller = retune(self.controller, changes)

    def counters(self) -> dict[str, int]:
        """Updates made, ticks held, answers refused."""
        return {"updates": self.updates, "held": self.held, "refused": self.refused}
