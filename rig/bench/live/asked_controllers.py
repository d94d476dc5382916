"""The controllers that a live plant asks: in its own process, and in lockstep those in other processes.

Both are asked like a controller of a run in one process (`rig.bench.run.local_controllers`): by the compiled loop or by
the exchange, and the answer to the measurement of tick k is received at tick k. A paced plant does not ask controllers
in other processes: they get its steps and their commands take effect when they arrive (`rig.bench.live.hub`).

In the plant process (`ControllersInPlant`): the answer comes without the bus. Otherwise such a controller behaves like
one with its own process: it has its own name on the bus, its own topic for parameters, its own events and totals. A
controller that raises an exception leaves the run; its last command is held, then safe values replace it.

In lockstep (`Lockstep`): the answer comes over the bus. The first controller that is asked at a tick sends the step and
waits for the answers of all that have joined and are due; it does not depend on the order in which they arrive. A step
without an answer is sent again, first after 10 ms, then at growing intervals; a controller answers a repeated step with
the same command. A controller that has not answered for `EVICTED` seconds is evicted and treated like one that died.
Controllers join between two pieces of the run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any

from rig import controllers
from rig.bench.live.housekeeping import Housekeeper
from rig.bench.live.hub import Hub
from rig.bench.run.experiment import Experiment
from rig.bench.run.local_controllers import NEVER, CompiledControllers, ControllerInProcess
from rig.bench.run.simulate import carry_on
from rig.bus.port import Session
from rig.controllers.blocks.base import Values
from rig.controllers.device import Device
from rig.controllers.runtime.loop import Loop, failure
from rig.controllers.runtime.service import Service
from rig.errors import UsageError

AGAIN = 0.01  # s until a step without an answer is sent again; doubled each time. chosen
EVICTED = 5.0  # s. chosen
NO_BOARD = "a board does not answer"
"""How a run in lockstep ends without one of its boards."""
_LOOK_NS = 100_000_000  # between two rounds of the housekeeping while the plant waits. chosen
MOST = 1 << 10
"""Most commands that are read in a frame in which no controller is due."""


class _Resident(ControllerInProcess):
    """A controller in the plant process, with its own `session`. An exception ends the controller, not the plant."""

    survives = Exception  # whatever its own code raises

    def __init__(self, name: str, loop: Loop, experiment: Experiment, session: Session) -> None:
        super().__init__(name, loop, experiment)
        self.service = Service(session, loop)
        self.left = False
        self.failure = ""
        """Why it has left; "" if its code has not failed."""
        self._held_reported = False

    def _lose(self, why: Exception) -> None:
        self.due = NEVER
        self.given = None
        self.fault = None
        self.service.tick = self._runner.tick
        self.service.t_ns = self._runner.t_ns
        self.service.failed(fault := failure(self.name, self.service.t_ns, why))
        self.failure = str(fault)
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
        self._experiment = experiment
        self._notice = notice
        self._all: dict[str, _Resident] = {}
        for name in sorted(experiment.scene.in_plant):
            loop = Loop(controllers.restored(described[name]))
            self._all[name] = resident = _Resident(name, loop, experiment, session.stand_in("controller", name))
            resident.expect(0)
            resident.native()  # compiled if the rehearsal has done so
        self.at_work = list(self._all.values())
        """Those that have not left."""
        self.partners: Sequence[ControllerInProcess] = ()
        """Controllers in other processes that are asked like those in this process (`Lockstep`)."""
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


class Stopped(Exception):
    """Raised in place of an answer when the run shall end."""


class Lockstep:
    """Sends steps and waits for the answers, until `stopped()`."""

    def __init__(self, hub: Hub, housekeeper: Housekeeper, stopped: Callable[[], bool]) -> None:
        self._hub = hub
        self._housekeeper = housekeeper
        self._stopped = stopped
        self._commands = hub.commands
        self._exchange = hub.experiment.exchange
        self._evicted: set[str] = set()
        self._partners: dict[str, Partner] = {}
        self._tick = -1  # tick of the last step
        self._due: set[str] = set()  # controllers that have not answered it
        self._found: dict[str, Values] = {}  # the answers to it
        self._again = AGAIN
        self._looked = 0
        self.again = 0
        """Number of repeated steps."""

    def look(self) -> Sequence[ControllerInProcess]:
        """The controllers that have joined and are not evicted; to be called between two pieces of the run."""
        hub = self._hub
        queues = self._exchange.queues
        here = [
            name for name in sorted(queues) if ("controller", name) in hub.watch.present and name not in hub.in_plant
        ]
        self._evicted.intersection_update(here)
        known = {name: partner for name, partner in self._partners.items() if queues.get(name) is partner.queue}
        self._partners = {
            name: known.get(name) or Partner(name, self, hub) for name in here if name not in self._evicted
        }
        return [*self._partners.values()]

    @property
    def asks_each_tick(self) -> bool:
        """Whether a controller is due at each tick, and the compiled loop can ask all of them."""
        queues = [partner.queue for partner in self._partners.values()]
        runner = self._hub.runner
        if not any(queue.period == 1 for queue in queues):
            return False
        if len(queues) > len(runner.controllers.controllers):
            return False
        if not all(queue.connected and queue.link is None for queue in queues):
            return False
        drives = (drive for queue in queues for drive in queue.drives)
        return all(runner.plain(drive) is not None for drive in drives)

    def exchange(self, tick: int) -> None:
        """Send the step of `tick` and wait for the answers of the controllers that are due. Raises Stopped.

        At a tick that the plant runner has not reached yet, because the compiled loop asks, this waits for a moment
        only: the loop then ends, and another call continues to wait.
        """
        hub = self._hub
        due = self._due
        if tick != self._tick:
            self._tick = tick
            self._found = {}
            self._again = AGAIN
            hub.gather(tick)
            for name, partner in self._partners.items():
                if not tick % partner.queue.period:
                    due.add(name)
            hub.put_step(tick)
            self._looked = self._commands.put_ns
            if not due:
                self._pass_over()
        while due:
            command = self._commands.next(self._again)
            if command is not None:
                name, answered, values = command
                if answered == tick:
                    self._found[name] = values
                    due.discard(name)
                elif name not in self._exchange.queues:
                    self._exchange.receive(name, answered, ())
            elif not self._goes_on_waiting(tick):
                return

    def answer(self, name: str, tick: int) -> Values | None:
        """The answer of a controller to the step of `tick`; None without one, see `exchange`."""
        if tick != self._tick or self._due:
            self.exchange(tick)
        return self._found.get(name)

    def _goes_on_waiting(self, tick: int) -> bool:
        """Repeat the step; whether the plant runner is at this tick. Raises Stopped."""
        hub = self._hub
        now = time.monotonic_ns()
        if self._stopped():
            raise Stopped
        here = hub.runner.tick == tick
        if here and (now - self._looked > _LOOK_NS or self._again > AGAIN):
            self._looked = now
            self._overdue(now - self._commands.put_ns)
        if self._due:
            hub.put_step(tick)
            self.again += 1
            self._again = min(self._again * 2.0, 0.5) if here else AGAIN
        return here

    def _pass_over(self) -> None:
        """Read commands when no controller is due: answers to repeated steps, or from controllers without admission."""
        for _ in range(MOST):
            command = self._commands.next()
            if command is None:
                return
            if command[0] not in self._exchange.queues:
                self._exchange.receive(*command)

    def _overdue(self, waited_ns: int) -> None:
        """Stop waiting for controllers that have left, or that hang (these are evicted)."""
        self._hub.serve_scene()
        self._hub.session.flush()
        self._housekeeper.notice()
        present = self._hub.watch.present
        for name in sorted(self._due):
            if ("controller", name) in present:
                if waited_ns < EVICTED * 1e9:
                    continue
                self._evicted.add(name)
                tick = self._hub.runner.tick
                text = f"controller {name} did not answer for {EVICTED:g} s and is evicted at tick {tick}"
                self._housekeeper.faults.append(text)
                self._hub.experiment.journal.note("evicted", text, controller=name)
            self._due.discard(name)
            del self._partners[name]
            if isinstance(self._hub.experiment.scene.controllers.get(name), Device):
                self._hub.experiment.stop(NO_BOARD)
                raise Stopped


class Partner(ControllerInProcess):
    """A controller in another process, which the plant asks like one in its own: the answer comes from `lockstep`."""

    def __init__(self, name: str, lockstep: Lockstep, hub: Hub) -> None:
        self._take_place(name, hub.experiment)
        self._lockstep = lockstep
        self.columns = []
        self.due = -(-hub.runner.tick // self.queue.period) * self.queue.period

    def ask(self, tick: int) -> Values:
        """See `ControllerInProcess.ask`. An answer that the compiled loop cannot put into force is kept in `given`."""
        values = self._lockstep.answer(self.name, tick)
        if values is None:
            if self._runner.tick < tick:
                return ()  # it is asked again when the loop has ended
            values = ()  # it has left, or is evicted
        self.due = tick + self.queue.period
        self.given = values
        return values if isfinite(sum(values)) else ()

    def native(self) -> None:
        """See `ControllerInProcess.native`."""
        return

    def catch_up(self, tick: int, send: bool = False) -> None:
        """See `ControllerInProcess.catch_up`: a controller in another process is asked at each of its ticks."""
