"""Lockstep: the plant integrates a frame after every controller that has joined and is due has answered its step.

A step without an answer is sent again, first after 10 ms, then at growing intervals; a controller answers a repeated
step with the same command. A controller that has not answered for `EVICTED` seconds is evicted and treated like one
that died. Answers are processed in the order of names, so that the run does not depend on their order of arrival.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rig.bench.housekeeping import Housekeeper
from rig.bench.hub import Hub

AGAIN = 0.01
EVICTED = 5.0
_LOOK_NS = 100_000_000
MOST = 1 << 10
"""Most commands that are read in a frame in which no controller is due."""


class Lockstep:
    """Exchanges steps and answers, until `stopped()`. `look` before the first exchange, and from time to time."""

    def __init__(self, hub: Hub, housekeeper: Housekeeper, stopped: Callable[[], bool]) -> None:
        self._hub, self._housekeeper, self._stopped = hub, housekeeper, stopped
        self._commands, self._exchange = hub.commands, hub.experiment.exchange
        self._evicted: set[str] = set()
        self._partners: list[tuple[str, int]] = []
        """Controllers that have joined and are not evicted, with their periods [frames]."""
        self._due: set[str] = set()
        """Those that have not answered the step of this tick."""
        self.again = 0
        """Number of repeated steps."""

    def exchange(self) -> None:
        """Send the step of this tick, wait for the answers of the controllers that are due, and pass them on."""
        tick, due = self._hub.runner.tick, self._due
        for name, period in self._partners:
            if not tick % period:
                due.add(name)
        self._hub.put_step()
        if due:
            self._wait(tick)
        else:
            self._pass_over()

    def look(self) -> None:
        """Find out which controllers have joined, or left."""
        present, in_plant, queues = self._hub.watch.present, self._hub.in_plant, self._exchange.queues
        here = [name for name in queues if ("controller", name) in present and name not in in_plant]
        self._evicted.intersection_update(here)
        self._partners = [(name, queues[name].period) for name in here if name not in self._evicted]

    def _wait(self, tick: int) -> None:
        """Wait for the answers to the step of `tick` and pass them to the exchange."""
        due, commands, exchange = self._due, self._commands, self._exchange
        again, looked = AGAIN, commands.put_ns
        found = {}
        while due:
            command = commands.next(again)
            if command is not None:
                name, answered, values = command
                if answered == tick:
                    found[name] = values
                    due.discard(name)
                elif name not in exchange.queues:
                    exchange.receive(name, answered, ())
                continue
            if self._stopped():
                due.clear()
                break
            now = time.monotonic_ns()
            if now - looked > _LOOK_NS or again > AGAIN:
                looked = now
                self._overdue(now - commands.put_ns)
            if due:
                self._hub.put_step()
                self.again += 1
                again = min(again * 2.0, 0.5)
        for name in sorted(found):
            exchange.receive(name, tick, found[name])

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
        if waited_ns >= EVICTED * 1e9:
            present = self._hub.watch.present
            for name in sorted(name for name in self._due if ("controller", name) in present):
                self._evicted.add(name)
                text = (
                    f"controller {name} did not answer for {EVICTED:g} s and is evicted at tick {self._hub.runner.tick}"
                )
                self._housekeeper.faults.append(text)
                self._hub.experiment.journal.note("evicted", text, controller=name)
        self.look()
        self._due.intersection_update(name for name, _ in self._partners)
