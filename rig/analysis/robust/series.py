"""Components as they are sold: values of the series E6 to E192 (IEC 60063) in place of those of a design.

The growth of the worst rig is steep in a design, so that its components are rounded before anything is proved: of all
values of the series near the design, the combination whose worst rig grows least. What is no component (a gain, delta)
keeps its value.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.box import Box
from rig.analysis.robust.descent import beyond
from rig.analysis.robust.design import Designed
from rig.analysis.robust.tasks import Region, Tasks, worst
from rig.errors import UsageError
from rig.scenes.axis import Axis
from rig.units import brief

Array = NDArray[np.float64]
_E24 = (10, 11, 12, 13, 15, 16, 18, 20, 22, 24, 27, 30, 33, 36, 39, 43, 47, 51, 56, 62, 68, 75, 82, 91)
SERIES = {"E6": 6, "E12": 12, "E24": 24, "E48": 48, "E96": 96, "E192": 192}
"""The series, with the number of values of a decade."""
COMPONENTS = ("ohm", "H", "F")
"""Units of the values that are components."""
_EACH = 2  # values of the series on either side of a design
_TRIED = 4  # combinations whose worst rig is searched


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


def _sold(axis: Axis, value: float, series: str) -> list[float]:
    """The values of a series near a value, within the range of the axis."""
    low, high = axis.values
    return [each for each in near(value, series) if low <= each <= high]


def checked(series: str | None, box: Box, tolerance: bool) -> str:
    """Return the name of a series. Raises UsageError for another name, for a `tolerance`, for a design without
    components, and for a range without a value of the series.
    """
    if series is None:
        return ""
    name = str(series).upper()
    if name not in SERIES:
        raise UsageError(f"series {brief(series)}: expected {', '.join(SERIES)}")
    components = [axis for axis in box.free if axis.unit in COMPONENTS]
    if not components:
        raise UsageError(
            f"series {name}: no free value is a component (resistance, inductance, capacitance); leave --series out, "
            "or free one with --over"
        )
    if tolerance:
        raise UsageError(
            "series: a design at the edge of a tolerance holds with no other values; state the tolerance with "
            "--against and minimise the growth"
        )
    empty = [axis for axis in components if not _sold(axis, axis.values[1], name)]
    between = [f"{axis.key} between {' and '.join(map(axis.text, axis.values))}" for axis in empty]
    if between:
        raise UsageError("\n".join(f"series {name}: has no value of {each}; state a wider range" for each in between))
    return name


def rounded(tasks: Tasks, design: Designed, region: Region, series: str) -> tuple[Designed, int]:
    """Return a design with components of a series, and the number of combinations near it.

    Raises UsageError if no value of the series lies within the ranges and limits of the design.
    """
    box = tasks.growth.box
    values = box.design(design.x)
    choices = []
    for axis, share in zip(box.free, design.x.tolist()):
        low, high = axis.values
        sold = [(value - low) / (high - low) for value in _sold(axis, values[axis.key], series)]
        choices.append(sold if axis.unit in COMPONENTS else [share])
        if not choices[-1]:
            raise UsageError(
                f"series {series}: has no value near {axis.key} = {axis.text(values[axis.key])}, where the search "
                "ended; state a range that begins above it, or leave --series out"
            )
    designs = [x for x in map(np.array, itertools.product(*choices)) if not beyond(x, tasks.limits)]
    if not designs:
        raise UsageError(f"series {series}: no combination of its values keeps the limits of the design")
    U = np.unique(np.vstack([design.rigs, design.worst.u]), axis=0)
    growths = tasks.largest(np.array(designs), U)
    tried: list[Designed] = []
    for i in np.argsort(growths, kind="stable")[:_TRIED].tolist():
        if not tried or growths[i] < min(other.growth for other in tried):
            bad = worst(tasks, designs[i], region, U)
            tried.append(design._replace(x=designs[i], worst=bad, audit=None))
    return min(tried, key=lambda other: other.growth), len(designs)
