"""Which settings are worth having, and which one to take.

A setting is on the Pareto front where no other is both cheaper and more accurate. Taken is, of those that are accurate
enough and fit the budget, the cheapest at p99; those that cost up to a tenth more are held to cost the same, and of
them the most accurate one is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from rig.errors import UsageError
from rig.qualify.cost.table import WORST, Row

SAME = 1.1  # times the cost: the same
_TOLD = 2.0  # times what the references are apart: a setting that is nearer cannot be told from them


def front(rows: Sequence[Row], metric: str) -> list[Row]:
    """The settings that no other beats in both error and cost, cheapest first."""
    best, found = math.inf, []
    timed = [row for row in rows if row.p99 > 0.0]
    for row in sorted(timed, key=lambda row: (row.p99, row.error(metric))):
        if row.error(metric) < best:
            best = row.error(metric)
            found.append(row)
    return found


def recommended(rows: Sequence[Row], metric: str, target: float | None, budget: float | None) -> Row:
    """The setting to take. `target`: largest error; `budget`: largest share of a frame at p99.

    Without a target the most accurate one that fits. Raises UsageError where none does, with what there is.
    """
    able = [row for row in rows if row.p99 > 0.0 and math.isfinite(row.error(metric))]
    fitting = [row for row in able if budget is None or row.share <= budget]
    enough = [row for row in fitting if target is None or row.error(metric) <= target]
    if not enough:
        raise UsageError(_why(able, fitting, metric, target, budget))
    if target is None:
        best = min(row.error(metric) for row in enough)
        enough = [row for row in enough if row.error(metric) <= max(best, _TOLD * row.floor(metric))]
    least = min(row.p99 for row in enough)
    return min((row for row in enough if row.p99 <= SAME * least), key=lambda row: row.error(metric))


def _why(able: list[Row], fitting: list[Row], metric: str, target: float | None, budget: float | None) -> str:
    if not able:
        return "no setting gets through this scene; the table says why"
    if not fitting:
        least = min(able, key=lambda row: row.share)
        took = f"the cheapest, {least.setting}, takes {least.share:.1%}"
        return f"no setting fits {_percent(budget)} of a frame here; {took}"
    best = min(fitting, key=lambda row: row.error(metric))
    within = "" if budget is None else f" within {_percent(budget)} of a frame"
    name = best.worst if metric == WORST else metric
    error, floor = best.error(metric), best.floor(name)
    if error <= _TOLD * floor:
        return (
            f"no setting can be told to be accurate to {target:.0e}{within}: the references agree to {floor:.0e} in "
            f"{name} only, and {best.setting} is as near to them"
        )
    return f"no setting is accurate to {target:.0e}{within}; the best, {best.setting}, has {error:.1e} in {name}"


def _percent(share: float | None) -> str:
    return "all" if share is None else f"{100.0 * share:g} %"
