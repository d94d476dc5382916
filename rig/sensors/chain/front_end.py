"""The common description of all instruments, which rig.solve.sampling runs."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass

from rig.sensors.chain.instants import Instants
from rig.units import brief

_POSITIVE = ("noise", "resolution", "dropout_rate", "dropout_shortest", "dropout_longest")
_NUMBERS = ("direct", "gain", "offset", "slope", "warmth", "fade", "rise", *_POSITIVE)


@dataclass(frozen=True)
class FrontEnd:
    """A front end: y = Q{ sat[ gain H(s) x e^{-s delay} + offset + drift + noise ] } at `instants`, then drop-outs.

    H(s) = direct + sum_i residues_i / (s - poles_i), where a pole with positive imaginary part represents its pair.
    `echoes`: pairs (share, delay [s]) of added copies of H x; the delay is rounded to the nearest sample.
    With `averages`, H is the mean over the sample period that ends at the sample instant.
    Drift in t [s]:  slope t + warmth (e^{-fade t} - e^{-rise t}).  The defaults are a perfect instrument.
    """

    instants: Instants
    delay_ns: int = 0
    poles: tuple[complex, ...] = ()
    residues: tuple[complex, ...] = ()
    direct: float = 1.0
    averages: bool = False
    echoes: tuple[tuple[float, float], ...] = ()
    gain: float = 1.0  # output unit per input unit
    offset: float = 0.0
    slope: float = 0.0  # per second
    warmth: float = 0.0
    fade: float = 0.0  # 1/s
    rise: float = 0.0  # 1/s
    noise: float = 0.0  # standard deviation of one sample
    low: float = -math.inf
    high: float = math.inf
    resolution: float = 0.0  # least significant bit; 0: not quantised
    slew: float = math.inf  # largest change per second
    dropout_rate: float = 0.0  # 1/s
    dropout_shortest: float = 0.0  # s
    dropout_longest: float = 0.0  # s
    holds: bool = False  # a lost sample repeats the last one; otherwise it is 0

    @property
    def period_ns(self) -> float:
        """Time between two samples [ns]."""
        return self.instants.period_ns

    def faults(self) -> Iterator[str]:
        """What keeps it from being run, a line each: numbers that are not finite, poles that do not decay."""
        for name in _NUMBERS:
            value = getattr(self, name)
            if not isinstance(value, int | float) or not math.isfinite(value):
                yield f"{name} is {brief(value)}; expected a finite number"
            elif name in _POSITIVE and value < 0.0:
                yield f"{name} is {value:g}; expected at least 0"
        if len(self.poles) != len(self.residues):
            yield f"there are {len(self.poles)} poles and {len(self.residues)} residues; expected as many of both"
        for name in ("poles", "residues"):
            for value in getattr(self, name):
                if not isinstance(value, int | float | complex) or not cmath.isfinite(value):
                    yield f"{name} contain {brief(value)}; expected finite numbers"
                elif name == "poles" and value.real >= 0.0:
                    yield f"a pole is {value:g}; expected a negative real part, so that it decays"

    def response(self, s: complex) -> complex:
        """The complex response to exp(s t), without saturation and other limits."""
        if self.averages:
            turn = s * 1e-9 * self.period_ns
            filtered = (1.0 - cmath.exp(-turn)) / turn
        else:
            filtered = self.direct + sum(_pole(r, p, s) for p, r in zip(self.poles, self.residues))
        echoes = sum(share * cmath.exp(-s * later) for share, later in self.echoes)
        return self.gain * filtered * (1.0 + echoes) * cmath.exp(-s * 1e-9 * self.delay_ns)


def _pole(residue: complex, pole: complex, s: complex) -> complex:
    own = residue / (s - pole)
    return own + residue.conjugate() / (s - pole.conjugate()) if pole.imag else own


def deviation(density: float, rate: float) -> float:
    """Standard deviation of samples of white noise with one-sided `density` [unit/sqrt(Hz)] up to rate/2 [Hz]."""
    return density * math.sqrt(0.5 * rate)
