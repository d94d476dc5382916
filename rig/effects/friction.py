"""Friction laws: the coefficient mu over slip speed v >= 0, and the static coefficient of a sticking contact.

    stribeck     mu_dynamic + (mu_static - mu_dynamic) exp(-v / speed_scale)     characteristic A
    falling      max(mu_zero - slope v, mu_floor)                                characteristic B
    coulomb      mu_static at rest, mu_kinetic in slip                           characteristic C
    constant     mu, at rest and in slip
    exponential  mu_kinetic + (mu_static - mu_kinetic) exp(-decay v)
    table        a monotone cubic through (speeds, values), constant beyond
    seal         (mixed_force / (1 + decay v) + film (v + offset)^0.5) / load    a measured force

Source: A, B, C from Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, figure 3 (A's formula is a choice:
the paper gives its shape), seal from its equation 3.1; exponential from Liu and Ouyang, the slider-on-disc rig.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from rig.about import About
from rig.model import friction_law
from rig.model.friction_law import Law
from rig.quantities import (
    NewtonPerRootSpeed,
    NonNegativeNewton,
    PositiveMetrePerSecond,
    PositiveNewton,
    PositiveSecondPerMetre,
    Ratio,
    SecondPerMetre,
    Section,
    Speed,
)
from rig.units import si


class _OverSpeed(Section):
    declares: ClassVar = About("a coefficient over the slip speed; stick and slip")


class Stribeck(_OverSpeed):
    """The Stribeck law: an exponential fall from the static to the dynamic coefficient."""

    law: Literal["stribeck"]
    mu_static: Annotated[Ratio, Field(title="static coefficient of friction")]
    mu_dynamic: Annotated[Ratio, Field(title="dynamic coefficient of friction")]
    speed_scale: PositiveMetrePerSecond

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.stribeck(self.mu_static, self.mu_dynamic, self.speed_scale)


class Falling(_OverSpeed):
    """A coefficient that falls linearly with the slip speed, down to a floor."""

    law: Literal["falling"]
    mu_zero: Annotated[Ratio, Field(title="coefficient of friction at zero speed")]
    slope: SecondPerMetre
    mu_floor: Ratio = 0.0

    @model_validator(mode="after")
    def _floor_below(self) -> Self:
        if self.mu_floor > self.mu_zero:
            raise ValueError(f"mu_floor {self.mu_floor:g} is above mu_zero {self.mu_zero:g}")
        return self

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.falling(self.mu_zero, self.slope, self.mu_floor)


class Coulomb(_OverSpeed):
    """Coulomb friction: one coefficient in stick, one in slip."""

    law: Literal["coulomb"]
    mu_static: Annotated[Ratio, Field(title="static coefficient of friction")]
    mu_kinetic: Annotated[Ratio, Field(title="kinetic coefficient of friction")]

    @model_validator(mode="after")
    def _static_is_larger(self) -> Self:
        if self.mu_static < self.mu_kinetic:
            raise ValueError(
                f"mu_static {self.mu_static:g} is below mu_kinetic {self.mu_kinetic:g}: a contact that begins to slip "
                "would stick again immediately, and stick would end immediately; give at least the same value"
            )
        return self

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.coulomb(self.mu_static, self.mu_kinetic)


class Constant(_OverSpeed):
    """One coefficient in stick and slip. It does not fall with the speed; instability then comes from mode coupling."""

    law: Literal["constant"]
    mu: Annotated[Ratio, Field(title="coefficient of friction")]

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.coulomb(self.mu, self.mu)


class Exponential(_OverSpeed):
    """An exponential fall with the decay constant `decay` [s/m].

    A decay of zero is refused: the coefficient would be mu_static at every speed.
    """

    law: Literal["exponential"]
    mu_static: Annotated[Ratio, Field(title="static coefficient of friction")]
    mu_kinetic: Annotated[Ratio, Field(title="kinetic coefficient of friction")]
    decay: PositiveSecondPerMetre

    @field_validator("decay", mode="before")
    @classmethod
    def _falls(cls, decay: object) -> object:
        none = False
        with suppress(TypeError, ValueError):  # a value that is not a number is reported by the check of its type
            none = si(decay, "s/m") == 0.0
        if none:
            raise ValueError(
                'must be greater than 0 s/m: it would be mu_static at every speed; a sudden drop is "coulomb"'
            )
        return decay

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.stribeck(self.mu_static, self.mu_kinetic, 1.0 / self.decay)


class Table(_OverSpeed):
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
        return self

    def friction(self) -> Law:
        """The law for the solver."""
        static = self.values[0] if self.mu_static is None else self.mu_static
        return friction_law.table(np.array(self.speeds), np.array(self.values), static)


class Seal(_OverSpeed):
    """The friction force of a lubricated seal, measured over speed under the normal force `load` [N].

    Under another normal force the friction force changes in proportion.
    """

    law: Literal["seal"]
    load: PositiveNewton
    mixed_force: NonNegativeNewton
    decay: PositiveSecondPerMetre
    film: NewtonPerRootSpeed
    offset: PositiveMetrePerSecond

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.seal(self.mixed_force / self.load, self.decay, self.film / self.load, self.offset)


Friction = Annotated[Stribeck | Falling | Coulomb | Constant | Exponential | Table | Seal, Field(discriminator="law")]
