"""The exchange: passes commands of controllers to actuators by these rules, and counts every case.

    in time         takes effect at the frame boundary after its arrival, not before the stated delay of the controller
    two at once     the later command counts, the other one is `overtaken`
    another matrix  in a paced run takes effect when the matrix is built (rig.bench.rebuild); other values at once
    missing         the last command is held; `hold` ticks after the missing one was due, safe values replace it
    not finite      the actuator keeps its value
    out of range    clamped
    not its own     refused and reported: each actuator has one owner

The protocol sets values too. A controller that commands an actuator overrules the protocol; the value of the protocol
returns when the controller is disconnected.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from math import isfinite, nan
from typing import TYPE_CHECKING, Any, Protocol

from rig.bench.command_queue import AS_SENT, CLAMPED, SAFE, CommandQueue
from rig.bench.journal import Journal
from rig.bus import topics
from rig.errors import UsageError
from rig.model.assembly import Input
from rig.quantities import brief

if TYPE_CHECKING:
    from rig.bench.rebuild import Rebuild

LONGEST_NS = 3600 * 10**9
"""Longest period of a controller. # chosen"""


class Actuators(Protocol):
    """The part of the plant runner that commands reach."""

    @property
    def tick(self) -> int:
        """The present tick."""

    @property
    def inputs(self) -> Mapping[str, Input]:
        """Actuators with unit, range and safe value."""

    def apply(self, name: str, value: float) -> None:
        """Set an actuator to a value at the present tick."""

    def ramp(self, name: str, to: float, ticks: int) -> None:
        """Move an actuator linearly to a value within whole ticks."""


class Exchange:
    """All command queues of a run. `hold`: ticks for which the last command is held when commands are missing."""

    def __init__(self, runner: Actuators, frame_ns: int, hold: int, journal: Journal) -> None:
        self.lines: dict[str, CommandQueue] = {}
        self.all_lines: dict[str, CommandQueue] = {}
        """The last queue of every name, also of dismissed controllers, because their counts stay in the summary."""
        self.refused: dict[str, int] = {}
        """Senders without a queue, and how often they were refused."""
        self._runner, self._frame_ns, self._hold = runner, frame_ns, hold
        self.journal = journal
        self._owner: dict[str, str] = {}
        self._asked = {name: one.value for name, one in runner.inputs.items()}
        self._moves: dict[str, tuple[float, float, int, int]] = {}
        self._stairs: set[str] = set()
        """Of these, actuators that move in steps, one per frame, because no state of theirs has a slope."""
        self.in_force: dict[str, float] = {}
        """The value that each actuator was set to last."""
        self._order: list[CommandQueue] = []
        self._changed: list[CommandQueue] = []
        self.refit: Rebuild | None = None
        """Builds the rigs that commands need and that cannot be built at once."""

    def check(self, name: str, drives: Sequence[str], period_ns: int, gone: Collection[str] = ()) -> None:
        """Raise UsageError if a controller cannot be admitted: an actuator is unknown or belongs to another controller.

        `gone`: controllers that have left and own nothing any more.
        """
        inputs = self._runner.inputs
        faults = [] if topics.is_name(name) else ["is no name; a name is 1 to 64 letters, digits, '_', '.', '-'"]
        faults += [
            f"{d:.80}: there is no such actuator; there are {', '.join(inputs)}" for d in drives if d not in inputs
        ]
        faults += [f"{d:.80}: is named twice" for d in dict.fromkeys(drives) if drives.count(d) > 1]
        free = {name, *gone}
        taken = [(d, self._owner[d]) for d in drives if self._owner.get(d, name) not in free]
        faults += [f"{drive}: is driven by {owner} already" for drive, owner in taken]
        former = self.all_lines.get(name)
        if former is not None and former.counts.taken and len(former.drives) != len(drives):
            faults.append(
                f"commanded {len(former.drives)} actuators before in this run and would now command {len(drives)}; a "
                "recording holds one number of commands under each name, so give the controller another name"
            )
        if period_ns % self._frame_ns or not 0 < period_ns <= LONGEST_NS:
            frame, longest = f"{self._frame_ns / 1e6:g} ms", f"{LONGEST_NS / 1e9:g} s"
            allowed = f"no whole number of {frame} frames between {frame} and {longest}"
            faults.append(f"its period of {brief(period_ns)} ns is {allowed}")
        if faults:
            raise UsageError("\n".join(f"{name[:80]!r}: {fault}" for fault in faults))

    def admit(self, name: str, drives: Sequence[str], period_ns: int, delay_ns: int = 0) -> CommandQueue:
        """Add a queue for a controller. Raises UsageError if the controller cannot be admitted."""
        self.check(name, drives, period_ns)
        line = CommandQueue(name, drives, period_ns // self._frame_ns, delay_ns // self._frame_ns)
        if name in self.all_lines:
            line.follow(self.all_lines[name])
        self.lines[name] = self.all_lines[name] = line
        self._order = [self.lines[key] for key in sorted(self.lines)]
        self._owner.update(dict.fromkeys(drives, name))
        return line

    def dismiss(self, name: str) -> None:
        """Remove a controller that is not in the scene; its actuators are free again."""
        line = self.lines.pop(name)
        self._order.remove(line)
        for drive in line.drives:
            del self._owner[drive]
        self._give_back(line)

    def receive(self, sender: str, answered: int, values: Sequence[float]) -> None:
        """Take a command: the answer of `sender` to the measurement of tick `answered`."""
        line = self.lines.get(sender)
        if line is None:
            self.refused[sender] = self.refused.get(sender, 0) + 1
            self.journal.repeated("refused", f"{sender} drives no actuator of this run; its commands are refused")
        elif len(values) != len(line.drives):
            if len(values):  # an empty answer is allowed: there was no sample yet
                line.counts.refused += 1
                text = f"a command of {sender} has {len(values)} values for its {len(line.drives)} actuators"
                self.journal.repeated("refused", text)
        elif answered > self._runner.tick:
            line.counts.refused += 1
            self.journal.repeated("refused", f"{sender} answers a step that was not sent yet")
        elif line.connected:
            tick = self._runner.tick
            due = answered + line.delay
            line.queue.append((due if due > tick else tick, answered, values))

    def take_over(self) -> list[CommandQueue]:
        """Put the commands of this tick into force and return the queues that changed (a list that is reused)."""
        tick, changed = self._runner.tick, self._changed
        changed.clear()
        for line in self._order:
            queue = line.queue
            if queue and queue[0][0] <= tick:
                _, answered, values = queue.popleft()
                while queue and queue[0][0] <= tick:
                    _, answered, values = queue.popleft()
                    line.counts.overtaken += 1
                self._take(line, tick, answered, values)
                changed.append(line)
            elif line.wanted and self.refit is not None and self.refit.done:
                if (wanted := self._in_range(line.drives, line.wanted)) != line.wanted:
                    line.status = CLAMPED
                    line.counts.clamped += 1
                if (values := self._possible(line, wanted)) != line.values:
                    last = line.last
                    self.impose(line, line.answered, line.status, values)
                    line.last = last  # the tick of the command
                    changed.append(line)
            elif line.values and tick - line.last >= line.period and line.status != SAFE:
                line.counts.held += 1
                if tick - line.last >= line.period + self._hold:
                    self._step_in(line, tick)
                    changed.append(line)
        if self._stairs:
            self._climb()
        return changed

    def until(self, but: Collection[str] = ()) -> int | None:
        """Return the first later tick at which `take_over` must act if no command arrives; None: never.

        `but`: controllers whose commands somebody else puts into force meanwhile.
        """
        found = self._runner.tick + 1 if self._stairs else None
        for line in self._order:
            if line.name in but:
                continue
            tick = line.queue[0][0] if line.queue else None
            if line.values and line.status != SAFE:
                missing = max(line.last + line.period, self._runner.tick + 1)
                tick = missing if tick is None else min(tick, missing)
            if tick is not None:
                found = tick if found is None else min(found, tick)
        return found

    def _take(self, line: CommandQueue, tick: int, answered: int, given: Sequence[float]) -> None:
        counts, status = line.counts, AS_SENT
        if not isfinite(sum(given)):
            given = self._without_gaps(line, given)
        given = tuple(given)
        if (wanted := self._in_range(line.drives, given)) != given:
            status = CLAMPED
            counts.clamped += 1
        age = tick - answered
        if age > counts.oldest:
            counts.oldest = age
        if age > line.delay + 1:
            counts.late += 1
        counts.taken += 1
        if line.status == SAFE:
            self.journal.note("back", f"{line.name} commands again", controller=line.name)
        self.impose(line, answered, status, self._possible(line, wanted))

    def _in_range(self, drives: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
        """Return the values clamped to the ranges of this tick; a parameter of the rig may have changed the ranges."""
        inputs = self._runner.inputs
        for drive, value in zip(drives, values):
            one = inputs[drive]
            if not one.low <= value <= one.high:  # rare, but checked at every command
                return tuple([min(max(v, inputs[d].low), inputs[d].high) for d, v in zip(drives, values)])
        return tuple(values)

    def _possible(self, line: CommandQueue, wanted: tuple[float, ...]) -> tuple[float, ...]:
        """Return the values of `wanted` that can be in force at this tick; the others wait for their rig."""
        possible = wanted if self.refit is None else self.refit.possible(line.drives, wanted)
        line.wanted = () if possible == wanted else wanted
        return possible

    def impose(self, line: CommandQueue, answered: int, status: int, values: tuple[float, ...]) -> None:
        """Put values into force unchanged: `take_over` has checked them, or they come from a recording."""
        tick, in_force = self._runner.tick, self.in_force
        line.values, line.answered, line.status, line.last = values, answered, status, tick
        for drive, value in zip(line.drives, values):
            if in_force.get(drive) != value:
                in_force[drive] = value
                self._runner.apply(drive, value)
        line.keep(tick)

    def _without_gaps(self, line: CommandQueue, given: Sequence[float]) -> Sequence[float]:
        """Replace values that are NaN or infinite by those in force."""
        if all(map(isfinite, given)):
            return given  # only the sum overflowed
        line.counts.not_finite += 1
        self.journal.repeated("not finite", f"a command of {line.name} is not finite; the last one is held")
        kept = line.values or tuple(self._asked_now(drive) for drive in line.drives)
        return tuple([value if isfinite(value) else held for value, held in zip(given, kept)])

    def _step_in(self, line: CommandQueue, tick: int) -> None:
        line.counts.safe += 1
        silent = (tick - line.last) * self._frame_ns / 1e6
        text = f"{line.name} has been silent for {silent:g} ms: {', '.join(line.drives)} to safe values"
        self.journal.note("safe", text, controller=line.name)
        safe = tuple([self._runner.inputs[drive].safe for drive in line.drives])
        self.impose(line, -1, SAFE, self._possible(line, safe))

    def ask(self, name: str, value: float) -> None:
        """Set an actuator to a value of the protocol, clamped like any other."""
        one = self._runner.inputs[name]
        value = min(max(value, one.low), one.high)
        self._asked[name] = value
        self._moves.pop(name, None)
        self._stairs.discard(name)
        if not self._overruled(name):
            self._write(name, value)

    def move(self, name: str, to: float, ticks: int) -> None:
        """Move an actuator linearly to a value of the protocol within `ticks`."""
        one = self._runner.inputs[name]
        to = min(max(to, one.low), one.high)
        start = self._asked_now(name)
        self._moves[name] = (start, to, self._runner.tick, ticks)
        self._asked[name] = to
        if not self._overruled(name):
            self._ramp(name, to, ticks)

    def connect(self, name: str, on: bool) -> None:
        """Connect a controller to its actuators from this tick on, or disconnect it."""
        line = self.lines[name]
        if line.connected and not on:
            line.connected = False
            self._give_back(line)
        line.connected = on

    def give_up(self, ticks: int) -> None:
        """Bring all actuators to their safe values, within `ticks` if they can move, else at once; ignore commands."""
        for line in self._order:
            line.connected = False
            line.queue.clear()
            line.values = line.wanted = ()
        self._moves.clear()
        self._stairs.clear()
        for name, one in self._runner.inputs.items():
            self._asked[name] = one.safe
            if one.slope:
                self._ramp(name, one.safe, ticks)
            else:
                self._write(name, one.safe)

    def given_back(self, line: CommandQueue) -> dict[str, float]:
        """Return the values of the protocol to which the actuators of a disconnected controller return."""
        return {drive: self._asked_now(drive) for drive in line.drives} if line.values else {}

    def _give_back(self, line: CommandQueue) -> None:
        given_back = self.given_back(line)
        line.queue.clear()
        line.values, line.status, line.wanted = (), AS_SENT, ()
        for drive, value in given_back.items():
            self._write(drive, value)
            if drive in self._moves:
                _, to, begin, ticks = self._moves[drive]
                left = begin + ticks - self._runner.tick
                if left > 0:
                    self._ramp(drive, to, left)

    def _asked_now(self, name: str) -> float:
        """Return the value that the protocol sets for an actuator at this tick, also during a ramp."""
        if name in self._moves:
            start, to, begin, ticks = self._moves[name]
            share = min((self._runner.tick - begin) / ticks, 1.0)
            return self._in_range([name], [start + (to - start) * share])[0]
        return self._in_range([name], [self._asked[name]])[0]

    def overruler(self, name: str) -> str:
        """Return the controller that drives an actuator; "" if there is none."""
        owner = self._owner.get(name)
        return owner if owner is not None and self.lines[owner].values else ""

    def _overruled(self, name: str) -> bool:
        if not (owner := self.overruler(name)):
            return False
        self.journal.repeated(
            "overruled", f"{name} follows {owner}; the protocol's value waits until it is disconnected"
        )
        return True

    def _write(self, name: str, value: float) -> None:
        if self.in_force.get(name) != value:
            self.in_force[name] = value
            self._runner.apply(name, value)

    def _ramp(self, name: str, to: float, ticks: int) -> None:
        if self._runner.inputs[name].slope:
            self.in_force[name] = nan
            self._runner.ramp(name, to, ticks)
        else:
            self._stairs.add(name)

    def _climb(self) -> None:
        """Make the next step of each actuator that moves in steps, unless a controller drives it."""
        for name in self._stairs:
            if not self.overruler(name):
                self._write(name, self._asked_now(name))

    def counters(self) -> dict[str, dict[str, Any]]:
        """Return the counts of each controller; unknown senders are under "refused"."""
        found: dict[str, dict[str, Any]] = {name: asdict(line.counts) for name, line in self.all_lines.items()}
        return found | ({"refused": dict(self.refused)} if self.refused else {})
