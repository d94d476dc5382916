"""The whole search: the design, the nominal optimum and the scene beside it, the audit, and what each value costs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.pool import Progress
from rig.analysis.robust.design import Designed, audited, nominal_optimum, region_of, robust, tolerance
from rig.analysis.robust.growth import Growth, NoSliding, Piece
from rig.analysis.robust.job import Job, opened
from rig.analysis.robust.series import Rounded, rounded
from rig.analysis.robust.tasks import Found, Region, Tasks
from rig.analysis.robust.worst import Worst, ascended, whole, worst
from rig.errors import SceneError, UsageError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
SCENE = "scene"
NOMINAL = "nominal optimum"
ROBUST = "robust"
_IDLE = 1e-9  # 1/s over a whole range: less is no influence
_STUCK = 1e-3  # of the growth of a mode over a whole range: less does not move it
_EDGE = 0.02  # of the frequency of an edge of the band: modes nearer to it are named
_PERCENT = 0.01
_DRAWN = 5  # worst rigs of a design that are listed


class Entry(NamedTuple):
    """A design x [free]: growth [1/s] and frequency [Hz] of its `nominal` rig, and its `worst` rigs.

    `rates`: the eigenvalues of its nominal rig and of its worst rigs.
    """

    name: str
    x: Array
    nominal: tuple[float, float]
    worst: Worst
    rates: tuple[Complex, ...]


class Findings(NamedTuple):
    """What a search has found.

    `entries`: the robust design, the nominal optimum, the scene, as far as there are. `region`: the box that the design
    is for, in coordinates of the stated one, and `factor` of a tolerance (NaN: none was asked for). `audit`: random
    rigs of the robust design; `beside` [rig]: growth of the same with the nominal optimum. `relief` [uncertain]: by how
    much less the worst rig grows with the nominal value; `percent`: growth of the worst rig if this range is a percent
    of its value wider, a delay a frame. `idle`: keys without influence. `stuck`: frequency of the mode that limits
    every design and moves with none. `edges`: frequencies [Hz] of modes beside an edge of the band. `rounded`: to
    components of a series, which the robust design then has.
    `assembled`: number of rigs; `units`: of units of work.
    """

    entries: tuple[Entry, ...]
    design: Designed
    region: Region
    factor: float
    audit: Found
    beside: Array
    relief: Array
    percent: Array
    idle: tuple[str, ...]
    stuck: float
    edges: tuple[float, ...]
    assembled: int
    units: int
    rounded: Rounded | None = None


def find(
    job: Job, root: Path, workers: int | None = None, progress: Progress | None = None, cluster: str = ""
) -> tuple[Findings, Path]:
    """Carry out a robust design; return what it has found and the folder of its units.

    Raises UsageError, SceneError for a box without steady sliding or a band without modes, WorkerError.
    """
    with opened(job, root, workers, progress, cluster) as (tasks, folder):
        found = _find(job, tasks)
    if progress is not None:
        progress(job.expected, job.expected)
    return found, folder


def _find(job: Job, tasks: Tasks) -> Findings:
    box = job.box
    region = whole(len(box.uncertain))
    own = _own(job)
    if own is not None:
        _check_rig(job, tasks.growth, own)
    optimum = nominal_optimum(tasks, job.seed) if box.free else None
    if optimum is not None and own is None:
        _check_rig(job, tasks.growth, optimum)
    also = [x for x in (optimum, own) if x is not None and ((x >= 0.0) & (x <= 1.0)).all()]
    factor = math.nan
    held = None
    if job.tolerance is not None:
        factor, held = tolerance(tasks, job.seed, job.number, job.target, list(also))
        region = region_of(tasks, job.number, factor)
    design = held or robust(tasks, job.seed, also, region)
    nominal = box.centre
    if optimum is not None and tasks.growth.value(design.x, nominal) < tasks.growth.value(optimum, nominal):
        optimum = tasks.polished(design.x[None], nominal[None])[0][0]  # a better one than its own search has found
    components = None
    if job.series:
        components = rounded(tasks, design.x, design.worst, design.rigs, region, job.limits, job.series)
        design = design._replace(x=components.x, worst=components.worst, audit=None)
    x = design.x
    entries = [_entry(tasks, ROBUST, x, region, design.worst)]
    if optimum is not None:
        entries.append(_entry(tasks, NOMINAL, optimum, region))
    if own is not None and box.free:
        entries.append(_entry(tasks, SCENE, own, region))
    audit = design.audit or audited(tasks, x, region, job.seed)
    beside = tasks.growths(optimum, audit.u).growth if optimum is not None else np.zeros(0)
    relief = _relief(tasks, x, design.worst)
    percent = _percent(tasks, design, region)
    return Findings(
        tuple(entries),
        design,
        region,
        factor,
        audit,
        beside,
        relief,
        percent,
        _idle(tasks.growth, design),
        _stuck(tasks.growth, design),
        _edges(tasks.growth, entries),
        tasks.count,
        tasks.next,
        components,
    )


def _own(job: Job) -> Array | None:
    """The design of the scene as it is; None if it leaves out a free value."""
    values = job.scene.values()
    own = {axis.key: values.get(axis.key, (None, ""))[0] for axis in job.box.free}
    if any(value is None for value in own.values()):
        return None
    return job.box.at({key: float(value) for key, value in own.items()})


def _check_rig(job: Job, growth: Growth, x: Array) -> None:
    """Raise SceneError if the nominal rig of a design has no growth, UsageError if it has no mode in the band."""
    u = growth.box.centre
    try:
        matrix = growth.matrix(x, u)
    except NoSliding as fault:
        values = {**growth.box.design(x), **growth.box.rig(growth.box.design(x), u)}
        at = ", ".join(f"{key} = {value:.6g}" for key, value in values.items())
        raise SceneError(job.scene.name, [f"the nominal rig ({at}) has no growth: {fault}"]) from None
    rates = matrix.spectrum
    hertz = np.abs(rates.imag[np.isfinite(rates.real)]) / (2.0 * math.pi)
    if growth.inside(hertz).any():
        return
    low, high = job.band
    near = sorted(set(hertz.round(9).tolist()), key=lambda value: min(abs(value - low), abs(value - high)))[:4]
    listed = ", ".join(f"{value:.5g}" for value in sorted(near))
    raise UsageError(
        f"band {low:g} Hz:{high:g} Hz: {job.scene.name} has no mode in it; the nearest are at {listed} Hz. "
        "State a band that contains the modes that are to decay"
    )


def _entry(tasks: Tasks, name: str, x: Array, region: Region, bad: Worst | None = None) -> Entry:
    growth = tasks.growth
    bad = worst(tasks, x, region) if bad is None else bad
    rates = []
    for u in (growth.box.centre, *bad.rigs[:_DRAWN]):
        try:
            matrix = growth.matrix(x, u)
        except NoSliding:
            continue
        every = matrix.spectrum
        rates.append(every[np.lexsort((-every.imag, -every.real))])
    return Entry(name, x, growth.value(x, growth.box.centre), bad, tuple(rates))


def _relief(tasks: Tasks, x: Array, bad: Worst) -> Array:
    """By how much less the worst rig grows, with the nominal value of each uncertain value."""
    m = len(bad.u)
    rigs = np.tile(bad.u, (m, 1))
    rigs[np.arange(m), np.arange(m)] = tasks.growth.box.centre
    return bad.growth - tasks.growths(x, rigs).growth


def _percent(tasks: Tasks, design: Designed, region: Region) -> Array:
    """Growth of the worst rig if one range is wider by a percent of its value on both sides, a delay by a frame."""
    box = tasks.growth.box
    values = box.design(design.x)
    out = np.full(len(box.uncertain), np.nan)
    for i, value in enumerate(box.uncertain):
        width = value.ends[1] - value.ends[0]
        centre = 1.0 if value.relative else abs(values.get(value.key, value.nominal))
        more = (value.step or _PERCENT * centre) / width if width else 0.0
        if not more:
            continue
        low, high = region.low.copy(), region.high.copy()
        low[i] -= more
        high[i] += more
        rigs = np.vstack([design.worst.rigs, design.rigs])
        tried = [rigs]
        for end in (low[i], high[i]):
            moved = rigs.copy()
            moved[:, i] = end
            tried.append(moved)
        every = np.unique(np.vstack(tried), axis=0)
        found = tasks.growths(design.x, every)
        out[i] = ascended(tasks, design.x, Region(low, high), every, found.growth).growth
    return out


def _idle(growth: Growth, design: Designed) -> tuple[str, ...]:
    """Keys without influence on any eigenvalue that may count, at all rigs of the set."""
    box = growth.box
    largest = dict.fromkeys((*(axis.key for axis in box.free), *_keys(growth)), 0.0)
    for of_rig, keys in ((False, [axis.key for axis in box.free]), (True, _keys(growth))):
        for pieces in _pieces(growth, design, of_rig):
            slopes = np.max([np.abs(piece.slope) for piece in pieces], axis=0)
            for key, slope in zip(keys, slopes.tolist()):
                largest[key] = max(largest[key], slope)
    skipped = {value.key for value in box.uncertain if value.step or not value.ends[0] < value.ends[1]}
    return tuple(key for key, slope in largest.items() if slope < _IDLE and key not in skipped)


def _pieces(growth: Growth, design: Designed, of_rig: bool) -> Iterator[list[Piece]]:
    """The eigenvalues that may count at each rig of the set, and at the worst one."""
    for u in np.unique(np.vstack([design.rigs, design.worst.u]), axis=0):
        try:
            pieces = growth.pieces(design.x, u, of_rig)
        except NoSliding:
            continue
        if pieces:
            yield pieces


def _keys(growth: Growth) -> list[str]:
    return [value.key for value in growth.box.uncertain]


def _stuck(growth: Growth, design: Designed) -> float:
    """The frequency of the mode that limits at every rig of the set, if no free value moves it; else NaN."""
    tones = set()
    for pieces in _pieces(growth, design, of_rig=False) if len(design.x) else ():
        top = max(pieces, key=lambda piece: (piece.inside, piece.rate.real))
        if np.abs(top.slope).max() > max(_IDLE, _STUCK * abs(top.rate.real)):
            return math.nan
        tones.add(round(abs(top.rate.imag) / (2.0 * math.pi), 3))
    return tones.pop() if len(tones) == 1 else math.nan


def _edges(growth: Growth, entries: list[Entry]) -> tuple[float, ...]:
    """Frequencies [Hz] of modes of the robust design within two percent of an edge of the band."""
    near = set()
    for rates in entries[0].rates:
        hertz = rates.imag[rates.imag > 0.0] / (2.0 * math.pi)
        for edge in growth.band:
            if 0.0 < edge < math.inf:
                near |= {round(float(value), 1) for value in hertz[np.abs(hertz - edge) <= _EDGE * edge]}
    return tuple(sorted(near))


def confidence(count: int) -> float:
    """Return the share of rigs that can be worse than `count` random ones, with 99.9 % confidence."""
    return math.log(1000.0) / count
