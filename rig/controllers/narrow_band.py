"""Active damping of brake squeal through the voltage of a stack: observer and feedback of the modes in a band.

    e = y - 2 Re sum z_i        z_i <- z_i + l_i e        u = -Re sum conj(k_i) z_i        z_i <- p_i z_i + g_i u

A force along the brake's axis proportional to the velocity of the pad along its surface damps the squeal mode only with
the right phase. Near flutter the coupling of force and velocity is complex, so feedback with a real gain of either sign
shifts the frequency and destabilises neighbouring modes. Here the observer has one complex state z_i for each mode of
the band, driven by the limited command u (|u| <= limit); the design step computes the gains k_i, l_i from the matrices.
Source: Kroeger, Neubauer, Popp (2008), figure 21; observer and feedback are derived here (linear quadratic, discrete
time).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks import base
from rig.controllers.blocks.base import ControllerSection, Gain, Numbers, Update, Values, mapped
from rig.controllers.blocks.design import Linear, Rig
from rig.quantities import Hertz, PositiveVolt, Second, Speed

Modes = tuple[complex, ...]
LEAST = 1e-6  # least disturbance of each mode, as a share of that of all modes
_ROUNDING = 1e-12  # growth over a period that counts as rounding
KEYS = ("poles", "driven", "corrected", "fed_back")


class NarrowBand(ControllerSection):
    """Parameters; the band of width `bandwidth` is centred at `frequency`.

    `effort` [V s/m]: weight in the quadratic cost v^2 + (u / effort)^2; more effort means larger voltages.
    `disturbance`: random voltage [V] at the stack that is equivalent to the real disturbances. `noise`: standard
    deviation of one sample; the observer corrects less for a larger one.
    """

    fixed: ClassVar[frozenset[str]] = ControllerSection.fixed | {
        "frequency",
        "bandwidth",
        "effort",
        "disturbance",
        "noise",
    }

    kind: Literal["narrow_band"]
    sensor: str
    frequency: Hertz
    bandwidth: Hertz = 2000.0
    effort: Gain = 6e4
    disturbance: PositiveVolt = 1.0
    noise: Speed = 3e-4
    limit: PositiveVolt = 50.0
    enable_at: Second = 0.0
    drive: str = "amplifier.voltage"


class Band(NamedTuple):
    """The constants of the controller: one entry for each mode."""

    poles: Modes
    driven: Modes
    corrected: Modes
    fed_back: Modes
    enable_ns: int
    limit: float


def _corrected(z: complex, gain: complex, e: float) -> complex:
    return z + gain * e


def _advanced(z: complex, pole: complex, driven: complex, u: float) -> complex:
    return pole * z + driven * u


def law(p: Band, state: Modes, t_ns: int, values: Values) -> tuple[Modes, Values]:
    """State of the modes at the next sample, and the voltage [V] until then."""
    poles, driven, corrected, fed_back, enable_ns, limit = p
    expected = 0j
    for z in state:
        expected += z
    modes: Modes = mapped(state, _corrected, (values[0] - 2.0 * expected.real,), state, corrected)
    u = 0.0
    if t_ns >= enable_ns:
        for k, z in zip(fed_back, modes):
            u -= k.real * z.real + k.imag * z.imag
        if u < -limit:
            u = -limit
        elif u > limit:
            u = limit
    return mapped(modes, _advanced, (u,), modes, poles, driven), (u,)


class NarrowBandFeedback(base.SceneController[NarrowBand]):
    """The controller; its state is one complex number for each mode of the band."""

    update: Update

    def __init__(self, section: NarrowBand, numbers: Numbers) -> None:
        base.require(numbers, KEYS)
        super().__init__(section, numbers)
        modes = {}
        for key in KEYS:
            modes[key] = tuple([complex(*pair) for pair in numbers[key]])
        self.constants = Band(**modes, enable_ns=round(section.enable_at * 1e9), limit=section.limit)
        self.update = partial(law, self.constants)

    @staticmethod
    def design(rig: Rig, section: NarrowBand) -> dict[str, Any]:
        """Observer and feedback of the modes in the band, as pairs (real, imaginary part), one for each mode.

        Raises ValueError if no mode is in the band, or if a mode of the closed loop, in the band or outside, grows.
        """
        import control

        half = 0.5 * section.bandwidth
        delay = section.delay * 1e-9
        period = section.period * 1e-9
        band = section.frequency - half, section.frequency + half
        modes, residues = rig.modes(section.sensor, section.drive, delay, *band)
        if not len(modes):
            known = ", ".join(map(str, sorted({round(f) for f in rig.frequencies()})))
            raise ValueError(f"frequency: no mode is in the band about {section.frequency:g} Hz; there are {known} Hz")
        poles = np.exp(modes * period)
        driven = residues * (poles - 1.0) / modes
        F = _real(np.diag(poles))
        G = _parts(driven)[:, None]
        C = np.tile([2.0, 0.0], len(modes))[None, :]
        k, _, _ = control.dlqr(F, G, C.T @ C, np.array([[section.effort**-2]]))
        shaken = section.disturbance**2 * G @ G.T
        least = LEAST * np.trace(shaken) * np.eye(len(F))  # the observer never corrects a mode without disturbance
        _, P, _ = control.dlqe(F, np.eye(len(F)), C, shaken + least, np.array([[section.noise**2]]))
        corrected = (P @ C.T / (C @ P @ C.T + section.noise**2)).ravel()
        numbers = {
            "poles": _pairs(poles),
            "driven": _pairs(driven),
            "corrected": _pairs(_complex(corrected)),
            "fed_back": _pairs(_complex(k.ravel())),
        }
        growth, frequency = rig.closed(NarrowBandFeedback(section, numbers), section.sensor, delay)
        if growth * period > _ROUNDING:
            raise ValueError(
                f"effort: with {section.effort:g} V s/m a mode at {frequency:.0f} Hz grows with {growth:.3g} 1/s; "
                "less effort, more noise, or a wider band"
            )
        return numbers

    def linear(self) -> Linear:
        """See `Linear`: for a connected controller within its limit; states: real and imaginary parts in turn."""
        free = self.constants._replace(enable_ns=0, limit=math.inf)

        def step(xi: Sequence[float], y: float) -> tuple[Sequence[float], float]:
            state, (u,) = law(free, tuple(map(complex, xi[0::2], xi[1::2])), 0, (y,))
            return [part for z in state for part in (z.real, z.imag)], u

        return Linear(2 * len(self.constants.poles), step)

    def start(self) -> Modes:
        """The state of a brake at rest."""
        return (0j,) * len(self.constants.poles)


def _parts(numbers: NDArray[np.complex128]) -> NDArray[np.float64]:
    """[re, im, re, im, ...]"""
    return np.column_stack([numbers.real, numbers.imag]).ravel()


def _pairs(numbers: NDArray[np.complex128]) -> list[list[float]]:
    """[[re, im], [re, im], ...]"""
    return [[float(z.real), float(z.imag)] for z in numbers]


def _complex(parts: NDArray[np.float64]) -> NDArray[np.complex128]:
    return np.asarray(parts[0::2] + 1j * parts[1::2])


def _real(matrix: NDArray[np.complex128]) -> NDArray[np.float64]:
    """A complex matrix as a real one over real and imaginary parts in turn."""
    turned = np.array([[0.0, -1.0], [1.0, 0.0]])
    return np.asarray(np.kron(matrix.real, np.eye(2)) + np.kron(matrix.imag, turned))
