"""The report of a limit cycle with its Floquet multipliers, or the reason why there is none.

The multipliers are the growth of a small disturbance over one period: the eigenvalues of the derivative of the return
map (rig.analysis.cycles.return_map), without the one that belongs to the shift along the motion. The error estimate for
the others is its deviation from one, or the noise of runs over the step of the differences if that is larger. A contact
that sticks erases the disturbance: its multiplier is zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.repetition import REPEAT
from rig.printable import counted
from rig.results import Column, Result, Table
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
_ROUNDING = 1e-13  # of the largest output of the same unit: smaller values are shown as zero
_MANY = 10  # multipliers; of more only the largest are shown
_SHOWN = 6  # of many multipliers


@dataclass(frozen=True)
class Floquet:
    """Multipliers, the largest first; `error`: the estimate above (NaN: the motion is driven).

    `why`: why the multipliers are not known, "" if they are.
    """

    multipliers: tuple[complex, ...] = ()
    error: float = math.nan
    why: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {"multipliers": [[v.real, v.imag] for v in self.multipliers], "error": self.error, "why": self.why}

    def text(self) -> str:
        """Return the multipliers as text; values below the error are shown as zero."""
        if self.why:
            return self.why
        known = math.isfinite(self.error)
        small = 10.0 * self.error if known else 0.0
        most = len(self.multipliers) if len(self.multipliers) <= _MANY else _SHOWN
        shown = [_multiplier(value, small) for value in self.multipliers[:most]]
        left = self.multipliers[most:]
        if left:
            shown.append(f"{len(left)} more of size {abs(left[0]):.6g} and less")
        text = ", ".join(shown)
        return f"{text} (to {self.error:.1e})" if known else text


@dataclass(frozen=True)
class Cycle(Result):
    """A limit cycle. Without one `found` is false and `why` has the reason; `decided` is false if the search was
    inconclusive.

    period, frequency   [s], [Hz]             amplitude   half of peak to peak, of each output
    stick_time          [s] in one period, and its share, for each contact
    extremes            (lowest, highest) of each plant output in its unit; start and end of stick: outputs there
    energy              [J] in one cycle by term; `error`: residual of the energy balance, relative to the largest term
                        or to the stored energy
    repeats             largest difference of a state after one period, relative to its range
    floquet             multipliers: growth of a small disturbance over one period
    newton              steps of Newton's method that closed it; 0 if simulation alone did
    """

    FIGURE: ClassVar = "rig.analysis.cycles.figures:cycle_figure"

    scene: str
    method: str
    found: bool
    why: str
    after: float
    period: float = math.nan
    repeats: float = math.nan
    stick_time: dict[str, float] = field(default_factory=dict)
    extremes: dict[str, tuple[float, float]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    stick_start: dict[str, float] = field(default_factory=dict)
    stick_end: dict[str, float] = field(default_factory=dict)
    energy: dict[str, float] = field(default_factory=dict)
    events: tuple[tuple[float, str], ...] = ()
    floquet: Floquet = field(default_factory=Floquet)
    newton: int = 0
    decided: bool = True
    left_out: str = ""
    """The controllers that do not act, in words."""
    time: Array = field(default_factory=lambda: np.empty(0), compare=False)
    """Instants in one period [s], several in each step of the integrator, [n]."""
    outputs: dict[str, Array] = field(default_factory=dict, compare=False)
    """Each plant output at these instants, [n]; both sides of a jump have the same instant."""
    sticking: tuple[tuple[float, float], ...] = ()
    """Begin and end [s] of each interval of this period in which the first contact sticks."""
    rig: Scene | None = field(default=None, compare=False)
    """The scene."""
    state: dict[str, float] = field(default_factory=dict, compare=False)
    """Every state at the first of these instants, by name."""

    @property
    def multiplier(self) -> float:
        """Size of the largest multiplier: below one, the cycle attracts nearby motions. NaN if there is none."""
        return max((abs(v) for v in self.floquet.multipliers), default=math.nan)

    @property
    def frequency(self) -> float:
        """Frequency of the cycle [Hz]."""
        return 1.0 / self.period

    @property
    def stick_share(self) -> dict[str, float]:
        """Share of the period that each contact sticks."""
        return {name: time / self.period for name, time in self.stick_time.items()}

    @property
    def amplitude(self) -> dict[str, float]:
        """Half of peak to peak of each output: the amplitude index of a cycle."""
        return {name: 0.5 * (high - low) for name, (low, high) in self.extremes.items()}

    @property
    def repels(self) -> bool:
        """Whether the cycle is unstable: a small disturbance grows from period to period."""
        return self.multiplier > 1.0 + max(10.0 * self.floquet.error, REPEAT)

    def facts(self) -> dict[str, Any]:
        """Return the cycle, without its outputs over time."""
        if not self.found:
            kept = ("scene", "method", "found", "decided", "why", "after", "left_out")
            return {name: getattr(self, name) for name in kept}
        derived = {"frequency": self.frequency, "stick_share": self.stick_share, "amplitude": self.amplitude}
        derived |= {"events": [{"t": t, "what": what} for t, what in self.events], "floquet": self.floquet.to_json()}
        drawn = ("time", "outputs", "rig", "state")  # for figures and Python: thousands of numbers
        return {**{name: value for name, value in vars(self).items() if name not in drawn}, **derived}

    def shown(self) -> Iterator[str | Table]:
        """Yield period, times of stick, the range of each output, multipliers and energy."""
        alone = [f"  {self.left_out}"] if self.left_out else []
        if not self.found:
            yield f"{self.scene}: {self.why}"
            yield from alone
            return
        attracts = self.multiplier < 1.0 - max(10.0 * self.floquet.error, REPEAT)
        sticks = any(self.stick_time.values())
        kind = "limit cycle" if sticks or attracts or self.repels else "periodic motion"
        kind = f"{'unstable ' * self.repels}{kind}{'' if sticks else ' in which nothing sticks'}"
        newton = f", the last of the way by {counted(self.newton, 'step')} of Newton's method" if self.newton else ""
        yield f"{self.scene}: {kind}, {self.method}, settled after {self.after:.4g} s{newton}"
        yield from alone
        yield f"  period {self.period:.10g} s, {self.frequency:.6g} Hz; repeats to {self.repeats:.1e}"
        for name, time in self.stick_time.items():
            yield f"  {name} sticks for {time:.10g} s, {100.0 * time / self.period:.4g} % of the period"
        numbers = ("lowest", "highest", "amplitude", "stick starts", "stick ends")
        columns = [Column("output"), *(Column(name, digits=".8g") for name in numbers), Column("unit")]
        rows = []
        largest: dict[str, float] = {}
        for name, ends in self.extremes.items():
            largest[self.units[name]] = max(largest.get(self.units[name], 0.0), *map(abs, ends))
        for name, ends in self.extremes.items():
            values = (*ends, self.amplitude[name], self.stick_start.get(name), self.stick_end.get(name))
            none = _ROUNDING * largest[self.units[name]]
            rounded = (0.0 if value is not None and abs(value) <= none else value for value in values)
            rows.append((name, *rounded, self.units[name]))
        yield ""
        yield Table("ranges", columns, rows)
        yield f"\n  Floquet multipliers: {self.floquet.text()}"
        terms = ", ".join(f"{name} {v:.6g}" for name, v in self.energy.items() if name != "error" and v)
        yield f"\n  energy in a cycle [J]: {terms}; residual {abs(self.energy['error']):.1e}"


def _multiplier(value: complex, small: float) -> str:
    """A multiplier as text; zero up to the size `small`."""
    if abs(value) <= small:
        return "0"
    return f"{value.real:.6g}" if value.imag == 0.0 else f"{value.real:.6g} {value.imag:+.6g}i"
