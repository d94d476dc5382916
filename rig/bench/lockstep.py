"""Lockstep: the plant integrates a frame after every controller that has joined and is due has answered its step.

A step without an answer is sent again, first after 10 ms, then at growing intervals; a controller answers a repeated
step with the same command. A controller that has not answered for `EVICTED` seconds is evicted and treated like one
that died. Controllers join and leave between two ticks. Answers are processed in the order of names, so that the run
does not depend on their order of arrival.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rig.bench.housekeeping import Housekeeper
from rig.bench.hub import Hub

AGAIN = 0.01
EVICTED = 5.0
_LOOK = 0.1
MOST = 1 << 10
"""Most commands that are read in a frame in which no controller is due."""


class Lockstep:
    """Sends steps and waits for the answers, until `stopped()`."""

    def __init__(self, hub: Hub, housekeeper: Housekeeper, stopped: Callable[[], bool]) -> None:
        self._hub, self._housekeeper, self._stopped = hub, housekeeper, stopped
        self._runner, self._queues = hub.runner, hub.experiment.exchange.queues
        self._evicted: set[str] = set()
        self._due: set[str] = set()
        self.again = 0
        """Number of repeated steps."""

    def ask(self) -> None:
        """Send the step of this tick."""
        tick, present, in_plant = self._runner.tick, self._hub.watch.present, self._hub.in_plant
        self._due = {
            name
            for name, queue in self._queues.items()
            if tick % queue.period == 0 and ("controller", name) in present and name not in in_plant
        }
        if self._evicted:
            self._evicted = {name for name in self._evicted if name in self._queues and ("controller", name) in present}
            self._due -= self._evicted
        self._hub.put_step()

    def wait(self) -> None:
        """Wait for the answers to the step and pass them to the exchange."""
        if not self._due:
            self._pass_over()
            return
        tick, begun = self._runner.tick, time.monotonic()
        again, looked = AGAIN, begun
        found = {}
        while self._due:
            command = self._hub.commands.next(again)
            if command is not None:
                name, act = command
                if act.tick == tick:
                    found[name] = tuple(act.values)
                    self._due.discard(name)
                elif name not in self._queues:
                    self._hub.experiment.exchange.receive(name, act.tick, ())
                continue
            now = time.monotonic()
            if self._stopped():
                break
            if now - looked > _LOOK or again > AGAIN:
                looked = now
                self._look(now - begun)
            if self._due:
                self._hub.put_step()
                self.again += 1
                again = min(again * 2.0, 0.5)
        for name in sorted(found):
            self._hub.experiment.exchange.receive(name, tick, found[name])

    def _pass_over(self) -> None:
        """Read commands when no controller is due: answers to repeated steps, or from controllers without admission."""
        for _ in range(MOST):
            command = self._hub.commands.next()
            if command is None:
                return
            if command[0] not in self._queues:
                self._hub.experiment.exchange.receive(command[0], command[1].tick, ())

    def _look(self, waited: float) -> None:
        """Stop waiting for controllers that have left, or that hang (these are evicted)."""
        self._hub.serve_scene()
        self._hub.session.flush()
        self._housekeeper.notice()
        present = self._hub.watch.present
        self._due = {name for name in self._due if ("controller", name) in present}
        if waited < EVICTED:
            return
        for name in sorted(self._due):
            self._evicted.add(name)
            text = f"controller {name} did not answer for {EVICTED:g} s and is evicted at tick {self._runner.tick}"
            self._housekeeper.faults.append(text)
            self._hub.experiment.journal.note("evicted", text, controller=name)
        self._due.clear()
