"""A run in this process: the same stand, exchange and controller objects, no bus, as fast as it goes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controllers.base import Controller, Values
from controllers.base import Samples as Heard
from controllers.loop import Loop
from rig.bench.exchange import Exchange, Playback
from rig.bench.operation import Operation
from rig.bench.stand import Stand
from rig.bench.truth import Truth
from rig.errors import NumericsError, UsageError
from rig.record.run import Commands, Run, Samples
from rig.scenes.scene import Scene

_FRAMES = 1 << 12

Report = Callable[[Operation], None]


def simulate(
    scene: Scene,
    controllers: Mapping[str, Controller],
    duration_ns: int | None = None,
    commands: Mapping[str, Commands] | None = None,
    report: Report | None = None,
    events: Iterable[Mapping[str, Any]] = (),
) -> Run:
    """Run `scene` with `controllers` (by name; those of the scene) for `duration_ns`, or as long as its protocol takes.

    `commands` and `events`: of a recorded run; what came from controllers and operators takes effect when and as it did
    then, and no controller is asked. `report` is called ten times a simulated second. A run that the numerics had to
    stop is returned as far as it came, with `fault`; what happened stands in its events.
    """
    if duration_ns is None and scene.duration_ns is None:
        raise UsageError(f"{scene.name} has no protocol that ends; say how long: --duration 10")
    duration_ns = scene.duration_ns if duration_ns is None else duration_ns
    loops = {name: Loop(controller) for name, controller in controllers.items()}
    stand = Stand(scene, truthful=True)
    truth = stand.truth
    assert truth is not None
    operation = Operation(
        scene,
        stand,
        duration_ns,
        lambda name, changes: loops[name].retune(changes),
        exchange=Exchange if commands is None else Playback,
        events=events,
    )
    if isinstance(operation.exchange, Playback):
        assert commands is not None
        operation.exchange.play(commands)
    columns = {name: i for i, name in enumerate(stand.bank.names)}
    asked = sorted(loops.items()) if commands is None else []
    wired = [(name, loop, [columns[r] for r in loop.controller.reads]) for name, loop in asked]
    bank = stand.bank
    kept = Measurements(stand)
    latest, every = stand.bank.latest, max(100_000_000 // scene.frame_ns, 1)
    begin, receive, take_over = operation.begin, operation.exchange.receive, operation.take_over
    fault = ""
    try:
        while begin():
            tick = stand.tick
            t_ns = tick * stand.frame_ns
            for name, loop, reads in wired:
                if t_ns % loop.controller.period_ns == 0:
                    if loop.hears:
                        heard: Values | Heard = tuple([bank.samples(i).tolist() for i in reads])
                    else:
                        heard = tuple([float(latest[i]) for i in reads])
                    receive(name, tick, loop.answer(t_ns, heard))
            take_over()
            stand.frame()
            kept.add()
            if report is not None and tick % every == 0:
                report(operation)
    except NumericsError as error:
        fault = str(error)
        operation.journal.note("diverged", fault)
    return _run(scene, stand, operation, truth, kept, loops, fault)


class Measurements:
    """Every published sample of every sensor."""

    def __init__(self, stand: Stand) -> None:
        bank = self._bank = stand.bank
        self._frame_ns = stand.frame_ns
        self._fast = [i for i, period in enumerate(bank.periods_ns) if period < stand.frame_ns]
        self._quick: dict[int, list[NDArray[np.float64]]] = {i: [] for i in self._fast}
        self._full: list[NDArray[np.float64]] = []
        self._block = np.empty((_FRAMES, len(bank.names)))
        self._rows = 0
        self.add()

    def add(self) -> None:
        """Keep the samples of the last frame."""
        if self._rows == _FRAMES:
            self._full.append(self._block)
            self._block, self._rows = np.empty_like(self._block), 0
        self._block[self._rows] = self._bank.latest
        self._rows += 1
        for i in self._fast:
            self._quick[i].append(self._bank.samples(i).copy())

    def samples(self) -> dict[str, Samples]:
        """What each sensor published: times [ns], values."""
        latest = np.concatenate([*self._full, self._block[: self._rows]])
        out = {}
        for i, (name, period) in enumerate(zip(self._bank.names, self._bank.periods_ns)):
            if i in self._quick:
                values = np.concatenate(self._quick[i])
            else:  # published at the first frame that begins at or after each multiple of the period
                count = (len(latest) - 1) * self._frame_ns // period + 1
                frames = -(-np.arange(count, dtype=np.int64) * period // self._frame_ns)
                values = latest[frames[frames < len(latest)], i]
            out[name] = Samples(np.arange(len(values), dtype=np.int64) * period, values)
        return out


def _run(
    scene: Scene,
    stand: Stand,
    operation: Operation,
    truth: Truth,
    kept: Measurements,
    loops: Mapping[str, Loop],
    fault: str,
) -> Run:
    outputs, modes = truth.outputs(stand.motion)
    units = dict(stand.units)
    units |= {f"meas/{name}": unit for name, unit in zip(stand.bank.names, stand.bank.units)}
    events = [event._asdict() for event in operation.journal.events] + truth.events
    statistics = stand.statistics()
    return Run(
        scene=scene.to_json(),
        step_ns=stand.step_ns,
        frame_ns=stand.frame_ns,
        time=np.arange(len(outputs), dtype=np.float64) * (stand.step_ns * 1e-9),
        signals={name: np.ascontiguousarray(outputs[:, i]) for i, name in enumerate(stand.outputs)},
        units=units,
        measurements=kept.samples(),
        commands={name: line.commands() for name, line in operation.exchange.lines.items()},
        events=sorted(events, key=lambda event: event["t_ns"]),
        energy=statistics.pop("energy"),
        summary={
            "ended": operation.over or "stopped by the numerics",
            "plant": statistics,
            "exchange": operation.exchange.counters(),
            "controllers": {name: loop.counters() for name, loop in loops.items()},
            "sensors": stand.bank.counters(),
        },
        mode=modes,
        fault=fault,
    )
