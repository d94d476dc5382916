"""Whether no rig of the box of a design grows, for the whole box: rig.analysis.robust.certificate over its matrices.

A delay in whole frames has no matrix between two frames: each is a box of its own. Parts of the boxes are examined in
units of work, which the pool computes and the store of the search keeps, so that a proof can be interrupted as well.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.analysis.pool import Arrays, Progress
from rig.analysis.robust.certificate import SMOOTH, region_of
from rig.analysis.robust.growth import Growth, NoSliding
from rig.analysis.robust.job import Job, opened
from rig.analysis.robust.search import Findings

Array = NDArray[np.float64]
PROVED, REFUTED, UNDECIDED = "proved", "refuted", "undecided"
BOXES = 4000
"""Most parts that are examined."""
_EACH = 16  # parts of a unit of work: about 0.3 s
_AT_ONCE = 16  # units: between two of them the share that is proved is told


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
    most: int = BOXES,
) -> Certificate:
    """Return what is known of all rigs of a design; `most`: parts that are examined.

    `progress` gets the share of the box that is proved, in thousandths. Raises UsageError, WorkerError; what is
    finished stays.
    """
    x = found.design.x
    growth = job.grown()
    for u in found.design.worst.rigs:
        if _grows(growth, x, u, job.target):
            return Certificate(REFUTED, job.target, u)
    choices = []
    for value, low, high in zip(job.box.uncertain, *found.region):
        frames = round((value.ends[1] - value.ends[0]) / value.step * (high - low)) if value.step else 0
        each = [(at, at) for at in np.linspace(low, high, frames + 1)] if value.step else [(low, high)]
        choices.append(each)
    boxes = [np.array(ends).T for ends in itertools.product(*choices)]
    with opened(job, root, workers, cluster=cluster, first=found.units) as (tasks, _):
        return examined(
            lambda parts, each: tasks.divided(x, parts, job.target, each), boxes, job.target, most, progress
        )


def _grows(growth: Growth, x: Array, u: Array, limit: float) -> bool:
    try:
        matrix = growth.matrix(x, u)
    except NoSliding:
        return False
    values = np.linalg.eigvals(matrix.A).astype(np.complex128)
    return region_of(limit, growth.band, matrix.period, matrix.up_to, values).holds(values)


def examined(
    divided: Callable[[list[Array], int], Sequence[Arrays]],
    boxes: Sequence[Array],
    limit: float,
    most: int = BOXES,
    progress: Progress | None = None,
) -> Certificate:
    """Return what is known of `boxes` [box][2, count].

    `divided`: parts [part][4, count], each the two corners of a box and its own within that, and a number -> the
    results of `Examination.divided` into at most so many parts each.
    """
    whole = np.array([[0.0], [1.0]]) * np.ones(boxes[0].shape[1])
    todo = [np.vstack([box, whole]) for box in boxes]
    sums = dict.fromkeys(("parts", "cells", "share"), 0.0)
    largest = dict.fromkeys(("degree", "error", "rest"), 0.0)
    rig = None
    why = ""
    while todo and rig is None and not why and sums["parts"] < most:
        room = most - int(sums["parts"])
        each = max(1, min(_EACH, room // len(todo)))
        count = min(_AT_ONCE, room // each)
        at_once, todo = todo[-count:], todo[:-count]
        for part, result in zip(at_once, divided(at_once, each)):
            if "why" in result:
                why = str(result["why"])
                break
            todo += [np.vstack([part[:2], left]) for left in result["left"]]
            for name in sums:
                sums[name] += float(result[name])
            for name in largest:
                largest[name] = max(largest[name], float(result[name]))
            if rig is None and len(result["rig"]):
                low, high = part[:2]
                rig = low + (high - low) * result["rig"][0]
        if largest["error"] > SMOOTH:
            error = f"error of the polynomial: {largest['error']:.1e}"
            why = f"the matrix of a rig is no smooth function of the uncertain values ({error})"
        if progress is not None:
            progress(round(1000 * sums["share"] / len(boxes)), 1000)
    return Certificate(
        REFUTED if rig is not None else UNDECIDED if todo or why else PROVED,
        limit,
        rig,
        int(sums["parts"]),
        len(todo),
        sums["share"] / len(boxes),
        int(sums["cells"]),
        int(largest["degree"]),
        largest["error"],
        largest["rest"],
        why,
    )
