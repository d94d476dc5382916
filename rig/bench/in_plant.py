"""The controllers of a scene that work in the plant's process: asked at their ticks, as in a run in one process.

The answer to the measurement of tick k is received at tick k, with no bus in between. Everything else is as of a
controller with a process of its own: its name is taken, its parameters are asked for and set on its own topic, its
events and last words are its own. One that raises leaves; its last command is held, then safe values step in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import controllers
from controllers.loop import Loop
from controllers.service import Service
from rig.bench.operation import Operation
from rig.bench.working import Working
from rig.bus.port import Session
from rig.errors import UsageError


class _Resident(Service):
    """One such controller, `working`, which speaks on a session of its own."""

    def __init__(self, session: Session, working: Working) -> None:
        super().__init__(session, working.loop)
        self.working = working
        self.left = False

    def answer(self, tick: int, t_ns: int) -> None:
        """Answer the measurement of `tick`. What the controller raises ends it, not the plant."""
        self.tick, self.t_ns = tick, t_ns
        held = self.loop.held
        try:
            self.working.answer()
        except Exception as error:  # of whatever it computes
            self.failed(error)
            self.leave()
            self.session.close()
            return
        if self.loop.held and not held:
            self.held()

    def leave(self) -> None:
        """The last words, once."""
        if not self.left:
            self.left = True
            super().leave()


class InPlant:
    """All of them. `numbers`: of the design step of each; `notice` is called when one has failed and left."""

    def __init__(
        self, session: Session, operation: Operation, numbers: Mapping[str, Any], notice: Callable[[], object]
    ) -> None:
        self._stand, self._notice = operation.stand, notice
        self._all: dict[str, _Resident] = {}
        for name in sorted(operation.scene.in_plant):
            told = controllers.described(operation.scene.controllers[name], numbers.get(name, {}))
            working = Working(name, Loop(controllers.restored(told)), operation)
            self._all[name] = _Resident(session.stand_in("controller", name), working)
        self._at_work = list(self._all.values())
        for one in self._at_work:
            one.session.announce()

    def answer(self) -> None:
        """Let those answer that are due at this tick."""
        tick = self._stand.tick
        for one in self._at_work:
            if one.working.due == tick:
                one.answer(tick, self._stand.t_ns)
                if one.left:
                    self._at_work = [other for other in self._at_work if not other.left]
                    self._notice()

    def poll(self) -> None:
        """Answer who asks for parameters, or sets them."""
        for one in self._at_work:
            one.server.poll()

    def retune(self, name: str, changes: Mapping[str, Any]) -> None:
        """Change parameters of one at this tick. Raises UsageError if it cannot be, or if it has left."""
        one = self._all[name]
        if one.left:
            raise UsageError(f"controller {name} has left")
        one.asked({"set": dict(changes)})

    def leave(self) -> None:
        """The run has ended: the last words of those who are still at work."""
        for one in self._at_work:
            one.leave()
