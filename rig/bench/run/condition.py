"""The condition of a step that waits for a measurement, and the range of the last samples that it needs."""

from __future__ import annotations

from collections import deque
from math import isfinite

from rig.scenes.protocol import Wait


class Condition:
    """The condition of a wait for a measurement; see `rig.scenes.protocol.Wait`."""

    def __init__(self, step: Wait, column: int, frame_ns: int) -> None:
        self.column = column
        self.is_met = False
        self._kind = step.condition
        self._limit = step.limit
        frames = max(step.window // frame_ns, 1)
        self._range = Range(frames)
        self._before: deque[tuple[float, float]] = deque(maxlen=frames + 1)

    def met(self, sample: float) -> bool:
        """Whether the condition is met, after the sample of one more frame. NaN or infinity restarts the windows."""
        if not isfinite(sample):
            self._range.clear()
            self._before.clear()
        elif self._kind == "above":
            self.is_met = sample > self._limit
        elif self._kind == "below":
            self.is_met = sample < self._limit
        elif self._range.add(sample):
            now = (self._range.highest, self._range.lowest)
            past = self._before
            if self._kind == "quiet":
                self.is_met = (now[0] - now[1]) / 2.0 < self._limit
            else:  # settled
                past.append(now)
                settled = all(abs(value - before) < self._limit for value, before in zip(now, past[0]))
                self.is_met = len(past) == past.maxlen and settled
        return self.is_met


class Range:
    """Highest and lowest of the last `frames` samples, by two monotonic queues in amortised constant time."""

    def __init__(self, frames: int) -> None:
        self.frames = frames
        self._high: deque[tuple[int, float]] = deque()
        self._low: deque[tuple[int, float]] = deque()
        self._seen = 0

    def clear(self) -> None:
        """Forget all samples."""
        self._high.clear()
        self._low.clear()
        self._seen = 0

    def add(self, sample: float) -> bool:
        """Add a sample; whether there are `frames` of them."""
        high = self._high
        low = self._low
        number = self._seen
        while high and high[-1][1] <= sample:
            high.pop()
        while low and low[-1][1] >= sample:
            low.pop()
        high.append((number, sample))
        low.append((number, sample))
        oldest = number - self.frames
        if high[0][0] <= oldest:
            high.popleft()
        if low[0][0] <= oldest:
            low.popleft()
        self._seen = number + 1
        return self._seen >= self.frames

    @property
    def highest(self) -> float:
        """Highest of the last `frames` samples."""
        return self._high[0][1]

    @property
    def lowest(self) -> float:
        """Lowest of the last `frames` samples."""
        return self._low[0][1]
