"""The condition of the recordings that a study keeps: a measure beyond a level, such as "cycle.amplitude > 5 mm"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rig.analysis.studies.measures import Measure
from rig.errors import UsageError
from rig.quantities import finite
from rig.scenes.faults import near
from rig.units import with_point

_FORM = re.compile(r"\s*(?P<name>[^<>]+?)\s*(?P<sense>[<>])\s*(?P<level>[^<>]+?)\s*")


@dataclass(frozen=True)
class Condition:
    """A condition on measure number `measure`; `level` in the unit of the measure."""

    text: str
    measure: int
    above: bool
    level: float

    def holds(self, value: float) -> bool:
        """Return whether the condition holds; never for a missing value."""
        return value > self.level if self.above else value < self.level


def condition(text: str, measures: Sequence[Measure]) -> Condition:
    """Read "MEASURE > VALUE UNIT" or "MEASURE < VALUE UNIT". Raises UsageError."""
    found = _FORM.fullmatch(text) if isinstance(text, str) else None
    if found is None:
        raise UsageError(f'keep {text}: expected MEASURE > VALUE or MEASURE < VALUE, such as "cycle.amplitude > 5 mm"')
    names = [one.name for one in measures]
    if found["name"] not in names:
        raise UsageError(f"keep {text}: {found['name']} is not a measure of this study; {near(found['name'], names)}")
    number = names.index(found["name"])
    unit = measures[number].unit or "1"
    level: float | str = with_point(found["level"], f"keep {text}: the level")
    try:
        level = float(level)
    except ValueError:
        pass
    try:
        return Condition(text, number, found["sense"] == ">", finite(level, unit))
    except ValueError as fault:
        raise UsageError(f"keep {text}: the level {fault}") from None
