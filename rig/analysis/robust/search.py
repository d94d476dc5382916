"""The whole search: the design, the nominal optimum and the scene beside it, the audit, and what each value costs.

The search is a function of its seed, so that its units come in the same order each time. When the same design is
started again, it reads the results that its folder contains already and continues from there.

Afterwards the whole box of the design may be examined (rig.analysis.robust.certificate), in units of the same work. A
delay in whole frames has no matrix between two frames: each is a box of its own.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.pool import Arrays, Progress, Store, asking
from rig.analysis.robust.box import values_text
from rig.analysis.robust.certificate import Region as Forbidden
from rig.analysis.robust.design import Designed, audited, nominal_optimum, region_of, robust, tolerance
from rig.analysis.robust.growth import Growth, Piece, hertz
from rig.analysis.robust.series import rounded
from rig.analysis.robust.stated import Job
from rig.analysis.robust.tasks import Found, Region, Tasks, ascended, whole, worst
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
_DRAWN = 5  # worst rigs of a design whose eigenvalues are drawn
_NEAR = 4  # modes that are named where the band has none
PROVED, REFUTED, UNDECIDED = "proved", "refuted", "undecided"
PARTS = 4000
"""Most parts of a box that are examined."""
_AT_ONCE = 256  # parts: between two of them the share that is proved is told


class Entry(NamedTuple):
    """A design x [free]: growth [1/s] and frequency [Hz] of its `nominal` rig, and its `worst` rigs.

    `rates`: the eigenvalues of its nominal rig and of its worst rigs.
    """

    name: str
    x: Array
    nominal: tuple[float, float]
    worst: Found
    rates: tuple[Complex, ...]


class Findings(NamedTuple):
    """What a search has found.

    `entries`: the robust design, the nominal optimum, the scene, as far as there are. `region`: the box that the design
    is for, in coordinates of the stated one, and `factor` of a tolerance (NaN: none was asked for). `audit`: random
    rigs of the robust design; `beside` [rig]: growth of the same with the nominal optimum. `relief` [uncertain]: by how
    much less the worst rig grows with the nominal value; `percent`: growth of the worst rig if this range is a percent
    of its value wider, a delay a frame. `idle`: keys without influence. `stuck`: frequency of the mode that limits
    every design and moves with none. `edges`: frequencies [Hz] of modes beside an edge of the band. `assembled`: number
    of rigs; `units`: of units of work. `unrounded`: the design before its components were those of a series, and
    `combinations` of these near it.
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
    unrounded: Designed | None
    combinations: int


@contextmanager
def opened(
    job: Job,
    root: Path,
    workers: int | None = None,
    progress: Progress | None = None,
    cluster: str = "",
    first: int = 0,
) -> Iterator[tuple[Tasks, Path]]:
    """Open the units of a job, from number `first` on, and their folder.

    Raises UsageError, WorkerError as a study does; what is finished stays.
    """
    work = job.work
    store = Store.of(work, root)
    say = progress or (lambda done, total: None)
    with asking(work, store, workers, work.total, cluster) as ask:
        yield (
            Tasks(job.grown(), job.limits, ask, first, lambda done: say(done, max(job.expected, done + 1))),
            store.folder,
        )


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
    growth = tasks.growth
    region = whole(len(box.uncertain))
    own = _own(job)
    if own is not None:
        _check_rig(job, growth, own)
    optimum = nominal_optimum(tasks, job.seed) if box.free else None
    if optimum is not None and own is None:
        _check_rig(job, growth, optimum)
    also = [x for x in (optimum, own) if x is not None and ((x >= 0.0) & (x <= 1.0)).all()]
    factor, held = math.nan, None
    if job.tolerance is not None:
        factor, held = tolerance(tasks, job.seed, job.number, job.target, also)
        region = region_of(tasks, job.number, factor)
    design = held or robust(tasks, job.seed, also, region)
    if optimum is not None and growth.value(design.x, box.centre) < growth.value(optimum, box.centre):
        optimum = tasks.polished(design.x[None], box.centre[None])[0][0]  # a better one than its own search has found
    unrounded, combinations = None, 0
    if job.series:
        unrounded = design
        design, combinations = rounded(tasks, design, region, job.series)
    x = design.x
    entries = [_entry(tasks, ROBUST, x, design.worst)]
    if optimum is not None:
        entries.append(_entry(tasks, NOMINAL, optimum, worst(tasks, optimum, region)))
    if own is not None and box.free:
        entries.append(_entry(tasks, SCENE, own, worst(tasks, own, region)))
    audit = design.audit or audited(tasks, x, region, job.seed)
    beside = tasks.growths(optimum, audit.u).growth if optimum is not None else np.zeros(0)
    relief = _relief(tasks, design)
    percent = np.array([_percent(tasks, design, region, i) for i in range(len(box.uncertain))])
    return Findings(
        tuple(entries),
        design,
        region,
        factor,
        audit,
        beside,
        relief,
        percent,
        _idle(growth, design),
        _stuck(growth, design),
        _edges(growth, entries[0]),
        tasks.count,
        tasks.next,
        unrounded,
        combinations,
    )


def _own(job: Job) -> Array | None:
    """The design of the scene as it is; None if it leaves out a free value."""
    values = job.scene.values()
    own = {axis.key: values.get(axis.key, (None, ""))[0] for axis in job.box.free}
    return None if None in own.values() else job.box.at(own)


def _check_rig(job: Job, growth: Growth, x: Array) -> None:
    """Raise SceneError if the nominal rig of a design has no growth, UsageError if it has no mode in the band."""
    nominal = growth.matrix(x, growth.box.centre)
    if nominal.why:
        design = job.box.design(x)
        at = values_text({**design, **job.box.rig(design, job.box.centre)})
        raise SceneError(job.scene.name, [f"the nominal rig ({at}) has no growth: {nominal.why}"])
    rates = nominal.spectrum
    tones = hertz(rates[np.isfinite(rates.real)])
    if growth.inside(tones).any():
        return
    low, high = job.band
    near = sorted(set(tones.round(9).tolist()), key=lambda tone: min(abs(tone - low), abs(tone - high)))
    listed = ", ".join(f"{tone:.5g}" for tone in sorted(near[:_NEAR]))
    raise UsageError(
        f"band {low:g} Hz:{high:g} Hz: {job.scene.name} has no mode in it; the nearest are at {listed} Hz. "
        "State a band that contains the modes that are to decay"
    )


def _entry(tasks: Tasks, name: str, x: Array, bad: Found) -> Entry:
    growth = tasks.growth
    rigs = [growth.matrix(x, u) for u in (growth.box.centre, *bad.u[:_DRAWN])]
    rates = [rig.spectrum for rig in rigs if not rig.why]
    rates = [every[np.lexsort((-every.imag, -every.real))] for every in rates]
    return Entry(name, x, growth.value(x, growth.box.centre), bad, tuple(rates))


def _relief(tasks: Tasks, design: Designed) -> Array:
    """By how much less the worst rig grows, with the nominal value of each uncertain value."""
    centre = tasks.growth.box.centre
    rigs = np.where(np.eye(len(centre), dtype=bool), centre, design.worst.u[0])
    return design.growth - tasks.growths(design.x, rigs).growth


def _percent(tasks: Tasks, design: Designed, region: Region, i: int) -> float:
    """Growth of the worst rig if a range is wider by a percent of its value on both sides, a delay by a frame."""
    value = tasks.growth.box.uncertain[i]
    width = value.ends[1] - value.ends[0]
    own = tasks.growth.box.design(design.x).get(value.key, value.nominal)
    more = value.step or _PERCENT * (1.0 if value.relative else abs(own))
    if not width or not more:
        return math.nan
    wider = np.eye(len(region.low))[i] * (more / width)
    beyond = Region(region.low - wider, region.high + wider)
    rigs = np.vstack([design.worst.u, design.rigs])
    tried = np.vstack([rigs, rigs, rigs])
    tried[len(rigs) :, i] = np.repeat([beyond.low[i], beyond.high[i]], len(rigs))
    found = tasks.growths(design.x, np.unique(tried, axis=0))
    return float(ascended(tasks, design.x, beyond, found).growth[0])


def _idle(growth: Growth, design: Designed) -> tuple[str, ...]:
    """Keys without influence on any eigenvalue that may count, at all rigs of the set."""
    box = growth.box
    skipped = {value.key for value in box.uncertain if value.step or not value.ends[0] < value.ends[1]}
    moving = set()
    for of_rig, keys in ((False, [axis.key for axis in box.free]), (True, box.keys)):
        for piece in itertools.chain(*_pieces(growth, design, of_rig)):
            moving |= {key for key, slope in zip(keys, piece.slope) if abs(slope) >= _IDLE}
    every = dict.fromkeys([*(axis.key for axis in box.free), *box.keys])
    return tuple(key for key in every if key not in moving | skipped)


def _pieces(growth: Growth, design: Designed, of_rig: bool) -> list[list[Piece]]:
    """The eigenvalues that may count at each rig of the set, and at the worst one."""
    rigs = np.unique(np.vstack([design.rigs, design.worst.u[0]]), axis=0)
    return [pieces for u in rigs if (pieces := growth.pieces(design.x, u, of_rig))]


def _stuck(growth: Growth, design: Designed) -> float:
    """The frequency of the mode that limits at every rig of the set, if no free value moves it; else NaN."""
    tones = set()
    for pieces in _pieces(growth, design, of_rig=False) if len(design.x) else ():
        top = max(pieces, key=lambda piece: (piece.inside, piece.rate.real))
        if np.abs(top.slope).max() > max(_IDLE, _STUCK * abs(top.rate.real)):
            return math.nan
        tones.add(round(float(hertz(np.array(top.rate))), 3))
    return tones.pop() if len(tones) == 1 else math.nan


def _edges(growth: Growth, robust: Entry) -> tuple[float, ...]:
    """Frequencies [Hz] of modes of the robust design within two percent of an edge of the band."""
    rates = np.concatenate([*robust.rates, np.zeros(0)])
    tones = hertz(rates[rates.imag > 0.0])
    edges = [edge for edge in growth.band if 0.0 < edge < math.inf]
    near = [tones[np.abs(tones - edge) <= _EDGE * edge] for edge in edges]
    return tuple(sorted({round(float(tone), 1) for tone in np.concatenate([*near, np.zeros(0)])}))


@dataclass(frozen=True)
class Certificate:
    """What is known of a box: `verdict` is "proved", "refuted" or "undecided".

    `rig` [count]: of a refuted one, a rig that grows faster than the `limit` [1/s], in the unit cube. `boxes`: how many
    parts were examined, `left`: how many are undecided, `share`: of the volume, that is proved. `cells`: how many cells
    of the edge. `degree`, `error`: of the polynomial, in its largest entry; `rest`: the largest E of a proved part over
    the distance of an eigenvalue from the edge.
    """

    verdict: str
    limit: float
    rig: Array | None = None
    boxes: int = 0
    left: int = 0
    share: float = 0.0
    cells: int = 0
    degree: int = 0
    error: float = 0.0
    rest: float = 0.0
    why: str = ""


def proved(
    job: Job,
    found: Findings,
    root: Path,
    workers: int | None = None,
    progress: Progress | None = None,
    cluster: str = "",
    most: int = PARTS,
) -> Certificate:
    """Return what is known of all rigs of a design; `most`: parts that are examined.

    `progress` gets the share of the box that is proved, in thousandths. Raises UsageError, WorkerError; what is
    finished stays.
    """
    x = found.design.x
    growth = job.grown()
    for u in found.design.worst.u:
        rig = growth.matrix(x, u)
        if not rig.why and Forbidden.of(rig, job.target, growth.band).holds(rig.values):
            return Certificate(REFUTED, job.target, u)
    ends = []
    for value, low, high in zip(job.box.uncertain, *found.region):
        frames = np.linspace(low, high, value.frames(low, high) + 1) if value.step else ()
        ends.append([(at, at) for at in frames] or [(low, high)])
    boxes = [np.array(each).T for each in itertools.product(*ends)]
    with opened(job, root, workers, cluster=cluster, first=found.units) as (tasks, _):
        return examined(lambda parts: tasks.examined(x, parts), boxes, job.target, most, progress)


def examined(
    ask: Callable[[list[Array]], Sequence[Arrays]],
    boxes: Sequence[Array],
    limit: float,
    most: int = PARTS,
    progress: Progress | None = None,
) -> Certificate:
    """Return what is known of `boxes` [box][2, count].

    `ask`: parts [part][4, count], each the two corners of a box and its own within that -> what
    `rig.analysis.robust.certificate.Examination.examined` returns for each.
    """
    todo = [np.vstack([box, np.zeros_like(box[0]), np.ones_like(box[0])]) for box in boxes]
    known = Certificate(UNDECIDED, limit)
    while todo and known.rig is None and not known.why and known.boxes < most:
        count = min(_AT_ONCE, most - known.boxes)
        parts, todo = todo[-count:], todo[:-count]
        for part, result in zip(parts, ask(parts)):
            known = _joined(known, part, result, len(boxes))
            todo += [np.vstack([part[:2], half]) for half in result.get("halves", ())]
        if progress is not None:
            progress(round(1000 * known.share), 1000)
    verdict = REFUTED if known.rig is not None else UNDECIDED if todo or known.why else PROVED
    return replace(known, verdict=verdict, left=len(todo))


def _joined(known: Certificate, part: Array, result: Arrays, boxes: int) -> Certificate:
    """What is known of `boxes` with the result of one more part."""
    if "why" in result:
        return replace(known, why=str(result["why"]))
    low, high, first, last = part
    rigs = [*low + (high - low) * result["rig"], known.rig]
    is_proved = not len(result["rig"]) and not len(result["halves"])
    return replace(
        known,
        rig=rigs[0],
        boxes=known.boxes + 1,
        share=known.share + (float(np.prod(last - first)) / boxes if is_proved else 0.0),
        cells=known.cells + int(result["cells"]),
        degree=max(known.degree, int(result["degree"])),
        error=max(known.error, float(result["error"])),
        rest=max(known.rest, float(result["rest"])),
    )
