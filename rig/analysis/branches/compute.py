"""What is followed and from where: steady sliding, the cycles that begin at its Hopf points, and those that a
simulation, a map or a recording shows.

Every family of cycles is saved while it is computed. An interrupted computation goes on from its last point.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.branches import begin
from rig.analysis.branches.begin import HOPF, SIMULATION, Start
from rig.analysis.branches.places import FAILURES, Place, missed, place
from rig.analysis.branches.result import CYCLES, FORCED, REST, SLIDING, Branch, Branches, Point, SpecialPoint
from rig.analysis.branches.trace import LONGEST, Segment, Special, follow
from rig.analysis.cycles.cycle import limit_cycle
from rig.analysis.cycles.cycle_report import Cycle
from rig.analysis.cycles.repetition import refuse
from rig.analysis.cycles.return_map import Family, ReturnMap, same, word
from rig.analysis.linear import eigenvalue_curves as curves
from rig.analysis.linear.modes import at_rest
from rig.analysis.linear.sweep import Critical, Sweep, sweep
from rig.analysis.pool import Store, Work, digest, packed, unpacked
from rig.errors import RigError, UsageError
from rig.machine.files import write_file
from rig.model.formulation import signal_rows
from rig.model.friction_law import coulomb
from rig.model.method import ADAPTIVE, chosen
from rig.model.singular import assembled
from rig.model.system import System
from rig.printable import counted
from rig.scenes.axis import Axis
from rig.scenes.faults import near
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene
from rig.solve.records import CLOSED, SLIP_MINUS, SLIP_PLUS
from rig.stability.linearisation import Steady, settled, sliding_key, steady

Array = NDArray[np.float64]
Watch = Callable[[str], object]
ROOT = Path("branches")
FILE = "branches.json"
"""The file of finished branches: `Branches.to_json`, with the plant and the values of the scene."""
VALUES = 41
"""Values of the parameter at which sliding is computed, if the range names no number."""
POINTS = 400
"""Most points of a family of cycles."""
SAVE = 2.0
"""Seconds between two savings: an interruption loses at most so much."""
_SAME_PERIOD = 1e-3  # relative: the period of a motion may lie so far beside those of two points of its branch
_SAME_SIZE = 2e-2  # relative: the same of their size
_SAME_POINT = 1e-8  # relative: two values of one Hopf point
_SMALL = 1e-9  # of the largest speed of a surface: it rests
_NEAR = 1e-7  # of a critical value: growth is straight up to there


@dataclass(frozen=True)
class Job:
    """Branches to be computed. `starts`: "hopf", "simulation", values at which to simulate, motions."""

    scene: Scene
    axis: Axis
    output: str
    starts: tuple[str | float | Start, ...] = (HOPF, SIMULATION)
    most: int = POINTS
    longest: float = LONGEST

    @property
    def work(self) -> Work:
        """Name and identity of the folder of the results."""
        axis = (self.axis.key, self.axis.values)
        identity = repr([axis, self.output, self.starts, self.most, self.longest])
        shown = {name: getattr(self.axis, name) for name in ("key", "unit", "values", "shown")}
        about = {"scene": json.loads(self.scene.to_json()), "axes": [shown], "output": self.output, "settings": {}}
        return Work(dict, range(0), f"{self.scene.name}", digest(self.scene, identity), about=about)


def job(
    scene: Scene,
    over: str,
    output: str | None = None,
    starts: Sequence[Any] = (HOPF, SIMULATION),
    most: int = POINTS,
) -> Job:
    """Describe branches: `over` as rig.scenes.axis.Axis parses it, or KEY=FROM:TO; `starts`: see `rig.branches`.

    Raises SceneError, UsageError.
    """
    refuse(scene, "a branch of cycles")
    axis = Axis.parse(over, scene, count=VALUES)
    axis = replace(axis, values=tuple(sorted(axis.values)))
    assembly = scene.assemble()
    outputs = assembly.outputs
    watched = next(iter(outputs)) if output is None else output
    faults = []
    if watched not in outputs:
        faults.append(f"output {watched}: {scene.plant} has no such output; {near(watched, outputs)}")
    faults += unfit(scene, axis)
    if faults:
        raise UsageError("\n".join(f"{scene.name}: {fault}" for fault in faults))
    motions: list[str | float | Start] = []
    for start in starts:
        motions += begin.starts(start, scene, axis)
    return Job(scene, axis, watched, tuple(motions), most)


def unfit(scene: Scene, axis: Axis) -> Iterator[str]:
    """Yield why the cycles of a scene cannot be followed over a parameter."""
    if idle := axis.idle(scene):
        yield idle
    first, last = (axis.at(scene, axis.values[i]).assemble().system() for i in (0, -1))
    if not first.patches:
        yield "the rig has no contact that can slide"
        return
    method = chosen(scene.clock.method, first)
    if method not in ("exact", *ADAPTIVE):
        yield (
            f"clock.method = {method}: branches need located events, which exact, {', '.join(ADAPTIVE)} have; "
            "-p clock.method=auto"
        )
    if running := _running(first):
        yield (
            f"{running} runs on: the surface is uneven, the motion follows its turns, and no cycle repeats. "
            "Leave the unevenness out (-p waviness=none, -p inhomogeneity=none, -p sector=none), or use rig map"
        )
    if same(first, last) and np.array_equal(settled(first, first.start), settled(last, last.start)):
        yield f"{axis.key} acts on no steady motion of the rig"
    if why := _changed(first, last) or _turned(axis, first, last):
        yield why


def _running(system: System) -> str:
    """A driving state that neither rests nor belongs to a generator, such as the travel of an uneven surface; or ""."""
    x = settled(system, system.start)
    A = assembled(system, sliding_key(system)).A
    rates = np.where(np.abs(A @ x) > _SMALL * (np.abs(A) @ np.abs(x)), A @ x, 0.0)  # a lag rests but for rounding
    turning = {state for a, b, _ in system.generators for state in (a, b)}
    return next((system.names[i] for i in range(system.one, system.n) if rates[i] and i not in turning), "")


def _changed(first: System, last: System) -> str:
    def names(system: System) -> tuple[object, ...]:
        patches = [patch.name for patch in system.patches]
        normals = [normal.name for normal in system.normals]
        return patches, normals, list(system.coordinates), system.n

    if names(first) == names(last):
        return ""
    return "the parameter changes the contacts or the coordinates of the rig in this range"


def _turned(axis: Axis, first: System, last: System) -> str:
    """Whether a surface changes its direction over the range."""
    if any(a * b < 0.0 for a, b in zip(_surface_speeds(first), _surface_speeds(last))):
        return f"{axis.key}: a surface changes its direction in this range; compute each side of 0 on its own"
    return ""


def _surface_speeds(system: System) -> list[float]:
    """The speed of each surface as it is driven at the start, without the motion of the rig."""
    x = system.start.copy()
    x[: system.one] = 0.0
    return [float(patch.surface @ x) for patch in system.patches]


def branches(job: Job, root: Path = ROOT, watch: Watch = lambda text: None) -> Branches:
    """Compute the branches of a job; what its folder under `root` holds is not computed again.

    `watch` gets what is done, in words. Raises UsageError if the folder cannot be used. After an interruption the same
    call continues.
    """
    work = job.work
    store = Store.of(work, root)
    with store.open(work):
        result = Computation(job, store, watch).run()
        content = result.to_json() | {"plant": job.scene.plant, "values": begin.values_of(job.scene)}
        write_file(store.folder / FILE, json.dumps(content).encode())
        return result


def driven_by(job: Job) -> str:
    """Return the name of the generator that forces the rig of a job, such as "dither"; "" if none does."""
    system = job.axis.at(job.scene, job.axis.values[-1]).assemble().system()
    running = (system.names[a] for a, b, _ in system.generators if system.start[[a, b]].any())
    return next(running, "").split(".")[0]


def store_of(job: Job, root: Path = ROOT) -> Store:
    """Return the store of a job under `root`."""
    return Store.of(job.work, root)


class Computation:
    """One computation of all branches of a job; without a store nothing is saved.

    `specials`: the special points of the cycles that it has followed itself, not of those that it found in the store.
    """

    def __init__(self, job: Job, store: Store | None = None, watch: Watch = lambda text: None) -> None:
        self.job = job
        self.store = store
        self.watch = watch
        self.axis = job.axis
        self.family = Family(job.scene, [job.axis], [job.output])
        self.low = job.axis.values[0]
        self.high = job.axis.values[-1]
        self.saved = {unit: unpacked(arrays) for unit, arrays in store.load().items()} if store else {}
        self.branches: list[Branch] = []
        self.specials: list[Special] = []
        self.notes: list[str] = []
        self.unit = -1

    def run(self) -> Branches:
        """Compute everything."""
        if alone := left_out(self.job.scene):
            self.notes.append(alone)
        if forcing := driven_by(self.job):
            self._forced(forcing)
        else:
            self._sliding_and_cycles()
        unit = self.job.scene.assemble().outputs[self.job.output].unit
        notes = tuple(dict.fromkeys(self.notes))
        folder = self.store.folder if self.store else None
        return Branches(self.job.scene, self.axis, self.job.output, unit, tuple(self.branches), notes, folder)

    def _sliding_and_cycles(self) -> None:
        self.watch("sliding")
        swept = sweep(self.job.scene, self.axis)
        self.branches += _equilibria(self.job, swept)
        for start in self.job.starts:
            if start == HOPF:
                self._from_hopf_points(swept)
            elif start == SIMULATION:
                middle = 0.5 * (self.low + self.high)
                for value in (middle, self.low, self.high):
                    self._from_simulation(value)
            elif isinstance(start, float):
                self._from_simulation(start)
            elif isinstance(start, Start):
                self._both_ways(start)

    def _from_hopf_points(self, swept: Sweep) -> None:
        for critical in swept.critical:
            if critical.kind != "flutter":
                what = f"at {self.axis.text(critical.value, 10)} sliding ends by {critical.kind}, where no cycle begins"
                self.notes.append(what)
                continue
            value = critical.value
            known = any(self._ends_at(branch, value) for branch in self.branches)
            make = (lambda: None) if known else partial(begin.from_hopf, self.family, value)
            self._family(make, f"the Hopf point at {self.axis.text(value, 8)}")

    @staticmethod
    def _ends_at(branch: Branch, value: float) -> bool:
        """Whether cycles that are followed already have shrunk to the Hopf point at a value."""
        end = branch.end
        if branch.kind != CYCLES or end is None or end.kind != "hopf":
            return False
        return abs(end.value - value) <= max(end.accuracy, _SAME_POINT * abs(value))

    def _from_simulation(self, value: float) -> None:
        if (raw := self.saved.get(self.unit + 1)) is not None:  # it was found before
            first = Point.of(raw["branches"][0]["points"][0]) if raw["branches"] else None
            self._both_ways(None if first is None else Start(first.value, first.state, first.period))
            return
        self.watch(f"simulation at {self.axis.text(value)}")
        try:
            cycle = limit_cycle(self.axis.at(self.job.scene, value))
        except RigError as error:
            self.notes.append(f"simulation at {self.axis.text(value)}: {' '.join(str(error).split())}")
            cycle = None
        known = False
        if cycle is not None and cycle.found:
            known = any(self._holds(branch, value, cycle) for branch in self.branches)
        elif cycle is not None and not cycle.decided:
            self.notes.append(f"simulation at {self.axis.text(value)}: {cycle.why}")
        if cycle is None or not cycle.found or known:
            self._both_ways(None)
        else:
            self._both_ways(Start(value, cycle.state, cycle.period))

    def _at(self, value: float) -> list[tuple[Branch, Point]]:
        return Branches(self.job.scene, self.axis, self.job.output, "", tuple(self.branches)).at(value)

    def _holds(self, branch: Branch, value: float, cycle: Cycle) -> bool:
        """Whether a cycle has the events of a branch, and period and extremes between those of two of its points."""
        if branch.kind != CYCLES or word([what for _, what in cycle.events]) != branch.events:
            return False
        low, high = cycle.extremes[self.job.output]
        size = _SAME_SIZE * (high - low)
        for a, b in pairwise(branch.points):
            if _between(value, (a.value, b.value), _SAME_POINT * abs(value)):
                period = _between(cycle.period, (a.period, b.period), _SAME_PERIOD * cycle.period)
                if period and _between(low, (a.low, b.low), size) and _between(high, (a.high, b.high), size):
                    return True
        return False

    def _both_ways(self, start: Start | None) -> None:
        """Follow the cycle of a start to both sides; None: nothing, or what was saved."""
        for sign in (1.0, -1.0):

            def first(sign: float = sign) -> Place | None:
                if start is None or self._leaves(start.value, sign):
                    return None
                at = begin.from_start(self.family, start)
                return replace(at, t=sign * at.t)

            self._family(first, f"the motion at {self.axis.text(start.value)}" if start else "")

    def _leaves(self, value: float, sign: float) -> bool:
        """Whether a branch from a value leaves the range at once."""
        return value >= self.high if sign > 0.0 else value <= self.low

    def _forced(self, forcing: str) -> None:
        """Follow forced motions from the values of the starts; a simulation: from the middle and the ends."""
        self.notes.append(f"{forcing} is on: motions with its period are followed, and no steady sliding exists")
        simulated = [0.5 * (self.low + self.high), self.low, self.high]
        wanted = [s.value if isinstance(s, Start) else s for s in self.job.starts if s != HOPF]
        values: list[float] = []
        for start in wanted:
            values += simulated if isinstance(start, str) else [start]
        if not values:
            self.notes.append("such a motion begins at no Hopf point: --start simulation, or a value")
        for value in values:
            known = any(branch.kind == FORCED for branch, _ in self._at(value))
            for sign in (1.0, -1.0):

                def first(sign: float = sign, value: float = value, known: bool = known) -> Place | None:
                    if known or self._leaves(value, sign):
                        return None
                    at = begin.from_forced(self.family, value)
                    return replace(at, t=sign * at.t)

                self._family(first, f"the forced motion at {self.axis.text(value)}", FORCED)

    # one family: computed, saved, continued

    def _family(self, make: Callable[[], Place | None], what: str, kind: str = CYCLES) -> None:
        self.unit += 1
        saved = self.saved.get(self.unit, {"branches": [], "last": None, "done": False, "notes": []})
        made = [replace(Branch.of(raw), family=self.unit) for raw in saved["branches"]]
        notes = list(saved["notes"])
        if not saved["done"]:
            try:
                first = rebuilt(self.family, saved["last"]) if saved["last"] else make()
            except FAILURES as error:
                first = None
                notes.append(f"{what}: not followed: {' '.join(str(error).split())}")
            if first is None:
                self._save(made, None, True, notes)
            else:
                self._follow(made, first, notes, kind)
        self.branches += made
        self.notes += notes

    def _follow(self, made: list[Branch], first: Place, notes: list[str], kind: str) -> None:
        """Follow a family from a place on, and save it as it grows."""
        points: list[Point] = []
        last: list[Place] = []
        events: list[tuple[str, ...]] = []
        saved_at = time.monotonic()
        continued = bool(made) and made[-1].end is None
        if continued:
            points += made.pop().points

        def note(at: Place) -> None:
            nonlocal saved_at
            segment = Segment([at])
            if not points or not continued or len(last):
                points.append(_point(at))
            last[:] = [at]
            events[:] = [segment.names]
            self.watch(self._progress(made, points[-1]))
            if time.monotonic() - saved_at > SAVE:
                self._save([*made, Branch(kind, self.unit, segment.names, tuple(points))], at, False, notes)
                saved_at = time.monotonic()

        try:
            left = self.job.most - sum(len(b.points) for b in made) - len(points) + continued
            for segment in follow(first, self.low, self.high, max(left, 1), note, self.job.longest):
                self.specials += [*segment.specials, *filter(None, [segment.end])]
                specials = tuple(_special(special) for special in segment.specials)
                end = _special(segment.end) if segment.end else None
                made.append(Branch(kind, self.unit, segment.names, tuple(points), specials, end))
                points.clear()
                continued = False
        except KeyboardInterrupt:
            if last:
                kept = [*made, Branch(kind, self.unit, events[0], tuple(points))] if points else made
                self._save(kept, last[0], False, notes)
            raise
        self._save(made, None, True, notes)

    def _progress(self, made: Sequence[Branch], point: Point) -> str:
        count = sum(len(b.points) for b in (*self.branches, *made))
        how = "stable" if point.stable else "unstable"
        number = len(self.branches) + len(made) + 1
        return f"branch {number}: {self.axis.text(point.value)}, {how}; {counted(count, 'point')} before"

    def _save(self, made: Sequence[Branch], last: Place | None, done: bool, notes: Sequence[str]) -> None:
        raw: dict[str, Any] = {
            "branches": [branch.to_json() for branch in made],
            "last": last and raw_of(last),
            "done": done,
            "notes": list(notes),
        }
        for branch in raw["branches"]:
            del branch["name"]
        if self.store is not None:
            self.store.save({self.unit: packed(raw)})


def _equilibria(job: Job, swept: Sweep) -> Iterator[Branch]:
    """Steady sliding over the axis, split where there is none; at rest the interval of equilibria in stick."""
    criticals = [c.value for c in swept.critical if min(job.axis.values) < c.value < max(job.axis.values)]
    sliding: list[Point] = []
    rest: list[Point] = []
    parts: list[list[Point]] = [sliding]
    for value in sorted({*job.axis.values, *criticals}):
        scene = job.axis.at(job.scene, value)
        try:
            assembly, at = at_rest(scene)
        except RigError:
            at = None
        if at is not None and not at.speed.any():
            ends = _interval(at, dict(assembly.outputs[job.output].row))
            if ends is not None:
                rest.append(Point(value, *ends, stable=True, stick=1.0))
        elif at is not None and at.exists:
            rates = at.eigenvalues()
            level = _output(at, dict(assembly.outputs[job.output].row))
            stable = bool(np.all(rates.real <= curves.none(rates)))
            parts[-1].append(Point(value, level, level, stable, multipliers=tuple(complex(v) for v in rates)))
            continue
        if parts[-1]:
            parts.append([])
    for part in parts:
        if part:
            within = [critical for critical in swept.critical if part[0].value <= critical.value <= part[-1].value]
            specials = [_critical(job, critical, part) for critical in within]
            yield Branch(SLIDING, -1, (), tuple(part), tuple(specials))
    if rest:
        yield Branch(REST, -1, (), tuple(rest))


def _critical(job: Job, critical: Critical, part: Sequence[Point]) -> SpecialPoint:
    """The special point of a critical value within a part of steady sliding."""
    value = critical.value
    nearest = min(part, key=lambda point: abs(point.value - value))
    kind = "hopf" if critical.kind == "flutter" else critical.kind
    if critical.frequency:
        period = 1.0 / critical.frequency
        accuracy = _rounding(job, critical)
    else:
        period = math.nan
        accuracy = curves.RELATIVE * abs(value)
    return SpecialPoint(kind, value, accuracy, nearest.low, nearest.high, period)


def _rounding(job: Job, critical: Critical) -> float:
    """How far rounding can move the value of a critical point: the error of its eigenvalue, by the angle between its
    left and right vector in balanced coordinates, over the slope of its growth.
    """
    from scipy.linalg import matrix_balance

    def mode(value: float) -> tuple[float, float]:
        at = at_rest(job.axis.at(job.scene, value))[1]
        A = matrix_balance(at.A[np.ix_(at.moving, at.moving)])[0]
        rates, right, left = curves.of_matrix(A)
        i = int(np.abs(rates - 2j * math.pi * critical.frequency).argmin())
        lengths = float(np.linalg.norm(left[:, i]) * np.linalg.norm(right[:, i]))
        angle = lengths / max(float(np.abs(left[:, i] @ right[:, i])), _SMALL)
        return float(rates[i].real), curves.RELATIVE * float(np.linalg.norm(A, 2)) * angle

    value = critical.value
    low, high = sorted((job.axis.values[0], job.axis.values[-1]))
    below = max(value - _NEAR * abs(value), low)
    above = min(value + _NEAR * abs(value), high)
    growth_below, _ = mode(below)
    growth_above, _ = mode(above)
    least = curves.RELATIVE * abs(value)
    if growth_above == growth_below:
        return least
    _, error = mode(value)
    return max(least, error * abs(above - below) / abs(growth_above - growth_below))


def _output(at: Steady, row: dict[str, float]) -> float:
    over_x, over_t = signal_rows(at.system, at.modes, [row])
    return float((over_x @ at.x + over_t @ at.T)[0])


def _interval(at: Steady, row: dict[str, float]) -> tuple[float, float] | None:
    """Lowest and highest value of an output at rest in stick: friction up to the static limit to either side."""
    system = at.system
    laws = [coulomb(patch.law.static, patch.law.static) for patch in system.patches]
    limit = replace(system, patches=tuple(replace(patch, law=law) for patch, law in zip(system.patches, laws)))
    ends = []
    for modes in product((SLIP_PLUS, SLIP_MINUS), repeat=len(laws)):
        key = system.key(modes, [CLOSED] * len(system.normals), [0] * len(system.limiters))
        try:
            end = steady(limit, key)
        except RigError:
            return None
        if end.balanced:
            ends.append(_output(end, row))
    return (min(ends), max(ends)) if ends else None


def _between(number: float, ends: tuple[float, float], within: float) -> bool:
    """Whether a number lies between two others, or so near to them."""
    return min(ends) - within <= number <= max(ends) + within


def _point(at: Place) -> Point:
    """The point of a place."""
    rig = at.rig
    low, high = _extremes(at)
    stick = sum(part.end - part.begin for part in at.run.intervals(rig.step, at.period) if rig.stuck(part.key))
    of_motion, accuracy = at.known_multipliers()
    return Point(
        at.p,
        low=low,
        high=high,
        stable=not at.unstable,
        period=at.period,
        stick=stick / at.period,
        multipliers=of_motion,
        multiplier_accuracy=accuracy,
        residual=missed(at),
        state=dict(zip(rig.system.names, at.map.state(at.u).tolist())),
    )


def _extremes(at: Place) -> tuple[float, float]:
    """The lowest and the highest value of the output in a period."""
    (values,) = at.run.values
    return -_highest(-values, at.rig.step, at.period), _highest(values, at.rig.step, at.period)


def _highest(values: Array, step: float, period: float) -> float:
    """The maximum of a periodic series, by a parabola through its largest values."""
    values = values[: math.ceil(period / step - 0.5)]
    times = step * np.arange(len(values))
    k = int(values.argmax())
    x, y = (np.roll(series, 1 - k)[:3] for series in (times, values))
    if len(y) < 3 or max(y[0], y[2]) >= y[1]:
        return float(values[k])
    x = (x - times[k] + 0.5 * period) % period - 0.5 * period
    bend, slope, top = np.polyfit(x / step, y - values[k], 2).tolist()
    above = top - 0.25 * slope**2 / bend if bend < 0.0 else 0.0
    return float(values[k] + above)


def _special(special: Special) -> SpecialPoint:
    low, high = _extremes(special.at)
    return SpecialPoint(
        kind=special.kind,
        value=special.p,
        accuracy=special.accuracy,
        low=low,
        high=high,
        period=special.at.period,
        contact=special.contact,
        turns=special.turns,
        why=special.why,
    )


def raw_of(at: Place) -> dict[str, Any]:
    """Return a place as JSON values."""
    return {
        "u": at.u.tolist(),
        "t": at.t.tolist(),
        "size": at.map.size.tolist(),
        "T0": at.map.T0,
        "P0": at.map.P0,
        "others": at.map.others,
        "begins": at.map.begins,
        "forced": at.map.period is not None,
        "phase": at.map.phase,
        "step": at.step,
    }


def rebuilt(family: Family, raw: Mapping[str, Any]) -> Place:
    """Return the place of `raw_of`."""
    period = begin.period_of if raw["forced"] else None
    others = tuple(raw["others"])
    begins = tuple((tick, key) for tick, key in raw["begins"])
    map = ReturnMap(family, np.array(raw["size"]), raw["T0"], raw["P0"], others, period, raw["phase"], begins)
    u = np.array(raw["u"])
    at = place(map, u, map.end(u), t=np.array(raw["t"]))
    return replace(at, step=raw["step"])
