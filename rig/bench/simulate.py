"""A run in this process: the same plant runner, exchange and controllers as in a live run, without a bus.

It runs as fast as possible. Frames run in one piece up to the next tick at which something acts: the protocol, a limit,
or a command that the compiled loop cannot put into force. Commands of a disconnected controller are discarded; it is
called afterwards, with the samples of each of its ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rig import design
from rig.bench.compiled_controllers import CompiledControllers
from rig.bench.controller_in_process import ControllerInProcess
from rig.bench.exchange import Exchange
from rig.bench.experiment import Experiment
from rig.bench.playback import Playback
from rig.bench.runner import PlantRunner
from rig.controllers import restored
from rig.controllers.blocks.base import Controller
from rig.controllers.runtime.loop import Loop
from rig.errors import NumericsError, UsageError
from rig.plants.structures import model_store
from rig.record.run import Commands, Run
from rig.scenes.scene import Scene

Stop = Callable[[], str]
"""Returns why to stop, or "" to continue."""


def simulate(
    scene: Scene,
    controllers: Mapping[str, Controller] | None = None,
    duration_ns: int | None = None,
    commands: Mapping[str, Commands] | None = None,
    stop: Stop | None = None,
    events: Iterable[Mapping[str, Any]] = (),
) -> Run:
    """Run `scene` for `duration_ns`, or for the duration of its protocol.

    `controllers`: by name; by default those of the scene, with their design values.
    `commands` and `events`: those of a recorded run. Actions of controllers and operators then take effect at the same
    ticks with the same values, and no controller is called. `stop` is called ten times per simulated second; it returns
    why to stop, or "". If the integration has to stop, the run up to there is returned with `fault`, and its events say
    what happened. Raises UsageError without a duration.
    """
    if duration_ns is None and scene.duration_ns is None:
        raise UsageError(f"{scene.name} has no protocol that ends; state a duration, e.g. --duration 10")
    duration_ns = scene.duration_ns if duration_ns is None else duration_ns
    own = design.described(scene) if controllers is None else {}
    if controllers is None:
        controllers = {name: restored(told) for name, told in own.items()}
    with model_store.gathered() as models:
        carried = carry_out(scene, controllers, duration_ns, commands, stop, events)
    for one in models.values():  # drawing the run assembles its rig again
        model_store.offer(one)
    run = _run(scene.made_with(models), tuple(models.values()), *carried)
    run.controllers = own
    return run


class Carried(NamedTuple):
    """The objects of a finished run in this process; `fault`: why the integration had to stop."""

    runner: PlantRunner
    experiment: Experiment
    loops: dict[str, Loop]
    fault: str


def carry_out(
    scene: Scene,
    controllers: Mapping[str, Controller],
    duration_ns: int | None = None,
    commands: Mapping[str, Commands] | None = None,
    stop: Stop | None = None,
    events: Iterable[Mapping[str, Any]] = (),
) -> Carried:
    """Simulate like `simulate`, without making a `Run`. Without a duration the run ends when `stop` says so."""
    experiment, working = begun(scene, controllers, duration_ns, commands, events)
    runner = experiment.runner
    every = max(100_000_000 // scene.frame_ns, 1)
    fault = ""
    try:
        while experiment.begin():
            until = experiment.until()
            if stop is not None:
                until = min(until, runner.tick + every - runner.tick % every)
            carry_on(experiment, working, until)
            if stop is not None and (why := stop()):
                experiment.stop(why)
    except NumericsError as error:
        fault = str(error)
        experiment.journal.note("diverged", fault)
        for one in working:
            one.catch_up(runner.tick + 1)
    experiment.end()
    return Carried(runner, experiment, {one.name: one.loop for one in working}, fault)


def begun(
    scene: Scene,
    controllers: Mapping[str, Controller],
    duration_ns: int | None = None,
    commands: Mapping[str, Commands] | None = None,
    events: Iterable[Mapping[str, Any]] = (),
    before: Callable[[Experiment], object] = lambda _: None,
) -> tuple[Experiment, list[ControllerInProcess]]:
    """A run in this process at its first tick, and its working controllers: none if `commands` are played back.

    `before` is called with the experiment before it is opened.
    """
    loops = {name: Loop(controller) for name, controller in controllers.items()}
    experiment = Experiment(
        scene,
        PlantRunner(scene, truthful=True),
        duration_ns,
        lambda name, changes: loops[name].retune(changes),
        exchange=Exchange if commands is None else Playback,
        events=events,
    )
    if isinstance(experiment.exchange, Playback):
        assert commands is not None
        experiment.exchange.play(commands)
    before(experiment)
    experiment.open()
    working = [ControllerInProcess(name, loop, experiment) for name, loop in sorted(loops.items()) if commands is None]
    for one in working:
        one.expect((duration_ns or 0) // (one.line.period * scene.frame_ns))
    return experiment, working


def carry_on(
    experiment: Experiment,
    working: Sequence[ControllerInProcess],
    until: int,
    inside: CompiledControllers | None = None,
) -> None:
    """Step the plant runner to tick `until` or until a limit is exceeded; on the way only controllers act.

    `inside`: lends controllers to the compiled loop; callers that call this often pass their own.
    """
    runner, exchange = experiment.runner, experiment.exchange
    if until - runner.tick == 1 and not working:  # each frame of a run whose controllers have processes
        experiment.take_over()
        runner.frames(1)
        return
    inside = inside or CompiledControllers(experiment)
    heard, others = ([one for one in working if one.line.connected is on] for on in (True, False))
    while True:
        for one in working:
            one.answer()
        experiment.take_over()
        tick, end = runner.tick, until
        lent = inside.lend(heard) if end - tick > 1 else ()
        for one in heard:
            if one.name not in lent:
                end = min(end, one.due)
        if end - tick > 1 and (waits := exchange.until(lent)) is not None:
            end = min(end, waits)
        try:
            runner.frames(end - tick)
        finally:
            inside.take_back()
        for one in others:
            one.catch_up(runner.tick)
        if runner.tick >= until or runner.limited:
            return


def _run(
    scene: Scene,
    models: tuple[bytes, ...],
    runner: PlantRunner,
    experiment: Experiment,
    loops: Mapping[str, Loop],
    fault: str,
) -> Run:
    truth, measurements = runner.truth, runner.measurements
    assert truth is not None
    assert measurements is not None
    runner.hand_over(truth)
    outputs, modes = truth.outputs()
    units = dict(runner.units)
    units |= {f"meas/{name}": unit for name, unit in zip(runner.bank.names, runner.bank.units)}
    events = [event._asdict() for event in experiment.journal.events] + truth.events()
    statistics = runner.statistics()
    return Run(
        scene=scene.to_json(),
        step_ns=runner.step_ns,
        frame_ns=runner.frame_ns,
        time=np.arange(len(modes), dtype=np.float64) * (runner.step_ns * 1e-9),
        signals=dict(zip(runner.outputs, outputs)),
        units=units,
        measurements=measurements.samples(),
        commands={name: line.commands() for name, line in experiment.exchange.all_lines.items()},
        events=sorted(events, key=lambda event: event["t_ns"]),
        energy=statistics.pop("energy"),
        summary={
            "ended": experiment.over or "stopped by the numerics",
            "plant": statistics,
            "audit": runner.audit(),
            "exchange": experiment.exchange.counters(),
            "controllers": {name: loop.counters() for name, loop in loops.items()},
            "sensors": runner.bank.counters(),
        },
        mode=modes,
        models=models,
        fault=fault,
    )
