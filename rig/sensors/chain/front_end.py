"""The common description of all instruments, which rig.solve.sampling runs."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass

from rig.sensors.chain.instants import Instants
from rig.units import brief, is_number

_POSITIVE = ("fade", "rise", "noise", "resolution", "dropout_rate", "dropout_shortest", "dropout_longest")
_NUMBERS = ("direct", "gain", "offset", "slope", "warmth", *_POSITIVE)
_LIMITS = ("low", "high", "slew")
_LONGEST_DELAY = 100_000_000_000  # ns, as `rig.sensors.chain.units.Delay`


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
        """What keeps it from being run, a line each: values of a wrong type, numbers that are not finite, poles that do
        not decay.
        """
        if not isinstance(self.instants, Instants):
            yield f"instants is {brief(self.instants)}; expected self.instants"
        whole = isinstance(self.delay_ns, int) and not isinstance(self.delay_ns, bool)
        if not whole or not 0 <= self.delay_ns <= _LONGEST_DELAY:
            yield f"delay_ns is {brief(self.delay_ns)}; expected whole nanoseconds from 0 to {_LONGEST_DELAY:g}"
        for name in ("averages", "holds"):
            if not isinstance(getattr(self, name), bool):
                yield f"{name} is {brief(getattr(self, name))}; expected True or False"
        yield from self._wrong_numbers()
        yield from self._wrong_filter()
        yield from self._wrong_echoes()

    def _wrong_numbers(self) -> Iterator[str]:
        for name in _NUMBERS:
            value = getattr(self, name)
            if not is_number(value):
                yield f"{name} is {brief(value)}; expected a finite number"
            elif name in _POSITIVE and value < 0.0:
                yield f"{name} is {value:g}; expected at least 0"
        strange = [name for name in _LIMITS if not _is_limit(getattr(self, name))]
        yield from (f"{name} is {brief(getattr(self, name))}; expected a number, or math.inf" for name in strange)
        if not strange and self.low > self.high:
            yield f"low is {self.low:g}, above high = {self.high:g}"
        if not strange and self.slew <= 0.0:
            yield f"slew is {self.slew:g}; expected above 0"
        lengths = self.dropout_shortest, self.dropout_longest
        if all(map(is_number, lengths)) and lengths[0] > lengths[1]:
            yield f"dropout_shortest is {lengths[0]:g} s, above dropout_longest = {lengths[1]:g} s"

    def _wrong_filter(self) -> Iterator[str]:
        if not all(isinstance(values, tuple | list) for values in (self.poles, self.residues)):
            both = f"poles are {brief(self.poles)}, residues {brief(self.residues)}"
            yield f"{both}; expected two tuples of numbers, as those of rig.sensors.chain.filters"
            return
        if len(self.poles) != len(self.residues):
            yield f"there are {len(self.poles)} poles and {len(self.residues)} residues; expected as many of both"
        for name in ("poles", "residues"):
            for value in getattr(self, name):
                if not isinstance(value, int | float | complex) or not cmath.isfinite(value):
                    yield f"{name} contain {brief(value)}; expected finite numbers"
                elif name == "poles" and value.real >= 0.0:
                    yield f"a pole is {value:g}; expected a negative real part, so that it decays"

    def _wrong_echoes(self) -> Iterator[str]:
        pairs = self.echoes if isinstance(self.echoes, tuple | list) else (self.echoes,)
        for pair in pairs:
            fits = isinstance(pair, tuple | list) and len(pair) == 2 and all(map(is_number, pair))
            if not fits or not 0.0 <= pair[1] <= 1e-9 * _LONGEST_DELAY:
                most = f"{1e-9 * _LONGEST_DELAY:g}"
                yield f"echoes contain {brief(pair)}; expected pairs (share, delay), the delay from 0 to {most} s"

    def response(self, s: complex) -> complex:
        """The complex response to exp(s t), without saturation and other limits."""
        if self.averages:
            turn = s * 1e-9 * self.period_ns
            filtered = (1.0 - cmath.exp(-turn)) / turn
        else:
            filtered = self.direct + sum(_pole(r, p, s) for p, r in zip(self.poles, self.residues))
        echoes = sum(share * cmath.exp(-s * later) for share, later in self.echoes)
        return self.gain * filtered * (1.0 + echoes) * cmath.exp(-s * 1e-9 * self.delay_ns)


def _is_limit(value: object) -> bool:
    """Whether a value is a number, which may be infinite."""
    return isinstance(value, int | float) and not math.isnan(value)


def _pole(residue: complex, pole: complex, s: complex) -> complex:
    own = residue / (s - pole)
    return own + residue.conjugate() / (s - pole.conjugate()) if pole.imag else own


def deviation(density: float, rate: float) -> float:
    """Standard deviation of samples of white noise with one-sided `density` [unit/sqrt(Hz)] up to rate/2 [Hz]."""
    return density * math.sqrt(0.5 * rate)
