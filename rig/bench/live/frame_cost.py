"""The processor time of frames, as a rehearsal measures it, and the largest pace that holds with it.

A frame of a run costs more than the same frame in a rehearsal: it sends and receives messages, and recorder and bus
have used its caches meanwhile (`BESIDE_NS`). A pace holds if all this takes at most `MOST` of the wall time of a frame,
or of a piece of several frames (rig.bench.live.pace).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10

import numpy as np

from rig.bench.live.pace import length
from rig.scenes.scene import Scene

BESIDE_NS = 150_000
"""Processor time [ns] of a piece beside that in a rehearsal. # measured: 110 to 170 us in four scenes on two cores"""
MOST = 0.9
"""Largest share of the wall time of a frame that it may be busy. # chosen: a tenth is left for other programs"""


@dataclass(frozen=True)
class FrameCost:
    """The processor time of a frame [ns]: its mean in each measured part of the protocol.

    `seconds`: simulated time [s] up to which it was measured. `whole`: whether this is the whole run.
    """

    means_ns: tuple[float, ...]
    seconds: float
    whole: bool = True

    def frame_ns(self, scene: Scene) -> float:
        """The cost [ns] that is exceeded in as much of the run as may be late (`clock.late_share_valid`)."""
        return float(np.quantile(self.means_ns, 1.0 - scene.clock.late_share_valid))

    def busy(self, scene: Scene, pace: float) -> float:
        """Share of the wall time of a frame, or of a piece, that the plant is busy at `pace`."""
        frames = length(scene, pace)
        spent_ns = frames * self.frame_ns(scene) + BESIDE_NS
        return spent_ns * pace / (frames * scene.frame_ns)

    def holding(self, scene: Scene, pace: float) -> float:
        """The largest pace up to `pace`, to two digits, at which the plant is busy for at most `MOST` of a frame."""
        while self.busy(scene, pace) > MOST:  # a smaller pace may have shorter pieces, whose messages weigh more
            pace = _rounded_down(MOST * pace / self.busy(scene, pace))
        return pace


def _rounded_down(value: float) -> float:
    """A positive value with two digits, rounded down."""
    digit = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{floor(value / digit) * digit:.2g}")


def kept_pace(scene: Scene, pace: float, cost: FrameCost, adapts: bool) -> tuple[float, str]:
    """The pace of a run that asks for `pace`, and what to tell its user before the start; "" if `pace` holds.

    `adapts`: whether the run takes the largest pace that holds on this machine.
    """
    busy = cost.busy(scene, pace)
    frame = _frame_in_words(scene, pace)
    holding = cost.holding(scene, pace)
    if holding == pace:
        return pace, f"pace {pace:g}: {frame} is {busy:.0%} busy on this machine" if adapts else ""
    where = "" if cost.whole else f" in the first {cost.seconds:.3g} s of the run"
    load = f"at a pace of {pace:g} {frame} is {busy:.0%} busy on this machine{where}"
    if adapts:
        return holding, f"pace {holding:g}: {load}, and {MOST:.0%} holds"
    late = "will" if busy > 1.0 else "may"
    return pace, (
        f"warning: {load}, and frames {late} be late; a pace of {holding:g} holds: --pace {holding:g}, or --pace auto "
        "to let each machine find its own"
    )


def _frame_in_words(scene: Scene, pace: float) -> str:
    frames = length(scene, pace)
    wall_ms = frames * scene.frame_ns / pace * 1e-6
    return f"a frame of {wall_ms:.3g} ms" if frames == 1 else f"a piece of {frames} frames ({wall_ms:.3g} ms)"
