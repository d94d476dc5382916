"""The report of `rig modes`: a sliding equilibrium and its vibration modes, as records, text, table and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from rig.analysis.text_table import columns
from rig.model.build_checks import Finding
from rig.record.film_points import grouped
from rig.results import Result

_LEAST = 0.01  # of the energy: smallest share shown of a long shape, and how many at most
_LONG, _MOST = 4, 6


@dataclass(frozen=True)
class Mode:
    """One vibration mode about the equilibrium.

    `energy`: share of each coordinate in the kinetic energy, and of each network state in the network's energy, which
    makes metres, radians and volts comparable. `shape`: amplitude of each state; the one with the largest share is 1.
    """

    growth: float
    frequency: float
    damping: float
    shape: dict[str, complex]
    energy: dict[str, float]

    @property
    def kind(self) -> str:
        """The kind of mode, in words."""
        if self.growth == 0.0 == self.frequency:
            return "stays"
        if abs(self.growth) <= 1e-9 * 2.0 * math.pi * self.frequency:
            return "neutral"
        if self.growth > 0.0:
            return "flutter" if self.frequency else "divergence"
        return "decays"


@dataclass(frozen=True)
class Sliding:
    """A sliding equilibrium and the modes about it, least stable first.

    `exists` is false without steady sliding, and `why` has the reason. The numbers are then invalid, with one
    exception: at constant coefficients the modes do not depend on the place of the equilibrium, so that they `count`
    also where the contact would have to pull. `equilibrium`: plant outputs; `coefficient`: friction over normal force
    of each contact. `pulls`: number of points of a film that would have to pull; the modes are those with all points
    closed.
    """

    exists: bool
    why: str
    counts: bool
    equilibrium: dict[str, float]
    coefficient: dict[str, float]
    modes: tuple[Mode, ...]
    pulls: int = 0

    @property
    def growth(self) -> float:
        """The largest growth rate [1/s]."""
        return max((mode.growth for mode in self.modes), default=math.nan)

    @property
    def stable(self) -> bool:
        """Whether every mode decays."""
        return self.exists and all(mode.growth < 0.0 for mode in self.modes)


@dataclass(frozen=True)
class Modes(Result):
    """The vibration modes of a scene at steady sliding (`rig.analysis.modes.modes`).

    `dithered`: the same with averaged dither of `amplitude` [unit] at `hertz`; None for a scene without dither. `slow`:
    why the dither cannot be averaged; `dithered` is then the forced motion, and its modes are Floquet exponents.
    `free`: natural frequencies [Hz] of a part of the rig by itself. `limits`: critical coefficients of friction in
    closed form (infinite: never reached).
    """

    FIGURE: ClassVar = "rig.analysis.sweep_figure:modes_figure"

    scene: str
    mode: str
    sliding: Sliding
    units: dict[str, str]
    findings: tuple[Finding, ...]
    dithered: Sliding | None = None
    amplitude: float = 0.0
    unit: str = ""
    hertz: float = 0.0
    slow: str = ""
    free: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)

    COLUMNS: ClassVar = ("mode", "growth 1/s", "frequency Hz", "damping ratio", "shape (share of the energy)")

    def table(self) -> list[tuple[str, float, float, float, str]]:
        """Return a row for each mode, in the order of COLUMNS."""
        found, how = [(mode.kind, mode) for mode in self.sliding.modes], "forced" if self.slow else "dithered"
        found += [(f"{mode.kind}, {how}", mode) for mode in (self.dithered.modes if self.dithered else ())]
        return [
            (kind, one.growth, one.frequency, one.damping, shape_text(one.shape, one.energy)) for kind, one in found
        ]

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "scene": self.scene,
            "mode": self.mode,
            "units": self.units,
            **_plain(self.sliding),
            "dither": None
            if self.dithered is None
            else {
                "amplitude": self.amplitude,
                "unit": self.unit,
                "hertz": self.hertz,
                "slow": self.slow,
                **_plain(self.dithered),
            },
            "free": dict(self.free),
            "limits": dict(self.limits),
            "findings": [finding.to_json() for finding in self.findings],
        }

    def text(self) -> str:
        """Return the report as text."""
        what = "steady sliding" if self.sliding.coefficient else "at rest"
        lines = [f"{self.scene}: {'' if self.sliding.exists else 'no '}{what} ({self.mode})"]
        if not self.sliding.exists:
            lines += [f"  no steady sliding at these values: {self.sliding.why}"]
        else:
            lines += self._outputs()
        if self.sliding.pulls:
            lines += [f"  {self.sliding.pulls} points would have to pull; the modes below count all points as closed"]
            lines += [f"  friction coefficient at {name} = {v:.6g}" for name, v in self.sliding.coefficient.items()]
        if self.sliding.exists or self.sliding.counts:
            rows = [(k, f"{g:.6g}", f"{f:.6g}", f"{d:.4g}", s) for k, g, f, d, s in self.table()]
            lines += ["", *columns([self.COLUMNS, *rows], "<>>><")]
        if self.free:
            free = [(name, f"{hertz:.6g}") for name, hertz in self.free.items()]
            lines += ["", "  natural frequencies of parts by themselves [Hz]:", *columns(free, "<>")]
        if self.limits:
            known = ", ".join(
                f"{name} {mu:.6g}" if math.isfinite(mu) else f"{name} never" for name, mu in self.limits.items()
            )
            lines += ["", f"  coefficients of friction at the limits: {known}"]
        if self.dithered is not None:
            effect = ", ".join(f"{v:.4g} at {name}" for name, v in self.dithered.coefficient.items())
            lines += ["", f"  dithered: {self.amplitude:g} {self.unit} at {self.hertz:g} Hz"]
            if not self.slow:
                lines[-1] += f", friction {effect} (averaged)"
            else:
                forced = (
                    "Floquet exponents of the forced motion"
                    if self.dithered.exists or self.dithered.counts
                    else "no result"
                )
                lines += [f"    not averaged: {self.slow}", f"    {forced}"]
                lines[-1] += f", mean friction {effect}" if effect else ""
                if self.dithered.why:
                    held = self.dithered.counts and not self.dithered.exists
                    closed = "; they are those of the contact held closed" if held else ""
                    lines[-1] += f": {self.dithered.why}{closed}"
        lines += ["", *(f"  {f.level}: {f.what}\n    {f.remedy}" for f in self.findings)] if self.findings else []
        return "\n".join(lines)

    def _outputs(self) -> Iterator[str]:
        """The outputs at equilibrium; a row of places (`pressure_3_2`) as a range."""
        for common, names in grouped(self.sliding.equilibrium).items():
            unit, values = self.units[names[0]], [self.sliding.equilibrium[name] for name in names]
            if len(names) == 1:
                yield f"  {names[0]} = {values[0]:.6g} {unit}"
            else:
                yield f"  {common} of {len(names)} points: {min(values):.6g} to {max(values):.6g} {unit}"


def shape_text(shape: Mapping[str, complex], energy: Mapping[str, float]) -> str:
    """Return a shape as text: energy share and angle of each coordinate and network state; only the large ones of many.

    Without energy: size and angle of each state.
    """
    if not energy:
        return ", ".join(f"{name} {abs(v):.3g} at {_degrees(v)} deg" for name, v in shape.items())
    least = max(_LEAST, sorted(energy.values())[-min(_MOST, len(energy))] if len(energy) > _LONG else 0.0)
    large = {name: share for name, share in energy.items() if share >= least}
    parts = [f"{name} {100.0 * share:.3g} % at {_degrees(shape[name])} deg" for name, share in large.items()]
    left = sum(share > 0.0 for share in energy.values()) - len(large)
    return ", ".join(parts) + (f"; {left} with less than {100.0 * least:.2g} %" if left else "")


def _degrees(v: complex) -> int:
    """The angle of an amplitude; half a turn always has the same sign, whatever the rounding."""
    angle = round(math.degrees(math.atan2(v.imag, v.real)))
    return 180 if angle == -180 else angle


def _plain(sliding: Sliding) -> dict[str, Any]:
    return {
        "exists": sliding.exists,
        "stable": sliding.stable,
        "why": sliding.why,
        "counts": sliding.counts,
        "equilibrium": sliding.equilibrium,
        "coefficient": sliding.coefficient,
        "pulls": sliding.pulls,
        "modes": [
            {
                "kind": mode.kind,
                "growth": mode.growth,
                "frequency": mode.frequency,
                "damping": mode.damping,
                "shape": {name: [v.real, v.imag] for name, v in mode.shape.items()},
                "energy": mode.energy,
            }
            for mode in sliding.modes
        ],
    }
