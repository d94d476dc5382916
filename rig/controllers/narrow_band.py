"""Damp the squeal of a brake through the voltage of its stack: an observer of the modes in a band, fed back.

    e = y - 2 Re sum z_i        z_i <- z_i + l_i e        u = -Re sum conj(k_i) z_i        z_i <- p_i z_i + g_i u

A force along the brake's axis that follows the velocity of the pad along its surface damps the squeal mode at one phase
only: near flutter the coupling of force and velocity is complex, so plain feedback of either sign shifts the frequency,
and it destabilises the modes beside. Here each mode of the band has a turning number z_i of its own, which is told what
the stack does to it (|u| <= limit, as it is given), and the design step finds the phases k_i, l_i from the matrices.
Source: Kroeger, Neubauer, Popp (2008), figure 21; observer and feedback are ours (linear quadratic, discrete time).
"""

from __future__ import annotations

from typing import ClassVar, Literal

from rig.controllers.blocks.base import ControllerSection, Gain, Numbers, Values
from rig.errors import UsageError
from rig.quantities import Hertz, PositiveVolt, Second, Speed

Modes = tuple[complex, ...]
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
