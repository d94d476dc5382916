"""Steps that a controller left unanswered, because it was behind or did not receive them.

A controller publishes them as an event, so that a replay and a continued recording repeat what it knew at each step:

    {"first": 3200, "last": 5180, "arrived": [[3200, 4100], [4800, 5180]]}

The steps that were due from tick `first` to tick `last` were not answered. A controller of every sample got the samples
of those that `arrived` with the step after `last`.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterable, Mapping
from typing import Any

KIND = "skipped"
"""Kind of the event."""


class Ticks:
    """A set of ticks, as intervals in rising order. `most`: gap between two ticks of one interval at most."""

    def __init__(self, intervals: Iterable[tuple[int, int]] = (), most: int = 1) -> None:
        self._first: list[int] = []
        self._last: list[int] = []
        self._most = most
        for first, last in intervals:
            self._first.append(first)
            self._last.append(last)

    def add(self, tick: int) -> None:
        """Add a tick after all others."""
        if self._last and tick - self._last[-1] <= self._most:
            self._last[-1] = tick
        else:
            self._first.append(tick)
            self._last.append(tick)

    def __contains__(self, tick: int) -> bool:
        place = bisect(self._first, tick) - 1
        return place >= 0 and tick <= self._last[place]

    def before(self, end: int) -> Ticks:
        """Those before tick `end`."""
        return Ticks((first, min(last, end - 1)) for first, last in self.intervals() if first < end)

    def intervals(self) -> list[tuple[int, int]]:
        """First and last tick of each interval."""
        return list(zip(self._first, self._last))


class SkippedSteps:
    """The steps that one controller has not answered in a recording, from the data of its events in order."""

    def __init__(self, events: Iterable[Mapping[str, Any]] = ()) -> None:
        unanswered: list[tuple[int, int]] = []
        arrived: list[tuple[int, int]] = []
        for data in events:
            try:
                interval = _pair(data["first"], data["last"])
                inside = [_pair(*pair) for pair in data["arrived"]]
            except (KeyError, TypeError, ValueError):  # a user's controller may publish anything
                continue
            unanswered.append(interval)
            arrived += inside
        self.unanswered = Ticks(sorted(unanswered))
        self.arrived = Ticks(sorted(arrived))

    def before(self, end: int) -> SkippedSteps:
        """Those before tick `end`."""
        steps = SkippedSteps()
        steps.unanswered = self.unanswered.before(end)
        steps.arrived = self.arrived.before(end)
        return steps


def _pair(first: Any, last: Any) -> tuple[int, int]:
    if type(first) is not int or type(last) is not int:
        raise TypeError
    return first, last
