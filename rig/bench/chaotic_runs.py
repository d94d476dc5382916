"""Compares two runs of a rig whose contact points open, made on different processors.

Rounding differs between processors. Up to the first opening of a point the motion is stable against rounding, and
samples agree. After it the motion is chaotic: samples soon differ, and only statistics can agree. Each tolerance is
about twice the spread of runs of the shipped plate whose initial states differ by rounding.
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
last milliseconds before it amplify a rounding error to 4e-7. # chosen"""
ONSET = 0.01
"""Largest difference between the times of the first opening, as a share of that time. # chosen"""
SHORTEST = 0.1
"""Shortest time span whose statistics are compared [s]. # chosen: 0.03 s have twice the spread"""
FEWEST = 1000
"""Fewest samples of outputs whose statistics are compared: with 20 the RMS is uncertain by 16 %. # chosen"""
RMS, BAND = 1.5, 2.0
"""Largest factor between the RMS of accelerations, and between their RMS in one band. # chosen"""
MEAN, LEAST = 0.1, 0.15
"""Largest difference between the means, and between the least values, of the contact fraction. # chosen"""
RANGE = 0.5
"""Largest difference between ranges of the pressure centre, as a share of the longest range. # chosen"""


class Compared(NamedTuple):
    """One statistic of a recording and of its re-simulation; `allowed`: the tolerance in words."""

    recorded: Statistic
    simulated: float
    allowed: str
    agrees: bool

    def __str__(self) -> str:
        one, unit = self.recorded, "" if self.recorded.unit == "1" else f" {self.recorded.unit}"
        return f"{one.name}: {one.value:.4g} and {self.simulated:.4g}{unit} ({self.allowed})"


class Openings(NamedTuple):
    """Time of the first opening of a point [s] in the recording and in its re-simulation; None: never."""

    recorded: float | None
    simulated: float | None

    @classmethod
    def of(cls, run: Run, again: Run) -> Openings:
        """The first openings of a recording and its re-simulation."""
        return cls(first_opening(run), first_opening(again))

    @property
    def first(self) -> float | None:
        """The earlier time; None if no point opens in either run."""
        return min((one for one in self if one is not None), default=None)

    def fault(self, step: float) -> str:
        """Why the times do not agree; "" if they do. `step`: time between samples of the recording [s]."""
        if self.recorded is None and self.simulated is None:
            return ""
        if self.recorded is None or self.simulated is None:
            times = ["never" if one is None else f"at t = {one:.6g} s" for one in self]
            return f"a contact point opens first {times[0]} in the recording and {times[1]} here"
        if abs(self.recorded - self.simulated) <= ONSET * self.recorded + step:
            return ""
        return (
            f"a contact point opens first at t = {self.recorded:.6g} s in the recording and at {self.simulated:.6g} s "
            f"here; {100 * ONSET:g} % are allowed"
        )


def compared(run: Run, again: Run, first: float, last: float) -> Iterator[Compared]:
    """Compare all statistics with a tolerance from `first` to `last` [s].

    Outputs of the plant are compared at the instants that both runs have: the recording of a live run has 200 per
    second. With fewer than `FEWEST` such instants only sensors are compared, which have all of their samples.
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
    """`run` with its outputs only at the instants of `beside`; without outputs if these are fewer than `FEWEST`."""
    t_ns, other = (np.rint(one.time * 1e9).astype(np.int64) for one in (run, beside))
    here = np.isin(t_ns, other, assume_unique=True)
    inside = here & (run.time >= first) & (run.time <= last)
    enough = np.count_nonzero(inside) >= FEWEST
    signals = {name: v[here] for name, v in run.signals.items()} if enough else {}
    return replace(run, time=run.time[here], signals=signals)
