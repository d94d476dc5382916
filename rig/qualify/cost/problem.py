"""What is measured of a scene: its plant with every actuator held, from a start, for a length of time.

Actuators have the values that the protocol of the scene holds for the longest. A rig that starts with other values
starts stuck to its surface, outside of a limit cycle; else as the scene says. A first run, by the method of the scene,
tells what kind of motion it is and how long it has to be watched:

    cycle       mode changes repeat: watched until some rounds after they do; over a surface that is not alike all
                round they must do so over a whole turn of it
    vibration   mode changes that do not repeat (yet)
    smooth      none in the last third: growth, decay, forced motion

What leaves a limit of the scene is watched until then. The window that is read is a whole number of frames.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig import kernel
from rig.analysis.cycle import stuck
from rig.analysis.orbit import Orbit
from rig.analysis.repetition import all_round, repeating, turn_of
from rig.bench.rig_variant import with_values
from rig.bench.runner import PlantRunner
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.motion.motion import Event
from rig.qualify.cost.settings import Setting, of
from rig.scenes.protocol import Hold, Load, Ramp, Set, flat
from rig.scenes.scene import Scene
from rig.stability.linearisation import sliding_key, steady

Array = NDArray[np.float64]
ROUNDS = 4  # cycles that are watched
TIGHT = 1e-10  # tolerance of the first run
_REPEATS = 1e-6  # of a period: it repeats
_LONGEST = 60.0  # s, simulated
_WALL = 3.0  # s, for the first run
_EVENTS = 4000
_TIMED = 2000  # sample steps in one turn, at least
_FALL = 7.0  # e to the power of it: the fall of a motion that is watched


@dataclass(frozen=True)
class Problem:
    """A scene's plant on a stretch of time. `length` and `window` in ticks: the whole run, and its end that is read.

    `count`: mode changes in one cycle, 0 where there is none; `slips`: those of them that are no lift-offs. `values`:
    what actuators are held at. `leaves`: which limit of the scene the motion leaves, where it ends.
    """

    scene: Scene
    assembly: Assembly
    system: System
    values: dict[str, float]
    kind: str
    length: int
    window: int
    count: int
    slips: int = 0
    leaves: str = ""

    @property
    def step(self) -> float:
        """Sample step [s]."""
        return self.scene.step_ns * 1e-9

    @property
    def seconds(self) -> float:
        """Length of the run [s]."""
        return self.length * self.step

    @property
    def quantities(self) -> list[str]:
        """Names of the outputs that are watched."""
        outputs = list(self.assembly.outputs)
        first = "displacement" if "displacement" in outputs else outputs[0]
        read = [name for section in self.scene.sensors.values() for name in [section.reads] if name in outputs]
        return list(dict.fromkeys([first, *read]))

    @property
    def digest(self) -> str:
        """Hash (16 hex digits) of scene, sources and problem; the setting of the scene itself left out."""
        return digest(self.scene)

    @property
    def timed(self) -> int:
        """Ticks that are timed: those of the window, and so many more that a turn is not over at once."""
        return self.window if self.leaves else max(self.window, _TIMED)

    def orbit(self, setting: Setting, framed: bool = True) -> Orbit:
        """The plant from the start on, carried by `setting`; `framed`: step by step as a run with it."""
        scene = setting.applied(self.scene)
        tolerance, start = scene.clock.tolerance, self.system.start
        return Orbit(scene, self.assembly, start, setting.method, tolerance, self.quantities, framed)

    def later(self, setting: Setting) -> Array:
        """The state where the window begins."""
        orbit, begin = self.orbit(setting), self.length - self.window
        while orbit.motion.tick < begin:
            orbit.block(begin - orbit.motion.tick)
        return orbit.motion.x.copy()

    def runner(self, setting: Setting) -> PlantRunner:
        """The plant with its sensors, as a run carries it, actuators in force."""
        runner = PlantRunner(_tolerant(setting.applied(self.scene)))
        for name, value in self.values.items():
            runner.apply(name, value)
        return runner


def _tolerant(scene: Scene) -> Scene:
    """The scene, run even where it grows."""
    return replace(scene, clock=scene.clock.model_copy(update={"unstable": "run"}))


def digest(scene: Scene) -> str:
    """Hash (16 hex digits) of everything that a table of costs depends on, the machine left out."""
    told = json.loads(Setting("exact", 1e-7, 100_000).applied(scene).to_json())
    kept = {key: told[key] for key in told.keys() - {"name", "title", "about", "origins"}}
    text = json.dumps(kept, sort_keys=True) + kernel.source_key() + _own_sources()
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def _own_sources() -> str:
    """The sources that say what is measured."""
    rooms = Path(__file__).parents[2]
    names = [f"qualify/cost/{name}" for name in ("problem", "measures", "reference")]
    names += [f"analysis/{name}" for name in ("output_polynomials", "orbit", "repetition")]
    return "".join((rooms / f"{name}.py").read_text() for name in names)


def problem(scene: Scene, values: Mapping[str, float] | None = None) -> Problem:
    """Find out what to measure of `scene`. Raises rig.errors.NumericsError where the motion has to stop.

    `values`: of actuators, where it has them; by default those that its protocol holds for the longest.
    """
    assembly = scene.assemble()
    values = held(scene, assembly) if values is None else {k: v for k, v in values.items() if k in assembly.inputs}
    for name, value in values.items():
        one = assembly.inputs[name]
        if one.write is None and not one.state:  # nothing commands it: it is a parameter
            scene = replace(scene, parameters=with_values(scene.parameters, {name: value}))
    assembly = scene.assemble()
    values = {name: value for name, value in values.items() if value != assembly.inputs[name].value}
    runner = PlantRunner(_tolerant(scene))
    for name, value in values.items():
        runner.apply(name, value)
    system = replace(assembly.system(), start=runner.motion.x.copy())
    if values:
        sliding = steady(system, sliding_key(system))
        if sliding.exists:
            system = replace(system, start=stuck(system, sliding.x))
    first = Problem(scene, assembly, system, values, "smooth", 0, 0, 0)
    return _watched(first)


def held(scene: Scene, assembly: Assembly) -> dict[str, float]:
    """The values that the protocol holds actuators at for the longest, those that differ from the start."""
    now = {name: one.value for name, one in assembly.inputs.items()}
    start, times = dict(now), {tuple(now.values()): 0}
    for step in flat(scene.protocol):
        if isinstance(step, Load):
            now[step.target] = step.force
        elif isinstance(step, Ramp | Set) and step.target in now:
            now[step.target] = step.to
        elif isinstance(step, Hold):
            key = tuple(now.values())
            times[key] = times.pop(key, 0) + int(step.time)
    longest = max(reversed(times), key=lambda key: times[key])
    return {name: value for name, value in zip(now, longest) if value != start[name]}


def lift(what: str) -> bool:
    """Whether a mode change is that of a contact which opens or closes."""
    return what.endswith((" opens", " closes"))


def _watched(first: Problem) -> Problem:
    """Run it once: what kind of motion it is, and how long it has to be watched."""
    scene, step = first.scene, first.step
    setting = of(scene, first.system)
    orbit = first.orbit(replace(setting, tolerance=TIGHT) if setting.tolerance else setting)
    turn = turn_of(steady(first.system, sliding_key(first.system)))
    longest = min(max(scene.duration_ns or 10**10, _turns(turn)), int(_LONGEST * 1e9)) // scene.step_ns
    events: list[Event] = []
    count, enough, asked = 0, longest, 0
    end = time.perf_counter() + _WALL
    while orbit.motion.tick < enough and len(events) < _EVENTS and time.perf_counter() < end:
        events += orbit.block(min(orbit.longest, enough - orbit.motion.tick))
        if beyond := orbit.beyond():
            first = replace(first, leaves=f"{beyond} after {orbit.motion.tick * step:.3g} s")
            break
        if count or len(events) < asked + max(4, asked // 4):
            continue
        asked = len(events)
        found, drift = repeating(events, step, _REPEATS)
        period = (events[-1].tick - events[-1 - found].tick) * step if found else 0.0
        if drift <= _REPEATS and all_round(period, turn):
            count = found
            enough = min(longest, orbit.motion.tick + int((ROUNDS + 0.5) * period / step))
    length = orbit.motion.tick
    whole = scene.frame_ns // scene.step_ns
    length = max(length // whole, 3) * whole
    if count and len(events) > ROUNDS * count:
        span = (events[-1].tick - events[-1 - ROUNDS * count].tick) / ROUNDS
        slips = sum(not lift(event.what) for event in events[-count:])
        window = int(span) + 1
        return replace(first, kind="cycle", length=length, window=window + -window % whole, count=count, slips=slips)
    if any(event.tick > 2 * length // 3 for event in events):
        return replace(first, kind="vibration", length=length, window=_third(length, whole))
    last = max((event.tick for event in events), default=0) * step
    frames = min(length // whole, int((last + _dies(first.system)) / (scene.frame_ns * 1e-9)))
    length = max(frames, 3) * whole
    return replace(first, kind="smooth", length=length, window=_third(length, whole))


def _turns(turn: float) -> int:
    """Time [ns] of as many turns of `turn` [s] as it takes for the last third to be a whole one; 0 without turns."""
    return 0 if math.isinf(turn) else int(3.1e9 * turn)


def _third(length: int, whole: int) -> int:
    """A third of a run [ticks], in whole frames."""
    return length // (3 * whole) * whole


def _dies(system: System) -> float:
    """Time [s] after which a small motion about steady sliding is too small to be watched; a long one if it lasts."""
    sliding = steady(system, sliding_key(system))
    rate = -float(sliding.eigenvalues()[0].real) if sliding.exists else 0.0
    return _FALL / rate if rate > _FALL / _LONGEST else _LONGEST
