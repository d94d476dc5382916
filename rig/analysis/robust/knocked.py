"""Rigs of a design that begin at steady sliding and are knocked: their scenes, and the size of a knock.

A case is a design with the nominal rig or with its worst one. If its growth is that of closed loops, its controllers
act and are designed for the scene with the values of the design: they are not told of the errors of the rig. If it is
that of the plant alone, controllers are left out.

The unit of a knock is the impulse after which the linear motion would just stop a contact or open it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from rig.analysis.linear.modes import at_rest
from rig.analysis.robust.box import Box
from rig.analysis.robust.envelope import Mode, of_rates
from rig.analysis.robust.growth import Growth, NoSliding
from rig.analysis.robust.search import NOMINAL, ROBUST, SCENE, Entry, Findings
from rig.errors import SceneError
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.protocol import Hold, Knock
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, inputs, own_law, sliding_key

Array = NDArray[np.float64]
NOMINAL_RIG = "nominal"
WORST_RIG = "worst"
_STEPS = 2000  # in which the largest amplitude of a linear motion after a knock is looked for


@dataclass(frozen=True)
class Case:
    """A `design` with its `rig`: nominal or worst. `scene`: begins at steady sliding, and has no protocol.

    `values`: of design and rig (SI) by key. `mode`: the one whose growth counts.
    """

    design: str
    rig: str
    scene: Scene
    values: dict[str, float]
    mode: Mode

    @property
    def name(self) -> str:
        """Design and rig in words."""
        return f"{self.design}, {self.rig} rig"

    @cached_property
    def rest(self) -> tuple[Assembly, Steady]:
        """The plant and its steady sliding."""
        return at_rest(self.scene)

    @property
    def sliding(self) -> Steady:
        """Steady sliding of the plant."""
        return self.rest[1]

    @cached_property
    def _running(self) -> System:
        """The plant as a run has it."""
        return self.scene.assemble().system()

    @property
    def sliding_key(self) -> int:
        """The mode set of sliding in a run."""
        return sliding_key(self._running)

    def described(self, key: int) -> str:
        """A mode set of a run in words."""
        return self._running.describe(key)

    @cached_property
    def unit(self) -> float:
        """The impulse [N s] after which a linear motion just stops a contact or opens it; 0: no place for a knock."""
        return _unit(self.sliding)

    @cached_property
    def offset(self) -> float:
        """How far its start is from sliding, as a share of the way at which a contact stops or opens."""
        at = self.sliding
        away = at.system.start - at.x
        away[2 * len(at.system.coordinates) :] = 0.0
        return float(np.abs(_contact_rows(at) @ away).max(initial=0.0))

    def knocked(self, size: float, seconds: float) -> Scene:
        """The scene with a knock of `size` (in its units) at the begin of a run of `seconds`."""
        knock = Knock(step="knock", impulse=size * self.unit)
        return replace(self.scene, protocol=(knock, Hold(step="hold", time=seconds)))


def cases(growth: Growth, found: Findings) -> Iterator[Case]:
    """Yield the robust design and the nominal optimum with the nominal and the worst rig, as far as these slide."""
    for entry in found.entries:
        if entry.name in (ROBUST, NOMINAL):
            yield from _of_design(growth, entry)


def _of_design(growth: Growth, entry: Entry) -> Iterator[Case]:
    box: Box = growth.box
    name = entry.name if box.free else SCENE
    design = box.design(entry.x)
    for rig, u in ((NOMINAL_RIG, box.centre), (WORST_RIG, entry.worst.u)):
        values = box.rig(design, u)
        try:
            matrix = growth.matrix(entry.x, u)
        except NoSliding:
            continue
        rates = matrix.spectrum
        rate, hertz = growth.of_rates(rates, matrix.up_to)
        if math.isfinite(rate):
            scene = growth.rig(design, values) if growth.closed else growth.designed(design).with_values(values)
            both = {**design, **values}
            yield Case(name, rig, at_sliding(_alone(scene, growth.closed)), both, of_rates(rates, rate, hertz))


def _alone(scene: Scene, closed: bool) -> Scene:
    """The scene without its protocol and the faults of its parts, with loops that are closed from the begin."""
    controllers: dict[str, Any] = {}
    for name, section in scene.controllers.items() if closed else ():
        at_once = "enable_at" in type(section).model_fields
        controllers[name] = section.model_copy(update={"enable_at": 0}) if at_once else section
    believed = scene.believed if closed else {}
    clock = scene.clock.model_copy(update={"unstable": "run"})
    return replace(scene, controllers=controllers, believed=believed, clock=clock, protocol=(), faults={})


def at_sliding(scene: Scene) -> Scene:
    """Return the scene with the values `start.*` that begin a run nearest to steady sliding.

    Its controllers are still designed for the start that it had.
    """
    own = {key: value for key, (value, _) in scene.values().items() if _states_start(key, value)}
    at = at_rest(scene)[1]
    count = 2 * len(at.system.coordinates)
    begins = at.system.start[:count]
    columns: dict[str, Array] = {}
    for key, value in own.items():
        try:
            columns[key] = at_rest(scene.with_values({key: value + 1.0}))[1].system.start[:count] - begins
        except SceneError:  # a start that the scene does not take
            continue
    if not columns:
        return scene
    changes, *_ = np.linalg.lstsq(np.column_stack([*columns.values()]), at.x[:count] - begins, rcond=None)
    starts = {key: own[key] + change for key, change in zip(columns, changes.tolist())}
    made = scene.with_values(starts)
    if not scene.controllers or scene.redesign:
        return made
    return replace(made, believed={**{key: own[key] for key in starts}, **scene.believed})


def _states_start(key: str, value: Any) -> bool:
    return key.startswith("start.") and isinstance(value, float)


def _contact_rows(at: Steady) -> Array:
    """Rows over the states whose value is 1 or -1 where a contact stops or opens [row, state]."""
    system = at.system
    slope = inputs(system, at.modes, at.x, own_law(system, at.modes))[1]
    load = at.modes.load + at.modes.load_t @ slope
    slips = at.speed != 0.0
    pressed = at.load > 0.0
    return np.vstack([system.slip_rows[slips] / at.speed[slips, None], load[pressed] / at.load[pressed, None]])


def _unit(at: Steady) -> float:
    """See `Case.unit`: the largest amplitude within a period of the slowest mode, before the plant grows by itself."""
    system = at.system
    if not system.strike.any():
        return 0.0
    first = len(system.coordinates)
    x = np.zeros(system.n)
    x[first : 2 * first] = np.linalg.solve(system.mass, system.strike)
    growth = float(at.eigenvalues()[0].real)
    slowest = at.time_scales()[1]
    step = expm(at.A * (min(slowest, 1.0 / growth if growth > 0.0 else math.inf) / _STEPS))
    rows = _contact_rows(at)
    largest = 0.0
    for _ in range(_STEPS):
        largest = max(largest, float(np.abs(rows @ x).max(initial=0.0)))
        x = step @ x
    return 1.0 / largest if largest else 0.0
