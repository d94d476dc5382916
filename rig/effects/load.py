"""The normal force that presses the bodies together: constant, or held by a magnet with lag and limits.

    N = F,  or  N' = (min(max(u, force_min), force_max) - N) / lag       u: commanded force

The contact opens where N would become negative: friction is then absent.
Source: Kroeger, Neubauer, Popp (2008), equation 4.6; lags of electromagnets 5 to 20 ms (calibrated).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from rig.about import About, Bound, SetPoint
from rig.effects.drive import Lag, actuator
from rig.model.assembly import Assembly
from rig.model.named_rows import Row
from rig.quantities import NonNegativeNewton, Section

STRONGEST = 1e5
"""Largest force [N] that can be commanded to a load without `force_max` [chosen]."""


class Load(Section):
    """The force [N] at the start, and lag and limits of the magnet."""

    declares: ClassVar = About("presses the bodies together")

    force: Annotated[NonNegativeNewton, Field(title="load"), SetPoint()]
    lag: Lag = None
    force_min: NonNegativeNewton = 0.0
    force_max: Annotated[NonNegativeNewton | None, Bound(of="force")] = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        high = math.inf if self.force_max is None else self.force_max
        if not self.force_min < high:
            raise ValueError(f"force_min {self.force_min:g} N is not below force_max {high:g} N")
        if not self.force_min <= self.force <= high:
            raise ValueError(f"force {self.force:g} N is outside force_min {self.force_min:g} N .. {high:g} N")
        return self


def add(a: Assembly, load: Load, moved: Mapping[str, str]) -> Row:
    """Add the magnet's states and its actuator `load.force`; returns the row of the normal force [N]."""
    high = math.inf if load.force_max is None else load.force_max
    bounds = (load.force_min, high)
    return actuator(a, "load.force", "N", load.force, load.force, bounds, STRONGEST, load.lag, "load", moved)
