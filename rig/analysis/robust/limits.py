"""Linear limits of a design: "spring_1.damping + 2 * spring_2.damping < 0.6 N*s/m"."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.box import Box
from rig.errors import Faults, UsageError
from rig.scenes.faults import near
from rig.units import brief, same_unit, si

Array = NDArray[np.float64]
_TERM = re.compile(r"\s*(?P<sign>[+-]?)\s*(?:(?P<factor>\d[\d.]*(?:e[+-]?\d+)?)\s*\*?\s*)?(?P<key>[A-Za-z_][\w.]*)\s*")
_FORM = 'expected a sum of free keys, "spring_1.damping + 2 * spring_2.damping < 0.6 N*s/m"'


@dataclass(frozen=True)
class Limit:
    """A limit `slope` x + `over` <= 0 of design x [free], in units of the largest sum of its terms over the ranges.

    `text`: as its user states it; `weights` [free] and `bound`: the same in SI, weights * values <= bound.
    """

    text: str
    slope: Array
    over: float
    weights: Array
    bound: float

    def excess(self, x: Array) -> float:
        """How far a design is beyond the limit; at most 0 if it keeps it."""
        return float(self.slope @ x) + self.over


def limits(box: Box, given: Iterable[str]) -> tuple[Limit, ...]:
    """Return the limits of a design. Raises UsageError with every fault."""
    faults = Faults()
    texts = [given] if isinstance(given, str) else [*given]
    read = [faults(partial(_limit, box, text), None) for text in texts]
    faults.raise_found()
    return tuple(limit for limit in read if limit is not None)


def _limit(box: Box, text: str) -> Limit:
    parts = re.split(r"\s*([<>])=?\s*", text) if isinstance(text, str) else []
    if len(parts) != 3:
        raise UsageError(f"limit {brief(text)}: {_FORM}")
    terms, sense, level = parts
    keys = {axis.key: i for i, axis in enumerate(box.free)}
    weights = np.zeros(len(keys))
    units: list[str] = []
    at = 0
    while at < len(terms):
        term = _TERM.match(terms, at)
        if term is None or (at and not term["sign"]):
            raise UsageError(f"limit {text}: {_FORM}; limits are linear")
        key = term["key"]
        if key not in keys:
            raise UsageError(
                f"limit {text}: {key} is not free; {near(key, keys) if keys else 'nothing is: add --over'}"
            )
        weights[keys[key]] += (-1.0 if term["sign"] == "-" else 1.0) * float(term["factor"] or 1.0)
        units.append(box.free[keys[key]].unit)
        at = term.end()
    if not units or not all(same_unit(units[0], unit) for unit in units):
        raise UsageError(f"limit {text}: a sum of {' and '.join(dict.fromkeys(units)) or 'nothing'}; expected one unit")
    try:
        bound = si(level, units[0])
    except ValueError as fault:
        raise UsageError(f"limit {text}: {fault}") from None
    if sense == ">":
        weights, bound = -weights, -bound
    low, high = np.array([axis.values for axis in box.free]).T
    scale = float(np.abs(weights) @ np.maximum(np.abs(low), np.abs(high))) or 1.0
    slope = weights * (high - low) / scale
    limit = Limit(text, slope, (float(weights @ low) - bound) / scale, weights, bound)
    if limit.excess(np.where(slope < 0.0, 1.0, 0.0)) > 0.0:
        raise UsageError(f"limit {text}: no design within the ranges keeps it; widen a range or the limit")
    return limit
