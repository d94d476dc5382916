"""The order at which errors fall with the step, as observed, of each method that has one."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rig.qualify.cost.settings import THEORY
from rig.qualify.cost.table import WORST, Row

_CLEAR = 30.0  # times the least error that can be told
_LARGEST = 0.1
_RANGE = 1.5  # times the finest step: steps that differ less, as where frames cut them all, tell no order


def orders(rows: Sequence[Row], seconds: float) -> dict[str, float]:
    """Method -> slope of the largest error over the step (its mean, where it varies), between the finest clear points.

    Methods with fewer than two clear points are left out.
    """
    found = {}
    for method in THEORY:
        points = [(math.log(step(row, seconds)), math.log(row.error(WORST))) for row in rows if _clear(row, method)]
        points = sorted(points)[:4]
        if len(points) > 1 and points[-1][0] - points[0][0] > math.log(_RANGE):
            steps, found_errors = np.array(points).T
            found[method] = float(np.polyfit(steps, found_errors, 1)[0])
    return found


def step(row: Row, seconds: float) -> float:
    """The step of a setting [s]; of one that adapts it, the mean."""
    return row.setting.step_ns * 1e-9 if row.setting.step_ns else seconds / max(row.steps, 1)


def _clear(row: Row, method: str) -> bool:
    error = row.error(WORST)
    known = bool(row.setting.step_ns or row.steps)
    return row.setting.method == method and known and _CLEAR * row.floor(WORST) < error < _LARGEST
