"""The observed order of convergence of each method with a fixed step."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rig.analysis.motion_measures.settings import THEORY
from rig.qualify.cost.table import WORST, Row

_CLEAR = 30.0  # multiple of the resolution above which an error is used
_LARGEST = 0.1
_RANGE = 1.5  # smallest ratio of steps: similar steps, as where frames cut them all, give no order


def orders(rows: Sequence[Row], seconds: float) -> dict[str, float]:
    """Return method -> slope of the largest error over the step (its mean, if it varies), between the finest clear
    points.

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
    """Return the step of a setting [s]; the mean if the method adapts it."""
    return row.setting.step_ns * 1e-9 if row.setting.step_ns else seconds / max(row.steps, 1)


def _clear(row: Row, method: str) -> bool:
    error = row.error(WORST)
    known = bool(row.setting.step_ns or row.steps)
    return row.setting.method == method and known and _CLEAR * row.floor(WORST) < error < _LARGEST
