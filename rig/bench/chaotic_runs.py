"""Two runs of a rig whose contact points open, made by different processors: what of them has to agree, and how far.

Rounding differs. Up to the first opening the motion forgets it, and samples agree. From then on the motion is chaotic:
samples differ soon, and only statistics can agree. Each tolerance is about twice the spread that runs of the shipped
plate have among themselves when their start differs by rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rig.record.run import Run
from rig.record.statistics import ACCELERATION, Statistic, first_opening, statistics

BEFORE = 1e-5
"""Largest deviation up to the first opening, as a share of the range of a signal. Points that stick and slip in the
last milliseconds before it make 4e-7 of a rounding. # chosen"""
ONSET = 0.01
"""Largest difference of the first opening, as a share of its time. # chosen"""
SHORTEST = 0.1
"""A shorter stretch has no statistics that agree [s]. # chosen: 0.03 s have twice the spread"""
FEWEST = 1000
"""Samples of outputs whose statistics are compared: 20 alone have an RMS that is uncertain by 16 %. # chosen"""
RMS, BAND = 1.5, 2.0
"""Largest factor between the RMS of accelerations, and between those of one band. # chosen"""
MEAN, LEAST = 0.1, 0.15
"""Largest difference of the contact fraction, its mean and its least value. # chosen"""
RANGE = 0.5
"""Largest difference between ranges of the pressure centre, of the longest range. # chosen"""


class Compared(NamedTuple):
    """One statistic of a recording and of its simulation; `allowed` in words."""

    recorded: Statistic
    simulated: float
    allowed: str
    agrees: bool

    def __str__(self) -> str:
        one, unit = self.recorded, "" if self.recorded.unit == "1" else f" {self.recorded.unit}"
        return f"{one.name}: {one.value:.4g} and {self.simulated:.4g}{unit} ({self.allowed})"


class Openings(NamedTuple):
    """When a point opened first [s] in the recording and in its simulation; None: never."""

    recorded: float | None
    simulated: float | None

    @classmethod
    def of(cls, run: Run, again: Run) -> Openings:
        """Of a recording and its simulation."""
        return cls(first_opening(run), first_opening(again))

    @property
    def first(self) -> float | None:
        """The earlier one; None where no point opens in either."""
        return min((one for one in self if one is not None), default=None)

    def fault(self, step: float) -> str:
        """Why they do not agree; "" if they do. `step`: between samples of the recording [s]."""
        if self.recorded is None and self.simulated is None:
            return ""
        if self.recorded is None or self.simulated is None:
            told = ["never" if one is None else f"at t = {one:.6g} s" for one in self]
            return f"a contact point opens first {told[0]} in the recording and {told[1]} here"
        if abs(self.recorded - self.simulated) <= ONSET * self.recorded + step:
            return ""
        return (
            f"a contact point opens first at t = {self.recorded:.6g} s in the recording and at {self.simulated:.6g} s "
            f"here; {100 * ONSET:g} % are allowed"
        )


def compared(run: Run, again: Run, first: float, last: float) -> Iterator[Compared]:
    """The statistics of both from `first` to `last` [s] that have a tolerance.

    Outputs of the plant are taken at the instants that both have: a recording off the bus has 200 a second. Sensors
    have all of their samples; with fewer than `FEWEST` outputs in the stretch, they are what is compared.
    """
    here = {one.name: one for one in statistics(_thinned(again, run, first, last), first, last)}
    both = [one for one in statistics(_thinned(run, again, first, last), first, last) if one.name in here]
    longest = max((max(one.value, here[one.name].value) for one in both if one.kind == "range"), default=0.0)
    for one in both:
        value = here[one.name].value
        away, factor = abs(one.value - value), max(one.value, value)
        if one.kind in ("rms", "band") and one.unit == ACCELERATION:
            most = RMS if one.kind == "rms" else BAND
            yield Compared(one, value, f"factor {most:g}", factor <= most * min(one.value, value))
        elif one.kind in ("mean", "least"):
            allowed = MEAN if one.kind == "mean" else LEAST
            yield Compared(one, value, f"within {allowed:g}", away <= allowed)
        elif one.kind == "range":
            allowed = RANGE * longest
            yield Compared(one, value, f"within {allowed:.2g} {one.unit}", away <= allowed)


def _thinned(run: Run, beside: Run, first: float, last: float) -> Run:
    """`run` with its outputs at the instants of `beside` alone; without outputs where these are too few."""
    t_ns, other = (np.rint(one.time * 1e9).astype(np.int64) for one in (run, beside))
    here = np.isin(t_ns, other, assume_unique=True)
    inside = here & (run.time >= first) & (run.time <= last)
    enough = np.count_nonzero(inside) >= FEWEST
    signals = {name: v[here] for name, v in run.signals.items()} if enough else {}
    return replace(run, time=run.time[here], signals=signals)
