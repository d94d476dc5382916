"""The controllers of a scene that work in the plant process: called at their ticks, as in a run in one process.

The answer to the measurement of tick k is received at tick k, without the bus. Otherwise such a controller behaves like
one with its own process: it has its own name on the bus, its own topic for parameters, its own events and totals. A
controller that raises an exception leaves the run; its last command is held, then safe values replace it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rig import controllers
from rig.bench.run.compiled_controllers import CompiledControllers
from rig.bench.run.experiment import Experiment
from rig.bench.run.local_controllers import NEVER, ControllerInProcess
from rig.bench.run.simulate import carry_on
from rig.bus.port import Session
from rig.controllers.runtime.loop import Loop, failure
from rig.controllers.runtime.service import Service
from rig.errors import UsageError


class _Resident(ControllerInProcess):
    """A controller in the plant process, with its own `session`. An exception ends the controller, not the plant."""

    def __init__(self, name: str, loop: Loop, experiment: Experiment, session: Session) -> None:
        super().__init__(name, loop, experiment)
        self.service = Service(session, loop)
        self.left = False
        self.failure = ""
        """Why it has left; "" if its code has not failed."""
        self._held_reported = False

    def answer(self) -> None:
        """See `ControllerInProcess.answer`."""
        try:
            self._answer()
        except Exception as error:  # raised by the controller's own code
            self._fail(error)

    def catch_up(self, tick: int, send: bool = False) -> None:
        """See `ControllerInProcess.catch_up`."""
        try:
            if self.due < tick:
                self._catch_up(tick, send)
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self.due, self.given, self.fault = NEVER, None, None
        self.service.tick, self.service.t_ns = self._runner.tick, self._runner.t_ns
        self.service.failed(why := failure(self.name, self.service.t_ns, error))
        self.failure = str(why)
        self.leave()
        self.service.session.close()

    def look(self) -> None:
        """Update what it publishes: the tick that it answered last, and whether a measurement was missing."""
        if not self.left:
            self.service.tick = self.due - self.queue.period
            self.service.t_ns = max(self.service.tick, 0) * self._runner.frame_ns
            if self.loop.held and not self._held_reported:
                self._held_reported = True
                self.service.held()

    def leave(self) -> None:
        """Publish the last messages, once."""
        if not self.left:
            self.left = True
            self.service.leave()


class ControllersInPlant:
    """All controllers in the plant process.

    `described`: their descriptions by rig.design; `notice` is called when a controller has failed and left.
    """

    def __init__(
        self, session: Session, experiment: Experiment, described: Mapping[str, Any], notice: Callable[[], object]
    ) -> None:
        self._experiment, self._notice = experiment, notice
        self._all: dict[str, _Resident] = {}
        for name in sorted(experiment.scene.in_plant):
            loop = Loop(controllers.restored(described[name]))
            self._all[name] = resident = _Resident(name, loop, experiment, session.stand_in("controller", name))
            resident.expect(0)
            resident.native()  # compiled if the rehearsal has done so
        self.at_work = list(self._all.values())
        """Those that have not left."""
        self.partners: Sequence[ControllerInProcess] = ()
        """Controllers in other processes that are asked like those in this process (rig.bench.live.waiting)."""
        self._inside = CompiledControllers(experiment)
        for resident in self.at_work:
            resident.service.session.announce()

    def carry_on(self, until: int) -> None:
        """Step the plant runner to tick `until` or until a limit is exceeded; on the way only controllers act."""
        carry_on(self._experiment, [*self.at_work, *self.partners], until, self._inside)
        for resident in self.at_work:
            resident.look()
        if any(resident.left for resident in self.at_work):
            self.at_work = [resident for resident in self.at_work if not resident.left]
            self._notice()

    def poll(self) -> None:
        """Answer queries that read or set parameters."""
        for resident in self.at_work:
            resident.service.server.poll()

    def retune(self, name: str, changes: Mapping[str, Any]) -> None:
        """Change parameters of a controller at this tick. Raises UsageError if they are invalid or it has left."""
        resident = self._all[name]
        if resident.left:
            raise UsageError(f"controller {name} has left")
        resident.service.answer_request({"set": dict(changes)})

    @property
    def failures(self) -> list[str]:
        """Why controllers have failed, one line each."""
        return [resident.failure for resident in self._all.values() if resident.failure]

    def counters(self) -> dict[str, dict[str, int]]:
        """The counters of each controller (`Loop.counters`)."""
        return {name: resident.loop.counters() for name, resident in self._all.items()}

    def leave(self) -> None:
        """At the end of the run: publish the last messages of all controllers that still work."""
        for resident in self.at_work:
            resident.leave()
