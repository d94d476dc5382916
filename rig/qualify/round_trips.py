"""What round trips over a link say: how long an answer takes, and which period of a controller the link holds.

The other end is a board (rig.qualify.board_link) or the plant of another host (rig.qualify.remote_link).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rig.controllers.device import PATIENCE

PERIODS_MS = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""Periods of a controller that are suggested [ms]."""
_MISSED = 0.01  # of the questions: with more unanswered ones the 99 % quantile says nothing


def quantiles(trips: Sequence[float], patience: float) -> tuple[float, float, float]:
    """Return median, 99 % quantile and worst of round trips [ms]; `patience` [ms] for each if no answer came."""
    if not trips:
        return patience, patience, patience
    p50, p99, worst = np.percentile(trips, (50, 99, 100)).tolist()
    return p50, p99, worst


def period_of(p99: float, missed: float) -> float | None:
    """Return the least usual period [ms] of a controller for which 99 % of the answers come within its patience.

    `p99` [ms]; `missed`: the share of questions without an answer. None: there is no such period.
    """
    if missed > _MISSED:
        return None
    return next((period for period in PERIODS_MS if period >= p99 / PATIENCE), None)


def in_words(period: float | None) -> str:
    """Return what a link holds, as a line."""
    if period is None:
        return f"it holds no period of a controller up to {PERIODS_MS[-1]:g} ms"
    return f"it holds a period of {period:g} ms: 99 % answer within {PATIENCE:g} of it"
