"""Whether no rig of the box of a design grows, for the whole box: rig.analysis.robust.certificate over its matrices.

A delay in whole frames has no matrix between two frames: each is a box of its own.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.certificate import BOXES, PROVED, REFUTED, UNDECIDED, Certificate, certify
from rig.analysis.robust.growth import NoSliding
from rig.analysis.robust.job import Job
from rig.analysis.robust.search import Findings

Array = NDArray[np.float64]


def proved(job: Job, found: Findings, most: int = BOXES) -> Certificate:
    """Return what is known of all rigs of a design; `most`: boxes that are examined."""
    growth = job.grown()
    x = found.design.x
    low, high = found.region
    width = np.where(high > low, high - low, 1.0)
    suspects = np.clip((found.design.worst.rigs - low) / width, 0.0, 1.0)
    values = job.box.uncertain
    frames = [i for i, value in enumerate(values) if value.step]
    rest = [i for i, value in enumerate(values) if not value.step]
    counts = []
    for i in frames:
        ends = values[i].ends
        counts.append(round((ends[1] - ends[0]) / values[i].step * (high[i] - low[i])) + 1)
    total: Certificate | None = None
    shares = [np.linspace(0.0, 1.0, count) for count in counts]
    combinations = [*itertools.product(*shares)]
    for at in combinations:
        u = np.zeros(len(values))
        u[frames] = at

        def rig(inner: Array, fixed: Array = u) -> Array:
            every = fixed.copy()
            every[rest] = inner
            return low + (high - low) * every

        try:
            first = growth.matrix(x, rig(np.full(len(rest), 0.5)))
            examined = 0 if total is None else total.boxes
            same = [suspect for suspect in suspects if np.allclose(suspect[frames], at, atol=1e-9)]
            found_here = certify(
                lambda inner, rig=rig: growth.matrix(x, rig(inner)).A,  # type: ignore[misc]
                len(rest),
                job.target,
                job.band,
                first.period,
                first.up_to,
                np.array(same).reshape(-1, len(values))[:, rest],
                most - examined,
            )
        except NoSliding as fault:
            return Certificate(UNDECIDED, job.target, left=1, why=f"a rig of the box has no growth: {fault}")
        if found_here.rig is not None:
            found_here = replace(found_here, rig=rig(found_here.rig))
        total = found_here if total is None else _together(total, found_here)
        if total.verdict != PROVED:
            break
    assert total is not None
    return total if total.verdict == REFUTED else replace(total, share=total.share / len(combinations))


def _together(first: Certificate, second: Certificate) -> Certificate:
    """Two parts of a box as one; the second decides."""
    return replace(
        second,
        boxes=first.boxes + second.boxes,
        share=first.share + second.share,
        cells=first.cells + second.cells,
        degree=max(first.degree, second.degree),
        error=max(first.error, second.error),
        rest=max(first.rest, second.rest),
        seconds=first.seconds + second.seconds,
    )
