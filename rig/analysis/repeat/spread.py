"""The spread of numbers over runs with different seeds: median, smallest and largest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rig.analysis.repeat.measure import ONSET, Seen
from rig.analysis.text_table import columns
from rig.results import Result


class Spread(NamedTuple):
    """One number over `runs` runs, in `unit`."""

    name: str
    unit: str
    runs: int
    median: float
    least: float
    greatest: float


@dataclass(frozen=True)
class Repeats(Result):
    """Runs of one scene with `seeds`: its `random` parts, the numbers `seen` in each run, the reason why they `ended`
    early.

    `ended` is empty if every seed was simulated.
    """

    FIGURE: ClassVar = "rig.analysis.repeat.figure:figure"

    scene: str
    random: tuple[str, ...]
    seeds: tuple[int, ...]
    seen: tuple[Seen, ...]
    ended: str = ""

    @property
    def spreads(self) -> tuple[Spread, ...]:
        """The spread of every number, in the order of the first run that has it."""
        found: dict[str, list[float]] = {}
        units: dict[str, str] = {}
        for one in self.seen:
            for name, (value, unit) in one.numbers.items():
                found.setdefault(name, []).append(value)
                units[name] = unit
        return tuple(
            Spread(name, units[name], len(v), float(np.median(v)), min(v), max(v)) for name, v in found.items()
        )

    def values(self, name: str) -> list[float]:
        """Return a number of every run that has it, in the order of the seeds."""
        return [one.numbers[name].value for one in self.seen if name in one.numbers]

    @property
    def opened(self) -> int:
        """Number of runs in which a contact point opened after all were closed."""
        return len(self.values(ONSET))

    def text(self) -> str:
        """Return the report as text."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        count = len(self.seen)
        seeds = f"seeds {self.seeds[0]} to {self.seeds[-1]}"
        done = f"{count} of {len(self.seeds)} runs ({self.ended})" if self.ended else f"{count} runs"
        yield f"{self.scene}: {done}, {seeds}; random: {', '.join(self.random)}"
        if not count:
            return
        chaotic = any("contact_fraction" in name for one in self.seen for name in one.numbers)
        if chaotic:
            yield f"  a contact point opened in {self.opened} of {count} runs"
            if self.opened:
                yield "  the other numbers are from the first opening to the end, where the motion is chaotic"
        for one in self.seen:
            if one.fault:
                yield f"  seed {one.seed} stopped at t = {one.seconds:g} s: {one.fault}"
        yield ""
        rows = [("number", "median", "least", "greatest", "unit", "runs")]
        for s in self.spreads:
            rows.append((s.name, f"{s.median:.5g}", f"{s.least:.5g}", f"{s.greatest:.5g}", s.unit, str(s.runs)))
        yield from columns(rows, "<>>><>")

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "scene": self.scene,
            "random": list(self.random),
            "seeds": list(self.seeds),
            "ended": self.ended,
            "runs": [one.to_json() for one in self.seen],
            "spread": [one._asdict() for one in self.spreads],
        }
