"""A run in this process: the same plant runner, exchange and controllers as in a live run, without a bus.

It runs as fast as possible. Frames run in one piece up to the next tick at which something acts: the protocol, a limit,
or a command that the compiled loop cannot put into force. Commands of a disconnected controller are discarded; it is
called afterwards, with the samples of each of its ticks.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from rig import design
from rig.bench.run.checkpoint import KeptState, interval
from rig.bench.run.exchange import Exchange, Playback
from rig.bench.run.experiment import BEGIN, Experiment
from rig.bench.run.local_controllers import LOST, CompiledControllers, ControllerInProcess, Guest, loop_of
from rig.bench.run.runner import PlantRunner, ResumedRunner, Resumption
from rig.controllers import controller_drives, restored
from rig.controllers.blocks.base import Controller, gets_every_sample, is_elsewhere
from rig.controllers.runtime.loop import Loop
from rig.controllers.runtime.skipped import SkippedSteps
from rig.errors import ControllerFailed, NumericsError, UsageError
from rig.record.run import Commands, Run, Samples
from rig.scenes.protocol import Connect, Disconnect, Repeat
from rig.scenes.scene import Scene
from rig.structure import model_store

Tell = Callable[[int, int], object]
"""Gets the simulated seconds so far and of the whole run."""
NOBODY: Mapping[str, Guest] = {}
Stop = Callable[[], str]
"""Returns why to stop, or "" to continue."""


class Recorded(NamedTuple):
    """Actions of a recorded run, repeated at the same ticks with the same values: commands and actions of operators.

    Before tick `end` no command of a controller counts; without `end` none in the whole run. `skipped`: controller ->
    the steps before `end` that it did not answer. `whole`: controllers whose recorded commands count after `end`, too.
    `measured`: samples of the sensors; those of streams are published again (rig.sensors.stream).

    `resumption`: where to begin to simulate; before that measurements are played. None: at the begin.
    """

    commands: Mapping[str, Commands]
    events: Iterable[Mapping[str, Any]] = ()
    end: int | None = None
    resumption: Resumption | None = None
    skipped: Mapping[str, SkippedSteps] = MappingProxyType({})
    whole: Collection[str] = ()
    measured: Mapping[str, Samples] | None = None


def simulate(
    scene: Scene,
    controllers: Mapping[str, Controller] | None = None,
    duration_ns: int | None = None,
    recorded: Recorded | None = None,
    stop: Stop | None = None,
    tell: Tell | None = None,
    guests: Mapping[str, Guest] = NOBODY,
    audited: bool = True,
    boards: bool = False,
) -> Run:
    """Run `scene` for `duration_ns`, or for the duration of its protocol.

    `controllers`: by name; by default those of the scene, with their design values. `guests`: controllers that the
    scene does not know; they are admitted before the first tick.
    `recorded`: actions of a recorded run to repeat. `stop` is called ten times per simulated second; it returns why to
    stop, or "". `tell` is called after each piece of the run, and changes none of them. `audited`: judge the effects
    in the summary, which takes as long as a short run. `boards`: controllers on other hardware take part. If the
    integration has to stop, the run up to there is returned with `fault`, and its events say what happened; the same if
    the code of a controller raises an exception, which is then the cause of `Run.failure`. Raises
    UsageError without a duration.
    """
    if duration_ns is None and scene.duration_ns is None:
        raise UsageError(f"{scene.name} has no protocol that ends; state a duration, e.g. --duration 10")
    duration_ns = scene.duration_ns if duration_ns is None else duration_ns
    own: dict[str, dict[str, Any]] = {}
    with model_store.collected() as models:  # those of the rig that the controllers believe in, too
        if controllers is None:
            own = design.described(scene)
            played = () if recorded is None else recorded.whole
            controllers = {name: restored(own[name]) for name in own if name not in played}
            for controller in controllers.values():
                if boards and is_elsewhere(controller):
                    controller.run = "waits"  # type: ignore[attr-defined]
        carried = carry_out(scene, controllers, duration_ns, recorded, stop, tell, guests)
    for model in models.values():  # drawing the run assembles its rig again
        model_store.offer(model)
    run = _run(scene.made_with(models), tuple(models.values()), audited, carried)
    run.controllers = own
    run.failure = carried.failed
    return run


class FinishedRun(NamedTuple):
    """The objects of a finished run in this process; `fault`: why it had to stop, `failed`: if a controller was why.

    `checkpoints`: tick -> checkpoint (rig.bench.run.checkpoint).
    """

    runner: PlantRunner
    experiment: Experiment
    loops: dict[str, Loop]
    fault: str
    checkpoints: dict[int, bytes]
    failed: ControllerFailed | None = None


def carry_out(
    scene: Scene,
    controllers: Mapping[str, Controller],
    duration_ns: int | None = None,
    recorded: Recorded | None = None,
    stop: Stop | None = None,
    tell: Tell | None = None,
    guests: Mapping[str, Guest] = NOBODY,
) -> FinishedRun:
    """Simulate like `simulate`, without making a `Run`. Without a duration the run ends when `stop` says so."""
    experiment, working = begun(scene, controllers, duration_ns, recorded, guests=guests)
    runner = experiment.runner
    every = max(100_000_000 // scene.frame_ns, 1)
    apart = interval(runner.frame_ns, runner.step_ns)
    checkpoints: dict[int, bytes] = {}
    fault = ""
    failed = None
    try:
        while experiment.begin():
            until = min(experiment.until(), runner.tick + apart - runner.tick % apart)
            if stop is not None:
                until = min(until, runner.tick + every - runner.tick % every)
            carry_on(experiment, working, until)
            kept = None if runner.tick % apart or experiment.aborted else runner.checkpoint()
            if kept:
                checkpoints[runner.tick] = kept
            if tell is not None and duration_ns:
                tell(runner.t_ns // 1_000_000_000, -(-duration_ns // 1_000_000_000))
            why = "" if stop is None else stop()
            if why:
                experiment.stop(why)
    except NumericsError as error:
        fault = str(error)
        experiment.journal.note("diverged", fault)
        for asked in working:
            asked.catch_up(runner.tick + 1)
    except ControllerFailed as error:
        fault = str(error)
        failed = error
        experiment.stop("a controller failed")
        trace = "".join(traceback.format_exception(error.__cause__))
        experiment.journal.note(LOST, fault, controller=error.name, trace=trace)
    finally:
        for asked in working:
            asked.loop.end()
    experiment.end()
    loops = {controller.name: controller.loop for controller in working}
    return FinishedRun(runner, experiment, loops, fault, checkpoints, failed)


def begun(
    scene: Scene,
    controllers: Mapping[str, Controller],
    duration_ns: int | None = None,
    recorded: Recorded | None = None,
    before: Callable[[Experiment], object] = lambda _: None,
    guests: Mapping[str, Guest] = NOBODY,
    measured: Mapping[str, Samples] | None = None,
) -> tuple[Experiment, list[ControllerInProcess]]:
    """A run in this process at its first tick, and its controllers.

    `before` is called with the experiment before it is opened. `measured`: see `PlantRunner`.
    """
    loops = {name: loop_of(name, controller) for name, controller in controllers.items()}
    loops |= {name: loop_of(name, guest.controller) for name, guest in guests.items()}

    def retune(name: str, changes: Mapping[str, Any]) -> None:
        if name in loops:  # none in a re-simulation: their commands are recorded
            loops[name].retune(changes)

    frames = (duration_ns or 0) // scene.frame_ns
    if recorded is not None:
        measured = recorded.measured
    if recorded is None or recorded.resumption is None:
        runner = PlantRunner(scene, truthful=True, piece=frames, measured=measured)
    else:
        runner = ResumedRunner(scene, recorded.resumption, frames)
    experiment = Experiment(
        scene,
        runner,
        duration_ns,
        retune,
        exchange=Exchange if recorded is None else Playback,
        events=() if recorded is None else recorded.events,
    )
    if isinstance(experiment.exchange, Playback):
        assert recorded is not None
        experiment.exchange.play(recorded.commands, recorded.end, recorded.whole)
    before(experiment)
    if guests:
        _welcome(experiment, guests)
    experiment.open()
    working = [ControllerInProcess(name, loop, experiment) for name, loop in sorted(loops.items())]
    for asked in working:
        asked.expect(frames // asked.queue.period)
        if recorded is not None and asked.name in recorded.skipped:
            asked.skipped = recorded.skipped[asked.name]
    return experiment, working


def _welcome(experiment: Experiment, guests: Mapping[str, Guest]) -> None:
    """Admit guests as a live run does before its first frame. Raises UsageError for one that cannot be admitted."""
    sensors = experiment.runner.bank.names
    for name, (controller, delay_ns) in guests.items():
        if missing := [sensor for sensor in controller.reads if sensor not in sensors]:
            raise UsageError(f"{name} reads {', '.join(missing)}; the sensors are {', '.join(sensors)}")
        hears = gets_every_sample(controller)
        experiment.admit(name, controller.drives, controller.period_ns, hears, delay_ns=delay_ns)
    experiment.journal.note(BEGIN, f"begins with {', '.join(guests)}", here=[*experiment.exchange.queues])


def carry_on(
    experiment: Experiment,
    working: Sequence[ControllerInProcess],
    until: int,
    inside: CompiledControllers | None = None,
) -> None:
    """Step the plant runner to tick `until` or until a limit is exceeded; on the way only controllers act.

    `inside`: lends controllers to the compiled loop; callers that call this often pass their own.
    """
    runner = experiment.runner
    exchange = experiment.exchange
    if until - runner.tick == 1 and not working:  # each frame of a run whose controllers have processes
        exchange.take_over()
        runner.frames(1)
        return
    inside = inside or CompiledControllers(experiment)
    plays = exchange.plays
    heard = [asked for asked in working if asked.queue.connected and not plays]
    others = [asked for asked in working if plays or not asked.queue.connected]
    while True:
        for asked in working:
            asked.answer()
        exchange.take_over()
        tick = runner.tick
        end = until
        compiled = inside.lend(heard) if end - tick > 1 else ()
        for asked in heard:
            if asked.name not in compiled:
                end = min(end, asked.due)
        waits = exchange.until(compiled) if end - tick > 1 else None
        if waits is not None:
            end = min(end, waits)
        try:
            runner.frames(end - tick)
        finally:
            inside.take_back()
        for asked in others:
            asked.catch_up(runner.tick, plays)
        if runner.tick >= until or runner.limited:
            return


def _run(scene: Scene, models: tuple[bytes, ...], audited: bool, finished: FinishedRun) -> Run:
    runner = finished.runner
    experiment = finished.experiment
    truth = runner.truth
    measurements = runner.measurements
    assert truth is not None
    assert measurements is not None
    runner.hand_over(truth)
    outputs, modes = truth.outputs()
    units = dict(runner.units)
    units |= {f"meas/{name}": unit for name, unit in zip(runner.bank.names, runner.bank.units)}
    events = [event._asdict() for event in experiment.journal.events] + truth.events()
    statistics = runner.statistics()
    time = np.arange(len(modes), dtype=np.float64)
    time *= runner.step_ns * 1e-9
    return Run(
        scene=scene.to_json(),
        step_ns=runner.step_ns,
        frame_ns=runner.frame_ns,
        time=time,
        signals=dict(zip(runner.outputs, outputs)),
        units=units,
        measurements=measurements.samples(),
        commands={name: queue.commands() for name, queue in experiment.exchange.all_queues.items()},
        events=sorted(events, key=lambda event: event["t_ns"]),
        energy=statistics.pop("energy"),
        summary={
            "ended": experiment.over or "stopped by the numerics",
            "plant": statistics,
            "audit": runner.audit() if audited else [],
            "exchange": experiment.exchange.counters(),
            "controllers": {name: loop.counters() for name, loop in finished.loops.items()},
            "sensors": runner.bank.counters(),
            **({"network": network} if (network := experiment.network()) else {}),
        },
        mode=modes,
        models=models,
        fault=finished.fault,
        checkpoints=finished.checkpoints,
    )


class RestartableRig:
    """The rig of `scene` whose actuators `drives` are driven from outside, and which can begin again at any time.

    Controllers of the scene that would drive the same actuators are left out. Beginning again returns the plant runner
    to tick 0, which takes 0.5 ms and gives the bits of a new rig with the same seed.
    `working`: the controllers of the scene that stay, while an experiment runs.
    """

    def __init__(self, scene: Scene, drives: Collection[str]) -> None:
        out = {name for name, section in scene.controllers.items() if {*controller_drives(section)} & {*drives}}
        self.scene = replace(
            scene,
            controllers={name: section for name, section in scene.controllers.items() if name not in out},
            driven=scene.driven | {*drives},
            protocol=tuple(_without(scene.protocol, out)),
        )
        self._described = design.described(self.scene)
        self._loops: dict[str, Loop] = {}
        self.working: list[ControllerInProcess] = []
        self._make()

    def _make(self) -> None:
        self.runner = PlantRunner(self.scene)
        kick = self.runner.motion.integration.method == "kick"  # its tables have a memory: a new runner each time
        self._kept: KeptState | None = None if kick else self.runner.keep()

    def begin(self, seed: int, length_ns: int) -> Experiment:
        """Begin at tick 0 with this seed of all noise; the experiment is not yet open, so that others can be admitted.

        The runner may be another one than before.
        """
        if self._kept is None or self._kept.scene is not self.runner.scene:
            self.scene = replace(self.scene, seed=seed)
            self._make()
        else:
            self.runner.back(self._kept, seed)
        experiment = Experiment(self.scene, self.runner, length_ns, self._retune)
        self._loops = {name: Loop(restored(description)) for name, description in self._described.items()}
        self.working = [ControllerInProcess(name, loop, experiment) for name, loop in sorted(self._loops.items())]
        return experiment

    def _retune(self, name: str, changes: Mapping[str, Any]) -> None:
        self._loops[name].retune(changes)


def _without(protocol: Sequence[Any], controllers: set[str]) -> Iterable[Any]:
    """The steps of a protocol, without those that connect or disconnect these controllers."""
    for step in protocol:
        if isinstance(step, Connect | Disconnect) and step.controller in controllers:
            continue
        if isinstance(step, Repeat):
            yield step.model_copy(update={"steps": tuple(_without(step.steps, controllers))})
        else:
            yield step
