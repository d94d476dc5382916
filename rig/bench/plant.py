"""The plant of a live run: in lockstep with its controllers, at the pace of the wall clock, or both.

A frame of a paced run            A frame in lockstep
  wait until it is due              collect state and samples, if due
  receive messages                  protocol, if due; operators, every few milliseconds of the wall clock
  send step, samples, state         send step
  protocol, operators               wait for the controllers that joined and are due
  commands in force                 commands in force
  integrate                         integrate

In lockstep plant and controllers work one after the other, so that a tick takes the time of all that both do for it.
Therefore the plant looks at operators, presence of processes and events only when the protocol has something to do,
after an event, and every `LOOK_NS`. Meanwhile the compiled loop asks the controllers (rig.bench.lockstep).

If a controller dies, its last command is held, then its actuators take their safe values; the plant continues. If the
integration must stop, an event states where and why, and the recording is kept.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import Any

from rig import pinned_memory, placement, scheduling
from rig.bench import pace
from rig.bench.experiment import BEGIN
from rig.bench.finalise import finalise, timing_verdict
from rig.bench.job import Job, called
from rig.bench.lockstep import Lockstep, Stopped
from rig.bench.plant_parts import PlantParts
from rig.bench.prepared_rigs import PreparedRigs
from rig.bench.rebuild import Rebuild
from rig.bench.recorder_lag import RecorderLag
from rig.bus.port import Session
from rig.errors import NumericsError
from rig.parts import foreign_fault
from rig.process import no_garbage

Say = Callable[[str], object]
Show = Callable[[dict[str, Any]], object]
LOOK_NS = 10_000_000
"""Longest time [ns of the wall clock] between two looks at operators in lockstep. # chosen: nobody notices it"""


class Plant(PlantParts):
    """One run of a job on an open session. `stopping()` returns the reason to end at the next frame, or "".

    `sets`: mode sets that a paced run builds before its first frame.
    """

    def __init__(self, session: Session, job: Job, stopping: Callable[[], str], sets: Iterable[int] = ()) -> None:
        super().__init__(session, job)
        self._stopping, self._sets = stopping, sets
        self.operator.status = self._status

    def gather(self, say: Say) -> None:
        """Wait for the expected processes; `say` gets their names, and later lines of the run."""
        self.say = say
        present, deadline, shown = self.hub.watch.present, time.monotonic() + self.job.wait, ""
        self.hub.look()
        while missing := [called(role, name) for role, name in self.job.expect if (role, name) not in present]:
            if self._stopping() or self.housekeeper.orphaned():
                return
            waited = [who for who in missing if who not in self.operator.excused]
            if not waited or self.operator.begun or time.monotonic() >= deadline:
                self.housekeeper.miss(missing)
                break
            if (text := f"waiting for {', '.join(waited)}") != shown:
                shown = text
                say(text)
            self.hub.look(0.02)
            self.hub.serve_scene()
            self.operator.poll()
        self.from_start = set(present)

    def run(self, show: Show) -> dict[str, Any]:
        """Run all frames and return the summary; `show` gets the health five times per second."""
        try:
            self.run_frames(show)
        except NumericsError as error:
            self.fault = str(error)
            data = {"time": error.time, "mode": error.mode, "state": error.state}
            self.experiment.journal.note("diverged", self.fault, **data)
        except Exception as error:
            self.housekeeper.faults.append("the plant process failed")
            self.experiment.journal.note("fault", foreign_fault(error) or traceback.format_exc())
            finalise(self)
            raise
        return finalise(self)

    def run_frames(self, show: Show) -> None:
        """Run all frames, without the summary; see `run`."""
        job, pacer = self.job, None
        with ExitStack() as stack:
            if job.pace is not None:
                self.runner.motion.foresee(self._sets)
                self.prepared_rigs = PreparedRigs(self.experiment)
                self.experiment.exchange.rebuild = Rebuild(self.runner, self.experiment.journal, self.experiment.builds)
                self.experiment.builds.apart = True
            stack.enter_context(self.timing.interruptions.watched())
            # before real-time scheduling: a garbage collection after compiling takes 0.2 s or more
            stack.enter_context(no_garbage())
            stack.callback(sys.setswitchinterval, sys.getswitchinterval())
            sys.setswitchinterval(1e-4)  # a thread waits a tenth of a frame for the interpreter, instead of five frames
            own, of_bus = self.cores
            stack.enter_context(placement.placed(of_bus if job.in_lockstep else own, of_bus))
            if job.pace is not None:
                self.memory = stack.enter_context(pinned_memory.locked())
                self.ahead = stack.enter_context(scheduling.ahead(scheduling.PLANT, self._fell_back))
                self.waiting = pace.choose(int(self.timing.wall_ns))
                clock = pace.WallClock(self.waiting.spin_ns)
                pacer = pace.Pacer(self.runner.frame_ns, job.pace, self.scene.clock.overrun, clock)
            self.begun_ns = time.perf_counter_ns()
            self.housekeeper.begin(self.begun_ns, pacer)
            others = [name for role, name in sorted(self.from_start) if role != "plant"]
            self.experiment.journal.note(BEGIN, f"begins with {', '.join(others) or 'nobody else'}", here=others)
            self.experiment.open()
            if pacer is not None:
                pacer.anchor()
            if job.in_lockstep:
                self._in_lockstep(pacer, show)
            elif pacer is not None:
                self.paced(pacer, show)

    def paced(self, pacer: pace.Pacer, show: Show) -> None:
        """Run all frames, each batch of them when `pacer` says that it is due."""
        hub, operator, experiment = self.hub, self.operator, self.experiment
        housekeeper, rows = self.housekeeper, self.timing
        clock, processor = time.perf_counter_ns, time.thread_time_ns
        while True:
            frames = self.frame_batches.next(rows)
            hub.carries(frames)
            begin, late = pacer.wait(frames)
            spent = processor()
            hub.commands.receive()
            received = clock()
            hub.put_step(self.runner.tick)
            hub.gather(self.runner.tick)
            sent = clock()
            if not experiment.begin() or self._ends(pacer):
                rows.rows.append((begin, late, pacer.waited, 0, 0, 0, 0, spent))
                return
            operator.poll()
            self.in_plant.poll()
            goes_on = self._carry(frames)
            done = clock()
            if frames > 1:
                hub.put_applied()
            hub.put_events()
            looked = clock()
            if housekeeper.look(looked):
                self._report(show)
            served = clock()
            spans = (received - begin, done - sent, sent - received + looked - done, served - looked)
            rows.rows.append((begin, late, pacer.waited, *spans, spent))
            if not goes_on:
                return

    def _carry(self, frames: int) -> bool:
        """Advance the plant by a batch of frames and return whether the run continues.

        At the first tick everything except the commands is already done.
        """
        hub, experiment, runner, in_plant = self.hub, self.experiment, self.runner, self.in_plant
        end = runner.tick + frames
        while True:
            in_plant.carry_on(min(end, experiment.until(), hub.state_due) if frames > 1 else end)
            if runner.tick >= end:
                return True
            hub.gather_state(runner.tick)
            if not experiment.begin():
                return False

    def _in_lockstep(self, pacer: pace.Pacer | None, show: Show) -> None:
        hub, operator, experiment = self.hub, self.operator, self.experiment
        housekeeper, rows = self.housekeeper, self.timing
        lockstep, runner = Lockstep(hub, housekeeper, lambda: bool(self._stopping())), self.runner
        events, ahead = experiment.journal.events, 1
        lag = self._lag(show) if pacer is None else None
        clock, processor = time.perf_counter_ns, time.thread_time_ns
        while True:
            frames = self.frame_batches.next(rows)
            hub.carries(frames)
            if pacer is not None:
                begin, late = pacer.wait(frames)
                spent = processor()
            hub.gather(runner.tick)
            if not experiment.begin() or self._ends(pacer):
                return
            operator.poll()
            self.in_plant.poll()
            self.in_plant.partners = lockstep.look()
            first, begun, noted = runner.tick, clock(), len(events)
            quiet = self._quiet(pacer)
            until = min(experiment.until(), hub.checkpoint_due, first + ahead) if quiet else first + frames
            goes_on = True
            try:
                while True:
                    lockstep.exchange(runner.tick)
                    answered = clock()
                    if quiet and lockstep.asks_each_tick:
                        self.in_plant.carry_on(until)
                    else:
                        goes_on = self._carry(frames)
                    if not goes_on or runner.tick >= until or runner.limited or len(events) > noted:
                        break
            except Stopped:
                self._ends(pacer)
                return
            done = clock()
            ahead = max((runner.tick - first) * LOOK_NS // (done - begun), 1)
            if frames > 1:
                hub.put_applied()
            hub.put_events()
            looked = clock()
            if housekeeper.look(looked):
                self._report(show)
            if lag is not None:
                lag.look(looked)
            if pacer is not None:
                spans = (answered - begin, done - answered, looked - done, clock() - looked)
                rows.rows.append((begin, late, pacer.waited, *spans, spent))
            if not goes_on:
                return

    def _quiet(self, pacer: pace.Pacer | None) -> bool:
        """Whether neither a clock nor an operator nor a controller in the plant process has to act at each tick."""
        return pacer is None and not self.operator.paused and not self.in_plant.at_work

    def _status(self) -> dict[str, Any]:
        """How the run goes: the timing verdict if it ended now, its reasons, the step of the protocol, pause and pace.

        What other processes missed is counted at the end.
        """
        verdict = timing_verdict(self, self.hub.commands.lost(), [])
        word, reasons = (verdict.word, list(verdict.reasons)) if self.job.pace is not None else ("", [])
        return {
            "verdict": word,
            "reasons": reasons,
            "step": self.experiment.progress().step,
            "paused": self.operator.paused,
            "pace": self.job.pace,
        }

    def _lag(self, show: Show) -> RecorderLag:
        housekeeper = self.housekeeper

        def serve() -> None:
            if housekeeper.look(time.perf_counter_ns()):
                self._report(show)

        return RecorderLag(
            self.hub, self.recorders, serve, lambda: bool(self._stopping()) or housekeeper.gone, self.say
        )

    def _fell_back(self) -> None:
        assert self.ahead is not None
        text = f"real-time scheduling fell back: {self.ahead.why}"
        self.experiment.journal.note("scheduling", text)

    def _report(self, show: Show) -> None:
        while not self.refusals.empty():
            self.experiment.journal.note("refused", self.refusals.get(), by="protocol")
        if self.prepared_rigs is not None:
            self.prepared_rigs.look()
        show({"t": self.runner.t_ns / 1e9, **self.housekeeper.health})

    def _ends(self, pacer: pace.Pacer | None) -> bool:
        """Return whether the run must end. During a pause this waits, except for single steps."""
        operator, paused = self.operator, self.operator.paused
        if paused:
            self.experiment.postponed.step_back()
        while not (why := self._why()) and operator.paused and not operator.steps:
            self.housekeeper.look(time.perf_counter_ns())
            self.hub.put_events()
            time.sleep(0.01)
            operator.poll()
            self.in_plant.poll()
        if paused and pacer is not None:
            pacer.anchor()
        operator.steps -= operator.paused and operator.steps > 0
        if pacer is not None and pacer.stopped:
            why = "stopped: a frame began more than one frame late, and the scene asks to stop then"
        if why:
            self.experiment.stop(why)
        return bool(why)

    def _why(self) -> str:
        if self.housekeeper.gone:
            return "stopped: the process that started the plant has gone"
        why = self._stopping()
        self.interrupted = bool(why) and self.experiment.ends
        return why or self.operator.stopped
