"""Pareto front of the settings, and the recommended setting.

A setting is on the Pareto front if no other setting is both cheaper and has a smaller error. The recommended setting is
the cheapest at p99 of those that meet the target error and the budget. Settings whose 95 % interval begins below 1.1
times this cost count as equally cheap; of these only those are considered whose plant alone takes up to a tenth longer
than the fastest. The one with the smallest error is taken, of equal errors the one with the finest tolerance, because
frames may have cut the steps of all of them to the same length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from rig.errors import UsageError
from rig.qualify.cost.table import WORST, Row

SAME = 1.1  # ratio of costs that count as equal
_RESOLVED = 2.0  # an error below this multiple of the difference between the references is not resolved


def front(rows: Sequence[Row], metric: str) -> list[Row]:
    """Return the settings that no other beats in both error and cost, cheapest first."""
    best, found = math.inf, []
    timed = [row for row in rows if row.p99 > 0.0]
    for row in sorted(timed, key=lambda row: (row.p99, row.error(metric))):
        if row.error(metric) < best:
            best = row.error(metric)
            found.append(row)
    return found


def recommended(rows: Sequence[Row], metric: str, target: float | None, budget: float | None) -> Row:
    """Return the recommended setting. `target`: largest error; `budget`: largest share of a frame at p99.

    Without a target: the one with the smallest error that fits the budget. Raises UsageError if none does, with the
    best available one.
    """
    able = [row for row in rows if row.p99 > 0.0 and math.isfinite(row.error(metric))]
    fitting = [row for row in able if budget is None or row.share <= budget]
    enough = [row for row in fitting if target is None or row.error(metric) <= target]
    if not enough:
        raise UsageError(_why(able, fitting, metric, target, budget))
    if target is None:
        best = min(row.error(metric) for row in enough)
        enough = [row for row in enough if row.error(metric) <= max(best, _RESOLVED * row.floor(metric))]
    least = min(row.p99 for row in enough)
    cheap = [row for row in enough if row.cost.p99.low <= SAME * least]
    fastest = min(row.cost.tick.value for row in cheap)
    return min(
        (row for row in cheap if row.cost.tick.value <= SAME * fastest),
        key=lambda row: (row.error(metric), row.setting.tolerance),
    )


def _why(able: list[Row], fitting: list[Row], metric: str, target: float | None, budget: float | None) -> str:
    if not able:
        return "no setting completes this scene; the table has the reasons"
    if not fitting:
        least = min(able, key=lambda row: row.share)
        took = f"the cheapest, {least.setting}, takes {least.share:.1%}"
        return f"no setting fits {_percent(budget)} of a frame here; {took}"
    best = min(fitting, key=lambda row: row.error(metric))
    within = "" if budget is None else f" within {_percent(budget)} of a frame"
    name = best.worst if metric == WORST else metric
    error, floor = best.error(metric), best.floor(name)
    if error <= _RESOLVED * floor:
        return (
            f"no setting provably reaches a relative error of {target:.0e}{within}: the references agree only to "
            f"{floor:.0e} in {name}, and the error of {best.setting} is as small"
        )
    has = f"the best, {best.setting}, has {error:.1e} in {name}"
    return f"no setting reaches a relative error of {target:.0e}{within}; {has}"


def _percent(share: float | None) -> str:
    return "all" if share is None else f"{100.0 * share:g} %"
