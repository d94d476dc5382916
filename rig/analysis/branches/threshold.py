"""The unstable cycle between sliding and stick-slip as a threshold: least knocks to either side, shares of starts.

With one degree of freedom the cycle is a closed curve in the plane of displacement and velocity. What starts within it
comes to slide, what starts outside comes to vibrate. In more dimensions, and to confirm a threshold, motions are
simulated: a motion slides once it is so close to sliding that it can only decay (rig.analysis.cycles.cycle.Rest).

A knock is an impulse where the plant states it, or a pulse of an actuator: another value for a stated duration.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.branches.begin import Start, from_start
from rig.analysis.branches.compute import Job
from rig.analysis.branches.places import Place
from rig.analysis.branches.result import CYCLES, Branch, Branches
from rig.analysis.branches.trace import follow
from rig.analysis.cycles.cycle import Rest, comes_to_slide, stuck
from rig.analysis.cycles.return_map import Family
from rig.bench.free_rig import TIGHT, FreeRig
from rig.errors import UsageError
from rig.printable import columns, counted
from rig.scenes.axis import Axis
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, steady
from rig.units import si

Array = NDArray[np.float64]
Ranges = Mapping[str, tuple[float | str, float | str]]
"""Ends of the range of starts, by state; a text is a number with a unit of one."""
BESIDE = 1e-6
"""Share of a knock by which a threshold is confirmed from both sides."""
_CLOSE = 1e-9  # of the value: reached
_CURVE = 20000  # points of the closed curve, at least: its chords are then 1e-8 of it away
_STEPS = 50  # along the branch to a value
_NEVER = 1e-3  # of the largest: a knock in another direction than the motion
_PHASES = 400  # of a stable cycle at which a knock is tried on the closed curve,
_SIMULATED = 12  # and by simulation
_FINEST = 1.0 / 128.0  # share of the largest knock: the smallest that is tried,
_SIZES = 15  # and how many up to the largest
_BEYOND = 32.0  # ranges of the unstable cycle that an impulse may lead away
_LONGEST = 100  # periods of the unstable cycle that a pulse may last


@dataclass(frozen=True)
class Knock:
    """The least knock that leads to another motion: its `size` (an impulse, or the change of an actuator) in `unit`.

    `back`: from stick-slip to sliding, at a phase [s]. `confirmed`: by simulation of a little less and a little more.
    """

    size: float
    unit: str
    back: bool
    phase: float
    confirmed: bool


class Pulse(NamedTuple):
    """A pulse of an actuator, by the state that its command writes: held for `duration` [s] off its own value.

    `room` [2]: how far it can go to either side.
    """

    state: int
    unit: str
    duration: float
    room: tuple[float, float]


@dataclass(frozen=True)
class Share:
    """Share of starts that come to slide, of `count`; with its interval of 90 %. `simulated`: not by the threshold."""

    slides: float
    low: float
    high: float
    count: int
    simulated: bool

    @classmethod
    def of(cls, slides: NDArray[np.bool_], simulated: bool) -> Share:
        """The share of starts that slide, and its interval by Wilson."""
        from scipy.stats import binomtest

        low, high = map(float, binomtest(int(slides.sum()), len(slides)).proportion_ci(0.9, "wilson"))
        return cls(float(slides.mean()), low, high, len(slides), simulated)


def refuse_controllers(scene: Scene, plant_alone: bool) -> None:
    """Raise UsageError for a scene with controllers, unless the threshold of the `plant_alone` is asked for."""
    if scene.controllers and not plant_alone:
        raise UsageError(
            f"{scene.name}: a threshold is computed without controllers, but this scene has "
            f"{', '.join(scene.controllers)}: with a controller the least knock is another one. "
            "--plant-alone computes that of the plant without it; "
            "rig study SCENE --over start.KEY=VALUES --measure run.rms simulates starts with it"
        )


def pulsed(family: Family, value: float, knock: str) -> tuple[FreeRig, Pulse | None]:
    """The rig at a value of the parameter with the actuator of a knock as a state, and the pulse; without a knock the
    rig as it is. Raises UsageError.
    """
    if not knock:
        return family.rig((value,)), None
    name, _, time = knock.strip().partition(" ")
    scene = family.scene_at((value,))
    assembly = family.assembled(scene, {name})
    actuator = assembly.inputs.get(name)
    try:
        duration = si(time, "s")
    except ValueError as fault:
        raise UsageError(f'knock {knock}: expected ACTUATOR DURATION, e.g. "load.force 20 ms" ({fault})') from None
    if actuator is None or not actuator.state or not duration > 0.0:
        known = ", ".join(key for key, entry in assembly.inputs.items() if entry.state or key != name)
        raise UsageError(f"knock {knock}: expected an actuator of {scene.name} ({known}) and a duration above 0 s")
    rig = FreeRig(scene, assembly, tolerance=TIGHT)
    state = rig.system.names.index(actuator.state)
    now = float(rig.settled[state])
    return rig, Pulse(state, actuator.unit, duration, (actuator.high - now, now - actuator.low))


def known_ranges(rig: FreeRig, ranges: Ranges) -> dict[str, tuple[float, float]]:
    """The ranges of starts by state, as numbers. Raises UsageError for what is no state, and for no range."""
    names = [rig.system.names[i] for i in rig.moving]
    known = {}
    for name, ends in ranges.items():
        if name not in names:
            raise UsageError(f"start {name}: is no state of the rig; known: {', '.join(names)}")
        low, high = (si(end, "1") if isinstance(end, str) else float(end) for end in ends)
        if not (low < high and math.isfinite(high - low)):
            raise UsageError(f"start {name}={low:g}:{high:g}: expected two finite numbers, the smaller one first")
        known[name] = (low, high)
    return known


def refuse_outside(axis: Axis, value: float) -> None:
    """Raise UsageError for a value of the parameter at which no branch is followed."""
    low, high = axis.values[0], axis.values[-1]
    if not low <= value <= high:
        raise UsageError(
            f"{axis.key} = {axis.text(value)} lies outside of the range that is followed, {axis.text(low)} to "
            f"{axis.text(high)}: widen it, or take a value within it"
        )


@dataclass(frozen=True)
class Asked:
    """What is asked of a threshold: a value of the parameter (SI), a knock, ranges of starts, of `Threshold`."""

    value: float
    knock: str
    ranges: Mapping[str, tuple[float, float]]
    plant_alone: bool

    @classmethod
    def parse(cls, job: Job, value: str, starts: str | None, knock: str, plant_alone: bool) -> Asked:
        """Read a value with a unit and ranges such as "x=-2:2"; branches need not be known. Raises UsageError."""
        refuse_controllers(job.scene, plant_alone)
        try:
            at = si(value, job.axis.unit)
        except ValueError as fault:
            raise UsageError(f"--threshold {value}: {fault}") from None
        refuse_outside(job.axis, at)
        ranges = {}
        for part in (starts or "").split(","):
            if part.strip():
                name, _, ends = part.partition("=")
                try:
                    low, high = (float(end) for end in ends.split(":"))
                except ValueError:
                    raise UsageError(f'--starts {part.strip()}: expected STATE=FROM:TO, e.g. "x=-2:2"') from None
                ranges[name.strip()] = (low, high)
        rig, _ = pulsed(Family(job.scene, [job.axis], [job.output]), at, knock)
        return cls(at, knock, known_ranges(rig, ranges), plant_alone)

    def of(self, branches: Branches) -> Threshold:
        """The threshold on branches. Raises UsageError if there is none."""
        threshold = Threshold(branches, self.value, self.knock, self.plant_alone)
        threshold.ranges = self.ranges
        return threshold


class Threshold:
    """The unstable cycle at a value (SI) of the parameter of `branches`; `knock`: actuator and duration of its pulse,
    such as "load.force 20 ms". `plant_alone`: leave out the controllers of the scene. Raises UsageError if there is no
    such cycle, and for a scene with controllers unless `plant_alone`.
    """

    def __init__(self, branches: Branches, value: float, knock: str = "", plant_alone: bool = False) -> None:
        refuse_controllers(branches.scene, plant_alone)
        axis = branches.axis
        refuse_outside(axis, value)
        self.value = value
        self.text_of_value = axis.text(value)
        self.knock = knock
        self.ranges: Ranges = {}
        self.family = Family(branches.scene, [axis], [branches.output])
        self.rig, self.pulse = pulsed(self.family, value, knock)
        self.sliding: Steady = steady(self.rig.system, self.rig.key)
        cycles = [(branch, point.stable) for branch, point in branches.at(value) if branch.kind == CYCLES]
        unstable = [branch for branch, attracts in cycles if not attracts]
        stable = [branch for branch, attracts in cycles if attracts]
        self.rest = Rest(self.sliding, stuck(self.rig.system, self.sliding.x))
        if not unstable or not self.rest.stable:
            at = f"{axis.key} = {self.text_of_value}"
            stopped = self._stopped(branches) if self.rest.stable else ""
            if stopped:
                raise UsageError(f"{branches.scene.name}: an unstable cycle at {at} is not known: {stopped}")
            raise UsageError(
                f"{branches.scene.name}: there is no unstable cycle at {at} beside stable sliding; branches with "
                "dashed lines show where there is one"
            )
        self.unstable = self._place(unstable[0])
        if self.pulse and self.pulse.duration > _LONGEST * self.unstable.period:
            raise UsageError(f"knock {knock}: is too long; at most {_LONGEST} periods of the unstable cycle")
        self.stable = self._place(stable[0]) if stable else None

    @staticmethod
    def _stopped(branches: Branches) -> str:
        """Where branches stopped that were not followed to their end, and what leads further; "" if none did."""
        parts = []
        for branch in branches.branches:
            end = branch.end
            if branch.kind == CYCLES and end is not None and end.kind in ("most", "unresolved"):
                parts.append(f"the branch {branch.name} stopped at {branches.axis.text(end.value)} ({end.why})")
                parts += ["raise --points"] if end.kind == "most" else []
        return "; ".join(dict.fromkeys(parts))

    def _place(self, branch: Branch) -> Place:
        """The cycle at the value, from its neighbours on the branch."""
        for a, b in zip(branch.points, branch.points[1:]):
            if min(a.value, b.value) <= self.value <= max(a.value, b.value) and a.value != b.value:
                closest = min((a, b), key=lambda point: abs(point.value - self.value))
                return self._moved(from_start(self.family, Start(closest.value, closest.state, closest.period)))
        raise UsageError(f"the branch {branch.name} does not reach {self.text_of_value}")

    def _moved(self, at: Place) -> Place:
        """The cycle at the value, along the branch from a place near it."""
        if math.isclose(at.p, self.value, rel_tol=_CLOSE):
            return at
        towards = at if at.t[-1] * (self.value - at.p) > 0.0 else replace(at, t=-at.t)
        segment = next(follow(towards, min(at.p, self.value), max(at.p, self.value), _STEPS))
        if not math.isclose(segment.places[-1].p, self.value, rel_tol=_CLOSE):
            raise UsageError(f"the cycle at {self.text_of_value} lies beside a special point; take another value")
        return segment.places[-1]

    @property
    def planar(self) -> bool:
        """Whether the threshold is a closed curve around sliding in a plane."""
        return len(self.rig.moving) == 2 and not self.unstable.end.events

    @cached_property
    def curve(self) -> Array:
        """The unstable cycle [point, moving state], closed; between ticks by cubic Hermite polynomials."""
        rig, run = self.rig, self.unstable.run
        ends = np.vstack([run.states, run.states[:1]])
        rates = np.array([rig.rate(x, run.key) for x in ends])
        steps = np.full(len(ends) - 1, rig.step)
        steps[-1] = self.unstable.period - rig.step * (len(run.states) - 1)
        u = np.linspace(0.0, 1.0, max(math.ceil(_CURVE / len(steps)), 2), endpoint=False)[None, :, None]
        a, b = ends[:-1, None, rig.moving], ends[1:, None, rig.moving]
        da, db = (rates[part][:, None, rig.moving] * steps[:, None, None] for part in (slice(-1), slice(1, None)))
        between = (1.0 + 2.0 * u) * (1.0 - u) ** 2 * a + u * (1.0 - u) ** 2 * da
        between = between + u**2 * (3.0 - 2.0 * u) * b + u**2 * (u - 1.0) * db
        points = between.reshape(-1, len(rig.moving))
        return np.vstack([points, points[:1]])

    def inside(self, starts: Array) -> NDArray[np.bool_]:
        """Return whether starts [n, 2] lie within the closed curve of the unstable cycle."""
        from matplotlib.path import Path

        return np.asarray(Path(self.curve).contains_points(starts), dtype=np.bool_)

    def slides(self, moving: Array) -> bool:
        """Return whether the motion from these moving states comes to slide, by simulation."""
        return self._slides(self._state(moving))

    def _state(self, moving: Array) -> Array:
        x = self.rig.settled.copy()
        x[self.rig.moving] = moving
        return x

    def _slides(self, x: Array) -> bool:
        def known(x: Array) -> bool | None:  # outside of the curve for good
            if not self.planar:
                return None
            return self.rest.reached(x) or bool(self.inside(x[self.rig.moving][None])[0])

        ends = comes_to_slide(self.rig, self.rest, x, self.unstable.period, known)
        return bool(self.rest.share(x) < self.rest.share(self.rig.settled)) if ends is None else ends

    def struck(self, x: Array, size: float) -> Array:
        """Return the state after a knock in state x: an impulse [N s], or the pulse of the actuator."""
        rig = self.rig
        pulse = self.pulse
        after = x.copy()
        if pulse is None:
            nq = len(rig.system.coordinates)
            after[nq : 2 * nq] += size * np.linalg.solve(rig.system.mass, rig.system.strike)
            return after
        after[pulse.state] += size
        after = rig.carried(after, pulse.duration).x.copy()
        after[pulse.state] -= size
        return after

    def knocks(self) -> list[Knock]:
        """Return the least knocks from sliding, and back from the stable cycle, each confirmed by simulation."""
        rig = self.rig
        if self.pulse is None and not rig.system.strike.any():
            raise UsageError(f"{rig.scene.name}: its plant states no place for a knock; name an actuator")
        knocks = self._least([(self._state(self.sliding.x[rig.moving]), 0.0)], back=False)
        if self.stable is not None:
            states = self.stable.run.states
            stride = max(len(states) // (_PHASES if self.planar and self.pulse is None else _SIMULATED), 1)
            moving = states[::stride, self.stable.rig.moving]
            knocks += self._least([(self._state(x), i * stride * rig.step) for i, x in enumerate(moving)], back=True)
        return knocks

    def _least(self, starts: Sequence[tuple[Array, float]], back: bool) -> list[Knock]:
        """The least knock in one of the states, which occur at times [s], that leads to the other motion."""
        if self.planar and self.pulse is None:
            ways = self._crossings(starts)
        else:
            ways = self._simulated(starts, back)
        if not ways:
            return []
        size, (x, phase) = min(ways, key=lambda way: abs(way[0]))
        short = self._slides(self.struck(x, (1.0 - BESIDE) * size))
        beyond = self._slides(self.struck(x, (1.0 + BESIDE) * size))
        confirmed = short != back and beyond == back
        unit = self.pulse.unit if self.pulse else "N s"
        return [Knock(size, unit, back, phase, confirmed)]

    def _crossings(self, starts: Sequence[tuple[Array, float]]) -> list[tuple[float, tuple[Array, float]]]:
        """The impulses that lead to the closed curve."""
        moving = self.rig.moving
        out = []
        for x, phase in starts:
            direction = (self.struck(x, 1.0) - x)[moving]
            for sign in (1.0, -1.0):
                size = self._crossing(x[moving], sign * direction)
                if size is not None:
                    out.append((sign * size, (x, phase)))
        return out

    def _simulated(self, starts: Sequence[tuple[Array, float]], back: bool) -> list[tuple[float, tuple[Array, float]]]:
        """The same by simulation: of sizes that grow step by step up to the first that leads to the other motion."""
        if self.pulse is None:
            first, _ = starts[0]
            unit = (self.struck(first, 1.0) - first)[self.rig.moving]
            span = np.ptp(self.unstable.run.states, axis=0)[self.unstable.rig.moving]
            moved = np.abs(unit) > _NEVER * np.abs(unit).max()
            room = _BEYOND * float((span[moved] / np.abs(unit[moved])).min())
            rooms = (room, room)
        else:
            rooms = self.pulse.room
        before = 0.0
        for share in np.geomspace(_FINEST, 1.0, _SIZES):
            out = []
            for x, phase in starts:
                for sign, room in zip((1.0, -1.0), rooms):
                    if self._slides(self.struck(x, sign * share * room)) == back:
                        size = self._halved(x, sign * before * room, sign * share * room, back)
                        out.append((size, (x, phase)))
            if out:
                return out
            before = float(share)
        return []

    def _halved(self, x: Array, inside: float, outside: float, back: bool) -> float:
        """The size between two, of which only the second leads to the other motion."""
        while abs(outside - inside) > 0.1 * BESIDE * abs(outside):
            middle = 0.5 * (inside + outside)
            ends = self._slides(self.struck(x, middle)) == back
            inside, outside = (inside, middle) if ends else (middle, outside)
        return 0.5 * (inside + outside)

    def _crossing(self, origin: Array, direction: Array) -> float | None:
        """The least distance along a direction at which it crosses the closed curve."""
        a, b = self.curve[:-1] - origin, self.curve[1:] - origin
        normal = np.array([-direction[1], direction[0]])
        fa, fb = a @ normal, b @ normal
        cross = np.flatnonzero((fa <= 0.0) != (fb <= 0.0))
        share = (fa[cross] / (fa[cross] - fb[cross]))[:, None]
        along = ((1.0 - share) * a[cross] + share * b[cross]) @ direction / (direction @ direction)
        ahead = along[along > 0.0]
        return float(ahead.min()) if len(ahead) else None

    def drawn(self, ranges: Ranges, count: int, seed: int = 1) -> Array:
        """Draw starts [count, moving state], uniform in `ranges` (state -> ends); other states are those of sliding."""
        names = [self.rig.system.names[i] for i in self.rig.moving]
        starts = np.tile(self.sliding.x[self.rig.moving], (count, 1))
        draw = np.random.default_rng(seed)
        for name, (low, high) in known_ranges(self.rig, ranges).items():
            starts[:, names.index(name)] = draw.uniform(low, high, count)
        return starts

    def share(self, ranges: Ranges, count: int = 4000, seed: int = 1) -> Share:
        """Return the share of starts, drawn as `drawn` does, that come to slide: by the threshold or by simulation."""
        starts = self.drawn(ranges, count, seed)
        inside = self.inside(starts) if self.planar else np.array([self.slides(start) for start in starts])
        return Share.of(inside, not self.planar)

    @cached_property
    def _results(self) -> tuple[list[Knock], Share | None]:
        knocks = self.knocks()
        return knocks, self.share(self.ranges) if self.ranges else None

    def to_json(self) -> dict[str, Any]:
        """Return knocks and share of starts as JSON values."""
        knocks, share = self._results
        return {
            "value": self.value,
            "planar": self.planar,
            "knock": self.knock,
            "knocks": [asdict(knock) for knock in knocks],
            "share": share and asdict(share),
        }

    def text(self) -> str:
        """Return the least knocks, and the share of starts, as text."""
        knocks, share = self._results
        what = f"change of {self.knock}" if self.pulse else "impulse"
        rows = [(f"least knock at {self.text_of_value}", what, "", "confirmed by simulation from both sides")]
        for knock in knocks:
            what = "from stick-slip to sliding" if knock.back else "from sliding to stick-slip"
            at = f"{knock.phase:.4g} s into the period" if knock.back else ""
            rows.append((what, f"{knock.size:.8g} {knock.unit}", at, "yes" if knock.confirmed else "no"))
        lines = [*columns(rows, "<><<")]
        if text := left_out(self.rig.scene):
            lines.append(f"{text}: with its loop closed the least knock is another one")
        if self.stable is None:
            lines.append(
                "no stable cycle was followed at this value, which may lie beside its end: no knock back is computed"
            )
        if share is not None:
            how = "by simulation" if share.simulated else "by the threshold"
            interval = f"{100.0 * share.low:.4g} to {100.0 * share.high:.4g} % with 90 %"
            starts = f"{100.0 * share.slides:.4g} % of {counted(share.count, 'start')}"
            lines.append(f"{starts} come to slide ({interval}; {how})")
        return "\n".join(lines)
