"""Measured points: a monotone cubic through (speeds, values), constant beyond."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from rig.laws import FrictionLaw
from rig.model import friction_law
from rig.model.friction_law import Law
from rig.quantities import Ratio, Speed


class Table(FrictionLaw):
    """A law through measured points. Without `mu_static` the first value is the static coefficient."""

    law: Literal["table"]
    speeds: tuple[Speed, ...] = Field(min_length=2)
    values: tuple[Ratio, ...] = Field(min_length=2)
    mu_static: Ratio | None = None

    @model_validator(mode="after")
    def _points(self) -> Self:
        if len(self.speeds) != len(self.values):
            raise ValueError(f"{len(self.speeds)} speeds and {len(self.values)} values; give one value for each speed")
        if self.speeds[0] != 0.0 or any(b <= a for a, b in zip(self.speeds, self.speeds[1:])):
            raise ValueError("speeds must rise from 0 m/s")
        if self.mu_static is not None and self.mu_static < self.values[0]:
            raise ValueError(
                f"mu_static {self.mu_static:g} is below the first of the values, {self.values[0]:g}: a contact that "
                "begins to slip would stick again immediately; give at least the same value"
            )
        return self

    def friction(self) -> Law:
        """The law for the solver."""
        static = self.values[0] if self.mu_static is None else self.mu_static
        return friction_law.table(np.array(self.speeds), np.array(self.values), static)
