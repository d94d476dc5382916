"""The plant runner: steps plant and sensors of a scene, frame by frame.

The result depends only on the ticks at which actuators and parameters are written. Therefore a run in one process, over
the bus in lockstep, or re-simulated from a recording gives the same bits.

`PlantRunner` steps (`frames`), takes commands (`apply`, `ramp`, `knock`, `take`), and can return to a state that was
kept (`back`). `ResumedRunner` continues a recorded run from one of its checkpoints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from rig.bench.free_rig import FreeRig
from rig.bench.run.audit import StateSamples, audit
from rig.bench.run.before import findings
from rig.bench.run.checkpoint import Arrays, KeptState, packed, unpacked
from rig.bench.run.faulty_sensors import FaultySensors
from rig.bench.run.heard_over_links import ROOM, HeardOverLinks, Hearing
from rig.bench.run.measurements import Measurements
from rig.bench.run.plant_truth import Bands, Truth
from rig.bench.run.played_streams import PlayedStreams
from rig.bench.run.rig_variants import RigVariant, RigVariants, Wanted
from rig.compiled.records import Loan
from rig.controllers import controller_drives, controller_reads
from rig.effects import knock
from rig.effects.noise import SIGNAL
from rig.errors import SceneError, UsageError
from rig.model.assembly import Input, portrait
from rig.model.method import as_integrated
from rig.model.system import System
from rig.motion.motion import Frames
from rig.record.run import Samples
from rig.scenes.faults import shortened
from rig.scenes.part_faults import SensorFault
from rig.scenes.scene import Scene
from rig.sensors.chain.bank import CHUNK, Bank
from rig.sensors.chain.instants import Stream
from rig.sensors.stream import streams
from rig.solve.control_loop import controller_tables
from rig.solve.forces import RandomNumbers
from rig.solve.frames import Surroundings

DRAWS = 1 << 12  # random numbers that are drawn at once. chosen: 32 KiB
_NAME = "process noise"  # no instrument can have this name, since it has a space

Array = NDArray[np.float64]
ROWS = 1 << 15
"""Most steps that a motion keeps: for `truth` before they are handed over, and in one call."""


class Numbers:
    """Standard normal numbers of process noise (rig.effects.noise), one for each frame of a run, drawn in advance.

    The compiled loop takes them from `record`.

    They depend only on the seed of the scene, not on sensors or other processes.
    """

    def __init__(self, system: System, seed: int) -> None:
        self.record = RandomNumbers(np.array([-1]), np.array([DRAWS]), np.zeros(DRAWS))
        self.seed = seed
        self._stream = Stream(seed, _NAME)
        self.find(system)

    def find(self, system: System) -> None:
        """Find the noise signal in `system`, if it has one, and make a number available for its next frame."""
        self.record.state[0] = system.names.index(SIGNAL) if SIGNAL in system.names else -1
        self.fill()

    def fill(self) -> None:
        """Draw new numbers when all are used up."""
        if self.record.state[0] >= 0 and self.record.used[0] == DRAWS:
            self._stream.noise(self.record.numbers)
            self.record.used[0] = 0

    @property
    def used(self) -> int:
        """How many numbers have been used so far."""
        return self._stream.drawn[0] - (DRAWS - int(self.record.used[0]))

    def resume(self, used: int) -> None:
        """Continue after the first `used` numbers."""
        self._stream = Stream(self.seed, _NAME)
        self._stream.skip(used)
        self.record.used[0] = DRAWS
        self.fill()


class PlantRunner:
    """Plant and sensors of a scene at tick `tick` [frames]. Raises rig.errors.NumericsError if it must stop.

    `truthful`: keep all outputs at every sample step (`truth`) and all measurements (`measurements`). `piece`: number
    of frames computed at once, or of all frames of a truthful run; memory is allocated for them from the start.
    `measured`: recorded samples of the streams of the scene (rig.sensors.stream), which are published again; empty if
    the caller gives them to the bank. Without it a scene with streams raises UsageError.
    """

    def __init__(
        self,
        scene: Scene,
        truthful: bool = False,
        piece: int = 1,
        measured: Mapping[str, Samples] | None = None,
    ) -> None:
        played = streams(scene.sensors)
        if measured is None and played:
            name = next(iter(played))
            raise UsageError(
                f"sensors.{name}: a stream is measured while a run keeps pace with the clock: rig run {scene.name}, "
                "without --lockstep. Everywhere else give it another kind that reads the same output, or leave it out"
            )
        self.frame_ns = scene.frame_ns
        self.step_ns = scene.step_ns
        self.steps = self.frame_ns // self.step_ns
        self.tick = 0
        assembly = scene.assemble()
        self.inputs: dict[str, Input] = assembly.inputs
        self.values = {name: actuator.value for name, actuator in assembly.inputs.items()}
        needs = Bank.needs(scene.sensors)
        self.outputs: tuple[str, ...] = (*needs, *(name for name in assembly.outputs if name not in needs))
        self.units = {name: assembly.outputs[name].unit for name in self.outputs}
        rig = FreeRig(scene, assembly)
        clock = scene.clock
        system = rig.system
        try:
            as_integrated(system, rig.method, clock.smoothing)
        except ValueError as error:
            raise SceneError(scene.name, [f"clock.method = {clock.method!r}: {error}"]) from None
        self.findings = findings(scene, system)
        errors = [finding for finding in self.findings if finding.level == "error"]
        if errors and clock.unstable == "refuse":
            faults = [f"{finding.what} ({finding.number:.4g}): {finding.remedy}" for finding in errors]
            if all(isfinite(finding.number) for finding in errors):
                faults.append('clock.unstable = "run" runs it nevertheless, up to clock.limit')
            raise SceneError(scene.name, faults)
        self.bank = Bank(scene.sensors, needs, self.frame_ns, scene.seed, 8 * CHUNK if truthful else CHUNK)
        broken = {name: fault for name, fault in scene.faults.items() if isinstance(fault, SensorFault)}
        self._faulty_sensors = FaultySensors(self.bank, broken, self.frame_ns) if broken else None
        self._played = PlayedStreams(scene, self.bank, measured) if measured else None
        sections = scene.controllers.values()
        reads = sum(len(controller_reads(section)) for section in sections)
        drives = sum(len(controller_drives(section)) for section in sections)
        self.controllers = controller_tables(len(sections), reads, drives, scene.frame_ns)
        self.random_numbers = Numbers(system, scene.seed)
        surroundings = Surroundings(self.bank.loan.content, self.controllers, self.random_numbers.record)
        self.motion = rig.in_motion(
            outputs=[assembly.outputs[name].row for name in self.outputs],
            read=len(needs),
            with_energy=True,
            longest=ROWS if truthful else piece * self.steps,
            bounds={self.outputs.index(name): limit for name, limit in scene.limits.items()},
            frames=Frames(self.steps, Loan(surroundings), collects=truthful),
        )
        self._index = {name: i for i, name in enumerate(system.names)}
        driven = replace(scene, driven=frozenset(self.inputs)).assemble().inputs
        # Actuators that have no command state even when somebody drives them: each value needs its own matrices.
        self._coefficients = frozenset(
            name for name, actuator in driven.items() if not (actuator.state or actuator.write)
        )
        self._look = True
        self.state_samples = StateSamples(scene, self.values)
        self._needs = len(needs)
        self._truthful = truthful
        self._piece = piece
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
        for actuator in self.inputs.values():
            if actuator.lagging:
                command = float(motion.x[self._index[actuator.state]]) if actuator.state else actuator.value
                motion.write(self._index[actuator.lagging], min(max(command, actuator.low), actuator.high))
        motion.begin()
        self.bank.start(motion.outputs_now()[: self._needs].copy())
        if self._faulty_sensors is not None:
            self._faulty_sensors.apply()
        if self._played is not None:
            self._played.apply(0)
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
            _ = self.hearing
            most = min(most, ROOM)
        faulty = self._faulty_sensors
        ahead = None if faulty is None else faulty.ahead(self.tick)
        if ahead is not None:
            most = min(most, max(ahead, 1))
        played = self._played
        ahead = None if played is None else played.ahead(self.tick)
        if ahead is not None:
            most = min(most, ahead)
        try:
            self._look = self._carry(most)
        finally:
            self.tick = self.motion.tick // self.steps
        if faulty is not None:
            faulty.apply()
        if played is not None:
            played.apply(self.tick)
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
        motion = self.motion
        truth = self.truth
        rows = min(ROWS, motion.mode_sets.states_at_once)
        if truth is None:  # a longer call would only need more memory
            try:
                return motion.advance(min(most, max(rows // self.steps, 1)) * self.steps)
            finally:
                if self.bands is not None:
                    self.bands.add(motion)
        if motion.kept and motion.kept + self.steps > rows:
            self.hand_over(truth)
        room = max((rows - motion.kept) // self.steps, 1)
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

    def apply(self, name: str, value: float) -> None:
        """Set an actuator to `value` at this tick; a ramp in progress ends."""
        actuator = self.inputs[name]
        rebuilds = self.rebuilds(name, value)
        self.values[name] = value
        self.state_samples.hears(name, value)
        if actuator.write is not None:
            actuator.write(self.motion.x, self.values, self.t_ns * 1e-9)
        elif actuator.state:
            if actuator.slope:
                self.motion.write(self._index[actuator.slope], 0.0)
            self.motion.write(self._index[actuator.state], value)
        elif rebuilds:
            self.set_parameter(name, value)

    def ramp(self, name: str, to: float, ticks: int) -> None:
        """Move an actuator linearly to `to` within `ticks` frames; `apply` at the end stops it exactly there.

        For actuators with a slope: those that the protocol of the scene ramps.
        """
        actuator = self.inputs[name]
        start = float(self.motion.x[self._index[actuator.state]])
        self.values[name] = to
        self.motion.write(self._index[actuator.slope], (to - start) / (ticks * self.frame_ns * 1e-9))

    def reached(self, name: str) -> float:
        """The value that an actuator has reached: what follows its command, or else the command itself."""
        actuator = self.inputs[name]
        return float(self.motion.x[self._index[actuator.lagging or actuator.state]])

    def plain(self, name: str) -> tuple[int, int] | None:
        """The state that a command to this actuator is written to, and that of its slope (-1: none), where that is all.

        None where a command means more than that.
        """
        actuator = self.inputs[name]
        if (
            not actuator.state
            or actuator.write
            or name in self.state_samples.open
            or self.motion.integration.method == "kick"
        ):
            return None
        at = self._index[actuator.state]
        return None if at < 2 * len(self.motion.system.coordinates) else (at, self._index.get(actuator.slope, -1))

    def lacking(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return those of these actuators that need a command state and do not have one yet."""
        but = self._coefficients | self.scene.moved.keys()
        return tuple(name for name in names if self.coefficient(name) and name not in but)

    def take(self, variant: RigVariant) -> None:
        """Continue with this variant of the rig from this tick on; it must have been made from the present rig."""
        if self.truth is not None:
            self.hand_over(self.truth)
        self.motion.replace(variant.ready)
        self.variants.use(variant)
        for key, value in variant.wanted.parameters.items():
            if key in self.values:
                self.values[key] = value
            self.state_samples.hears(key, value)
        self.inputs.update(variant.assembly.inputs)
        self._index = {name: i for i, name in enumerate(self.motion.system.names)}
        self.random_numbers.find(self.motion.system)

    def go_on(self, wanted: Wanted) -> None:
        """Continue with the variant `wanted` from this tick on."""
        if wanted:
            self.take(self.variants.build(wanted))

    def coefficient(self, name: str) -> bool:
        """Whether an actuator has no command state: each value needs its own matrices."""
        actuator = self.inputs[name]
        return not (actuator.state or actuator.write)

    def rebuilds(self, name: str, value: float) -> bool:
        """Whether `apply` makes a new matrix of this value: the actuator has no command state and another value."""
        return self.coefficient(name) and value != self.values[name]

    def set_parameter(self, key: str, value: Any) -> None:
        """Change a parameter of the rig (`friction.mu_static`) at this tick. Raises SceneError when it cannot be."""
        self.go_on(Wanted({key: value}))

    def parameter(self, key: str) -> Any:
        """The value of a parameter of the rig now. Raises SceneError for an unknown key."""
        value: Any = self.scene.parameters
        for part in key.split("."):
            inside: dict[str, Any] = {}
            if isinstance(value, dict | BaseModel):
                inside = dict(value)
            if part not in inside:
                raise SceneError(shortened(key), ["is not a parameter of this rig"])
            value = inside[part]
        return value

    def knock(self, impulse: float, duration_ns: int = 0) -> None:
        """Strike the body with `impulse` [N s], along the sliding direction unless its plant says where.

        With a duration, which the protocol of the scene must have, the force is a half sine until `release`.
        """
        if duration_ns:
            self.motion.write(self._index[knock.states(duration_ns)[1]], knock.peak(impulse, duration_ns))
            return
        system = self.motion.system
        jump = np.linalg.solve(system.mass, system.strike) * impulse
        first = len(system.coordinates)
        for i, step in enumerate(jump):
            self.motion.write(first + i, float(self.motion.x[first + i] + step))

    def release(self) -> None:
        """End a knock with a duration: the force of the hammer is zero."""
        for duration_ns in self.scene.knocks:
            for state in knock.states(duration_ns):
                self.motion.write(self._index[state], 0.0)

    def checkpoint(self) -> bytes:
        """What `resume` needs at this tick, before anything is changed at it; empty if the method cannot resume."""
        if not (motion := self.motion.checkpoint()):
            return b""
        return packed({**motion, **self.bank.checkpoint(), "random": np.array([self.random_numbers.used])})

    def resume(self, kept: Arrays) -> None:
        """Continue from the `checkpoint` of this tick, made by a runner with the same rig and the same instruments.

        The instruments have published the samples of this tick already. Raises ValueError or KeyError for another rig.
        """
        self.motion.resume(kept, self.tick * self.steps)
        self.bank.resume(kept, self.t_ns)
        self.random_numbers.resume(int(kept["random"][0]))
        self._look = True

    def keep(self) -> KeptState:
        """The state of plant and instruments at this tick, for `back`. Call it before anything is changed at this tick.

        Raises UsageError for the method kick, which cannot return to a state.
        """
        if not (motion := self.motion.checkpoint()):
            raise UsageError(f"a rig with the method {self.motion.integration.method} cannot return to a state")
        arrays = {**motion, **self.bank.keep(), "random": np.array([self.random_numbers.used])}
        return KeptState(self.scene, self.tick, arrays, dict(self.values))

    def back(self, kept: KeptState, seed: int | None = None) -> None:
        """Return to a state of this runner, with the same bits from there on.

        `seed`: draw noise from another seed from there on; from tick 0 on the bits are those of a new runner with this
        seed. Raises UsageError if the rig was built again since, because a parameter has changed, and for a runner that
        keeps all outputs.
        """
        if kept.scene is not self.scene:
            raise UsageError("the rig was built anew since this state was kept; make a new runner")
        if self._truthful:
            raise UsageError("a runner that keeps all outputs cannot return to a state")
        if self.meas_links and kept.tick:
            raise UsageError("messages under way on impaired links are not kept: such a rig returns to tick 0 only")
        self.tick = kept.tick
        self.values = dict(kept.values)
        if seed is not None:
            self.bank.seed = self.random_numbers.seed = seed
        self.bank.back(kept.arrays)
        self.resume(kept.arrays)
        self.state_samples = StateSamples(self.scene, self.values)
        self.state_samples.begin(self.tick, self.t_ns * 1e-9)
        if seed is not None and not self.tick:
            self.start()
        elif not self.tick:
            self._connect()

    def statistics(self) -> dict[str, Any]:
        """Method, counts, stick share and energy so far."""
        energy = self.motion.energy()
        return {
            "method": self.motion.integration.method,
            **self.motion.counts(),
            **({"stick_share": self.motion.stick_share()} if self.motion.system.patches else {}),
            "findings": [finding.to_json() for finding in self.findings if finding.level != "info"],
            "energy": energy,
            "energy_error": energy["error"],
        }

    def audit(self) -> list[dict[str, Any]]:
        """Return the influence of each effect on this run, missing effects included (rig.bench.run.audit)."""
        return audit(self.scene, self.state_samples, self.motion)


class Resumption(NamedTuple):
    """A checkpoint at `tick`, and the recorded samples of each sensor, all of them up to there."""

    tick: int
    checkpoint: bytes
    measurements: Mapping[str, Samples]


class ResumedRunner(PlantRunner):
    """The plant of `scene`, which is simulated from a checkpoint on, in a run of `frames` frames.

    Up to the checkpoint nothing is integrated: the instruments publish the recorded samples, and recorded commands
    count as put into force at their ticks. So protocol, exchange and controllers do what they did and are in the state
    in which they were. At the checkpoint plant and instruments take the recorded state.

    Raises ValueError or KeyError at the checkpoint if it is one of another rig, LogError if it cannot be read.
    """

    def __init__(self, scene: Scene, resumption: Resumption, frames: int) -> None:
        super().__init__(scene, truthful=True, piece=frames, measured=resumption.measurements)
        self._resumption = resumption
        self._recorded = [resumption.measurements[name] for name in self.bank.names]
        self.state_samples.begin(resumption.tick, resumption.tick * self.frame_ns * 1e-9)

    def frames(self, most: int) -> None:
        """Play recorded samples up to the checkpoint; simulate from there on. See `PlantRunner.frames`."""
        left = self._resumption.tick - self.tick
        if left <= 0:
            super().frames(most)
            return
        count = min(most, left, self.bank.playable, ROOM)
        self.read_samples()
        self._put_into_force(self.tick + count)
        self.tick += count
        self.bank.play(self._recorded, self.t_ns)
        self._look = False
        if count == left:
            self.read_samples()
            self.resume(unpacked(self._resumption.checkpoint))

    def checkpoint(self) -> bytes:
        """See `PlantRunner.checkpoint`; empty before the own checkpoint, where plant and instruments have no state."""
        return super().checkpoint() if self.tick > self._resumption.tick else b""

    def _put_into_force(self, end: int) -> None:
        """Do what the compiled loop does with the recorded commands lent to it that are due before tick `end`."""
        controls = self.controllers
        for i in range(int(controls.clock[0]["count"])):
            line = controls.controllers[i]
            first = int(line["oldest"])
            waiting = controls.queue[i, first : first + int(line["waiting"])]
            count = int(np.searchsorted(waiting["tick"], end))
            controls.rows[i, :count] = waiting[:count]
            drives = slice(int(line["drives"]), int(line["driven"]))
            controls.values[:count, drives] = controls.queued[first : first + count, drives]
            line["kept"] = count
            line["oldest"] = first + count
            line["waiting"] = len(waiting) - count
