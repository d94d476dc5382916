"""Damp the squeal of a brake through the voltage of its stack: an observer of the modes in a band, fed back.

    e = y - 2 Re sum z_i        z_i <- z_i + l_i e        u = -Re sum conj(k_i) z_i        z_i <- p_i z_i + g_i u

A force along the brake's axis that follows the velocity of the pad along its surface damps the squeal mode at one phase
only: near flutter the coupling of force and velocity is complex, so plain feedback of either sign shifts the frequency,
and it destabilises the modes beside. Here each mode of the band has a turning number z_i of its own, which is told what
the stack does to it (|u| <= limit, as it is given), and the design step finds the phases k_i, l_i from the matrices.
Source: Kroeger, Neubauer, Popp (2008), figure 21; observer and feedback are ours (linear quadratic, discrete time).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from rig.controllers.blocks.base import ControllerSection, Gain, Numbers, Values
from rig.controllers.blocks.design import Linear, Rig
from rig.errors import UsageError
from rig.quantities import Hertz, PositiveVolt, Second, Speed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Modes = tuple[complex, ...]
LEAST = 1e-6  # of what the disturbance does to all modes: what each is shaken at least
_ROUNDING = 1e-12  # growth over a period of a mode that does not grow
KEYS = ("poles", "driven", "corrected", "fed_back")


class NarrowBand(ControllerSection):
    """Parameters; the band lies `bandwidth` wide about `frequency`.

    `effort`: voltage that is spent on a velocity, of the quadratic cost v^2 + (u / effort)^2. `disturbance`: a random
    voltage at the stack that shakes the brake as much as what really does; `noise`: of one sample, believed the less.
    """

    fixed: ClassVar[frozenset[str]] = ControllerSection.fixed | {
        "sensor", "drive", "frequency", "bandwidth", "effort", "disturbance", "noise",
    }  # fmt: skip

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


class NarrowBandFeedback:
    """One sample in, one voltage out; the state is one number for each mode."""

    def __init__(self, section: NarrowBand, numbers: Numbers) -> None:
        missing = [key for key in KEYS if key not in numbers]
        if missing:
            raise UsageError(f"needs numbers of the design step; missing: {', '.join(missing)}")
        self.section = section
        self.numbers = numbers
        self.reads = (section.sensor,)
        self.drives = (section.drive,)
        self.period_ns = section.period
        self.poles, self.driven, self.corrected, self.fed_back = (
            tuple(complex(*pair) for pair in numbers[key]) for key in KEYS
        )
        self.enable_ns = round(section.enable_at * 1e9)

    @staticmethod
    def design(rig: Rig, section: NarrowBand) -> dict[str, Any]:
        """Observer and feedback of the modes in the band, as pairs (real, imaginary part), one for each mode.

        Raises ValueError where a mode of the rig, in the band or outside, would grow with it.
        """
        import control
        import numpy as np

        half, delay, period = 0.5 * section.bandwidth, section.delay * 1e-9, section.period * 1e-9
        band = section.frequency - half, section.frequency + half
        modes, residues = rig.modes(section.sensor, section.drive, delay, *band)
        if not len(modes):
            found = ", ".join(f"{f}" for f in sorted({round(f) for f in rig.frequencies()}))
            raise ValueError(f"frequency: no mode is in the band about {section.frequency:g} Hz; there are {found} Hz")
        poles = np.exp(modes * period)
        driven = residues * (poles - 1.0) / modes
        F, G = _real(np.diag(poles)), _parts(driven)[:, None]
        C = np.tile([2.0, 0.0], len(modes))[None, :]
        k, _, _ = control.dlqr(F, G, C.T @ C, np.array([[section.effort**-2]]))
        shaken = section.disturbance**2 * G @ G.T
        least = LEAST * np.trace(shaken) * np.eye(len(F))  # a mode that nothing shakes would never be corrected
        _, P, _ = control.dlqe(F, np.eye(len(F)), C, shaken + least, np.array([[section.noise**2]]))
        corrected = (P @ C.T / (C @ P @ C.T + section.noise**2)).ravel()
        of = {"poles": poles, "driven": driven, "corrected": _complex(corrected), "fed_back": _complex(k.ravel())}
        numbers = {name: [[float(z.real), float(z.imag)] for z in values] for name, values in of.items()}
        growth, frequency = rig.closed(NarrowBandFeedback(section, numbers), section.sensor, delay)
        if growth * period > _ROUNDING:
            raise ValueError(
                f"effort: with {section.effort:g} V s/m a mode at {frequency:.0f} Hz grows with {growth:.3g} 1/s; "
                "less effort, more noise, or a wider band"
            )
        return numbers

    def linear(self) -> Linear:
        """See `Linear`: connected and within its limit, real and imaginary parts in turn."""
        within = self.section.model_copy(update={"limit": math.inf, "enable_at": 0.0})
        free = NarrowBandFeedback(within, self.numbers)

        def step(xi: Sequence[float], y: float) -> tuple[Sequence[float], float]:
            state, (u,) = free.update(tuple(map(complex, xi[0::2], xi[1::2])), 0, (y,))
            return [part for z in state for part in (z.real, z.imag)], u

        return Linear(2 * len(self.poles), step)

    def start(self) -> Modes:
        """A brake at rest."""
        return (0j,) * len(self.poles)

    def update(self, state: Modes, t_ns: int, values: Values) -> tuple[Modes, Values]:
        """The modes at the next sample, and the voltage [V] until then."""
        expected = 0j
        for z in state:
            expected += z
        e = values[0] - 2.0 * expected.real
        modes = tuple([z + gain * e for z, gain in zip(state, self.corrected)])
        u = 0.0
        if t_ns >= self.enable_ns:
            for k, z in zip(self.fed_back, modes):
                u -= k.real * z.real + k.imag * z.imag
            limit = self.section.limit
            u = -limit if u < -limit else limit if u > limit else u
        return tuple([p * z + g * u for p, z, g in zip(self.poles, modes, self.driven)]), (u,)


def _parts(numbers: NDArray[np.complex128]) -> NDArray[np.float64]:
    """[re, im, re, im, ...]"""
    import numpy as np

    return np.column_stack([numbers.real, numbers.imag]).ravel()


def _complex(parts: NDArray[np.float64]) -> NDArray[np.complex128]:
    import numpy as np

    return np.asarray(parts[0::2] + 1j * parts[1::2])


def _real(matrix: NDArray[np.complex128]) -> NDArray[np.float64]:
    """A complex matrix as a real one over real and imaginary parts in turn."""
    import numpy as np

    turned = np.array([[0.0, -1.0], [1.0, 0.0]])
    return np.asarray(np.kron(matrix.real, np.eye(2)) + np.kron(matrix.imag, turned))
