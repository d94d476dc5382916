"""A controller that works in this process: it is asked at its ticks, and its command is received at once."""

from __future__ import annotations

from itertools import repeat
from typing import Any

from controllers.loop import Loop
from rig.bench.operation import Operation


class Working:
    """A controller that works in this process. `due`: tick of its next answer."""

    def __init__(self, name: str, loop: Loop, operation: Operation) -> None:
        self.line = operation.exchange.lines[name]
        self.due = 0
        self.name, self.loop = name, loop
        self._stand, self._receive = operation.stand, operation.exchange.receive
        self._bank = operation.stand.bank
        self._columns = [self._bank.names.index(sensor) for sensor in loop.controller.reads]
        self._latest = self._bank.latest.item

    def answer(self) -> None:
        """Send a command if one is due at this tick."""
        tick = self._stand.tick
        if tick != self.due:
            return
        if self.loop.hears:
            heard: Any = tuple([self._bank.samples(i).tolist() for i in self._columns])
        else:
            heard = tuple(map(self._latest, self._columns))
        self._receive(self.name, tick, self.loop.answer(tick * self._stand.frame_ns, heard))
        self.due = tick + self.line.period

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
