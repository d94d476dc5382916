"""A controller that works in this process: it is asked at its ticks, and its command is received at once."""

from __future__ import annotations

from itertools import repeat
from typing import Any

from controllers.base import Values
from controllers.loop import Loop
from rig.bench.operation import Operation


class Working:
    """A controller that works in this process. `due`: tick of its next answer.

    `given`: what it has answered at this tick, if it has been asked already; `fault`: what came of that.
    """

    def __init__(self, name: str, loop: Loop, operation: Operation) -> None:
        self.line = operation.exchange.lines[name]
        self.due = 0
        self.given: Values | None = None
        self.fault: BaseException | None = None
        self.name, self.loop = name, loop
        self._stand, self._receive = operation.stand, operation.exchange.receive
        self._bank = operation.stand.bank
        self._columns = [self._bank.names.index(sensor) for sensor in loop.controller.reads]
        self._latest = self._bank.latest.item

    def answer(self) -> None:
        """Send a command if one is due at this tick."""
        tick = self._stand.tick
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
        """Have it answer the measurements of this tick."""
        self.due = tick + self.line.period
        if self.loop.hears:
            heard: Any = tuple([self._bank.samples(i).tolist() for i in self._columns])
        else:
            heard = tuple(map(self._latest, self._columns))
        self.given = self.loop.answer(tick * self._stand.frame_ns, heard)
        return self.given

    def catch_up(self, tick: int) -> None:
        """Give the answers due before `tick`, which nobody has waited for."""
        if self.due >= tick:
            return
        frame = self._stand.frame_ns
        times = range(self.due * frame, tick * frame, self.line.period * frame)
        recall = self._bank.published if self.loop.hears else self._bank.shown
        heard = [recall(i, times) for i in self._columns]
        for t_ns, values in zip(times, zip(*heard) if heard else repeat(())):
            self.loop.answer(t_ns, values)
        self.due += len(times) * self.line.period
