"""The simulation problem of a cost measurement: a scene's plant with every actuator held, a start, and a duration.

Actuators have the values that the protocol of the scene holds for the longest. If these differ from the initial values,
the rig starts stuck to its surface, outside of a limit cycle; otherwise it starts as the scene states. A first run with
the method of the scene decides the kind of motion and the duration:

    cycle       mode set changes repeat: simulated until some rounds after they do; on an uneven surface they must
                repeat over a whole turn of it
    vibration   mode set changes that do not repeat (yet)
    smooth      none in the last third: growth, decay, forced motion

A motion that leaves a limit of the scene is simulated until then. The evaluated window is a whole number of frames.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig import kernel
from rig.analysis.cycle import stuck
from rig.analysis.motion_measures.settings import Setting, of
from rig.analysis.orbit import Orbit
from rig.analysis.repetition import all_round, repeating, turn_of
from rig.bench.rig_variant import with_values
from rig.bench.runner import PlantRunner
from rig.model.assembly import Assembly, portrait
from rig.model.system import System
from rig.motion.memory import Event
from rig.scenes.protocol import Hold, Load, Ramp, Set, flat
from rig.scenes.scene import Scene
from rig.stability.linearisation import sliding_key, steady

Array = NDArray[np.float64]
ROUNDS = 4  # simulated cycles after repetition
TIGHT = 1e-10  # tolerance of the first run
_REPEATS = 1e-6  # of a period: it counts as repeating
_LONGEST = 60.0  # s, simulated
_WALL = 3.0  # s, for the first run
_EVENTS = 4000
_TIMED = 2000  # fewest sample steps in one timed run
_FALL = 7.0  # natural logarithm of the decay over which a motion is simulated


@dataclass(frozen=True)
class Problem:
    """A scene's plant over a range of time. `length` and `window` in ticks: the whole run, and its evaluated end.

    `count`: mode set changes in one cycle, 0 without a cycle; `slips`: those of them that are not lift-offs. `values`:
    of the held actuators. `leaves`: the limit of the scene that the motion leaves, where it ends.
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

    def __reduce__(self) -> tuple[Any, ...]:
        rest = {one.name: getattr(self, one.name) for one in fields(self)[3:]}
        return _remade, (self.scene, self.system.start, rest)

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
        """Names of the compared outputs."""
        outputs = self.assembly.outputs
        first, _ = portrait(outputs) or (next(iter(outputs)), "")
        read = [name for section in self.scene.sensors.values() for name in [section.reads] if name in outputs]
        return list(dict.fromkeys([first, *read]))

    @property
    def digest(self) -> str:
        """Hash (16 hex digits) of scene, sources and problem, without the scene's own integrator setting."""
        return digest(self.scene)

    @property
    def timed(self) -> int:
        """Number of timed ticks: those of the window, and more if it is too short to time."""
        return self.window if self.leaves else max(self.window, _TIMED)

    def orbit(self, setting: Setting, framed: bool = True) -> Orbit:
        """Return the plant at its start with `setting`; `framed`: step by step as in a run with this setting."""
        scene = setting.applied(self.scene)
        tolerance, start = scene.clock.tolerance, self.system.start
        return Orbit(scene, self.assembly, start, setting.method, tolerance, self.quantities, framed)

    def later(self, setting: Setting) -> Array:
        """Return the state where the window begins."""
        orbit, begin = self.orbit(setting), self.length - self.window
        while orbit.motion.tick < begin:
            orbit.block(begin - orbit.motion.tick)
        return orbit.motion.x.copy()

    def runner(self, setting: Setting) -> PlantRunner:
        """Return the plant runner with sensors, as in a run, with the actuator values set."""
        runner = PlantRunner(_tolerant(setting.applied(self.scene)))
        for name, value in self.values.items():
            runner.apply(name, value)
        return runner


def _remade(scene: Scene, start: Array, rest: dict[str, Any]) -> Problem:
    """A problem that another process has pickled, made from its scene and its start."""
    assembly = scene.assemble()
    return Problem(scene, assembly, replace(assembly.system(), start=start), **rest)


def _tolerant(scene: Scene) -> Scene:
    """The scene with the permission to run if it is unstable."""
    return replace(scene, clock=scene.clock.model_copy(update={"unstable": "run"}))


def digest(scene: Scene) -> str:
    """Return a hash (16 hex digits) of everything that a cost table depends on, except the machine."""
    raw = json.loads(Setting("exact", 1e-7, 100_000).applied(scene).to_json())
    kept = {key: raw[key] for key in raw.keys() - {"name", "title", "about", "origins"}}
    text = json.dumps(kept, sort_keys=True) + kernel.source_key() + _own_sources()
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def _own_sources() -> str:
    """The sources that define the measurement."""
    rooms = Path(__file__).parents[2]
    names = ["qualify/cost/reference", *(f"analysis/motion_measures/{name}" for name in ("problem", "measures"))]
    names += [f"analysis/{name}" for name in ("output_polynomials", "orbit", "repetition")]
    return "".join((rooms / f"{name}.py").read_text() for name in names)


def problem(scene: Scene, values: Mapping[str, float] | None = None, patience: float = _WALL) -> Problem:
    """Determine the problem to measure for `scene`. Raises rig.errors.NumericsError if the simulation has to stop.

    `values`: of actuators that the rig has; by default those that the protocol holds for the longest. `patience` [s]:
    wall time of the first run; without a limit the result does not depend on the load of the machine.
    """
    assembly = scene.assemble()
    values = held(scene, assembly) if values is None else {k: v for k, v in values.items() if k in assembly.inputs}
    for name, value in values.items():
        one = assembly.inputs[name]
        if one.write is None and not one.state:  # no command reaches it: it is a parameter
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
    return _watched(first, patience)


def held(scene: Scene, assembly: Assembly) -> dict[str, float]:
    """Return the actuator values that the protocol holds for the longest, those that differ from the start."""
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
    """Return whether a mode change opens or closes a contact."""
    return what.endswith((" opens", " closes"))


def _watched(first: Problem, patience: float) -> Problem:
    """Simulate it once to find the kind of motion and the duration."""
    scene, step = first.scene, first.step
    setting = of(scene, first.system)
    orbit = first.orbit(replace(setting, tolerance=TIGHT) if setting.tolerance else setting)
    turn = turn_of(steady(first.system, sliding_key(first.system)))
    longest = min(max(scene.duration_ns or 10**10, _turns(turn)), int(_LONGEST * 1e9)) // scene.step_ns
    events: list[Event] = []
    count, enough, asked = 0, longest, 0
    end = time.perf_counter() + patience
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
    """Time [ns] of enough turns of `turn` [s] that the last third is a whole one; 0 without turns."""
    return 0 if math.isinf(turn) else int(3.1e9 * turn)


def _third(length: int, whole: int) -> int:
    """A third of a run [ticks], in whole frames."""
    return length // (3 * whole) * whole


def _dies(system: System) -> float:
    """Time [s] after which a small motion about steady sliding has decayed; a long one if it does not decay."""
    sliding = steady(system, sliding_key(system))
    rate = -float(sliding.eigenvalues()[0].real) if sliding.exists else 0.0
    return _FALL / rate if rate > _FALL / _LONGEST else _LONGEST
