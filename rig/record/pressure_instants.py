"""Characteristic instants of the pressure of a film in a run."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rig.record.run import Run
from rig.record.statistics import FRACTION, first_opening

_BEFORE = 0.02
"""The map before the first opening precedes it by this share of the time up to it."""


class Instant(NamedTuple):
    """A sample of a run, and why it was chosen."""

    sample: int
    why: str


def first_open(run: Run) -> int | None:
    """Return the first sample with an open point from the first opening on; None without an opening."""
    opened = first_opening(run)
    if opened is None:
        return None
    begin = int(np.searchsorted(run.time, opened))
    return begin + int(np.argmax(run.signals[FRACTION][begin:] < 1.0))


def characteristic(run: Run) -> list[Instant]:
    """Return the characteristic instants in order of time: around the first opening, at extremes, at the end.

    They are: before the first opening, at it, with the pressure most at either edge, with the fewest points in contact,
    at the end. Without any opening: four instants at equal distances. The moment of the pressure about the slider's
    middle decides where the pressure is most at an edge, so that a single last point with little load does not count.
    """
    count = run.time.size
    opening = first_open(run)
    if opening is None:
        why = "all in contact" if FRACTION in run.signals else ""
        return [Instant(i, why) for i in np.linspace(count / 4, count - 1, 4).astype(int).tolist()]
    fraction = np.nan_to_num(run.signals[FRACTION][opening:], nan=1.0)
    moment = np.nan_to_num((run.output("normal_force") * run.output("pressure_centre_x"))[opening:])
    found = [
        Instant(math.floor((1.0 - _BEFORE) * opening), "before the first opening"),
        Instant(opening, "first opening"),
        Instant(opening + int(moment.argmin()), "most at the rear edge"),
        Instant(opening + int(moment.argmax()), "most at the front edge"),
        Instant(opening + int(fraction.argmin()), "fewest in contact"),
        Instant(count - 1, "at the end"),
    ]
    return sorted(found)
