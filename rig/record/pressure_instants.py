"""Instants of a run at which the pressure of a film tells most."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rig.record.run import Run
from rig.record.statistics import FRACTION, first_opening

_BEFORE = 0.02
"""Share of the time up to the first opening that the map before it is ahead of it."""


class Instant(NamedTuple):
    """A sample of a run, and why it is looked at."""

    sample: int
    why: str


def first_open(run: Run) -> int | None:
    """The first sample that shows a point open from the first opening on; None without an opening."""
    opened = first_opening(run)
    if opened is None:
        return None
    begin = int(np.searchsorted(run.time, opened))
    return begin + int(np.argmax(run.signals[FRACTION][begin:] < 1.0))


def telling(run: Run) -> list[Instant]:
    """In the order of time: before the first opening, at it, with the pressure most at either edge, fewest in contact.

    Without any opening, four instants at equal distances. Where the pressure is at an edge is told by its moment about
    the slider's middle, so that one last point that bears little is no such instant.
    """
    count = run.time.size
    opening = first_open(run)
    if opening is None:
        return [Instant(i, "all in contact") for i in np.linspace(count / 4, count - 1, 4).astype(int).tolist()]
    fraction = np.nan_to_num(run.signals[FRACTION][opening:], nan=1.0)
    moment = np.nan_to_num((run.signals["normal_force"] * run.signals["pressure_centre_x"])[opening:])
    found = [
        Instant(math.floor((1.0 - _BEFORE) * opening), "before the first opening"),
        Instant(opening, "first opening"),
        Instant(opening + int(moment.argmin()), "most at the rear edge"),
        Instant(opening + int(moment.argmax()), "most at the front edge"),
        Instant(opening + int(fraction.argmin()), "fewest in contact"),
        Instant(count - 1, "at the end"),
    ]
    return sorted(found)
