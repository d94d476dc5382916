"""Components as they are sold: values of the series E6 to E192 (IEC 60063) in place of those of a design.

The growth of the worst rig is steep in a design, so that its components are rounded before anything is proved: of all
values of the series near the design, the combination whose worst rig grows least. What is no component (a gain, delta)
keeps its value.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.box import Box, Limit
from rig.analysis.robust.tasks import Region, Tasks
from rig.analysis.robust.worst import Worst, worst
from rig.errors import UsageError

Array = NDArray[np.float64]
_E24 = (10, 11, 12, 13, 15, 16, 18, 20, 22, 24, 27, 30, 33, 36, 39, 43, 47, 51, 56, 62, 68, 75, 82, 91)
SERIES = {"E6": 6, "E12": 12, "E24": 24, "E48": 48, "E96": 96, "E192": 192}
"""The series, with the number of values of a decade."""
COMPONENTS = ("ohm", "H", "F")
"""Units of the values that are components."""
_EACH = 2  # values of the series on either side of a design
_TRIED = 4  # combinations whose worst rig is searched


class Rounded(NamedTuple):
    """A design x [free] of components of a `series`, with its worst rig; `before`: the design that was rounded, and
    `growth` [1/s] of its worst rig; `tried`: number of combinations near it.
    """

    series: str
    x: Array
    worst: Worst
    before: Array
    growth: float
    tried: int


def decade(series: str) -> list[float]:
    """Return the values of a series from 1 to below 10."""
    count = SERIES[series]
    if count <= len(_E24):
        return [value / 10.0 for value in _E24[:: len(_E24) // count]]
    values = [round(10.0 ** (k / count), 2) for k in range(count)]
    return [9.2 if value == 9.19 else value for value in values]  # the one that the standard rounds otherwise


def near(value: float, series: str, each: int = _EACH) -> list[float]:
    """Return the values of a series around a positive value: as many as `each` to either side of it; none of 0."""
    if value <= 0.0:
        return []
    exponent = math.floor(math.log10(value))
    powers = range(exponent - 2, exponent + 3)
    every = sorted(float(f"{size:g}e{power}") for power in powers for size in decade(series))
    at = int(np.searchsorted(every, value))
    return every[at - each : at + each]


def checked(series: str | None, box: Box) -> str:
    """Return the name of a series. Raises UsageError for another name, for a design without components, and for a
    range without a value of the series.
    """
    if series is None:
        return ""
    name = series.upper() if isinstance(series, str) else ""
    if name not in SERIES:
        raise UsageError(f"series {series}: expected {', '.join(SERIES)}")
    components = [axis for axis in box.free if axis.unit in COMPONENTS]
    if not components:
        raise UsageError(
            f"series {name}: no free value is a component (resistance, inductance, capacitance); leave --series out, "
            "or free one with --over"
        )
    faults = []
    for axis in components:
        low, high = axis.values
        if high <= 0.0 or not any(low <= value <= high for value in near(high, name)):
            ends = f"{axis.text(low)} and {axis.text(high)}"
            faults.append(f"series {name}: has no value of {axis.key} between {ends}; state a wider range")
    if faults:
        raise UsageError("\n".join(faults))
    return name


def rounded(
    tasks: Tasks, x: Array, bad: Worst, rigs: Array, region: Region, limits: tuple[Limit, ...], series: str
) -> Rounded:
    """Return design x [free] with components of a series. `bad`: its worst rig; `rigs` [k, uncertain]: those that it
    was designed against.

    Raises UsageError if no value of the series lies within the ranges and limits of the design.
    """
    box = tasks.growth.box
    values = box.design(x)
    choices = []
    for axis, share in zip(box.free, x.tolist()):
        low, high = axis.values
        if axis.unit not in COMPONENTS:
            choices.append([share])
            continue
        sold = [value for value in near(values[axis.key], series) if low <= value <= high]
        if not sold:
            raise UsageError(
                f"series {series}: has no value near {axis.key} = {axis.text(values[axis.key])}, where the search "
                "ended; state a range that begins above it, or leave --series out"
            )
        choices.append([(value - low) / (high - low) for value in sold])
    designs = np.array([d for d in map(np.array, itertools.product(*choices)) if _allowed(d, limits)])
    if not len(designs):
        raise UsageError(f"series {series}: no combination of its values keeps the limits of the design")
    U = np.unique(np.vstack([rigs, bad.rigs]), axis=0)
    found = tasks.growths(np.repeat(designs, len(U), axis=0), np.tile(U, (len(designs), 1)))
    growths = found.growth.reshape(len(designs), len(U)).max(axis=1)
    best: tuple[Array, Worst] | None = None
    for i in np.argsort(growths, kind="stable")[:_TRIED].tolist():
        if best is not None and growths[i] >= best[1].growth:
            break
        its = worst(tasks, designs[i], region, U)
        if best is None or its.growth < best[1].growth:
            best = designs[i], its
    assert best is not None
    return Rounded(series, *best, x, bad.growth, len(designs))


def _allowed(x: Array, limits: tuple[Limit, ...]) -> bool:
    return all(limit.excess(x) <= 0.0 for limit in limits)
