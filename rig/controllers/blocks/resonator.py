"""A narrow band of a measurement as one rotating complex number: amplitude, phase and frequency at every sample.

    z <- p z + 2 (1 - |p|) y       p = exp((-w_b + i w_0) T)

A complex pole at the centre frequency w_0 with half of `bandwidth` to either side. For y = a cos(w_0 t + phi) it
settles on z = a exp(i (w_0 t + phi)): |z| is the amplitude without the ripple of a rectifier, and the angular velocity
of z is the frequency.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence


class Resonator:
    """A band-pass with centre and bandwidth (-3 dB, both sides) [Hz] at `period` [s]. The state is one number z."""

    __slots__ = ("gain", "period", "pole")

    def __init__(self, centre: float, bandwidth: float, period: float) -> None:
        self.period = period
        self.pole = cmath.exp(complex(-math.pi * bandwidth, 2.0 * math.pi * centre) * period)
        self.gain = 2.0 * (1.0 - abs(self.pole))

    def run(self, z: complex, samples: Sequence[float]) -> tuple[complex, float, complex]:
        """State after `samples`, mean of |z|^2, and sum of z_k conj(z_k-1), whose angle is w T."""
        pole = self.pole
        gain = self.gain
        square = 0.0
        turned = 0j
        for y in samples:
            before = z
            z = pole * z + gain * y
            square += z.real * z.real + z.imag * z.imag
            turned += z * before.conjugate()
        return z, square / len(samples) if samples else 0.0, turned
