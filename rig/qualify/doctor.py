"""The capability of this machine: timing of waits, cost of frames, and the scenes that would run VALID.

A frame begins late when the wait before it ends late, or when the frames before it took too long together. Therefore
the share of late frames is estimated as P(wait > frame) + P(behind > frame). The lag behind follows from the cost of
the frames before, including the bus and a reserve for the other processes of a run. Short frames are evaluated in the
batches in which they run (rig.bench.live.pace). The thresholds of the scene turn the share into a timing verdict,
at pace 1 or at the largest pace that the scene allows. If the plant may use real-time scheduling, other programs do not
interrupt its frames, and their cost is measured in processor time. Otherwise it is measured by the wall clock under the
present load: at a busier time the result differs.

The latency of the bus is the round trip of a message to another process over the private socket of a run.
"""

from __future__ import annotations

import compileall
import contextlib
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

import rig
from rig import bus, controllers, scenes, sensors
from rig.analysis.pool import kernel_shapes
from rig.bench.live import pace
from rig.bench.live.outcome import Job
from rig.bench.live.pace import length
from rig.bench.live.rehearsal import visited
from rig.bench.run.experiment import Experiment
from rig.bench.run.simulate import begun, carry_on
from rig.bus import encode
from rig.compiled import kernel
from rig.controllers import restored
from rig.controllers.blocks.base import is_elsewhere
from rig.design import described
from rig.errors import NumericsError, RigError, SceneError, UsageError
from rig.machine.process import Child, end, no_garbage
from rig.machine.scheduling import CONTROLLER, PLANT, ahead, choose, come_first, cores, placed
from rig.record.provenance import processor
from rig.scenes.scene import Scene

Times = NDArray[np.int64]
"""Durations [ns]."""
Clock = Callable[[], int]
Say = Callable[[str], object]
FRAME_NS = 1_000_000
"""The frame whose waits are measured: that of most scenes."""
LEAST = 2000
"""Fewest measured frames: the cost at p99 is then exceeded by twenty of them."""
RESERVE = 1.5
"""Cost of a frame in a run over its cost here. # measured: 1.2 to 1.5, because recorder and bus work beside it"""
ALONE = "measured in processor time: no other program interrupts a plant that is scheduled in real time"
AMONG = "measured by the wall clock: other programs interrupt a plant that is not scheduled in real time"
_ROW = 100  # consecutive measured frames: the lateness of one carries over to the next
_ENDLESS_NS = 10_000_000_000  # measured part of a protocol without an end
_PAUSE_S = 0.0005  # before a round trip, as between the frames of a paced run
_EACH_S = 0.001  # for a round trip with its pause: decides on their number
_FIRST = "plate"  # with a kernel that takes longer to compile than all others, and those that all scenes need


def round_trips(seconds: float, *, paced: bool = True) -> tuple[Times, Times, str]:
    """Measure round trips and single publications [ns] for about `seconds`; empty with a reason if they fail.

    `paced`: with real-time scheduling and a pause before each, as in a paced run; else one after the other, as in
    lockstep. The processes use the same cores as in such a run.
    """
    name = f"doctor-{os.getpid()}"
    none = np.zeros(0, dtype=np.int64)
    latest = np.zeros(2)
    fresh = np.ones(2, dtype=np.int64)
    trips = []
    puts = []
    try:
        with bus.host(name, "doctor") as session:
            answers = session.subscribe("act/*")
            present = session.watch("controller/*")
            step = session.publisher("step")
            session.announce()
            of_plant, of_bus = choose()
            arguments = [name, str(of_bus)]
            if paced:
                arguments.append("paced")
            child = Child("echo", ["rig.qualify.doctor", *arguments])
            try:
                if not present.wait_for("controller", "echo", 8.0):
                    return none, none, "the other process did not start"
                core = of_plant if paced else of_bus
                with placed(core, of_bus), ahead(PLANT) if paced else contextlib.nullcontext():
                    for number in range(max(int(seconds / _EACH_S), 50)):
                        payload = encode.step(number, number, latest, fresh)
                        begin = time.perf_counter_ns()
                        step.put(payload, number)
                        puts.append(time.perf_counter_ns() - begin)
                        if answers.get(timeout=0.5) is None:
                            return none, none, "no answer within 0.5 s"
                        trips.append(time.perf_counter_ns() - begin)
                        if paced:
                            time.sleep(_PAUSE_S)
            finally:
                end([child], 0.0)
    except RigError as error:
        return none, none, str(error)
    return np.array(trips), np.array(puts), ""


def echo(run: str, core: str, paced: str = "") -> None:
    """Run the other process on a core: answer every step until none has come for two seconds; `paced`: in real time."""
    with bus.join(run, role="controller", name="echo", wait=5.0) as session:
        steps = session.subscribe("step")
        act = session.publisher("act/echo")
        session.announce()
        with placed(int(core), int(core)), ahead(CONTROLLER) if paced else contextlib.nullcontext():
            while (step := steps.get(timeout=2.0)) is not None:
                act.put(encode.act(step.said.tick, step.t_ns, step.said.values), step.t_ns)


def costs(scene: Scene, least: int = LEAST, clock: Clock = time.perf_counter_ns) -> Times:
    """Measure the time of frames of protocol, plant and sensors [ns], at least `least` frames, spread over the
    protocol.

    Controllers in the plant's process are included, others are not. As in a paced run, a rehearsal has built the mode
    sets before. A short protocol is repeated. In a long one the frames between the measured rows run without
    interruption. `clock`: of the measurement [ns].
    """
    sets = visited(scene, Job(scene.to_json()))
    frame_times: list[int] = []
    count = -1
    while count < len(frame_times) < least:
        count = len(frame_times)
        frame_times += _carried_through(scene, sets, least, clock)
    return np.array(frame_times, dtype=np.int64)


def _carried_through(scene: Scene, sets: tuple[int, ...], least: int, clock: Clock) -> list[int]:
    """Frames of controller run, in order."""
    duration_ns = _ENDLESS_NS if scene.duration_ns is None else scene.duration_ns
    restored_by_name = {name: restored(description) for name, description in described(scene).items()}
    working = {name: controller for name, controller in restored_by_name.items() if not is_elsewhere(controller)}

    def prepare(experiment: Experiment) -> None:
        experiment.runner.motion.foresee(sets)
        experiment.prepared_rigs()

    experiment, answering = begun(scene, working, duration_ns, before=prepare, measured={})
    runner = experiment.runner
    truth = runner.truth
    assert truth is not None
    inside = [controller for controller in answering if controller.name in scene.in_plant]
    outside = [controller for controller in answering if controller.name not in scene.in_plant]
    apart = _ROW * max(duration_ns // scene.frame_ns // least, 1)
    frame_times: list[int] = []
    try:
        while True:
            tick = runner.tick
            if tick % _ROW == 0:
                runner.hand_over(truth)  # a paced run does not keep it: keep it out of the measured frames
            begin = clock()
            if not experiment.begin():
                break
            protocol = clock() - begin
            if tick % apart >= _ROW:
                carry_on(experiment, answering, min(experiment.until(), tick - tick % apart + apart))
                continue
            for controller in outside:
                controller.answer()
            begin = clock()
            for controller in inside:
                controller.answer()
            experiment.exchange.take_over()
            runner.frame()
            frame_times.append(protocol + clock() - begin)
    except NumericsError:  # the frames up to there count
        pass
    return frame_times


def behind(frame_times: Times, wall_ns: float) -> Times:
    """Return the lag of each frame [ns] because earlier ones took longer than their `wall_ns`; late frames catch up."""
    total = np.concatenate(([0.0], np.cumsum(frame_times[:-1] - wall_ns)))
    return (total - np.minimum.accumulate(np.minimum(total, 0.0))).astype(np.int64)


@dataclass(frozen=True)
class Spread:
    """A duration measured many times, in us; `beyond`: share of values above a frame of 1 ms."""

    count: int
    p50: float
    p95: float
    p99: float
    worst: float
    beyond: float

    @classmethod
    def of(cls, times: Times) -> Spread:
        """From nanoseconds."""
        p50, p95, p99 = (float(v) / 1e3 for v in np.quantile(times, (0.5, 0.95, 0.99)))
        return cls(len(times), p50, p95, p99, float(times.max()) / 1e3, float(np.mean(times > FRAME_NS)))

    def __str__(self) -> str:
        return f"p50 {self.p50:.0f}, p95 {self.p95:.0f}, p99 {self.p99:.0f}, worst {self.worst:.0f} us"


@dataclass(frozen=True)
class Fitness:
    """Whether one scene would run VALID here. `frame`: cost of its frames; None if not measured."""

    scene: str
    verdict: str
    reason: str
    frame: Spread | None = None


@dataclass(frozen=True)
class Report:
    """The result of `doctor`. `waiting`: how frames would be paced here, by `sleep` or `hybrid`, and why.

    `frames`: the clock in which the frames are measured. `bus`: plant -> controller -> plant over a private socket
    between two processes; None with the reason in `fault`.
    """

    machine: dict[str, Any]
    warm: bool
    sleep: Spread
    hybrid: Spread
    waiting: str
    scheduling: str
    frames: str
    bus: Spread | None
    put: Spread | None
    fault: str
    scenes: tuple[Fitness, ...]
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether every scene would run VALID."""
        return all(fitness.verdict == "VALID" for fitness in self.scenes)

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {**asdict(self), "ok": self.ok}

    def text(self) -> str:
        """Return the report as text."""
        m = self.machine
        lines = [
            f"machine     {m['processor']}, {m['cores']} cores usable, load {m['load']:.2f}, {m['system']}",
            f"software    Python {m['python']}, numba {m['numba']}",
            f"kernels     {'compiled' if self.warm else 'not all compiled yet: rig tool warmup'}",
            f"waiting     sleep:  {self.sleep}; {100 * self.sleep.beyond:.2g} % beyond 1 ms",
            f"            hybrid: {self.hybrid}; {100 * self.hybrid.beyond:.2g} % beyond 1 ms",
            f"            {self.waiting}",
            f"scheduling  {self.scheduling or 'in real time'}",
            f"frames      {self.frames}",
            f"bus         {f'round trip {self.bus}' if self.bus else self.fault}",
            "",
        ]
        width = max(len(fitness.scene) for fitness in self.scenes)
        lines += [f"{fitness.scene:<{width}}  {fitness.verdict:<9} {fitness.reason}" for fitness in self.scenes]
        if any(fitness.verdict in ("DEGRADED", "INVALID") for fitness in self.scenes):
            lines += [
                "",
                "frames are late when the machine is busy or wakes late: close other programs, or allow real-time "
                "scheduling (root, or a limit rtprio of 20)",
            ]
        return "\n".join(lines)


def doctor(seconds: float = 4.0, report: Say | None = None, names: Iterable[str] = ()) -> Report:
    """Measure waits and bus for about `seconds`, then the frames of the scenes `names`; all shipped ones take a minute.

    `report` gets a line for each measurement.
    """
    say = report or (lambda _: None)
    begin = time.perf_counter()
    loaded = [scenes.load(name) for name in names or scenes.names()]
    say("waiting for frames of 1 ms")
    come_first()
    with ahead(PLANT) as scheduled:
        waiting, slept, spun = _waits(0.6 * seconds)
        scheduling = scheduled.account
        alone = not scheduled.why
    late = spun if waiting.spin_ns else slept
    say("a round trip over the bus, between two processes")
    trips, puts, fault = round_trips(0.3 * seconds)
    trip, put = (Spread.of(samples) if len(samples) else None for samples in (trips, puts))
    say("frames of every scene, over its whole protocol")
    clock = time.thread_time_ns if alone else time.perf_counter_ns
    ready = kernel_shapes.ready()
    with no_garbage():
        fit = [_fitness(scene, ready, clock, late, put) for scene in loaded]
    return Report(
        machine={
            "processor": processor(),
            "cores": cores(),
            "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan,
            "system": f"{platform.system()} {platform.release()}",
            "python": platform.python_version(),
            "numba": numba.__version__,
            "kernels": str(kernel.FOLDER.path),
        },
        warm=all(fitness.verdict != "unknown" for fitness in fit),
        sleep=Spread.of(slept),
        hybrid=Spread.of(spun),
        waiting=f"{waiting.method}: {waiting.why}",
        scheduling=scheduling,
        frames=ALONE if alone else AMONG,
        bus=trip,
        put=put,
        fault=fault,
        scenes=tuple(fit),
        seconds=time.perf_counter() - begin,
    )


def _fitness(
    scene: Scene, ready: Collection[kernel_shapes.Shape], clock: Clock, late: Times, put: Spread | None
) -> Fitness:
    """Measure and evaluate one scene; a scene that cannot run is reported with the reason."""
    try:
        frame_times = costs(scene, clock=clock) if kernel_shapes.shape(scene) in ready else None
        return judge(scene, frame_times, late, put)
    except RigError as fault:
        reason = "; ".join(fault.faults) if isinstance(fault, SceneError) else str(fault).partition("\n")[0]
        return Fitness(scene.name, "refused", reason)


def judge(scene: Scene, frame_times: Times | None, late: Times, put: Spread | None) -> Fitness:
    """Predict the timing verdict of `scene` from its frame costs and the lateness of waits [ns]; `put`: on the bus."""
    if frame_times is None:
        return Fitness(
            scene.name, "unknown", "its kernels are not compiled yet: rig tool warmup, then rig tool doctor again"
        )
    if not frame_times.size:
        raise UsageError("its numerics stop within the first frame: rig simulate shows the reason")
    clock = scene.clock
    pace = min(clock.pace_limit or 1.0, 1.0)
    each = length(scene, pace)
    wall = each * scene.frame_ns / pace
    puts = 2 + sum(s.period_ns >= FRAME_NS for s in scene.sensors.values())
    publishing = round(1e3 * (put.p50 if put is not None else 0.0) * puts)
    whole = RESERVE * np.add.reduceat(frame_times, np.arange(0, frame_times.size, each)) + publishing
    share = min(float(np.mean(late > wall) + np.mean(behind(whole, wall) > wall)), 1.0)
    mean = float(np.mean(whole)) / wall
    p99 = float(np.quantile(whole, 0.99)) / wall
    what = "frame" if each == 1 else "piece"
    text = f"{100.0 * mean:.2g} % of a {what} busy, {100.0 * p99:.2g} % at p99; {100.0 * share:.2g} % of {what}s late"
    if share <= clock.late_share_valid:
        verdict = "VALID"
    else:
        verdict = "DEGRADED" if share <= clock.late_share_degraded else "INVALID"
        if mean > 1.0:
            text += ": a longer clock.frame, a looser clock.tolerance or a smaller --pace"
    if scene.slow:
        text += f"; {scene.slow}"
    return Fitness(scene.name, verdict, text, Spread.of(frame_times))


def _waits(seconds: float) -> tuple[pace.Waiting, Times, Times]:
    """The choice between sleep and hybrid, and the lateness of both [ns], measured alternately."""
    waiting = pace.choose(FRAME_NS)
    spin = waiting.spin_ns or int(min(1.5 * waiting.sleep_p95, FRAME_NS / 5))
    sleep = pace.WallClock()
    hybrid = pace.WallClock(spin)
    slept = []
    spun = []
    with no_garbage():
        for _ in range(max(int(seconds * 1e9 / FRAME_NS / 200), 1)):
            slept.append(pace.lateness(sleep, FRAME_NS, 100))
            spun.append(pace.lateness(hybrid, FRAME_NS, 100))
    return waiting, np.concatenate(slept), np.concatenate(spun)


def warmup(
    report: Say | None = None, names: Iterable[str] | None = None, workers: int = 1
) -> dict[kernel_shapes.Shape, float]:
    """Compile the kernels of the scenes `names`; by default of all shipped ones, and of the torture test.

    So are those of analyses with a tight tolerance (maps, branches), where they take another method than runs.
    Returns seconds for each compiled shape. `report` gets a line before and after each shape, with an estimate of the
    remaining time.
    """
    for package in (rig, controllers, sensors):  # some systems do not store bytecode: that costs 0.2 s at each start
        compileall.compile_dir(Path(package.__path__[0]), quiet=2)
    from rig.qualify.torture.cells import needed

    from_nothing = names is None and workers > 1 and kernel.FOLDER.keeps and not kernel_shapes.ready()
    first = [kernel_shapes.begun(_FIRST)] if from_nothing else []  # while all scenes are assembled, which takes 5 s
    try:
        loaded = [scenes.load(name) for name in (scenes.names() if names is None else names)]
        return kernel_shapes.prepare([*loaded, *(needed() if names is None else ())], report, workers, analysed=loaded)
    finally:
        end(first, 0.0)


if __name__ == "__main__":
    echo(*sys.argv[1:])
