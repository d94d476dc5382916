"""The timing of a paced run: lateness, spans of a frame, overruns by cause, and the timing verdict.

A frame is late if it begins more than one frame after its deadline. A sequence of late frames is one overrun. Its cause
is what kept the frame before the first late one busy or, if the plant was ready in time, the wait:

    wake       ready in time, but woken too late by the scheduler
    preempted  busy beyond the frame, but without the processor for most of that time
    host       one of these two, and the host of this virtual machine took half of the lateness or more at that time
    gc         a garbage collection                     compile    a kernel was compiled
    receive, plant, publish, serve                      the longest span of the frame

The timing verdict is VALID with at most 1 % of the frames late and nothing lost, DEGRADED with up to 5 % or a counted
loss, else INVALID; the scene may set other shares. Skipped frames of the wall clock count as late.

The host of a virtual machine may give its processors to others. The timing states how much it took (Linux, in steps of
10 ms). It takes one processor or all for 10 to 30 ms at a time (measured).

If several frames are computed in one piece, everything here is about pieces of `each` frames.

A frame only stores one tuple, which is evaluated outside the frame, five times per second.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba.core import event
from numpy.typing import NDArray

from rig.errors import ExitCode

NOTHING_LOST = "nothing lost"
SPANS = ("receive", "plant", "publish", "serve")
CAUSES = ("wake", "preempted", "host", "gc", "compile", *SPANS)
_PER_OCTAVE = 16  # bins of a histogram of times: each is 4.4 % wide. chosen
_STOLEN = 0.01  # smaller shares are not reported
_BINS = 48 * _PER_OCTAVE  # up to 2**48 ns, 78 hours

Row = tuple[int, int, bool, int, int, int, int, int]


class Spread:
    """The distribution of a duration [ns]: percentiles to 5 %, mean and maximum exact, in constant memory."""

    def __init__(self) -> None:
        self.count = 0
        self.total = 0
        self.worst = 0
        self._bins = np.zeros(_BINS, np.int64)

    def add(self, durations: NDArray[np.int64]) -> None:
        """Add durations [ns]; negative ones count as zero."""
        if not durations.size:
            return
        whole = np.maximum(durations, 0)
        self.count += whole.size
        self.total += int(whole.sum())
        self.worst = max(self.worst, int(whole.max()))
        bins = (np.log2(np.maximum(whole, 1)) * _PER_OCTAVE).astype(np.int64)
        self._bins += np.bincount(np.minimum(bins, _BINS - 1), minlength=_BINS)

    def quantile(self, share: float) -> float:
        """Quantile: the duration [ns] that the share `share` of all durations does not exceed."""
        if not self.count:
            return 0.0
        reached = int(np.searchsorted(np.cumsum(self._bins), share * self.count))
        return float(min(2.0 ** ((min(reached, _BINS - 1) + 1) / _PER_OCTAVE), self.worst))

    @property
    def mean(self) -> float:
        """Mean duration [ns]."""
        return self.total / self.count if self.count else 0.0

    def to_json(self) -> dict[str, float]:
        """Quantiles, mean and maximum [us], for the summary."""
        quantiles = {f"p{round(share * 100)}": self.quantile(share) / 1e3 for share in (0.5, 0.95, 0.99)}
        return {"mean": self.mean / 1e3, **quantiles, "max": self.worst / 1e3}


class Interruptions(event.Listener):  # type: ignore[misc]
    """Begin and end times of garbage collections and compilations (or loading of compiled code) in this process."""

    def __init__(self) -> None:
        self.seen: list[tuple[str, int, int]] = []
        self._collecting = 0
        self._compiling = 0
        self._depth = 0

    def within(self, kind: str, begin: int, end: int) -> int:
        """Time [ns] spent in `kind` between two times."""
        return sum(max(min(e, end) - max(b, begin), 0) for k, b, e in self.seen if k == kind)

    def forget(self, before: int) -> None:
        """Forget what ended before a time."""
        self.seen = [interruption for interruption in self.seen if interruption[2] >= before]

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Record collections and compilations in this process within the block."""
        event.register("numba:compiler_lock", self)  # type: ignore[no-untyped-call]
        gc.callbacks.append(self._collected)
        try:
            yield
        finally:
            gc.callbacks.remove(self._collected)
            event.unregister("numba:compiler_lock", self)  # type: ignore[no-untyped-call]

    def _collected(self, phase: str, _: dict[str, int]) -> None:
        if phase == "start":
            self._collecting = time.perf_counter_ns()
        else:
            self.seen.append(("gc", self._collecting, time.perf_counter_ns()))

    def on_start(self, _: Any) -> None:
        """Called by numba when a compilation begins; they nest."""
        if not self._depth:
            self._compiling = time.perf_counter_ns()
        self._depth += 1

    def on_end(self, _: Any) -> None:
        """Called by numba when a compilation ends."""
        self._depth -= 1
        if not self._depth:
            self.seen.append(("compile", self._compiling, time.perf_counter_ns()))


@dataclass(frozen=True)
class TimingVerdict:
    """The timing verdict VALID, DEGRADED or INVALID, and its reasons."""

    word: str
    reasons: tuple[str, ...]

    @property
    def exit_code(self) -> ExitCode:
        """TIMING if the timing is invalid, else DONE."""
        return ExitCode.TIMING if self.word == "INVALID" else ExitCode.DONE


class Timing:
    """The timing of one paced run in pieces of `each` frames, each of which has `wall_ns` of wall time."""

    def __init__(self, wall_ns: float, each: int = 1) -> None:
        self.wall_ns = wall_ns
        self.each = each
        self.rows: list[Row] = []
        """Per frame: begin, lateness, whether there was time to wait, spans, processor time before it; all in ns."""
        self.interruptions = Interruptions()
        self.lateness = Spread()
        self.spans = {name: Spread() for name in SPANS}
        self.busy = Spread()
        self.late = 0
        self.overruns = dict.fromkeys(CAUSES, 0)
        self.worst_ns = 0
        self.worst_frame = -1
        self.worst_cause = ""
        self.given_up = 0
        self.stolen_ns = 0
        """Processor time that the host of this machine has taken since the first frame [ns]."""
        self.stolen_share = 0.0
        """The same, as a share of the time of all processors."""
        self._last: Row | None = None
        self._cause = ""

    @property
    def frames(self) -> int:
        """Number of frames so far."""
        return self.lateness.count

    def resize(self, each: int) -> None:
        """Set the number of frames in a piece from now on."""
        if each != self.each:
            self.fold()
            self.wall_ns = self.wall_ns / self.each * each
            self.each = each

    def fold(self, stolen_ns: int = 0) -> None:
        """Evaluate the rows so far and forget them. `stolen_ns`: time that the host took meanwhile [ns]."""
        self.stolen_ns += stolen_ns
        if not self.rows:
            return
        rows = self.rows
        self.rows = []
        first = self.frames
        table = np.array(rows, np.int64)
        late = table[:, 1]
        self.lateness.add(late)
        for column, name in enumerate(SPANS, start=3):
            self.spans[name].add(table[:, column])
        self.busy.add(table[:, 3:7].sum(axis=1))
        for i in np.flatnonzero(late > self.wall_ns):
            before = rows[i - 1] if i else self._last
            if before is None or before[1] <= self.wall_ns:
                self._cause = self._explain(before, rows[i], stolen_ns)
                self.overruns[self._cause] += 1
            self.late += 1
            if late[i] > self.worst_ns:
                self.worst_ns = int(late[i])
                self.worst_frame = first + int(i)
                self.worst_cause = self._cause
        if not self.late and late.max() > self.worst_ns:
            self.worst_ns = int(late.max())
            self.worst_frame = first + int(late.argmax())
        self._last = rows[-1]
        self.interruptions.forget(self._last[0])

    def _explain(self, before: Row | None, row: Row, stolen_ns: int) -> str:
        host = "host" if 2 * stolen_ns >= row[1] else ""
        if before is None or row[2]:
            return host or "wake"
        begin, end = before[0], row[0]
        spans = dict(zip(SPANS, before[3:7]))
        for kind in ("compile", "gc"):
            if self.interruptions.within(kind, begin, end) > (end - begin) / 2:
                return kind
        longest = max(spans, key=lambda name: spans[name])
        preempted = row[7] - before[7] < (end - begin) / 2 and longest != "publish"
        return (host or "preempted") if preempted else longest

    @property
    def late_share(self) -> float:
        """Share of the frames of the wall clock that began late or were skipped."""
        due = self.frames + self.given_up
        return (self.late + self.given_up) / due if due else 0.0

    def verdict(
        self,
        valid: float,
        degraded: float,
        lost: Mapping[str, int] | None = None,
        faults: Sequence[str] = (),
        broken: bool = False,
        unknown: Sequence[str] = (),
    ) -> TimingVerdict:
        """The timing verdict. `valid`, `degraded`: largest shares of late frames for VALID and DEGRADED.

        `lost`: topic -> lost messages; `faults`: other reasons against VALID; `unknown`: processes whose losses are
        unknown; `broken`: an overrun has ended the run, so that it is INVALID with any share.
        """
        share = self.late_share
        reasons = []
        what = ("frames", "frame") if self.each == 1 else (f"pieces of {self.each} frames", "piece")
        if self.frames:
            reasons.append(f"{share:.2%} of {self.frames + self.given_up} {what[0]} late by more than one {what[1]}")
        if self.worst_ns:
            because = f", {self.worst_cause}" if self.worst_cause else ""
            reasons.append(f"worst {_in_words(self.worst_ns)} at {what[1]} {self.worst_frame}{because}")
        missing = {topic: count for topic, count in (lost or {}).items() if count}
        if self.stolen_share > _STOLEN:
            reasons.append(f"the host of this machine took {self.stolen_share:.1%} of its processors' time")
        if missing:
            reasons.append("lost " + ", ".join(f"{n} of {t}" for t, n in missing.items()))
        if unknown:
            reasons.append(f"unknown losses on the way to {', '.join(unknown)}")
        if not (missing or unknown):
            reasons.append(NOTHING_LOST)
        reasons.extend(faults)
        word = "DEGRADED" if share > valid or missing or unknown or faults else "VALID"
        return TimingVerdict("INVALID" if broken or share > degraded else word, tuple(reasons))

    def to_json(self) -> dict[str, Any]:
        """All counts, and durations [us]."""
        return {
            "frames": self.frames,
            "each": self.each,
            "late": self.late,
            "given_up": self.given_up,
            "late_share": self.late_share,
            "stolen_share": self.stolen_share,
            "overruns": {cause: count for cause, count in self.overruns.items() if count},
            "worst_us": self.worst_ns / 1e3,
            "worst_frame": self.worst_frame,
            "worst_cause": self.worst_cause,
            "lateness": self.lateness.to_json(),
            "busy": self.busy.to_json(),
            "spans": {name: spread.to_json() for name, spread in self.spans.items()},
        }


def _in_words(ns: int) -> str:
    """A time in words: "6.26 ms", from a second on "3 s"."""
    return f"{ns / 1e6:.3g} ms" if ns < 999.5e6 else f"{ns / 1e9:.3g} s"
