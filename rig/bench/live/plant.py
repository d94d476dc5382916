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
after an event, and every `LOOK_NS`. Meanwhile the compiled loop asks the controllers
(rig.bench.live.asked_controllers).

If a controller dies, its last command is held, then its actuators take their safe values; the plant continues. If the
integration must stop, an event states where and why, and the recording is kept.
"""

from __future__ import annotations

import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from typing import Any

from rig import design
from rig.bench.live import pace
from rig.bench.live.asked_controllers import ControllersInPlant, Lockstep, Stopped
from rig.bench.live.finalise import finalise, timing_verdict
from rig.bench.live.housekeeping import Housekeeper, RecorderLag
from rig.bench.live.hub import Hub
from rig.bench.live.operator_commands import Operator
from rig.bench.live.outcome import Job, called
from rig.bench.live.pace import FrameBatches, length
from rig.bench.live.timing import Timing
from rig.bench.run.builds import CommandedRigs, PreparedRigs
from rig.bench.run.experiment import BEGIN, Experiment
from rig.bench.run.runner import PlantRunner
from rig.bus.port import Session
from rig.bus.run_setup import Setup
from rig.errors import NumericsError, RigError
from rig.machine import scheduling
from rig.machine.process import no_garbage
from rig.parts import foreign_fault
from rig.quantities import run_length_ns
from rig.record.provenance import provenance
from rig.scenes.scene import Scene
from rig.structure import model_store

Say = Callable[[str], object]
Show = Callable[[dict[str, Any]], object]
# Longest time [ns of the wall clock] between two looks at operators in lockstep. # chosen: nobody notices it
LOOK_NS = 10_000_000


class Plant:
    """One run of a job on an open session. `stopping()` returns the reason to end at the next frame, or "".

    `sets`: mode sets that a paced run builds before its first frame.
    """

    def __init__(self, session: Session, job: Job, stopping: Callable[[], str], sets: Iterable[int] = ()) -> None:
        self.session = session
        self.job = job
        self.scene = scene = Scene.from_json(job.scene)
        with model_store.collected() as self.models:  # those of the rig that the controllers believe in, too
            self.runner = runner = PlantRunner(scene, piece=length(scene, job.pace))
            described = design.described(scene)
        duration_ns = run_length_ns(job.duration)
        self.experiment = Experiment(scene, runner, duration_ns, self._retune)
        self.cores = scheduling.choose()
        """Cores of the plant's thread (in a paced run) and of the threads of the bus."""
        self.setup = self._setup(described)
        self.hub = hub = Hub(session, self.experiment, self.setup, job.in_lockstep)
        self.operator = Operator(hub)
        self.prepared_rigs: PreparedRigs | None = None
        """Rigs that a paced run builds in advance."""
        self.frame_batches = FrameBatches(self.experiment, job.pace)
        self.timing = Timing(self.frame_batches.length * runner.frame_ns / (job.pace or 1.0), self.frame_batches.length)
        self.housekeeper = Housekeeper(hub, self.operator, job, self.timing)
        self.in_plant = ControllersInPlant(session, self.experiment, self.setup.controllers, self.housekeeper.notice)
        self.fault = ""
        """Why the numerics stopped the run."""
        self.interrupted = False
        """Whether a signal ended the run before the end that its protocol or its duration sets."""
        self.from_start: set[tuple[str, str]] = set()
        """Processes that were connected at the first frame."""
        self.waiting: pace.Waiting | None = None
        self.memory = ""
        """Why the memory of a paced run is not locked; "" if it is."""
        self.ahead: scheduling.Ahead | None = None
        """The real-time scheduling of a paced run."""
        self.begun_ns = 0
        self.refusals: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.say: Callable[[str], object] = lambda _: None
        """Gets lines for the user."""
        self._stopping = stopping
        self._sets = sets
        self.operator.status = self._status

    def recorders(self) -> list[str]:
        """The recorders of the run that are here."""
        return [name for role, name in self.hub.watch.present if role == "recorder" and self.is_recorder(name)]

    def is_recorder(self, name: str) -> bool:
        """Whether a recorder is that of the run: expected, or under a name that no guest can use."""
        return name in self.session.inbound.reserved or ("recorder", name) in self.job.expect

    def _setup(self, controllers: dict[str, dict[str, Any]]) -> Setup:
        scene = self.scene
        runner = self.runner
        return Setup(
            run=self.session.run,
            scene=scene.made_with(self.models).to_json() if self.models else self.job.scene,
            frame_ns=runner.frame_ns,
            step_ns=runner.step_ns,
            outputs={name: runner.units[name] for name in runner.outputs},
            sensors={n: (u, p) for n, u, p in zip(runner.bank.names, runner.bank.units, runner.bank.periods_ns)},
            controllers=controllers,
            paced=self.job.pace is not None,
            core=self.cores[1],
            provenance=provenance(scene.seed, self.job.command or tuple(sys.argv)),
            models=tuple(self.models.values()),
        )

    def _retune(self, controller: str, changes: dict[str, Any]) -> None:
        """Ask a controller to change its parameters. A paced run does not wait for the answer of another process."""
        if controller in self.scene.in_plant:
            self.in_plant.retune(controller, changes)
            return
        ask = partial(self.session.ask, f"param/{controller}", {"set": changes}, timeout=2.0)

        def ask_later() -> None:
            try:
                ask()
            except RigError as fault:
                self.refusals.put(f"{controller}: {fault}")

        if self.job.in_lockstep:
            ask()
        else:
            threading.Thread(target=ask_later, name=f"retune-{controller}", daemon=True).start()

    def gather(self, say: Say) -> None:
        """Wait for the expected processes; `say` gets their names, and later lines of the run."""
        self.say = say
        present = self.hub.watch.present
        deadline = time.monotonic() + self.job.wait
        shown = ""
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
        job = self.job
        experiment = self.experiment
        pacer = None
        with ExitStack() as stack:
            if job.pace is not None:
                self.runner.motion.foresee(self._sets)
                self.prepared_rigs = experiment.prepared_rigs()
                experiment.exchange.rebuild = CommandedRigs(self.runner, experiment.journal, experiment.builds)
                experiment.builds.apart = True
            stack.enter_context(self.timing.interruptions.watched())
            # before real-time scheduling: a garbage collection after compiling takes 0.2 s or more
            stack.enter_context(no_garbage())
            stack.callback(sys.setswitchinterval, sys.getswitchinterval())
            sys.setswitchinterval(1e-4)  # a thread waits a tenth of a frame for the interpreter, instead of five frames
            own, of_bus = self.cores
            stack.enter_context(scheduling.placed(of_bus if job.in_lockstep else own, of_bus))
            if job.pace is not None:
                self.memory = stack.enter_context(scheduling.locked())
                self.ahead = stack.enter_context(scheduling.ahead(scheduling.PLANT, self._fell_back))
                self.waiting = pace.choose(int(self.timing.wall_ns))
                clock = pace.WallClock(self.waiting.spin_ns)
                pacer = pace.Pacer(self.runner.frame_ns, job.pace, self.scene.clock.overrun, clock)
            self.begun_ns = time.perf_counter_ns()
            self.housekeeper.begin(self.begun_ns, pacer)
            others = [name for role, name in sorted(self.from_start) if role != "plant"]
            experiment.journal.note(BEGIN, f"begins with {', '.join(others) or 'nobody else'}", here=others)
            experiment.open()
            if pacer is not None:
                pacer.anchor()
            if job.in_lockstep:
                self._in_lockstep(pacer, show)
            elif pacer is not None:
                self.paced(pacer, show)

    def paced(self, pacer: pace.Pacer, show: Show) -> None:
        """Run all frames, each batch of them when `pacer` says that it is due."""
        hub = self.hub
        operator = self.operator
        experiment = self.experiment
        housekeeper = self.housekeeper
        rows = self.timing
        clock = time.perf_counter_ns
        processor = time.thread_time_ns
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
        hub = self.hub
        experiment = self.experiment
        runner = self.runner
        in_plant = self.in_plant
        end = runner.tick + frames
        while True:
            in_plant.carry_on(min(end, experiment.until(), hub.state_due) if frames > 1 else end)
            if runner.tick >= end:
                return True
            hub.gather_state(runner.tick)
            if not experiment.begin():
                return False

    def _in_lockstep(self, pacer: pace.Pacer | None, show: Show) -> None:
        hub = self.hub
        operator = self.operator
        experiment = self.experiment
        housekeeper = self.housekeeper
        rows = self.timing

        def serve() -> None:
            if housekeeper.look(time.perf_counter_ns()):
                self._report(show)

        lockstep = Lockstep(hub, housekeeper, lambda: bool(self._stopping()))
        runner = self.runner
        journal = experiment.journal
        ahead = 1
        lag = RecorderLag(hub, self.recorders, serve, lambda: bool(self._why()), self.say) if pacer is None else None
        clock = time.perf_counter_ns
        processor = time.thread_time_ns
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
            first = runner.tick
            begun = clock()
            noted = journal.count
            # neither a clock nor an operator nor a controller in the plant process has to act at each tick
            quiet = pacer is None and not operator.paused and not self.in_plant.at_work
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
                    if not goes_on or runner.tick >= until or runner.limited or journal.count > noted:
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
            serve()
            if lag is not None:
                lag.look(looked)
            if pacer is not None:
                spans = (answered - begin, done - answered, looked - done, clock() - looked)
                rows.rows.append((begin, late, pacer.waited, *spans, spent))
            if not goes_on:
                return

    def _status(self) -> dict[str, Any]:
        """How the run goes: timing verdict if it ended now, its reasons, step and end of the protocol, pause and pace.

        What other processes missed is counted at the end.
        """
        paced = self.job.pace is not None
        verdict = timing_verdict(self, self.hub.commands.lost(), [])
        return {
            "verdict": verdict.word if paced else "",
            "reasons": list(verdict.reasons) if paced else [],
            "step": self.experiment.progress().step,
            "done": self.experiment.protocol.done,
            "paused": self.operator.paused,
            "pace": self.job.pace,
        }

    def _fell_back(self) -> None:
        assert self.ahead is not None
        self.experiment.journal.note("scheduling", f"real-time scheduling fell back: {self.ahead.why}")

    def _report(self, show: Show) -> None:
        while not self.refusals.empty():
            self.experiment.journal.note("refused", self.refusals.get(), by="protocol")
        if self.prepared_rigs is not None:
            self.prepared_rigs.look()
        show({"t": self.runner.t_ns / 1e9, **self.housekeeper.health})

    def _ends(self, pacer: pace.Pacer | None) -> bool:
        """Return whether the run must end. During a pause this waits, except for single steps."""
        operator = self.operator
        paused = self.operator.paused
        if paused:
            self.experiment.postponed.step_back()
        why = self._why()
        while not why and operator.paused and not operator.steps:
            self.housekeeper.look(time.perf_counter_ns())
            self.hub.put_events()
            time.sleep(0.01)
            operator.poll()
            self.in_plant.poll()
            why = self._why()
        if paused and pacer is not None:
            pacer.anchor()
        operator.steps -= operator.paused and operator.steps > 0
        if pacer is not None and pacer.stopped:
            why = "stopped: a frame began more than one frame late, and the scene asks to stop then"
        if why:
            self.experiment.stop(why)
        return bool(why)

    def _why(self) -> str:
        why = self._stopping()
        self.interrupted = bool(why) and self.experiment.ends
        gone = "stopped: the process that started the plant has gone" if self.housekeeper.gone else ""
        return gone or why or self.operator.stopped
