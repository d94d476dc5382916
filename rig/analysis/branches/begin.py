"""The first place of a branch of cycles: at a Hopf point, from a motion that was simulated or recorded, or from a map.

A forced motion is simulated until its start has decayed, then closed by Newton's method.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rig.analysis.branches.places import Place, place
from rig.analysis.branches.trace import VIRTUAL, Special, follow
from rig.analysis.cycles.repetition import repeating
from rig.analysis.cycles.return_map import Array, Family, NoCycle, ReturnMap, closed, driven, parameter, sizes
from rig.bench.free_rig import FreeRig
from rig.errors import UsageError
from rig.record import reader
from rig.record.run import Run
from rig.record.run_list import drives
from rig.results import Result
from rig.scenes.axis import Axis
from rig.scenes.scene import Scene
from rig.stability.linearisation import steady
from rig.units import si

HOPF = "hopf"
SIMULATION = "simulation"
_FOLLOWED = 300  # places of a branch whose end is wanted
_PERIODS = 2000  # of the dither, at most, that the start is simulated
_DECAYS = 1e-4  # of its size: a motion that changes by less in a period is close enough for Newton's method
_INSIDE = 0.05  # of a period: the base of a forced motion is no closer to an event
_WATCHED = 60.0  # periods of the slowest mode in which a recorded motion has to repeat
_REPEATS = 1e-2  # of a period: a recorded motion repeats if its drift is smaller
_VIBRATES = ("stick-slip", "vibration")
_MAY_DIFFER = ("start", "clock", "sensors", "controllers", "faults", "network", "limits")


@dataclass(frozen=True)
class Start:
    """A motion from which a branch is followed: value of the parameter, state by name, period [s] (0: not known)."""

    value: float
    state: Mapping[str, float] = field(hash=False)
    period: float = 0.0


def starts(given: object, scene: Scene, axis: Axis) -> Iterator[str | float | Start]:
    """Yield what branches begin from: of a word, a value, the folder of a map or the map, a recording or the run.

    Raises UsageError.
    """
    if isinstance(given, str) and given in (HOPF, SIMULATION):
        yield given
    elif isinstance(given, Start):
        yield given
    elif isinstance(given, Run):
        yield _of_run(given, scene, axis)
    elif isinstance(given, Result):  # a map
        yield from _of_records(given.points() if hasattr(given, "points") else [], axis, "the map")
    elif isinstance(given, int | float):
        yield _inside(float(given), axis)
    elif isinstance(given, Path) or (isinstance(given, str) and Path(given).exists()):
        path = Path(given)
        if path.is_dir():
            yield from _of_folder(path, axis)
        else:
            yield _of_run(reader.open(path), scene, axis)
    else:
        try:
            value = si(str(given), axis.unit)
        except ValueError as fault:
            what = "is neither hopf, simulation, the folder of a map, a recording, nor a value"
            raise UsageError(f"start {given!s:.60}: {what} ({fault})") from None
        yield _inside(value, axis)


def _inside(value: float, axis: Axis) -> float:
    low = min(axis.values)
    high = max(axis.values)
    if not low <= value <= high:
        raise UsageError(f"start {axis.text(value)}: is outside of the range {axis.text(low)} to {axis.text(high)}")
    return value


def _of_folder(folder: Path, axis: Axis) -> Iterator[float]:
    import csv

    table = folder / "map.csv"
    if not table.is_file():
        raise UsageError(f"start {folder}: holds no finished map (map.csv); compute one with the command rig map")
    rows = []
    with table.open() as file:
        for row in csv.DictReader(file):
            rows.append({key.split(" [")[0]: value for key, value in row.items()})
    yield from _of_records(rows, axis, str(folder))


def _of_records(rows: Any, axis: Axis, what: str) -> Iterator[float]:
    """The ends and the middle of each range in which a map shows vibration."""
    records = list(rows)
    if not records or axis.key not in records[0]:
        raise UsageError(f"start {what}: is no map over {axis.key}")
    stretch: list[float] = []
    chosen: list[float] = []
    low = min(axis.values)
    high = max(axis.values)
    for record in [*records, {}]:
        if any(str(record.get(name)) in _VIBRATES for name in record if name.endswith("_state")):
            value = float(record[axis.key])
            if low <= value <= high:
                stretch.append(value)
        elif stretch:
            chosen += [stretch[len(stretch) // 2], stretch[0], stretch[-1]]
            stretch = []
    if not chosen:
        raise UsageError(f"start {what}: shows no vibration from {axis.text(low)} to {axis.text(high)}")
    yield from dict.fromkeys(chosen)  # rows of a second axis name the same values again


def _of_run(run: Run, scene: Scene, axis: Axis) -> Start:
    """The last recorded state of a run, from the outputs that depend on states alone."""
    recorded = Scene.from_json(run.scene_text())
    _alike(recorded, scene, axis)
    speed = next(iter(drives(run)), "")
    values = recorded.values()
    value = float(values[axis.key][0]) if axis.key in values else math.nan
    if axis.key == "drive.speed" and speed:
        value = float(run.signals[speed][-1])
    rig = Family(scene, [axis]).rig((_inside(value, axis),))
    moving = rig.moving
    column = {name: i for i, name in enumerate(rig.system.names)}
    outputs = rig.assembly.outputs
    known = [name for name, output in outputs.items() if name in run.signals and output.row.keys() <= column.keys()]
    rows = np.zeros((len(known), len(column)))
    for row, name in zip(rows, known):
        for of_state, weight in outputs[name].row.items():
            row[column[of_state]] = weight
    driving = rig.settled.copy()
    driving[moving] = 0.0
    measured = np.array([float(run.signals[name][-1]) for name in known]) - rows @ driving
    if np.linalg.matrix_rank(rows[:, moving]) < len(moving):
        raise UsageError(
            "the outputs of the recording do not determine its state; start from simulation, or from a value"
        )
    state, *_ = np.linalg.lstsq(rows[:, moving], measured, rcond=None)
    return Start(value, dict(zip([rig.system.names[i] for i in moving], state.tolist())))


def values_of(scene: Scene) -> dict[str, Any]:
    """Return the values (SI) on which the motions of a rig depend; not its start, sensors, controllers and clock."""
    return {k: v for k, (v, _) in scene.values().items() if k.split(".")[0] not in _MAY_DIFFER}


def _alike(recorded: Scene, scene: Scene, axis: Axis) -> None:
    """Refuse the recording of another rig. Its start, protocol, sensors and clock may differ."""
    if recorded.plant != scene.plant:
        raise UsageError(
            f"the recording is of {recorded.name} with the plant {recorded.plant}, and {scene.name} has {scene.plant}"
        )
    before = values_of(recorded)
    now = values_of(scene)
    differ = sorted(k for k in before.keys() | now.keys() if k != axis.key and before.get(k) != now.get(k))
    if differ:
        what = "; ".join(f"{k} = {before.get(k, 'none')} there, {now.get(k, 'none')} here" for k in differ[:3])
        more = f", and {len(differ) - 3} more" if len(differ) > 3 else ""
        raise UsageError(f"the recording is of a rig with other values (SI): {what}{more}; set them alike with -p")


def from_start(family: Family, start: Start, others: tuple[float, ...] = ()) -> Place:
    """Return the place of the cycle that a motion is near to. Raises NoCycle, NotSmooth."""
    values = (start.value, *others)
    rig = family.rig(values)
    x = rig.settled.copy()
    for i in rig.moving:
        x[i] = start.state[rig.system.names[i]]
    period = start.period
    if not period:
        slowest = steady(rig.system, rig.key).time_scales()[1]
        run = rig.carried(x, _WATCHED * slowest)
        count, drift = repeating([event for _, event in run.events], rig.step, _REPEATS)
        if not count or drift > _REPEATS:
            raise NoCycle("the recorded motion does not repeat")
        times = [time for time, _ in run.events]
        period = times[-1] - times[-1 - count]
        x = run.x
    return from_motion(family, values, x, period)


def ends(family: Family, start: Start, to: float, others: tuple[float, ...] = ()) -> Special | None:
    """Where a stable motion that is carried from its value towards another one ends: a fold, a jump; None if it lives.

    Raises NoCycle, NotSmooth where it cannot be followed.
    """
    at = from_start(family, start, others)
    at = replace(at, t=-at.t) if to < start.value else at
    for segment in follow(at, min(start.value, to), max(start.value, to), _FOLLOWED, sought=("fold",)):
        end = [segment.end] if segment.end else []
        for special in (*segment.specials, *end):
            if special.turns or special.kind in ("jump", "hopf"):
                return special
            if special.kind in ("unresolved", "most"):
                raise NoCycle(f"not followed beyond {special.p:.6g}: {special.why}")
    return None


def from_hopf(family: Family, p: float, others: tuple[float, ...] = ()) -> Place:
    """The first place of the cycles that begin at a Hopf point p, in the shape of the undamped mode."""
    rig = family.rig((p, *others))
    moving = rig.moving
    at = steady(rig.system, rig.key)
    x = at.x
    rates, shapes = at.eigenvectors()
    undamped = int(np.where(rates.imag > 0.0, np.abs(rates.real), np.inf).argmin())
    shape = shapes[:, undamped]
    swings = rig.system.slip_rows @ shape
    speeds = np.abs(rig.system.slip_rows @ x)
    scale = max((abs(swing) / speed for swing, speed in zip(swings, speeds) if speed > 0.0), default=0.0)
    shape = shape / (scale or float(np.abs(shape).max()))
    largest = moving[np.abs(shape[moving]).argmax()]
    shape = shape / np.exp(1j * np.angle(shape[largest]))
    size = sizes(np.abs(shape), rig)
    T = 2.0 * math.pi / complex(rates[undamped]).imag
    map = ReturnMap(family, size, T, abs(p) or 1.0, others)
    t = np.append(shape.real[moving] / size, [0.0, 0.0])
    t /= np.linalg.norm(t)
    eps = 2.0 * VIRTUAL
    origin = map.unknowns(x, T, p)
    u = origin + eps * t
    u, end = map.newton(u, lambda v, _: (float(t @ (v - origin)) - eps, t), u)
    return place(map, u, end, t)


def from_motion(family: Family, values: tuple[float, ...], x: Array, period: float) -> Place:
    """The place of the cycle that passes near state x of the rig with these values. Raises NoCycle and NotSmooth."""
    map, u, end = closed(family, values, x, period)
    return place(map, u, end, np.append(np.zeros(len(u) - 1), 1.0), held=True)


def period_of(rig: FreeRig) -> float:
    """Return the period [s] of the generator of a rig. Raises UsageError without exactly one."""
    rates = {rate for *_, rate in rig.system.generators}
    if len(rates) != 1:
        raise UsageError(f"{rig.scene.name}: a forced motion needs one generator, and the rig has {len(rates)}")
    return 2.0 * math.pi / rates.pop()


def from_forced(family: Family, value: float) -> Place:
    """Return the place of the motion with the period of the generator that the rig reaches. Raises NoCycle."""
    rig = family.rig((value,))
    T = period_of(rig)
    last = driven(rig, 0.0)
    run = rig.carried(last, T, keep=True)
    for _ in range(_PERIODS):
        generator = driven(rig, 0.0)
        x = generator.copy()
        x[rig.moving] = run.x[rig.moving]
        run = rig.carried(x, T, keep=True)
        size = sizes(np.ptp(run.states, axis=0), rig)
        repeats = bool(np.abs((x - last)[rig.moving] / size).max() < _DECAYS)
        if repeats:
            break
        last = x
    times = [0.0, *(t for t, _ in run.events), T]
    phase = 0.0
    if run.events and min(times[1], T - times[-2]) < _INSIDE * T:  # the base lies beside an event
        widest = max(range(len(times) - 1), key=lambda i: times[i + 1] - times[i])
        phase = 0.5 * (times[widest] + times[widest + 1]) / T
        x = rig.carried(x, phase * T).x
    size = np.maximum(size, np.abs(run.states[:, rig.moving]).max(axis=0))  # its mean moves by more than it vibrates
    map = ReturnMap(family, size, T, abs(value) or 1.0, (), period_of, phase)
    u = map.unknowns(x, T, value)
    closing = parameter(value / map.P0, len(u))
    try:
        u, end = map.newton(u, closing, u, map.end(u).met)
    except NoCycle as error:
        if repeats:
            raise error from None
        how = f"within {_PERIODS} periods: it is quasi-periodic, chaotic or of a longer period"
        raise NoCycle(f"the motion does not repeat with the period of its generator {how}") from None
    _, gradient = closing(u, end)
    return place(map, u, end, gradient, held=True)
