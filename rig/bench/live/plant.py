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

At its end (`finalise`) the plant publishes how many messages it sent; recorders and controllers answer with how many
they received. The difference is a loss. Then the plant publishes the timing verdict and the totals again, so that they
include it.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

from rig import controllers, design
from rig.bench.live import pace
from rig.bench.live.asked_controllers import NO_BOARD, ControllersInPlant, Lockstep, Stopped
from rig.bench.live.housekeeping import Housekeeper, RecorderLag
from rig.bench.live.hub import Hub, missing
from rig.bench.live.operator_commands import Operator
from rig.bench.live.outcome import Job, called
from rig.bench.live.pace import FrameBatches, length
from rig.bench.live.stream_ports import StreamPorts
from rig.bench.live.timing import Timing, TimingVerdict
from rig.bench.run.builds import CommandedRigs, PreparedRigs
from rig.bench.run.experiment import BEGIN, Experiment
from rig.bench.run.runner import PlantRunner
from rig.bus import messages
from rig.bus.inbound import TICKS
from rig.bus.port import Session
from rig.bus.run_setup import Setup
from rig.controllers.device import Device
from rig.controllers.runtime.loop import Loop
from rig.errors import BusError, DeviceError, ExitCode, NumericsError, RigError
from rig.machine import scheduling
from rig.machine.process import no_garbage
from rig.parts import foreign_fault
from rig.printable import counted
from rig.quantities import run_length_ns
from rig.record.provenance import provenance
from rig.scenes.scene import Scene
from rig.structure import model_store

# Longest wait for the totals of the other processes, and for a sign that a recorder still catches up [s].
ANSWERS_S = 5.0
# Longest wait for a recorder that catches up [s]. # chosen: what waits for it fits into 160 MB
CATCH_UP_S = 300.0
TELL_S = 2.0
"""Time between two lines about a recorder that catches up [s]."""
COUNTERS_S = 1.0  # longest wait for the counters of a controller [s]; it looks for questions ten times per second
LAST_ANSWER_S = 0.1  # longest wait for the answers to the last steps [s]

Say = Callable[[str], object]
Show = Callable[[dict[str, Any]], object]
# Longest time [ns of the wall clock] between two looks at operators in lockstep. # chosen: nobody notices it
LOOK_NS = 10_000_000


def finalise(plant: Plant) -> dict[str, Any]:
    """End the run of `plant` and return its summary."""
    hub = plant.hub
    experiment = plant.experiment
    runner = plant.runner
    now = time.perf_counter_ns()
    wall = now - plant.begun_ns if plant.begun_ns else 0
    plant.operator.close()
    hub.collect()  # a batch of frames may have ended before its last tick
    hub.put_applied()
    hub.put_rest()
    ended = "diverged" if plant.fault else experiment.over or "failed"
    experiment.end()
    counters = _counters(plant)
    plant.streams.close()
    plant.housekeeper.faults += [*experiment.postponed.never, *plant.in_plant.failures]
    for name, counts in counters.items():
        if counts["refused"]:
            plant.housekeeper.faults.append(
                f"{counted(counts['refused'], 'answer')} of {name} not finite, and not sent"
            )
        if counts["skipped"]:
            plant.housekeeper.faults.append(f"{name} was behind and skipped {counted(counts['skipped'], 'step')}")
        missed = counts.get("missed", 0)
        if missed > plant.scene.clock.late_share_valid * counts.get("asked", 0):  # fewer count as late frames do
            plant.housekeeper.faults.append(f"{counted(missed, 'step')} to {name} without an answer of its board")
    experiment.journal.note("end", ended)
    hub.put_events()
    plant.in_plant.leave()
    plant.housekeeper.tell_health(now)
    lost, unknown = _lost_elsewhere(plant)
    lost |= _unanswered(plant, {name: counts["skipped"] + counts.get("missed", 0) for name, counts in counters.items()})
    hub.commands.receive()
    lost |= hub.commands.lost()
    verdict = timing_verdict(plant, lost, unknown)
    code = verdict.exit_code or (ExitCode.INTERRUPTED if plant.interrupted else ExitCode.DONE)
    if plant.fault or experiment.aborted:
        code = ExitCode.STOPPED
    elif ended in ("failed", NO_BOARD):
        code = ExitCode.FAILED
    statistics = runner.statistics()
    t = runner.t_ns / 1e9
    summary: dict[str, Any] = {
        "run": plant.session.run,
        "scene": plant.scene.name,
        "verdict": verdict.word,
        "reasons": list(verdict.reasons),
        "exit_code": code,
        "ended": ended,
        "fault": plant.fault or experiment.aborted,
        "mode": _mode(plant.job),
        "pace": plant.job.pace,
        "ticks": runner.tick,
        "seconds": t,
        "wall_seconds": wall / 1e9,
        "rate": t * 1e9 / wall if wall else 0.0,
        "timing": plant.timing.to_json() if plant.job.pace else {},
        "waiting": plant.waiting._asdict() if plant.waiting else {},
        "scheduling": plant.ahead.account if plant.ahead else "",
        "memory": plant.memory,
        "round_trip": hub.commands.round_trip.to_json(),
        **({"links": links} if (links := hub.commands.by_link()) else {}),
        "loop": experiment.exchange.counters(),
        "controllers": counters,
        "lost": lost,
        "unknown": unknown,
        "refused": plant.session.inbound.refusals(),
        "faults": [*plant.housekeeper.faults, *plant.streams.faults()],
        "postponed": experiment.postponed.to_json(),
        "energy": statistics.pop("energy"),
        "plant": statistics,
        "audit": runner.audit(),
        "sensors": runner.bank.counters(),
        **({"streams": streams} if (streams := plant.streams.counters()) else {}),
        **({"network": network} if (network := experiment.network()) else {}),
        "processor_seconds": sum(os.times()[:2]),
    }
    summary = json.loads(json.dumps(summary, default=float))
    event = messages.event(runner.t_ns, runner.tick, "plant", "verdict", verdict.word, summary)
    plant.session.publisher("event/plant").put(event, runner.t_ns)
    hub.put_totals()
    return summary


def _mode(job: Job) -> str:
    """Which clock the run has, in the words of its summary."""
    if not job.pace:
        return "lockstep, not paced"
    return "lockstep" if job.in_lockstep else "paced"


def timing_verdict(plant: Plant, lost: dict[str, int], unknown: list[str]) -> TimingVerdict:
    """The timing verdict of a run. `lost`: messages by topic; `unknown`: processes whose losses are unknown."""
    faults = [*plant.housekeeper.faults, *plant.streams.faults()]
    for name, commands in plant.experiment.exchange.all_queues.items():
        if commands.counts.safe:
            faults.append(f"safe values replaced the commands of {name} {counted(commands.counts.safe, 'time')}")
        if commands.counts.not_finite:
            faults.append(f"{counted(commands.counts.not_finite, 'command')} of {name} not finite")
    if plant.fault:
        faults.append(plant.fault.partition("\n")[0])
    clock = plant.scene.clock
    pacer = plant.housekeeper.pacer
    return plant.timing.verdict(
        clock.late_share_valid, clock.late_share_degraded, lost, faults, pacer is not None and pacer.stopped, unknown
    )


def _counters(plant: Plant) -> dict[str, dict[str, int]]:
    """Controller -> its counters (`Loop.counters`); those of another process are asked for, if it is still here."""
    counters = plant.in_plant.counters()
    here = plant.hub.watch.present
    for name in plant.experiment.exchange.queues:
        if name not in counters and ("controller", name) in here:
            with suppress(BusError, LookupError, TypeError):  # one in another language has none
                told = plant.session.ask(f"param/{name}", {"get": []}, COUNTERS_S)["counters"]
                section = plant.scene.controllers.get(name)
                names = Loop.COUNTED if section is None else Loop.names_of(controllers.controller_class(section))
                counts = {what: told[what] for what in names}
                if all(type(count) is int and 0 <= count < TICKS for count in counts.values()):
                    counters[name] = counts
    return counters


def _unanswered(plant: Plant, skipped: Mapping[str, int]) -> dict[str, int]:
    """Return the number of steps without an answer, for each controller that was connected during the whole run.

    `skipped`: controller -> number of steps that it received and left out, or that its board did not answer.
    """
    hub = plant.hub
    unanswered = {}
    if plant.job.in_lockstep:  # a step in lockstep is repeated until it is answered
        return {}
    here = plant.from_start & hub.watch.present
    deadline = time.monotonic() + LAST_ANSWER_S
    asked = plant.scene.controllers.keys() - hub.in_plant
    for name in sorted(name for role, name in here if role == "controller" and name in asked):
        left_out = skipped.get(name, 0)
        while hub.commands.unanswered(name) > left_out:
            left = deadline - time.monotonic()
            if left <= 0.0:
                break
            hub.commands.next(left)
        if (count := hub.commands.unanswered(name) - left_out) > 0:
            unanswered[f"step to {name}"] = count
    return unanswered


def _lost_elsewhere(plant: Plant) -> tuple[dict[str, int], list[str]]:
    """Return the messages that others miss ("topic to name" -> number), and the recorders that did not answer.

    Only the recorder of the run and controllers that drive an actuator count: a viewer may drop what it cannot draw,
    and a guest may use any name.
    """
    hub = plant.hub
    session = plant.session
    queues = plant.experiment.exchange.queues
    hub.totals.drain()
    hub.put_totals()
    own = messages.decode("total/plant", session.totals())
    sent = {topic: n for topic, n in zip(own.sent_topic, own.sent) if topic != "total/plant"}
    roles = dict.fromkeys(plant.recorders(), "recorder")
    asked = set(roles)
    roles |= {name: role for role, name in hub.watch.present if role == "controller" and name in queues}
    missed: dict[str, int] = {}
    t = plant.runner.t_ns / 1e9
    deadline = time.monotonic() + ANSWERS_S
    last = time.monotonic() + CATCH_UP_S
    tell = time.monotonic() + TELL_S
    while asked:
        left = min(deadline, last) - time.monotonic()
        if left <= 0.0:
            break
        message = hub.totals.get(left)
        if message is None:
            break
        name = message.topic.partition("/")[2]
        if name not in roles or not hub.commands.speaks_for(message.user, name):
            continue
        if roles[name] == "recorder" and "total/plant" not in message.said.heard_topic:
            deadline = time.monotonic() + ANSWERS_S  # a plant as fast as possible outruns it; it goes on writing
            if time.monotonic() > tell:
                tell = time.monotonic() + TELL_S
                plant.say(f"waiting for {name}: {message.t_ns / 1e9:.1f} of {t:.1f} s are written")
            continue
        asked.discard(name)
        wanted = sent if roles[name] == "recorder" else {"step": sent["step"]}
        whole = (roles[name], name) in plant.from_start
        for topic, count in missing(wanted, message.said, whole).items():
            missed[f"{topic} to {name}"] = count
    plant.housekeeper.faults += [f"{roles[name]} {name} did not report what it received" for name in sorted(asked)]
    away = plant.from_start - hub.watch.present
    gone = {name for role, name in away if role == "recorder" and plant.is_recorder(name)}
    return missed, [f"recorder {name}" for name in sorted(asked | gone)]


class Plant:
    """One run of a job on an open session. `stopping()` returns the reason to end at the next frame, or "".

    `sets`: mode sets that a paced run builds before its first frame.
    """

    def __init__(self, session: Session, job: Job, stopping: Callable[[], str], sets: Iterable[int] = ()) -> None:
        self.session = session
        self.job = job
        self.scene = scene = Scene.from_json(job.scene)
        with model_store.collected() as self.models:  # those of the rig that the controllers believe in, too
            self.runner = runner = PlantRunner(
                scene, piece=length(scene, job.pace), measured=None if job.in_lockstep else {}
            )
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
        self.boards = {name for name, section in scene.controllers.items() if isinstance(section, Device)}
        """Controllers without which the run does not begin, and in lockstep ends."""
        self.streams = StreamPorts(scene, runner, self.experiment.journal)
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
            waits=self.job.in_lockstep,
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
        tickets = {f"controller {seat}": ticket for seat, ticket in self.session.tickets.items()}
        present = self.hub.watch.present
        deadline = time.monotonic() + self.job.wait
        shown = ""
        self.hub.look()
        while missing := [called(role, name) for role, name in self.job.expect if (role, name) not in present]:
            if self._stopping() or self.housekeeper.orphaned():
                return
            waited = [who for who in missing if who not in self.operator.excused]
            away = [who for who in waited if who in tickets]
            late = time.monotonic() >= deadline and not away  # a ticket is carried to its host by hand
            if not waited or self.operator.begun or late:
                self.housekeeper.miss(missing)
                if boards := [who for who in missing if who.removeprefix("controller ") in self.boards]:
                    raise DeviceError(f"{', '.join(boards)} is not here: a run does not begin without its board")
                break
            named = [f"{who} (ticket {tickets[who]})" if who in away else who for who in waited]
            text = f"waiting for {', '.join(named)}"
            if text != shown:
                shown = text
                say(text)
            self.hub.look(0.02)
            self.hub.serve_scene()
            self.operator.poll()
        self.streams.wait(self._stopping)
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
            self.streams.receive()
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
