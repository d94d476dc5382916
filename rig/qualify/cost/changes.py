"""The difference between the motions of two plants, by measure: with an effect and without it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from rig.analysis.motion_measures.measures import SLOW, Seen, observe
from rig.analysis.motion_measures.problem import Problem
from rig.analysis.motion_measures.settings import of

_NUDGE = 1e-9  # relative change of a start that reveals an irregular motion
_LEAST_NUDGE = 1e-12
_LEAST = 1e-9  # share of a measure that no run resolves
_SIGNIFICANT = 2.0  # a change counts above this multiple of the difference between two runs of an irregular motion
_UNITS = {
    "period": "s",
    "energy per cycle": "J",
    "frequency": "Hz",
    "growth rate": "1/s",
    "friction power": "W",
}
KINDS = {"cycle": "a limit cycle", "vibration": "a vibration that does not repeat", "smooth": "no events"}


@dataclass(frozen=True)
class Change:
    """A measure of the plant with an effect and without it, in `unit`; None if the measure does not exist.

    `size`: their difference as a share of the larger of both (for stick shares the difference), 1 if only one plant has
    the measure, 0 below the resolution of the runs (their tolerance, 1e-9 without one). `floor`: the same for two runs
    of the plant with the effect whose starts differ by rounding.
    """

    measure: str
    unit: str
    whole: float | None
    less: float | None
    size: float
    floor: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether the change is significant: neither zero nor the irregularity of the motion itself."""
        return self.size > _SIGNIFICANT * self.floor

    def text(self) -> str:
        """Return the report as text."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.whole is None or self.less is None:
            only = self.less if self.whole is None else self.whole
            return f"{self.measure} {only:.4g}{unit} only {'without' if self.whole is None else 'with'} it"
        digits = next((d for d in range(4, 17) if f"{self.whole:.{d}g}" != f"{self.less:.{d}g}"), 4)
        whole, less = (f"{one:.{digits}g}{unit}" for one in (self.whole, self.less))
        return f"{self.measure} {whole}, without it {less} ({_percent(self.size)} %)"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {**vars(self), "significant": self.significant}


def _percent(size: float) -> str:
    return f"{100.0 * size:.2g}" if size < 0.095 else f"{100.0 * size:.0f}"


def changed(whole: Problem, less: Problem) -> tuple[tuple[Change, ...], str]:
    """Compare the measures of `whole` and `less`; return changes, and notes on the two motions."""
    notes = [] if whole.kind == less.kind else [f"{KINDS[whole.kind]} with it, {KINDS[less.kind]} without it"]
    notes += [f"{which} it {one.leaves}" for which, one in (("with", whole), ("without", less)) if one.leaves]
    if not (whole.kind == less.kind == "cycle"):
        whole, less = _alike(whole, less)
    truth, seen = (observe(p, of(p.scene, p.system)) for p in (whole, less))
    for which, one in (("with", truth), ("without", seen)):
        notes += [f"{which} it the plant stops: {one.fault}"] if one.fault else []
    if truth.fault or seen.fault:
        return (), "; ".join(notes)
    floors = irregular(whole, truth) if whole.kind == "vibration" else {}
    resolved = max(_LEAST, *(of(p.scene, p.system).tolerance for p in (whole, less)))
    gone = whole.assembly.outputs.keys() - less.assembly.outputs.keys()
    found = []
    for name in dict.fromkeys((*truth.values, *seen.values)):
        output = name.partition(" ")[2]
        if output not in gone:
            unit = _UNITS[name] if name in _UNITS else getattr(whole.assembly.outputs.get(output), "unit", "1")
            values, size = (truth.values.get(name), seen.values.get(name)), _apart(name, truth, seen)
            found.append(Change(name, unit, *values, size if size > resolved else 0.0, floors.get(name, 0.0)))
    return tuple(found), "; ".join(notes)


def _alike(whole: Problem, less: Problem) -> tuple[Problem, Problem]:
    """Both treated as motions that do not repeat, over the same time."""
    frame = whole.scene.frame_ns // whole.scene.step_ns
    length = (min if whole.leaves or less.leaves else max)(whole.length, less.length)
    window = max(min(length, whole.window), min(length, less.window), length // 3) // frame * frame
    return tuple(replace(p, kind="vibration", length=length, window=window) for p in (whole, less))  # type: ignore[return-value]


def _apart(name: str, one: Seen, other: Seen) -> float:
    """Difference of a measure between two runs (see `Change`)."""
    a, b = one.values.get(name), other.values.get(name)
    if a is None or b is None:
        return 1.0
    larger = max(abs(a), abs(b))
    if name.startswith("stick share"):
        larger = 1.0
    if name == "growth rate":
        larger = max(larger, SLOW * 2.0 * math.pi * one.values.get("frequency", 0.0))
    return abs(a - b) / larger if larger > 0.0 else 0.0


def irregular(problem: Problem, seen: Seen) -> dict[str, float]:
    """By measure, the difference between a run and one whose start differs by rounding: large if the motion is
    chaotic.
    """
    structure = 2 * len(problem.system.coordinates)
    start = problem.system.start.copy()
    start[:structure] += _NUDGE * start[:structure] + _LEAST_NUDGE
    other = observe(replace(problem, system=replace(problem.system, start=start)), of(problem.scene, problem.system))
    return {name: _apart(name, seen, other) for name in seen.values}
