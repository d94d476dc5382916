"""A plant with its sensors that steps frame by frame: what is built for a scene, and what can be read at a tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from rig.bench.audit import StateSamples
from rig.bench.build_findings import findings
from rig.bench.faulty_sensors import FaultySensors
from rig.bench.heard import ROOM, HeardOverLinks, Hearing
from rig.bench.measurements import Measurements
from rig.bench.noise_numbers import Numbers
from rig.bench.plant_truth import Bands, Truth
from rig.bench.rig_variants import RigVariants
from rig.controllers import controller_drives, controller_reads
from rig.errors import SceneError
from rig.lent_records import Loan
from rig.model.assembly import Input, portrait
from rig.model.method import as_integrated, chosen
from rig.motion.motion import Frames, Motion
from rig.scenes.part_faults import SensorFault
from rig.scenes.scene import Scene
from rig.sensors.chain.bank import CHUNK, Bank
from rig.solve.control_loop import ControllerTables, controller_tables
from rig.solve.frames import Surroundings

Array = NDArray[np.float64]
ROWS = 1 << 15
"""Most steps that a motion keeps: for `truth` before they are handed over, and in one call."""


class SteppedPlant:
    """Plant and sensors of a scene, which step to tick `tick` [frames] (see rig.bench.runner.PlantRunner)."""

    def __init__(self, scene: Scene, truthful: bool = False, piece: int = 1) -> None:
        self.frame_ns, self.step_ns = scene.frame_ns, scene.step_ns
        self.steps = self.frame_ns // self.step_ns
        self.tick = 0
        assembly = scene.assemble()
        self.inputs: dict[str, Input] = assembly.inputs
        self.values = {name: one.value for name, one in assembly.inputs.items()}
        needs = Bank.needs(scene.sensors)
        self.outputs: tuple[str, ...] = (*needs, *(name for name in assembly.outputs if name not in needs))
        self.units = {name: assembly.outputs[name].unit for name in self.outputs}
        system = assembly.system()
        clock = scene.clock
        method = chosen(clock.method, system)
        try:
            as_integrated(system, method, clock.smoothing)
        except ValueError as error:
            raise SceneError(scene.name, [f"clock.method = {clock.method!r}: {error}"]) from None
        self.findings = findings(scene, system)
        errors = [one for one in self.findings if one.level == "error"]
        if errors and clock.unstable == "refuse":
            faults = [f"{one.what} ({one.number:.4g}): {one.remedy}" for one in errors]
            if all(isfinite(one.number) for one in errors):
                faults.append('clock.unstable = "run" runs it nevertheless, up to clock.limit')
            raise SceneError(scene.name, faults)
        self.bank = Bank(scene.sensors, needs, self.frame_ns, scene.seed, 8 * CHUNK if truthful else CHUNK)
        broken = {name: one for name, one in scene.faults.items() if isinstance(one, SensorFault)}
        self._faulty_sensors = FaultySensors(self.bank, broken, self.frame_ns) if broken else None
        self.controllers = _room(scene)
        self.random_numbers = Numbers(system, scene.seed)
        surroundings = Surroundings(self.bank.loan.content, self.controllers, self.random_numbers.record)
        self.motion = Motion(
            system,
            self.step_ns,
            method,
            outputs=[assembly.outputs[name].row for name in self.outputs],
            read=len(needs),
            tolerance=clock.tolerance,
            substeps=clock.substeps(self.step_ns),
            cap=clock.events_per_frame,
            limit=clock.limit,
            longest=ROWS if truthful else piece * self.steps,
            bounds={self.outputs.index(name): limit for name, limit in scene.limits.items()},
            frames=Frames(self.steps, Loan(surroundings), collects=truthful),
            smoothing=clock.smoothing,
        )
        self._index = {name: i for i, name in enumerate(system.names)}
        driven = replace(scene, driven=frozenset(self.inputs)).assemble().inputs
        self._coefficients = frozenset(name for name, one in driven.items() if not (one.state or one.write))
        """Actuators that have no command state even when somebody drives them: each value needs its own matrices."""
        self._look = True
        self.state_samples = StateSamples(scene, self.values)
        self._needs, self._truthful, self._piece = len(needs), truthful, piece
        self.variants = RigVariants(scene, self.motion, self.outputs)
        self.keep_samples: Callable[[], object] = lambda: None
        """Called before the bank forgets samples."""
        self.bands: Bands | None = None
        """What takes every step for viewers, while there are any."""
        self.pair = tuple(map(self.outputs.index, portrait(assembly.outputs) or ()))
        """Indices of displacement and velocity of the phase portrait."""
        self.start()

    def start(self) -> None:
        """Start to measure at tick 0; values written before act on the first samples.

        Actuators with a lag have reached their commands, and the instruments have settled.
        """
        motion = self.motion
        for one in self.inputs.values():
            if one.lagging:
                command = float(motion.x[self._index[one.state]]) if one.state else one.value
                motion.write(self._index[one.lagging], min(max(command, one.low), one.high))
        motion.begin()
        self.bank.start(motion.outputs_now()[: self._needs].copy())
        if self._faulty_sensors is not None:
            self._faulty_sensors.apply()
        self.truth = (
            Truth(motion.outputs_now(), motion.key, self.step_ns, self._piece * self.steps) if self._truthful else None
        )
        self.measurements = Measurements(self.bank, self._piece * self.frame_ns) if self._truthful else None
        self._connect()
        if self.measurements is not None:
            self.keep_samples = self.measurements.take

    def _connect(self) -> None:
        """Connect the controllers, over the impaired links as they are at tick 0."""
        self.meas_links = self.scene.links("meas", self.bank.seed)
        self._over_links = HeardOverLinks(self.bank, self.meas_links, self.frame_ns) if self.meas_links else None

    @property
    def scene(self) -> Scene:
        """The scene of the present rig."""
        return self.variants.scene

    @property
    def hearing(self) -> Hearing:
        """The measurements that controllers receive at this tick: the instruments, if no link is impaired."""
        return self.hearing_at(self.tick)

    def hearing_at(self, tick: int) -> Hearing:
        """The same at `tick`, which the bank has reached: a controller asked within a piece is ahead of `self.tick`."""
        if self._over_links is None:
            return self.bank
        self._over_links.advance(tick)
        return self._over_links

    @property
    def t_ns(self) -> int:
        """Present simulated time [ns]."""
        return self.tick * self.frame_ns

    def frame(self) -> None:
        """Advance the plant by one frame; the sensors publish the samples of this frame."""
        self.frames(1)

    def frames(self, most: int) -> None:
        """Step plant and sensors by 1 to `most` frames in one piece.

        It ends earlier when a limit is exceeded, when the sensor bank is full, and when many events have happened; the
        bank then holds the samples of these frames.
        """
        if self._look:
            if self.bank.short:
                if self.bank.full:
                    self.read_samples()
                self.bank.fill()
            self.random_numbers.fill()
        self._look = True
        if self._over_links is not None:
            _, most = self.hearing, min(most, ROOM)
        faulty = self._faulty_sensors
        if faulty is not None and (ahead := faulty.ahead(self.tick)) is not None:
            most = min(most, max(ahead, 1))
        try:
            self._look = self._carry(most)
        finally:
            self.tick = self.motion.tick // self.steps
        if faulty is not None:
            faulty.apply()
        if self.truth is None:
            self.state_samples.follow(self.motion, self.scene, self.outputs)
        if self.tick >= self.state_samples.due:
            self.state_samples.look(self.motion, self.scene, self.tick, self.steps)

    def read_samples(self) -> None:
        """Read what is needed of the samples that the bank is about to forget."""
        self.keep_samples()
        _ = self.hearing

    def _carry(self, most: int) -> bool:
        """Advance the motion by up to `most` frames; see `Motion.advance`."""
        motion, truth = self.motion, self.truth
        if truth is None:  # a longer call would only need more memory
            try:
                return motion.advance(min(most, max(ROWS // self.steps, 1)) * self.steps)
            finally:
                if self.bands is not None:
                    self.bands.add(motion)
        if motion.kept + self.steps > ROWS:
            self.hand_over(truth)
        room = (ROWS - motion.kept) // self.steps
        try:
            return motion.advance(min(most, room) * self.steps, keep=True)
        finally:
            if motion.event_count:
                truth.happened(motion.system, *motion.met())

    def hand_over(self, truth: Truth) -> None:
        """Give `truth` the steps that the motion has kept, as outputs computed with the present matrices."""
        truth.keep(self.motion)
        self.state_samples.follow(self.motion, self.scene, self.outputs)
        self.motion.kept = 0

    @property
    def limited(self) -> bool:
        """Whether an output exceeds the limit that the scene sets for it, at this tick."""
        return self._look and self.motion.beyond >= 0

    def beyond(self) -> str:
        """The first output that exceeds its limit; "" if none does."""
        return self.outputs[self.motion.beyond] if self.limited else ""

    def output_values(self) -> Array:
        """Plant truth [outputs] at this tick (a view, overwritten by the next call)."""
        return self.motion.outputs_now()

    def output(self, name: str) -> float:
        """Plant truth of one output at this tick."""
        return float(self.output_values()[self.outputs.index(name)])

    @property
    def mode(self) -> str:
        """Return the present contact states in words."""
        return self.motion.system.describe(self.motion.key)


def _room(scene: Scene) -> ControllerTables:
    """Return what the compiled loop needs for the controllers of a scene."""
    sections = scene.controllers.values()
    reads, drives = (sum(len(of(section)) for section in sections) for of in (controller_reads, controller_drives))
    return controller_tables(len(sections), reads, drives, scene.frame_ns)
