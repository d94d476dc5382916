"""The steps of a protocol in their order, with repeats unrolled: their number and their duration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import count
from typing import Any

from rig.scenes.protocol import Repeat, duration_ns


def unrolled(steps: Iterable[Any]) -> Iterator[Any]:
    """The steps in order, with repeats unrolled; endless if a step repeats for ever."""
    for step in steps:
        if isinstance(step, Repeat):
            for _ in count() if step.times == "forever" else range(step.times):
                yield from unrolled(step.steps)
        else:
            yield step


def number(steps: Iterable[Any]) -> int | None:
    """Number of steps with repeats unrolled; None if they never end."""
    return _total(steps, lambda _: 1)


def least_ns(steps: Iterable[Any]) -> int | None:
    """Least duration of the steps [ns], waits without any time; None if they never end."""
    return _total(steps, duration_ns)


def longest_ns(steps: Iterable[Any]) -> int | None:
    """Longest duration of the steps [ns], waits with their timeout; None if they never end."""
    return _total(steps, partial(duration_ns, waits=True))


def _total(steps: Iterable[Any], of: Callable[[Any], int]) -> int | None:
    """The sum of `of` over the steps with repeats unrolled; None if they never end."""
    total = 0
    for step in steps:
        if not isinstance(step, Repeat):
            total += of(step)
            continue
        inner = _total(step.steps, of)
        if inner is None or step.times == "forever":
            return None
        total += inner * step.times
    return total
