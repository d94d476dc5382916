"""A blow of a hammer with a stated duration: a half sine of force where a knock acts. Absent: no knock takes time.

    F(t) = pi I / (2 T) sin(pi t / T),  0 <= t <= T             I: impulse [N s], T: duration of the contact [s]

    s' = omega c, c' = -omega s, states s = F and c, omega = pi / T

A blow begins with c = pi I / (2 T) and ends with s = c = 0. Both are written at ticks, so every method integrates a
smooth force between them, and the work of the hammer is part of the work of the forces. Between blows both states are
zero. The spectrum of the force is zero first at 1.5 / T and 3 dB below its value at 0 Hz at about 0.6 / T.
Source: the half-sine pulse of IEC 60068-2-27, test Ea.
"""

from __future__ import annotations

import math
from collections.abc import Collection

from rig.model.assembly import Assembly, Output
from rig.picture import Plot

FORCE = "knock_force"
"""Output: force of the hammer [N]."""


def states(duration_ns: int) -> tuple[str, str]:
    """Names of the two states of a blow: s, the force, and c."""
    return f"knock_{duration_ns}ns.sin", f"knock_{duration_ns}ns.cos"


def peak(impulse: float, duration_ns: int) -> float:
    """The largest force [N] of a blow of `impulse` [N s]."""
    return math.pi * impulse / (2e-9 * duration_ns)


def add(a: Assembly, durations_ns: Collection[int]) -> None:
    """Add the force of blows of these durations, two states for each, and the output `knock_force`."""
    row = {}
    about = f"the force of a knock: half sine within {', '.join(f'{ns * 1e-6:g} ms' for ns in durations_ns)}"
    for duration_ns in durations_ns:
        sine, cosine = states(duration_ns)
        omega = math.pi / (1e-9 * duration_ns)
        a.signal(sine, {cosine: omega}, 0.0, "knock", about)
        a.signal(cosine, {sine: -omega}, 0.0, "knock")
        for coordinate, factor in a.strike.items():
            a.push(coordinate, {sine: factor})
        row[sine] = 1.0
    if row:
        a.outputs[FORCE] = Output(row, "N", Plot())
