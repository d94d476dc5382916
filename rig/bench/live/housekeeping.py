"""Tasks of a plant that are not needed in every frame: presence of processes, health messages, skipped time.

A plant without a pace also waits for its recorders (`RecorderLag`): it computes faster than a recorder writes. What the
recorder has received waits in a ring buffer (rig.record.recorder), which drops the oldest batches when it is full.
Therefore the plant waits when a recorder is half of the ring behind. A recorder states several times per second up to
which simulated time it has written.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from rig.bench.live import machine_load, pace
from rig.bench.live.hub import Hub
from rig.bench.live.operator_commands import Operator
from rig.bench.live.outcome import Job, called
from rig.bench.live.timing import Timing
from rig.bus.batch import WAITING
from rig.bus.topics import Message

ATTEND_NS = 20_000_000  # between two rounds of these tasks: 50 times per second. chosen
HEALTH_NS = 200_000_000  # between two messages of health: 5 times per second. chosen
MOST_WAITING = WAITING // 2  # most batches that a recorder may be behind
PATIENCE_S = 30.0
"""Longest wait for a recorder that does not get on [s]; from then on it loses messages, which are counted."""
_LOOK_S = 0.1  # between two looks at recorders that are behind. chosen
_EVERY_NS = 20_000_000  # between two rounds while the plant waits in lockstep: as often as `ATTEND_NS`
MISSED = ("controller", "recorder")
"""Roles whose early leaving the timing verdict mentions."""


class Housekeeper:
    """Does these tasks 50 times per second, and publishes the health of the run 5 times per second."""

    def __init__(self, hub: Hub, operator: Operator, job: Job, timing: Timing) -> None:
        self.faults: list[str] = []
        """Reasons for the timing verdict that are not about timing."""
        self.health: dict[str, Any] = {}
        self.gone = False
        """Whether the parent process has ended."""
        self.pacer: pace.Pacer | None = None
        self._hub = hub
        self._operator = operator
        self._job = job
        self._timing = timing
        self._experiment = hub.experiment
        self._runner = hub.runner
        self._due = self._health_due = 0
        self._marked = (0, 0)
        # Number of pauses of the wall clock so far, and their length [ns].
        self._pauses = 0
        self._passed_ns = 0
        # Processes that were expected, or present at the first frame.
        self._known: set[tuple[str, str]] = set(job.expect)
        # Processes that have left and not come back -> the entry in `faults`.
        self._left: dict[tuple[str, str], str] = {}
        self._asleep = pace.asleep_ns()
        self._begun = 0
        self._stolen = 0
        self._counted = False
        self._statistics: dict[str, Any] = {}

    def begin(self, now: int, pacer: pace.Pacer | None) -> None:
        """Start: the first frame begins at `now`."""
        self._due = self._health_due = now
        self._marked = (now, 0)
        self.pacer = pacer
        self._begun = now
        self._stolen = machine_load.stolen_ns()
        self._known |= self._hub.watch.present

    def look(self, now: int) -> bool:
        """Do what is due now; whether the health was published."""
        if now < self._due:
            return False
        self._due = now + ATTEND_NS
        self._hub.session.flush()
        self.notice()
        self._hub.serve_scene()
        if now < self._health_due:
            return False
        if not self._counted:  # spread over three calls, because one frame has no time for all
            self._count(now)
            return False
        if not self._statistics:
            self._statistics = self._runner.statistics()
            return False
        self._health_due = now + HEALTH_NS - 2 * ATTEND_NS
        self.gone = self.orphaned()
        self._publish(now)
        return True

    def orphaned(self) -> bool:
        """Whether the parent process has ended."""
        return self._job.parent not in (0, os.getppid())

    def notice(self) -> None:
        """Record which processes have joined and left."""
        note = self._experiment.journal.note
        for who in self._hub.look():
            known = {"role": who.role, "name": who.name}
            if who.here:
                note("joined", f"{called(who.role, who.name)} is here", **known)
                if (text := self._left.pop((who.role, who.name), None)) in self.faults:  # it was away for a time
                    away = text.replace(" left at t = ", " was away from t = ")
                    self.faults[self.faults.index(text)] = f"{away} to {self._runner.t_ns / 1e9:.3f} s"
                continue
            text = f"{called(who.role, who.name)} left at t = {self._runner.t_ns / 1e9:.3f} s"
            note("left", text, **known)
            if who.role in MISSED and self._missed(who.role, who.name):
                self.faults.append(text)
                self._left[who.role, who.name] = text

    def _missed(self, role: str, name: str) -> bool:
        """Whether the run relied on a process that has left.

        It relied on processes that it waited for or began with, on controllers that drive something, and on reserved
        names, such as a recorder started by hand. A guest that joins later can have any other name and does not count.
        """
        driving = role == "controller" and name in self._experiment.exchange.queues
        return (role, name) in self._known or driving or name in self._hub.session.inbound.reserved

    def miss(self, missing: Iterable[str]) -> None:
        """Record which expected processes (see `called`) are not present at the first frame."""
        for who in missing:
            text = f"{who} was not here when the run began"
            self._experiment.journal.note("missing", text)
            if who.startswith(MISSED):
                self.faults.append(text)

    def tell_health(self, now: int) -> None:
        """Publish the health of the run now."""
        self._count(now)
        self._publish(now)

    def _count(self, now: int) -> None:
        timing = self._timing
        self._counted = True
        self._hub.commands.fold()
        for text in self._hub.session.inbound.news():
            self._experiment.journal.repeated("refused", text)
        for text in self._hub.commands.floods():
            name = text.partition(" sent ")[0]  # told once: reading them makes frames late
            if not any(fault.startswith(f"{name} sent ") for fault in self.faults):
                self.faults.append(text)
            self._experiment.journal.repeated("flood", f"{name} sends too many commands")
        if self.pacer is not None:
            self._count_given_up(self.pacer)
            before = self._stolen
            self._stolen = machine_load.stolen_ns()
            timing.fold(self._stolen - before)
            whole = (now - self._begun) * (os.cpu_count() or 1)
            timing.stolen_share = timing.stolen_ns / whole if whole else 0.0

    def _publish(self, now: int) -> None:
        timing = self._timing
        statistics = self._statistics or self._runner.statistics()
        self._counted = False
        self._statistics = {}
        wall = now - self._marked[0]
        t_ns = self._runner.t_ns
        rate = (t_ns - self._marked[1]) / wall if wall else 0.0
        self._marked = (now, t_ns)
        progress = self._experiment.progress()
        steps = f" {progress.step}/{progress.steps or '-'}" if progress.step else ""
        left = progress.left_ns
        self.health = {
            "phase": "paused" if self._operator.paused else f"{progress.phase or 'run'}{steps}",
            "rate": rate,
            "lateness_us": timing.lateness.quantile(0.99) / 1e3,
            "worst_us": timing.worst_ns / 1e3,
            "late": timing.late + timing.given_up,
            "overruns": sum(timing.overruns.values()),
            "drops": sum(self._hub.commands.lost().values()),
            "held": sum(queue.counts.held for queue in self._experiment.exchange.all_queues.values()),
            "energy_error": statistics["energy_error"],
            "stick_share": statistics.get("stick_share", 0.0),
            "refused": self._hub.session.inbound.total,
            "eta_s": -1.0 if left is None else left / 1e9 / (self._job.pace or max(rate, 1e-9)),
        }
        self._hub.put_health(**self.health)

    def _count_given_up(self, pacer: pace.Pacer) -> None:
        """Record time of the wall clock that was skipped; its frames count as late."""
        new = pacer.take_given_up()
        self._timing.given_up += sum(skipped.frames for skipped in new)
        journal = self._experiment.journal
        for skipped in new:
            if skipped.late_ns > pace.PAUSE:
                journal.note("pause", _passed(skipped.late_ns), frame=skipped.frame, late_ns=skipped.late_ns)
                before = _passed(self._passed_ns, self._pauses)
                self._pauses += 1
                self._passed_ns += skipped.late_ns
                told = _passed(self._passed_ns, self._pauses)  # one fault for all: an overloaded machine has many
                self.faults = [fault for fault in self.faults if fault != before] + [told]
            else:
                journal.repeated("overrun", "time of the wall clock was given up", frames=skipped.frames)
        if (asleep := pace.asleep_ns()) > self._asleep + ATTEND_NS:
            text = f"the machine was suspended for {(asleep - self._asleep) / 1e9:.3g} s"
            journal.note("pause", text)
            self.faults.append(text)
        self._asleep = asleep


def _passed(late_ns: int, pieces: int = 1) -> str:
    times = f", in {pieces} pieces" if pieces > 1 else ""
    return f"{late_ns / 1e9:.3g} s of the wall clock passed without a frame{times}"


class RecorderLag:
    """Tells how far the recorders are behind, and waits for them.

    `names()`: the recorders that are waited for. `serve()` is called ten times per second while the plant waits, and
    `stopped()` ends a wait. `say` gets a line for the first wait, and for a recorder that does not get on.
    """

    def __init__(
        self,
        hub: Hub,
        names: Callable[[], Iterable[str]],
        serve: Callable[[], object],
        stopped: Callable[[], bool],
        say: Callable[[str], object],
    ) -> None:
        self._hub = hub
        self._names = names
        self._serve = serve
        self._stopped = stopped
        self._say = say
        # Simulated times [ns], and the number of batches sent before each; from the last written one on.
        self._sent: deque[tuple[int, int]] = deque()
        self._reached: dict[str, int] = {}  # recorder -> simulated time up to which it has written [ns]
        self._given_up: dict[str, int] = {}  # recorder that did not get on -> the time that it had reached
        self._said = False
        self._due = 0

    def look(self, now: int) -> None:
        """At most 50 times per second: note what was sent, and wait while a recorder is too far behind."""
        if now < self._due:
            return
        self._due = now + _EVERY_NS
        self._sent.append((self._hub.runner.t_ns, self._hub.session.batches))
        for message in self._hub.totals.drain():
            self._hear(message)
        if self._behind() > MOST_WAITING:
            self._wait()

    def _hear(self, message: Message) -> None:
        name = message.topic.partition("/")[2]
        if self._hub.commands.speaks_for(message.user, name):
            self._reached[name] = max(message.t_ns, self._reached.get(name, 0))

    def _behind(self) -> int:
        """Number of batches that the slowest recorder has not written."""
        reached = {name: self._reached.get(name, 0) for name in self._names()}
        self._given_up = {name: t_ns for name, t_ns in self._given_up.items() if reached.get(name) == t_ns}
        waited = [t_ns for name, t_ns in reached.items() if name not in self._given_up]
        if not waited:
            self._sent.clear()
            return 0
        while len(self._sent) > 1 and self._sent[1][0] <= min(waited):
            self._sent.popleft()
        return self._hub.session.batches - self._sent[0][1] if self._sent else 0

    def _wait(self) -> None:
        slow = dict(self._reached)
        moved = time.monotonic()
        if not self._said:
            self._said = True
            self._say("the recorder is slower than the plant, which waits for it from time to time")
        while self._behind() > MOST_WAITING and not self._stopped():
            self._serve()
            if (message := self._hub.totals.get(_LOOK_S)) is not None:
                self._hear(message)
            if self._reached != slow:
                slow = dict(self._reached)
                moved = time.monotonic()
            elif time.monotonic() > moved + PATIENCE_S:
                self._give_up()

    def _give_up(self) -> None:
        """Wait no more for the slowest recorders until they get on."""
        reached = {name: self._reached.get(name, 0) for name in self._names() if name not in self._given_up}
        for name in sorted(reached):
            if reached[name] == min(reached.values()):
                self._given_up[name] = reached[name]
                self._say(f"recorder {name} has written nothing for {PATIENCE_S:g} s; the plant continues without it")
