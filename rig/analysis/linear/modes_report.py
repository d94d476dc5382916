"""The report of `rig modes`: a sliding equilibrium and its vibration modes, as records, text, table and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from rig.model.assembly import Nodes
from rig.model.system import Finding
from rig.record.film_points import grouped
from rig.results import Column, Result, Table
from rig.structure.stated import Stated

_LONG = 4  # a shape with more shares of the energy than these does not fit into a line
_MOST = 6  # shares that are shown of a long shape
_LEAST = 0.01  # of the energy: the smallest share that is shown
_REGIONS = 3  # bodies or node sets that are shown


@dataclass(frozen=True)
class Mode:
    """One vibration mode about the equilibrium.

    `energy`: share of each coordinate in the kinetic energy, and of each network state in the network's energy, which
    makes metres, radians and volts comparable. `shape`: amplitude of each state; the one with the largest share is 1.
    `error`: of a reduced structure, the estimated error of the eigenvalue over its size; None if it is not known.
    `regions`: of a meshed structure, the share of each body or node set instead, the largest first.
    """

    growth: float
    frequency: float
    damping: float
    shape: dict[str, complex]
    energy: dict[str, float]
    error: float | None = None
    regions: Mapping[str, float] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """The kind of mode, in words; undecided where the growth is smaller than its estimated error."""
        if self.growth == 0.0 == self.frequency:
            return "stays"
        if abs(self.growth) <= 1e-9 * 2.0 * math.pi * self.frequency:
            return "neutral"
        if self.error is not None and abs(self.growth) <= self.error * 2.0 * math.pi * self.frequency:
            return "undecided"
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
    """The vibration modes of a scene at steady sliding (`rig.analysis.linear.modes.modes`).

    `dithered`: the same with averaged dither of `amplitude` [unit] at `hertz`; None for a scene without dither. `slow`:
    why the dither cannot be averaged; `dithered` is then the forced motion, and its modes are Floquet exponents.
    `free`: natural frequencies [Hz] of a part of the rig by itself. `limits`: critical coefficients of friction in
    closed form (infinite: never reached). `notes`: what the reduction of a structure leaves open, a sentence each;
    `up_to` [Hz]: it holds up to it; modes above, and heavily damped ones, are left out. `nodes`: of shapes.
    `left_out`: the controllers that do not act, in words. `stated`: mass and contacts of a meshed structure.
    """

    FIGURE: ClassVar = "rig.analysis.linear.figures:modes_figure"

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
    notes: tuple[str, ...] = ()
    up_to: float = math.inf
    nodes: Nodes | None = field(default=None, compare=False)
    left_out: str = ""
    stated: Stated | None = field(default=None, compare=False)

    def facts(self) -> dict[str, Any]:
        """Return the equilibrium, the modes with their shapes, the dither and the findings."""
        dither: dict[str, Any] | None = None
        if self.dithered is not None:
            dither = {"amplitude": self.amplitude, "unit": self.unit, "hertz": self.hertz, "slow": self.slow}
            dither |= _plain(self.dithered)
        content = {
            "scene": self.scene,
            "mode": self.mode,
            "units": self.units,
            **_plain(self.sliding),
            "dither": dither,
            "free": dict(self.free),
            "limits": dict(self.limits),
            "findings": [finding.to_json() for finding in self.findings],
            "left_out": self.left_out,
        }
        if math.isfinite(self.up_to):
            content["notes"] = list(self.notes)
            content["up_to"] = self.up_to
        if self.stated is not None:
            content["structure"] = self.stated.to_json()
        return content

    def shown(self) -> Iterator[str | Table]:
        """Yield the equilibrium, the modes, the dither and the findings."""
        sliding = self.sliding
        what = "steady sliding" if sliding.coefficient else "at rest"
        yield f"{self.scene}: {'' if sliding.exists else 'no '}{what} ({self.mode})"
        if self.left_out:
            yield f"  {self.left_out}"
        if sliding.exists:
            yield from self._outputs()
        else:
            yield f"  no steady sliding at these values: {sliding.why}"
        if self.stated is not None:
            yield from (f"  {what}: {words}" for what, words in self.stated.lines())
        if sliding.pulls:
            yield f"  {sliding.pulls} points would have to pull; the modes below count all points as closed"
        if sliding.exists or sliding.counts:
            yield ""
            yield _table("modes", sliding.modes)
            if math.isfinite(self.up_to):
                reduction = f"the reduction of the structure holds up to {self.up_to:g} Hz"
                yield f"  {reduction}; higher and heavily damped modes are left out"
        if self.notes:
            yield ""
            yield from (f"  warning: {note}" for note in self.notes)
        if self.free:
            yield "\n  natural frequencies of parts by themselves"
            yield Table("parts", [Column("part"), Column("frequency", "Hz", ".6g")], [*self.free.items()])
        if self.limits:
            known = [f"{name} {mu:.6g}" if math.isfinite(mu) else f"{name} never" for name, mu in self.limits.items()]
            yield f"\n  coefficients of friction at the limits: {', '.join(known)}"
        if self.dithered is not None:
            yield ""
            yield from self._dither_lines(self.dithered)
            if self.dithered.modes:
                yield _table("dithered", self.dithered.modes)
        if self.findings:
            yield ""
        for finding in self.findings:
            yield f"  {finding.level}: {finding.what}\n    {finding.remedy}"

    def summary(self) -> str:
        """Return the stability in one sentence: the mode that grows fastest, or that decays most slowly."""
        what = "steady sliding" if self.sliding.coefficient else "rest"
        clauses = [f"{what} {_stability(self.sliding)}"]
        if self.dithered is not None:
            clauses.append(f"with dither it {_stability(self.dithered)}")
        if self.left_out:
            clauses.append(self.left_out)
        return "; ".join(clauses)

    def _outputs(self) -> Iterator[str]:
        """The outputs at equilibrium; a row of places (`pressure_3_2`) as a range."""
        for common, names in grouped(self.sliding.equilibrium).items():
            unit = self.units[names[0]]
            values = [self.sliding.equilibrium[name] for name in names]
            if len(names) == 1:
                yield f"  {names[0]} = {values[0]:.6g} {unit}"
            else:
                span = f"{min(values):.6g} to {max(values):.6g} {unit}"
                yield f"  {common.removesuffix('_of')} of {len(names)} points: {span}"

    def _dither_lines(self, dithered: Sliding) -> list[str]:
        """What dither does: averaged friction, or the forced motion and why the friction is not averaged."""
        line = f"  dithered: {self.amplitude:g} {self.unit} at {self.hertz:g} Hz"
        effect = ", ".join(f"{v:.4g} at {name}" for name, v in dithered.coefficient.items())
        if not self.slow:
            return [f"{line}, friction {effect} (averaged)"]
        known = dithered.exists or dithered.counts
        forced = "Floquet exponents of the forced motion" if known else "no result"
        if effect:
            forced += f", mean friction {effect}"
        if dithered.why:
            forced += f": {dithered.why}"
            if dithered.counts and not dithered.exists:
                forced += "; they are those of the contact held closed"
        return [line, f"    not averaged: {self.slow}", f"    {forced}"]


def shape_text(
    shape: Mapping[str, complex], energy: Mapping[str, float], regions: Mapping[str, float] | None = None
) -> str:
    """Return a shape as text: energy share and angle of each coordinate and network state; only the large ones of many.

    With `regions`: the shares of these. Without energy: size and angle of each state.
    """
    if regions:
        large = [(name, share) for name, share in regions.items() if share >= _LEAST]
        return ", ".join(f"{name} {100.0 * share:.3g} %" for name, share in large[:_REGIONS])
    if not energy:
        return ", ".join(f"{name} {abs(v):.3g} at {_degrees(v)} deg" for name, v in shape.items())
    least = _LEAST
    if len(energy) > _LONG:
        rising = sorted(energy.values())
        least = max(_LEAST, rising[-min(_MOST, len(energy))])
    shown = {name: share for name, share in energy.items() if share >= least}
    parts = [f"{name} {100.0 * share:.3g} % at {_degrees(shape[name])} deg" for name, share in shown.items()]
    text = ", ".join(parts)
    left = sum(share > 0.0 for share in energy.values()) - len(shown)
    if left:
        text += f"; {left} with less than {100.0 * least:.2g} %"
    return text


def _table(name: str, modes: Sequence[Mode]) -> Table:
    """A table of modes; with a column of estimated errors if any is known."""
    estimated = any(mode.error is not None for mode in modes)
    columns = (
        Column("kind"),
        Column("growth", "1/s", ".6g"),
        Column("frequency", "Hz", ".6g"),
        Column("damping", "1", ".4g"),
        *[Column("error", "1", ".1e")] * estimated,
        Column("share of the energy"),
    )
    rows = []
    for mode in modes:
        shape = shape_text(mode.shape, mode.energy, mode.regions)
        rows.append((mode.kind, mode.growth, mode.frequency, mode.damping, *[mode.error] * estimated, shape))
    return Table(name, columns, rows)


def _stability(sliding: Sliding) -> str:
    """Predicate of a sentence on the stability of an equilibrium."""
    if not sliding.exists:
        return f"does not exist at these values: {sliding.why}" if sliding.why else "does not exist at these values"
    if not sliding.modes:
        return "has no vibration mode"
    mode = max(sliding.modes, key=lambda mode: mode.growth)
    at = f" at {mode.frequency:.4g} Hz" if mode.frequency else ""
    if mode.growth > 0.0:
        return f"is unstable: {mode.kind} grows with {mode.growth:.4g} 1/s{at}"
    if mode.growth == 0.0:
        return f"neither decays nor grows: {mode.kind}{at}"
    return f"is stable: the slowest mode decays with {-mode.growth:.4g} 1/s{at}"


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
        "modes": [_plain_mode(mode) for mode in sliding.modes],
    }


def _plain_mode(mode: Mode) -> dict[str, Any]:
    content = {
        "kind": mode.kind,
        "growth": mode.growth,
        "frequency": mode.frequency,
        "damping": mode.damping,
        "shape": {name: [v.real, v.imag] for name, v in mode.shape.items()},
        "energy": mode.energy,
    }
    if mode.error is not None:
        content["error"] = mode.error
    if mode.regions:
        content["regions"] = dict(mode.regions)
    return content
