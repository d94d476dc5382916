"""A controller in its own process: it answers the plant's steps, and ends when the plant ends.

    step      update and answer if its period is due; a repeated step gets the same answer again
    param     {"get": [keys]} or {"set": {key: value}}: checked, applied as a whole between two steps, reported as an
              event; {"list": true}: the parameters that can be set, with units
    alive     declared when the topics above are ready; without a plant this process ends within a second

A controller that is not in the scene (a user's own file) first requests admission from the plant and states what it
reads and drives; the plant refuses actuators that another controller drives.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rig import bus, controllers
from rig.bus import encode, run_setup
from rig.bus.port import Session
from rig.controllers.blocks.base import Controller, Samples, is_elsewhere
from rig.controllers.runtime.file import load_file
from rig.controllers.runtime.loop import NOT_FINITE, Loop, failure
from rig.controllers.runtime.service import Service
from rig.controllers.runtime.skipped import KIND, SkippedSteps, Ticks
from rig.errors import BusError, RigError, UsageError
from rig.machine.process import as_process, no_garbage, stopping, tell
from rig.machine.scheduling import CONTROLLER, ahead, anywhere, come_first, locked, placed
from rig.parts import is_file, trust_scene

LONG_NS = 300_000
LONG_ANSWERS = 20
"""A controller with this number of successive answers above this time [ns] leaves the processor core of the bus."""
UNHEARD = (math.nan,)
ADMITTED = 60.0
"""Longest wait [s] for admission: the plant may have to build or compile matrices for the controller's actuators."""
PATIENCE = 0.1  # s without a step after which this process checks whether the plant is alive


class Worker(Service):
    """One controller with its session on the bus. It begins with `changes` of its parameters."""

    def __init__(
        self,
        session: Session,
        described: run_setup.Setup,
        controller: Controller,
        changes: Mapping[str, object] | None = None,
    ) -> None:
        super().__init__(session, Loop(controller))
        self.answered = b""
        self._begins_with = changes
        if changes:
            self.loop.retune(changes)
        self._long = 0
        self._tells = hasattr(controller, "take_events")
        sensors = list(described.sensors)
        missing = [name for name in controller.reads if name not in sensors]
        if missing:
            raise UsageError(f"{session.name} reads {', '.join(missing)}; the sensors are {', '.join(sensors)}")
        self.columns = [sensors.index(name) for name in controller.reads]
        self.steps = session.subscribe("step")
        self._waiting = deque[Any]()
        """Steps that have arrived and are not answered."""
        self._most_behind = described.hold_frames
        self._frame_ns = described.frame_ns
        self._recorded = SkippedSteps(described.skipped.get(session.name, ()))
        self._period = controller.period_ns // (described.frame_ns or 1)
        self._expected = -1
        self._arrived = Ticks(most=self._period)
        """Tick of the next step to answer, -1 before the first one; skipped steps since the last answer."""
        self.act = session.publisher(f"act/{session.name}")
        self.plant = session.watch("plant/*")
        if session.name not in described.controllers:
            wanted = {"reads": controller.reads, "drives": controller.drives, "hears": self.loop.every_sample}
            body = {"do": "admit", "controller": session.name, "period_ns": controller.period_ns, **wanted}
            session.ask("cmd/plant", body, timeout=ADMITTED)

    def follow(self, stopped: Callable[[], bool]) -> None:
        """Answer steps until the plant leaves or `stopped()`. Raises BusError without a plant."""
        if not self.plant.wait_for("plant", "plant", 3.0):
            raise BusError(f"run {self.session.run} has no plant")
        self.session.announce()
        try:
            while not stopped():
                step = self.next_step()
                if self.session.lost:  # another process may have the seat by now: there are never two commanders
                    break
                if step is not None:
                    self.answer_step(step)
                elif not self.session.goes_on(self.plant):
                    break
                elif news := self.session.inbound.news():  # only while no step is due
                    self.publish("refused", "; ".join(news), {"refused": self.session.inbound.refusals()})
                self.server.poll()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self.failed(why := failure(self.session.name, self.t_ns, error))
            raise why from error
        finally:
            self.leave()
            self.loop.end()

    def next_step(self) -> Any:
        """The step to answer next; None if none arrives within `PATIENCE`.

        A controller that is behind by more than the hold skips to the newest step that is due: the plant would discard
        its answers to the others. While the plant waits for answers there is only one that is due.
        """
        waiting = self._waiting
        if not waiting:
            if (message := self.steps.get(timeout=PATIENCE)) is None:
                return None
            waiting.append(message.said)
        waiting.extend([message.said for message in self.steps.drain()])
        if self._most_behind is not None and waiting[-1].tick - waiting[0].tick > self._most_behind:
            newest = next((step for step in reversed(waiting) if self.loop.due(step.t_ns)), None)
            while newest is not None and waiting[0] is not newest:
                self._skip(waiting.popleft())
        return waiting.popleft()

    def _skip(self, step: Any) -> None:
        """Leave a step unanswered."""
        if step.tick <= self.tick:
            return
        self.tick = step.tick
        self.t_ns = step.t_ns
        self.answered = b""
        if self.loop.due(step.t_ns):
            self._arrived.add(step.tick)
            if self._expected < 0:
                self._expected = step.tick
            self.loop.skip(self._measurements(step))

    def _tell_skipped(self, tick: int) -> None:
        """Publish which steps before `tick`, which is answered now, have no answer, and which of them arrived."""
        if 0 <= self._expected < tick:
            last = tick - self._period
            data = {"first": self._expected, "last": last, "arrived": self._arrived.intervals()}
            begin, end = (at * self._frame_ns * 1e-9 for at in (self._expected, last))
            text = f"{self.session.name} was behind or missed steps: no answer to those from {begin:g} to {end:g} s"
            self.publish(KIND, text, data)
            self._arrived = Ticks(most=self._period)
        self._expected = tick + self._period

    def answer_step(self, step: Any) -> None:
        """Answer one step: with an update if it is new and due; a repeated step gets the same answer."""
        tick = step.tick
        t_ns = step.t_ns
        loop = self.loop
        if tick <= self.tick:
            if tick == self.tick and self.answered:
                self.act.put(self.answered, t_ns)
            return
        self.tick = tick
        self.t_ns = t_ns
        self.answered = b""
        if self._begins_with:
            self.changed(self._begins_with, tick - 1)
            self._begins_with = None
        if tick in self._recorded.unanswered:
            if tick in self._recorded.arrived and loop.due(t_ns):
                loop.skip(self._measurements(step))
            return
        if loop.due(t_ns):
            self._tell_skipped(tick)
            values = self._measurements(step)
            held = loop.held
            refused = loop.refused
            begin = time.perf_counter_ns()
            command = loop.answer(t_ns, values)
            if command or not is_elsewhere(loop.controller):
                self.answered = encode.act(tick, t_ns, command)
                self.act.put(self.answered, t_ns)
            if loop.refused and not refused:
                self.publish("not finite", NOT_FINITE.format(self.session.name), {})
            if self._tells:
                for kind, text in loop.controller.take_events():  # type: ignore[attr-defined]
                    self.publish(kind, text, {})
            self._long = self._long + 1 if time.perf_counter_ns() - begin > LONG_NS else 0
            if self._long == LONG_ANSWERS:
                anywhere()
            if loop.held and not held:
                self.held()

    def _measurements(self, step: Any) -> Any:
        """What the controller gets with a step: all new samples of its sensors, or the latest ones."""
        return self._new_samples(step) if self.loop.every_sample else tuple(map(step.values.__getitem__, self.columns))

    def _new_samples(self, step: Any) -> Samples:
        """The new samples of the sensors that are read; NaN for a sensor that the step does not contain."""
        brought = {}
        first = 0
        for place in step.heard:
            brought[place] = tuple(step.samples[first : first + step.fresh[place]])
            first += step.fresh[place]
        return tuple([brought.get(place, UNHEARD) for place in self.columns])

    def fell_back(self) -> None:
        """Publish that this process has lost real-time scheduling."""
        self.publish("scheduling", f"{self.session.name} left no pause for 0.2 s: real-time scheduling fell back", {})


def made(
    described: run_setup.Setup, name: str, file: Path | None = None, keys: Mapping[str, object] | None = None
) -> Controller:
    """The controller `name` of the scene, or the one in a user's own file. Raises UsageError for an unknown name."""
    if file is not None:
        return load_file(file, keys)
    if name in described.controllers:
        return controllers.restored(described.controllers[name])
    known = ", ".join(described.controllers) or "none"
    raise UsageError(f"the scene has no controller called {name}; it has {known}. A file has a suffix, such as .py")


def run(
    what: str,
    run: str | None = None,
    *,
    changes: Mapping[str, object] | None = None,
    wait: float = 10.0,
    trust: bool = False,
    ticket: Path | None = None,
    say: Callable[[str], object] = lambda _: None,
) -> None:
    """Run the controller `what`, a name in the scene or a file, in a live run (the only one by default).

    `changes`: parameters to begin with; of a file of another tool, all keys of its table. `trust`: run the code of
    foreign parts of the run. `ticket`: of a run on another host. Returns when the plant ends or on a signal to stop;
    raises RigError if it cannot begin, if the controller fails, or if a plant on another host is lost.
    """
    come_first()
    file = Path(what) if Path(what).suffix else None
    table: Mapping[str, object] = {}
    if file is not None and not is_file(what):
        table = changes or {}
        changes = None
    name = file.stem if file is not None else what
    with bus.join(run, role="controller", name=name, wait=wait, ticket=ticket) as session:
        described = run_setup.fetch(session, wait)
        if trust:
            trust_scene(described.scene)
        controller = made(described, name, file, table)
        if is_elsewhere(controller):
            controller.run = "paced" if described.paced and not described.waits else "waits"  # type: ignore[attr-defined]
        worker = Worker(session, described, controller, changes)
        drives = ", ".join(worker.loop.controller.drives)
        reads = ", ".join(worker.loop.controller.reads)
        say(f"{name} drives {drives} and reads {reads or 'nothing'} in {session.run}")
        with ExitStack() as stack:
            stack.enter_context(no_garbage())
            stop = stack.enter_context(stopping())
            stack.enter_context(placed(described.core, described.core))
            if described.paced:
                stack.enter_context(locked())
                stack.enter_context(ahead(CONTROLLER, worker.fell_back))
            worker.follow(stop.is_set)
        counted = ", ".join(f"{count} {what}" for what, count in worker.loop.counters().items())
        say(f"{name} has left {session.run}: {counted}")
        if gone := session.gone:
            raise BusError(gone)


def main(arguments: list[str] | None = None) -> int:
    """`python -m rig.controllers.runtime.process NAME_OR_FILE [--run RUN] [--wait S]`, started by a supervisor."""
    parser = argparse.ArgumentParser(prog="rig.controllers.runtime.process", description=__doc__.partition("\n")[0])
    parser.add_argument("what", help="name of a controller in the scene, or a file")
    parser.add_argument("--run", help="the run to join; by default the only one")
    parser.add_argument("--wait", type=float, default=10.0, help="longest wait for the run [s]")
    given = parser.parse_args(arguments)
    try:
        run(given.what, given.run, wait=given.wait)
    except RigError as error:
        if not tell("fault", str(error)):
            sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    as_process(main)
