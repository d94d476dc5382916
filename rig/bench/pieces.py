"""How many frames a live run carries in one piece: with one look at the clock and at the bus for all of them.

A frame of 50 us has no time for the bus, and needs none where its controllers work in the plant's process. What is due
at a tick still happens at that tick: protocol, limits, these controllers. What comes from other processes is taken at
the first tick of a piece, and what is published of its ticks goes out at its end.
"""

from __future__ import annotations

from math import gcd

from rig.bench.operation import Operation

LONGEST_NS = 1_000_000
"""Longest piece [ns of the wall clock]. # chosen: what others notice of it is below what the bus takes at times"""


class Pieces:
    """The pieces of a run at `pace` (None: without a clock, as at pace 1).

    A controller in another process is asked at the first tick of a piece, so that every tick at which it is due begins
    one. Where all controllers are in other processes a piece is one frame: their commands take effect one frame later.
    """

    def __init__(self, operation: Operation, pace: float | None) -> None:
        self._stand, self._lines = operation.stand, operation.exchange.lines
        self._in_plant = operation.scene.in_plant
        self._most = max(int(LONGEST_NS * (pace or 1.0)) // operation.stand.frame_ns, 1)

    @property
    def length(self) -> int:
        """Frames in a whole piece, as long as nobody joins or leaves."""
        periods = [line.period for name, line in self._lines.items() if name not in self._in_plant]
        if not periods:
            return self._most
        if not self._in_plant:
            return 1
        common = gcd(*periods)
        return next(frames for frames in range(min(self._most, common), 0, -1) if common % frames == 0)

    @property
    def left(self) -> int:
        """Frames from the present tick up to the first tick of the next piece."""
        if self._most == 1:
            return 1
        length = self.length
        return length - self._stand.tick % length
