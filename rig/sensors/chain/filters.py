"""Transfer functions of front ends in modal form: H(s) = direct + sum residues / (s - poles)."""

from __future__ import annotations

import math
from typing import NamedTuple


class Modal(NamedTuple):
    """A transfer function in modal form; `direct`: the part that passes without delay."""

    poles: tuple[complex, ...] = ()
    residues: tuple[complex, ...] = ()
    direct: float = 0.0


PASS = Modal(direct=1.0)
"""No filter: the limit of a corner frequency at infinity."""


def modal(zeros: tuple[complex, ...], poles: tuple[complex, ...], gain: float) -> Modal:
    """Poles and residues of  H(s) = gain prod(s - z) / prod(s - p).

    Poles must be distinct. `poles` contains each real pole and, of each complex pair, the pole with positive imaginary
    part; such a pole contributes r/(s-p) + r*/(s-p*) to H, where r is its residue.
    """
    full = [p for pole in poles for p in ({pole, pole.conjugate()} if pole.imag else {pole})]
    residues = []
    for pole in poles:
        r = complex(gain)
        for z in zeros:
            r *= pole - z
        for p in full:
            if p != pole:
                r /= pole - p
        residues.append(r)
    return Modal(tuple(poles), tuple(residues))


def _pair(frequency: float, quality: float) -> complex:
    """Upper pole of a resonance at `frequency` [Hz] with quality factor > 1/2."""
    w = 2.0 * math.pi * frequency
    zeta = 0.5 / quality
    return complex(-zeta * w, w * math.sqrt(1.0 - zeta * zeta))


def first_order(frequency: float) -> Modal:
    """Low-pass of first order, -3 dB at `frequency` [Hz]."""
    if math.isinf(frequency):
        return PASS
    w = 2.0 * math.pi * frequency
    return modal((), (complex(-w),), w)


def second_order(frequency: float, quality: float) -> Modal:
    """Low-pass  w^2 / (s^2 + w s / quality + w^2);  -3 dB at `frequency` [Hz] where quality = 1/sqrt(2)."""
    if math.isinf(frequency):
        return PASS
    pole = _pair(frequency, quality)
    return modal((), (pole,), abs(pole) ** 2)


def bessel(frequency: float) -> Modal:
    """Low-pass of third order with flattest delay, -3 dB at `frequency` [Hz]; delays low frequencies by .279/frequency.

    H = 15 / (p^3 + 6 p^2 + 15 p + 15) with p = 1.7557 s / (2 pi frequency)  (Thomson, Proc. IEE 96 (1949) 487).
    """
    if math.isinf(frequency):
        return PASS
    scale = 2.0 * math.pi * frequency / 1.7556723686812106
    real = -2.3221853546260856 * scale
    pair = complex(-1.8389073226869572, 1.7543809597837217) * scale
    return modal((), (complex(real), pair), 15.0 * scale**3)


def resonance(frequency: float, quality: float, highpass: float) -> Modal:
    """High-pass of first order at `highpass` [Hz] before a resonance:  s/(s + w_h)  w^2/(s^2 + w s/quality + w^2).

    With `highpass` 0 there is no high-pass, with an infinite `frequency` no resonance.
    """
    if highpass == 0.0:
        return second_order(frequency, quality)
    if math.isinf(frequency):
        corner = 2.0 * math.pi * highpass
        return Modal((complex(-corner),), (complex(-corner),), 1.0)
    pole = _pair(frequency, quality)
    return modal((0j,), (complex(-2.0 * math.pi * highpass), pole), abs(pole) ** 2)
