"""The exchange: passes commands of controllers to actuators by these rules, and counts every case.

    in time         takes effect at the frame boundary after its arrival, not before the stated delay of the controller
    impaired link   is sent after this delay, and arrives when the link has it: later, never or twice
    two at once     the later command counts, the other one is `overtaken`
    another matrix  in a paced run takes effect when the matrix is built (rig.bench.run.builds); other values at once
    missing         the last command is held; `hold` ticks after the missing one was due, safe values replace it
    outdated        is discarded: older than its delay, its period, `hold` and the longest delay of its link together
    not finite      the actuator keeps its value
    out of range    clamped
    not its own     refused and reported: each actuator has one owner

The protocol sets values too. A controller that commands an actuator overrules the protocol; the value of the protocol
returns when the controller is disconnected.

In a re-simulation recorded commands take effect at the same ticks with the same values (`Playback`). Commands are
recorded as they were asked for; what a faulty actuator makes of them is repeated with the scene.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from math import ceil, isfinite, nan
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.bench.run.command_queue import AS_SENT, CLAMPED, SAFE, CommandQueue
from rig.bench.run.journal import Journal
from rig.bus import topics
from rig.bus.impaired_link import ImpairedLink
from rig.errors import LogError, UsageError
from rig.model.assembly import Input
from rig.record.run import Commands
from rig.scenes.part_faults import ActuatorFault, Jam
from rig.solve.control_loop import ROWS
from rig.units import brief

if TYPE_CHECKING:
    from rig.bench.run.builds import CommandedRigs
    from rig.bench.run.runner import PlantRunner

LONGEST_NS = 3600 * 10**9
"""Longest period of a controller. # chosen"""


def in_range(inputs: Mapping[str, Input], drives: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
    """Return the values clamped to the ranges of this tick; a parameter of the rig may have changed the ranges."""
    for drive, value in zip(drives, values):
        actuator = inputs[drive]
        if not actuator.low <= value <= actuator.high:  # rare, but checked at every command
            return tuple([min(max(v, inputs[d].low), inputs[d].high) for d, v in zip(drives, values)])
    return tuple(values)


class ProtocolValues:
    """The value that the protocol sets for each actuator, also while a controller drives the actuator."""

    def __init__(self, runner: PlantRunner) -> None:
        self._runner = runner
        self._values = {name: actuator.value for name, actuator in runner.inputs.items()}
        # Actuator -> first and last value of its move, first tick, number of ticks.
        self._moves: dict[str, tuple[float, float, int, int]] = {}

    def set(self, name: str, value: float) -> float:
        """Set a value; a move ends. Returns the value clamped to the range of the actuator."""
        self._moves.pop(name, None)
        self._values[name] = in_range(self._runner.inputs, [name], [value])[0]
        return self._values[name]

    def move(self, name: str, to: float, ticks: int) -> tuple[float, int]:
        """Move linearly to a value within `ticks`, or to a limit on the way. Returns last value and number of ticks."""
        start = self.now(name)
        self._values[name] = in_range(self._runner.inputs, [name], [to])[0]
        if self._values[name] != to:
            ticks = max(ceil(ticks * (self._values[name] - start) / (to - start)), 1)
        self._moves[name] = (start, self._values[name], self._runner.tick, ticks)
        return self._values[name], ticks

    def now(self, name: str) -> float:
        """The value at this tick, also during a move."""
        value = self._values[name]
        if name in self._moves:
            start, to, begin, ticks = self._moves[name]
            value = start + (to - start) * min((self._runner.tick - begin) / ticks, 1.0)
        return in_range(self._runner.inputs, [name], [value])[0]

    def rest_of_move(self, name: str) -> tuple[float, int] | None:
        """Last value and remaining ticks of a move that goes on; None without one."""
        if name not in self._moves:
            return None
        _, to, begin, ticks = self._moves[name]
        left = begin + ticks - self._runner.tick
        return (to, left) if left > 0 else None

    def make_safe(self) -> None:
        """Set the safe value of every actuator; all moves end."""
        self._moves.clear()
        self._values = {name: actuator.safe for name, actuator in self._runner.inputs.items()}


class Exchange:
    """All command queues of a run. `hold`: ticks for which the last command is held when commands are missing."""

    def __init__(
        self,
        runner: PlantRunner,
        frame_ns: int,
        hold: int,
        journal: Journal,
        links: Mapping[str, ImpairedLink] = MappingProxyType({}),
    ) -> None:
        self.queues: dict[str, CommandQueue] = {}
        self.all_queues: dict[str, CommandQueue] = {}
        """The last queue of every name, also of dismissed controllers, because their counts stay in the summary."""
        self.refused: dict[str, int] = {}
        """Senders without a queue, and how often they were refused."""
        self._runner = runner
        self._frame_ns = frame_ns
        self._hold = hold
        self.faulty: dict[str, ActuatorFault] = {}
        """Actuators that are faulty at this tick, with their faults."""
        self.links = links
        """Controller -> the link of its commands, for those whose link is impaired."""
        self.journal = journal
        self._owner: dict[str, str] = {}
        self._protocol = ProtocolValues(runner)
        # Actuators on the move -> the tick from which on they are written: the last, or the next without a slope.
        self._steps: dict[str, int] = {}
        self.in_force: dict[str, float] = {}
        """The value that each actuator was set to last."""
        self._order: list[CommandQueue] = []
        self._changed: list[CommandQueue] = []
        self.rebuild: CommandedRigs | None = None
        """Builds the rigs that commands need and that cannot be built at once."""

    @property
    def plays(self) -> bool:
        """Whether commands come from a recording at this tick; those of controllers then have no effect."""
        return False

    def check(self, name: str, drives: Sequence[str], period_ns: int, gone: Collection[str] = ()) -> None:
        """Raise UsageError if a controller cannot be admitted: an actuator is unknown or belongs to another controller.

        `gone`: controllers that have left and own nothing any more.
        """
        inputs = self._runner.inputs
        faults = [] if topics.is_name(name) else ["is not a name; a name has 1 to 64 letters, digits, '_', '.', '-'"]
        faults += [
            f"{d:.80}: there is no such actuator; there are {', '.join(inputs)}" for d in drives if d not in inputs
        ]
        faults += [f"{d:.80}: is named twice" for d in dict.fromkeys(drives) if drives.count(d) > 1]
        free = {name, *gone}
        taken = [(d, self._owner[d]) for d in drives if self._owner.get(d, name) not in free]
        faults += [f"{drive}: is driven by {owner} already" for drive, owner in taken]
        former = self.all_queues.get(name)
        if former is not None and former.counts.taken and len(former.drives) != len(drives):
            faults.append(
                f"commanded {len(former.drives)} actuators before in this run and would now command {len(drives)}; a "
                "recording holds one number of commands under each name, so give the controller another name"
            )
        if period_ns % self._frame_ns or not 0 < period_ns <= LONGEST_NS:
            frame = f"{self._frame_ns / 1e6:g} ms"
            longest = f"{LONGEST_NS / 1e9:g} s"
            allowed = f"no whole number of {frame} frames between {frame} and {longest}"
            faults.append(f"its period of {brief(period_ns)} ns is {allowed}")
        if faults:
            raise UsageError("\n".join(f"{name[:80]!r}: {fault}" for fault in faults))

    def admit(self, name: str, drives: Sequence[str], period_ns: int, delay_ns: int = 0) -> CommandQueue:
        """Add a queue for a controller. Raises UsageError if the controller cannot be admitted."""
        self.check(name, drives, period_ns)
        period = period_ns // self._frame_ns
        delay = delay_ns // self._frame_ns
        queue = CommandQueue(name, drives, period, delay, self._hold, self.links.get(name))
        if name in self.all_queues:
            queue.follow(self.all_queues[name])
        self.queues[name] = self.all_queues[name] = queue
        self._order = [self.queues[key] for key in sorted(self.queues)]
        self._owner.update(dict.fromkeys(drives, name))
        return queue

    def dismiss(self, name: str) -> None:
        """Remove a controller that is not in the scene; its actuators are free again."""
        queue = self.queues.pop(name)
        self._order.remove(queue)
        for drive in queue.drives:
            del self._owner[drive]
        self._give_back(queue)

    def receive(self, sender: str, answered: int, values: Sequence[float]) -> None:
        """Take a command: the answer of `sender` to the measurement of tick `answered`."""
        queue = self.queues.get(sender)
        if queue is None:
            self.refused[sender] = self.refused.get(sender, 0) + 1
            self.journal.repeated("refused", f"{sender} drives no actuator of this run; its commands are refused")
        elif len(values) != len(queue.drives):
            if len(values):  # an empty answer is allowed: there was no sample yet
                queue.counts.refused += 1
                text = f"a command of {sender} has {len(values)} values for its {len(queue.drives)} actuators"
                self.journal.repeated("refused", text)
        elif answered > self._runner.tick:
            queue.counts.refused += 1
            self.journal.repeated("refused", f"{sender} answers a step that was not sent yet")
        elif queue.connected:
            tick = self._runner.tick
            due = answered + queue.delay
            queue.put(due if due > tick else tick, answered, values, tick)

    def take_over(self) -> list[CommandQueue]:
        """Put the commands of this tick into force and return the queues that changed (a list that is reused)."""
        tick = self._runner.tick
        changed = self._changed
        changed.clear()
        for queue in self._order:
            waiting = queue.queue
            command = self._last_due(queue, tick) if waiting and waiting[0][0] <= tick else None
            if command is not None:
                self._take(queue, tick, *command)
                changed.append(queue)
            elif queue.wanted and self._catches_up(queue):
                changed.append(queue)
            elif queue.values and tick - queue.last >= queue.period and queue.status != SAFE:
                queue.counts.held += 1
                if tick - queue.last >= queue.period + queue.hold:
                    self._step_in(queue, tick)
                    changed.append(queue)
        if self._steps:
            self._step()
        return changed

    def _last_due(self, queue: CommandQueue, tick: int) -> tuple[int, Sequence[float]] | None:
        """Take the commands that are due at `tick` from the queue; return the last one that is not outdated."""
        last = None
        while queue.queue and queue.queue[0][0] <= tick:
            _, answered, values = queue.queue.popleft()
            if tick - answered > queue.oldest:
                self._discard(queue)
                continue
            if last is not None:
                queue.counts.overtaken += 1
            last = answered, values
        return last

    def _discard(self, queue: CommandQueue) -> None:
        queue.counts.outdated += 1
        limit = queue.oldest * self._frame_ns / 1e6
        self.journal.repeated("outdated", f"commands of {queue.name} are older than {limit:g} ms and are discarded")

    def until(self, but: Collection[str] = ()) -> int | None:
        """Return the first later tick at which `take_over` must act if no command arrives; None: never.

        `but`: controllers whose commands another caller puts into force meanwhile.
        """
        first = self._next_step()
        for queue in self._order:
            if queue.name in but:
                continue
            tick = queue.queue[0][0] if queue.queue else None
            if queue.values and queue.status != SAFE:
                missing = max(queue.last + queue.period, self._runner.tick + 1)
                tick = missing if tick is None else min(tick, missing)
            if tick is not None:
                first = tick if first is None else min(first, tick)
        return first

    def _take(self, queue: CommandQueue, tick: int, answered: int, given: Sequence[float]) -> None:
        counts = queue.counts
        status = AS_SENT
        if not isfinite(sum(given)):
            given = self._without_gaps(queue, given)
        given = tuple(given)
        if (wanted := in_range(self._runner.inputs, queue.drives, given)) != given:
            status = CLAMPED
            counts.clamped += 1
        age = tick - answered
        if age > counts.oldest:
            counts.oldest = age
        if age > queue.oldest_in_time + 1:
            counts.late += 1
        counts.taken += 1
        if queue.status == SAFE:
            self.journal.note("back", f"{queue.name} commands again", controller=queue.name)
        self.impose(queue, answered, status, self._possible(queue, wanted))

    def _catches_up(self, queue: CommandQueue) -> bool:
        """Put the waiting values into force whose rig is built by now; whether there are any."""
        if queue.status != SAFE and self._runner.tick - queue.answered > queue.oldest:
            queue.wanted = ()
            self._discard(queue)
            return False
        if (wanted := in_range(self._runner.inputs, queue.drives, queue.wanted)) != queue.wanted:
            queue.status = CLAMPED
            queue.counts.clamped += 1
        if (values := self._possible(queue, wanted)) == queue.values:
            return False
        last = queue.last
        self.impose(queue, queue.answered, queue.status, values)
        queue.last = last  # the tick of the command
        return True

    def _possible(self, queue: CommandQueue, wanted: tuple[float, ...]) -> tuple[float, ...]:
        """Return the values of `wanted` that can be in force at this tick; the others wait for their rig."""
        possible = wanted if self.rebuild is None else self.rebuild.possible(queue.drives, wanted)
        queue.wanted = () if possible == wanted else wanted
        return possible

    def impose(self, queue: CommandQueue, answered: int, status: int, values: tuple[float, ...]) -> None:
        """Put values into force unchanged: `take_over` has checked them, or they come from a recording."""
        tick = self._runner.tick
        in_force = self.in_force
        apply = self._apply if self.faulty else self._runner.apply
        queue.values = values
        queue.answered = answered
        queue.status = status
        queue.last = tick
        for drive, value in zip(queue.drives, values):
            if in_force.get(drive) != value:
                in_force[drive] = value
                apply(drive, value)
        queue.keep(tick)

    def _without_gaps(self, queue: CommandQueue, given: Sequence[float]) -> Sequence[float]:
        """Replace values that are NaN or infinite by those in force."""
        if all(map(isfinite, given)):
            return given  # only the sum overflowed
        queue.counts.not_finite += 1
        self.journal.repeated("not finite", f"a command of {queue.name} is not finite; the last one is held")
        kept = queue.values or tuple(self._protocol.now(drive) for drive in queue.drives)
        return tuple([value if isfinite(value) else held for value, held in zip(given, kept)])

    def _step_in(self, queue: CommandQueue, tick: int) -> None:
        queue.counts.safe += 1
        silent = (tick - queue.last) * self._frame_ns / 1e6
        text = f"{queue.name} has been silent for {silent:g} ms: {', '.join(queue.drives)} to safe values"
        self.journal.note("safe", text, controller=queue.name)
        safe = tuple([self._runner.inputs[drive].safe for drive in queue.drives])
        self.impose(queue, -1, SAFE, self._possible(queue, safe))

    def ask(self, name: str, value: float) -> None:
        """Set an actuator to a value of the protocol, clamped like any other."""
        value = self._protocol.set(name, value)
        self._steps.pop(name, None)
        if not self._overruled(name):
            self._write(name, value)

    def move(self, name: str, to: float, ticks: int) -> None:
        """Move an actuator linearly to a value of the protocol within `ticks`."""
        to, ticks = self._protocol.move(name, to, ticks)
        if not self._overruled(name):
            self._ramp(name, to, ticks)

    def switch_fault(self, fault: ActuatorFault, begins: bool) -> None:
        """From this tick on an actuator is faulty or, if not `begins`, sound again."""
        name = fault.actuator
        if not begins:
            del self.faulty[name]
        elif isinstance(fault, Jam):
            self._runner.apply(name, self._runner.reached(name))
        if begins:
            self.faulty[name] = fault
        value = self.in_force.get(name, self._runner.inputs[name].value)
        if isfinite(value):
            self._apply(name, value)
            return
        self._apply(name, self._protocol.now(name))
        if (rest := self._protocol.rest_of_move(name)) is not None:
            self._apply(name, *rest)

    def _apply(self, name: str, value: float, ticks: int = 0) -> None:
        """Bring an actuator to a value, at once or linearly within `ticks`, as far as its fault allows."""
        fault = self.faulty.get(name)
        if isinstance(fault, Jam):
            return
        if fault is not None:
            value = in_range(self._runner.inputs, [name], [fault.factor * value])[0]
        if ticks:
            self._runner.ramp(name, value, ticks)
        else:
            self._runner.apply(name, value)

    def connect(self, name: str, on: bool) -> None:
        """Connect a controller to its actuators from this tick on, or disconnect it."""
        queue = self.queues[name]
        if queue.connected and not on:
            queue.connected = False
            self._give_back(queue)
        queue.connected = on

    def give_up(self, ticks: int) -> None:
        """Bring all actuators to their safe values, within `ticks` if they can move, else at once; ignore commands."""
        for queue in self._order:
            queue.connected = False
            queue.queue.clear()
            queue.values = queue.wanted = ()
        self._protocol.make_safe()
        self._steps.clear()
        for name, actuator in self._runner.inputs.items():
            if actuator.slope:
                self._ramp(name, actuator.safe, ticks)
            else:
                self._write(name, actuator.safe)

    def given_back(self, queue: CommandQueue) -> dict[str, float]:
        """Return the values of the protocol to which the actuators of a disconnected controller return."""
        return {drive: self._protocol.now(drive) for drive in queue.drives} if queue.values else {}

    def _give_back(self, queue: CommandQueue) -> None:
        given_back = self.given_back(queue)
        queue.queue.clear()
        queue.values = ()
        queue.status = AS_SENT
        queue.wanted = ()
        for drive, value in given_back.items():
            self._write(drive, value)
            if (rest := self._protocol.rest_of_move(drive)) is not None:
                self._ramp(drive, *rest)

    def overruler(self, name: str) -> str:
        """Return the controller that drives an actuator; "" if there is none."""
        owner = self._owner.get(name)
        return owner if owner is not None and self.queues[owner].values else ""

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
            self._apply(name, value)

    def _ramp(self, name: str, to: float, ticks: int) -> None:
        self._steps[name] = self._runner.tick + 1
        if self._runner.inputs[name].slope:
            self._steps[name] = self._runner.tick + ticks
            self.in_force[name] = nan
            self._apply(name, to, ticks)

    def _next_step(self) -> int | None:
        return max(min(self._steps.values()), self._runner.tick + 1) if self._steps else None

    def _step(self) -> None:
        """Write each actuator that moves in steps or has arrived, unless a controller drives it."""
        tick = self._runner.tick
        for name in [name for name, first in self._steps.items() if first <= tick]:
            if not self.overruler(name):
                self._write(name, self._protocol.now(name))
            if self._protocol.rest_of_move(name) is None:
                del self._steps[name]

    def counters(self) -> dict[str, dict[str, Any]]:
        """Return the counts of each controller; unknown senders are under "refused"."""
        counts: dict[str, dict[str, Any]] = {name: asdict(queue.counts) for name, queue in self.all_queues.items()}
        if self.refused:
            counts["refused"] = dict(self.refused)
        return counts


class PlayedCommands:
    """The recorded commands of one controller; the first `done` of them have taken effect."""

    def __init__(self, commands: Commands) -> None:
        self.commands = commands
        self.done = 0
        self._ticks = commands.tick.tolist()

    def due(self, ahead: int = 0) -> int | None:
        """The tick of the next command, or of the one `ahead` commands later; None if there is none."""
        at = self.done + ahead
        return self._ticks[at] if at < len(self._ticks) else None

    def is_due(self, tick: int) -> bool:
        """Whether the next command has to be in force at `tick`."""
        due = self.due()
        return due is not None and due <= tick


class Playback(Exchange):
    """An exchange that plays recorded commands and ignores controllers, up to tick `end` if it is not None.

    From `end` on it is an `Exchange`.
    """

    end: int | None = None
    played: Mapping[str, PlayedCommands] = {}
    whole: Collection[str] = ()

    def play(self, recorded: Mapping[str, Commands], end: int | None = None, whole: Collection[str] = ()) -> None:
        """Take the commands of each controller before tick `end` from a recording; all without `end`.

        `whole`: controllers whose later commands are taken from it, too.
        """
        self.end = end
        self.whole = whole
        readable = [
            (name, commands) for name, commands in recorded.items() if commands.tick.size
        ]  # damage may leave none
        self.played = {
            name: PlayedCommands(_before(None if name in whole else end, commands)) for name, commands in readable
        }
        for queue in self.queues.values():
            self._fits(queue)

    def admit(self, name: str, drives: Sequence[str], period_ns: int, delay_ns: int = 0) -> CommandQueue:
        """See `Exchange.admit`. Raises LogError if the recorded commands have another number of values."""
        queue = super().admit(name, drives, period_ns, delay_ns)
        self._fits(queue)
        return queue

    def _fits(self, queue: CommandQueue) -> None:
        if (played := self.played.get(queue.name)) is not None:
            if (width := played.commands.values.shape[1]) != len(queue.drives):
                raise LogError(
                    f"the recorded commands of {queue.name} have {width} values, its actuators are "
                    f"{', '.join(queue.drives)}"
                )

    @property
    def plays(self) -> bool:
        """Whether commands come from the recording at this tick."""
        return self.end is None or self._runner.tick < self.end

    def receive(self, sender: str, answered: int, values: Sequence[float]) -> None:
        """Take a command that takes effect at `end` or later; the recording has those before."""
        if self.end is None:
            return
        queue = self.queues[sender]
        due = answered + queue.delay
        if due >= self.end:
            super().receive(sender, answered, values)
        elif queue.link is not None and len(values) == len(queue.drives) and queue.connected:
            queue.put(due, answered, values, due)
            while queue.queue and queue.queue[0][0] < self.end:  # the recording has it
                queue.queue.popleft()

    def until(self, but: Collection[str] = ()) -> int | None:
        """The tick of the next recorded command; None if there is none.

        Ignores controllers whose admission is not in the recording. For the controllers in `but`, which the compiled
        loop handles, it is the tick of the first command that exceeds the loop's capacity.
        """
        if not self.plays:
            first = super().until(but)
            ticks = [first, *(self.played[name].due() for name in self.whole if name in self.played)]
            return min((tick for tick in ticks if tick is not None), default=None)
        due = [] if (step := self._next_step()) is None else [step]
        played = [(name, commands) for name, commands in self.played.items() if name in self.queues]
        ticks = [commands.due(ROWS if name in but else 0) for name, commands in played]
        return min([*due, *(tick for tick in ticks if tick is not None)], default=None)

    def take_over(self) -> list[CommandQueue]:
        """Put into force the recorded commands of this tick; from `end` on those that controllers have sent."""
        if not self.plays:
            later = [queue for queue in self._order if queue.name in self.whole and self._impose_played(queue)]
            changed = super().take_over()
            changed += later
            return changed
        changed = self._changed
        changed.clear()
        changed += filter(self._impose_played, self._order)
        if self._steps:
            self._step()
        return changed

    def _impose_played(self, queue: CommandQueue) -> bool:
        """Put the recorded commands of a controller that are due into force; whether there are any."""
        tick = self._runner.tick
        played = self.played.get(queue.name)
        before = 0 if played is None else played.done
        while played is not None and played.is_due(tick):
            _, answered, status, values = (column[played.done].tolist() for column in played.commands)
            self.impose(queue, answered, status, tuple(values))
            played.done += 1
        return played is not None and played.done > before


def _before(end: int | None, commands: Commands) -> Commands:
    """The commands before tick `end`; all of them without it."""
    count = commands.tick.size if end is None else int(np.searchsorted(commands.tick, end))
    return Commands(commands.tick[:count], commands.answered[:count], commands.status[:count], commands.values[:count])
