"""A run in this process: the same stand, exchange and controller objects, no bus, as fast as it goes.

Frames run in one piece up to the next at which somebody acts: the protocol, a limit, a command that the compiled loop
cannot put into force. The answers of a controller that is not connected are nobody's; it gives them afterwards, from
the samples of then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rig import design
from rig.bench.compiled_controllers import Inside
from rig.bench.controller_in_process import Working
from rig.bench.exchange import Exchange
from rig.bench.experiment import Operation
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
"""Why to stop, "" to go on."""


def simulate(
    scene: Scene,
    controllers: Mapping[str, Controller] | None = None,
    duration_ns: int | None = None,
    commands: Mapping[str, Commands] | None = None,
    stop: Stop | None = None,
    events: Iterable[Mapping[str, Any]] = (),
) -> Run:
    """Run `scene` for `duration_ns`, or as long as its protocol takes.

    `controllers`: by name; by default those of the scene, with the numbers of their design.
    `commands` and `events`: of a recorded run; what came from controllers and operators takes effect when and as it did
    then, and no controller is asked. `stop` is asked ten times a simulated second whether to end here, and why. A run
    that the numerics had to stop is returned as far as it came, with `fault`; what happened stands in its events.
    """
    if duration_ns is None and scene.duration_ns is None:
        raise UsageError(f"{scene.name} has no protocol that ends; say how long: --duration 10")
    duration_ns = scene.duration_ns if duration_ns is None else duration_ns
    own = design.described(scene) if controllers is None else {}
    if controllers is None:
        controllers = {name: restored(told) for name, told in own.items()}
    with model_store.gathered() as models:
        carried = carry_out(scene, controllers, duration_ns, commands, stop, events)
    for one in models.values():  # whoever draws the run assembles its rig
        model_store.offer(one)
    run = _run(scene.made_with(models), tuple(models.values()), *carried)
    run.controllers = own
    return run


class Carried(NamedTuple):
    """What is left of a run in this process; `fault`: why the numerics stopped it."""

    runner: PlantRunner
    operation: Operation
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
    """Do what `simulate` does, up to the run that it makes of it. Without an end, it ends when `stop` says so."""
    operation, working = begun(scene, controllers, duration_ns, commands, events)
    runner = operation.runner
    every = max(100_000_000 // scene.frame_ns, 1)
    fault = ""
    try:
        while operation.begin():
            until = operation.until()
            if stop is not None:
                until = min(until, runner.tick + every - runner.tick % every)
            carry_on(operation, working, until)
            if stop is not None and (why := stop()):
                operation.stop(why)
    except NumericsError as error:
        fault = str(error)
        operation.journal.note("diverged", fault)
        for one in working:
            one.catch_up(runner.tick + 1)
    operation.end()
    return Carried(runner, operation, {one.name: one.loop for one in working}, fault)


def begun(
    scene: Scene,
    controllers: Mapping[str, Controller],
    duration_ns: int | None = None,
    commands: Mapping[str, Commands] | None = None,
    events: Iterable[Mapping[str, Any]] = (),
    before: Callable[[Operation], object] = lambda _: None,
) -> tuple[Operation, list[Working]]:
    """A run in this process at its first tick, and its controllers at work: none where `commands` are played back.

    `before`: what is done before it is opened.
    """
    loops = {name: Loop(controller) for name, controller in controllers.items()}
    operation = Operation(
        scene,
        PlantRunner(scene, truthful=True),
        duration_ns,
        lambda name, changes: loops[name].retune(changes),
        exchange=Exchange if commands is None else Playback,
        events=events,
    )
    if isinstance(operation.exchange, Playback):
        assert commands is not None
        operation.exchange.play(commands)
    before(operation)
    operation.open()
    working = [Working(name, loop, operation) for name, loop in sorted(loops.items()) if commands is None]
    for one in working:
        one.expect((duration_ns or 0) // (one.line.period * scene.frame_ns))
    return operation, working


def carry_on(operation: Operation, working: Sequence[Working], until: int, inside: Inside | None = None) -> None:
    """Carry the plant runner on to tick `until`, or as far as no limit is passed; only controllers act on the way.

    `inside`: what lends them to the compiled loop, for who calls this often.
    """
    runner, exchange = operation.runner, operation.exchange
    if until - runner.tick == 1 and not working:  # each frame of a run whose controllers have processes
        operation.take_over()
        runner.frames(1)
        return
    inside = inside or Inside(operation)
    heard, others = ([one for one in working if one.line.connected is on] for on in (True, False))
    while True:
        for one in working:
            one.answer()
        operation.take_over()
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
    operation: Operation,
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
    events = [event._asdict() for event in operation.journal.events] + truth.events()
    statistics = runner.statistics()
    return Run(
        scene=scene.to_json(),
        step_ns=runner.step_ns,
        frame_ns=runner.frame_ns,
        time=np.arange(len(modes), dtype=np.float64) * (runner.step_ns * 1e-9),
        signals=dict(zip(runner.outputs, outputs)),
        units=units,
        measurements=measurements.samples(),
        commands={name: line.commands() for name, line in operation.exchange.all_lines.items()},
        events=sorted(events, key=lambda event: event["t_ns"]),
        energy=statistics.pop("energy"),
        summary={
            "ended": operation.over or "stopped by the numerics",
            "plant": statistics,
            "audit": runner.audit(),
            "exchange": operation.exchange.counters(),
            "controllers": {name: loop.counters() for name, loop in loops.items()},
            "sensors": runner.bank.counters(),
        },
        mode=modes,
        models=models,
        fault=fault,
    )
