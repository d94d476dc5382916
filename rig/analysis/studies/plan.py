"""The points of a study: a grid, at each of its points drawn samples, each of them run with several seeds.

random     independent draws (Monte Carlo)
latin      Latin hypercube: each parameter has one value in each of N equal shares
sobol      Sobol sequence, scrambled: fills the space evenly; N is a power of 2
saltelli   N (d + 2) points from which Sobol indices of d parameters are computed; N is a power of 2

The draws are the same at every point of the grid. Point number k is run with the seed of the study plus k. Source:
Saltelli et al., Comput. Phys. Commun. 181 (2010) 259-270.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.studies.factors import Factor, factors, refused
from rig.errors import SceneError, UsageError
from rig.quantities import whole
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
SAMPLINGS = ("random", "latin", "sobol", "saltelli")
SAMPLES = 64
"""Default number of samples."""
MOST = 10_000_000
"""Largest number of points, of samples, and of repeated runs."""
MOST_SEED = 2**62
"""Largest seed; those of all points then fit in 64 bits."""
_EDGE = 1e-12
SAMPLE, REPEAT = "sample", "repeat"
"""Dimensions of the results beside those of the grid."""


@dataclass(frozen=True)
class Plan:
    """The points of a study."""

    factors: tuple[Factor, ...]
    samples: int
    sampling: str
    repeat: int
    seed: int

    @property
    def grid(self) -> list[Factor]:
        """The parameters with given values."""
        return [one for one in self.factors if one.distribution is None]

    @property
    def drawn(self) -> list[Factor]:
        """The parameters with a distribution."""
        return [one for one in self.factors if one.distribution is not None]

    @property
    def rows(self) -> int:
        """Number of samples at each point of the grid; 1 without a distribution."""
        if not self.drawn:
            return 1
        return self.samples * (len(self.drawn) + 2 if self.sampling == "saltelli" else 1)

    @property
    def dimensions(self) -> dict[str, int]:
        """The dimensions of the results: the keys of the grid, sample, repeat; the last two only where needed."""
        found = {one.key: len(one.axis.values) for one in self.grid}
        found |= {SAMPLE: self.rows} if self.drawn else {}
        return found | ({REPEAT: self.repeat} if self.repeat > 1 else {})

    @property
    def total(self) -> int:
        """Number of points."""
        return math.prod(self.dimensions.values())

    @cached_property
    def shares(self) -> Array:
        """The drawn shares, [sample, drawn parameter], between 0 and 1."""
        from scipy.stats import qmc

        count, chance = len(self.drawn), np.random.default_rng(self.seed)
        if self.sampling not in SAMPLINGS[1:]:
            return chance.random((self.samples, count))
        if self.sampling == "latin":
            return np.asarray(qmc.LatinHypercube(count, rng=chance).random(self.samples))
        if self.sampling == "sobol":
            return np.asarray(qmc.Sobol(count, rng=chance).random(self.samples))
        both = qmc.Sobol(2 * count, bits=64, rng=chance).random(self.samples)
        a, b = both[:, :count], both[:, count:]
        mixed = []
        for column in range(count):
            one = a.copy()
            one[:, column] = b[:, column]
            mixed.append(one)
        return np.concatenate([a, b, *mixed])

    @cached_property
    def draws(self) -> Array:
        """The drawn values (SI), [sample, drawn parameter]."""
        shares = np.clip(self.shares, _EDGE, 1.0 - _EDGE)  # a normal distribution has no value at 0 and 1
        columns = [one.distribution.quantile(shares[:, i], one.axis.unit)  # type: ignore[union-attr]
                   for i, one in enumerate(self.drawn)]  # fmt: skip
        return np.column_stack(columns) if columns else np.zeros((1, 0))

    def values(self, number: int) -> dict[str, float]:
        """Return the values (SI) of the parameters of a point."""
        *at, sample = np.unravel_index(number // self.repeat, (*(len(one.axis.values) for one in self.grid), self.rows))
        found = {one.key: one.axis.values[i] for one, i in zip(self.grid, at)}
        return found | {one.key: float(self.draws[sample, i]) for i, one in enumerate(self.drawn)}

    def seed_of(self, number: int) -> int:
        """Return the seed of a point."""
        return self.seed + number


def plan(
    scene: Scene, over: Mapping[str, Any], samples: int | None, sampling: str, repeat: int, seed: int | None
) -> Plan:
    """Return the plan of a study of `scene`. Raises SceneError, UsageError with every fault."""
    faults: list[str] = []
    varied: tuple[Factor, ...] = ()
    try:
        varied = factors(scene, over)
    except SceneError as fault:
        faults.append(str(fault))
    numbers = {}
    for name, value, least, most in (
        ("samples", SAMPLES if samples is None else samples, 1, MOST),
        ("repeat", repeat, 1, MOST),
        ("seed", scene.seed if seed is None else seed, 0, MOST_SEED),
    ):
        try:
            numbers[name] = whole(name, value, least, most)
        except UsageError as fault:
            faults.append(str(fault))
            numbers[name] = least
    found = Plan(varied, sampling=sampling, **numbers)
    if sampling not in SAMPLINGS:
        faults.append(f"sampling {sampling}: unknown; known: {', '.join(SAMPLINGS)}")
    elif sampling in ("sobol", "saltelli") and found.drawn and found.samples & (found.samples - 1):
        near = 2 ** round(math.log2(found.samples))
        faults.append(f"samples = {found.samples}: must be a power of 2 for sampling {sampling}, such as {near}")
    if varied and not found.drawn and (samples is not None or sampling != "random"):
        faults.append("samples and sampling are for distributions, and no parameter has one, such as normal(0.4, 0.02)")
    if varied and not faults and found.total > MOST:
        faults.append(f"{found.total} points: must be at most {MOST}")
    if faults:
        raise UsageError("\n".join(faults))
    outside = []
    for i, one in enumerate(found.drawn):
        values = found.draws[:, i]
        try:
            remedy = (
                ""
                if one.distribution is None or one.distribution.kind == "uniform"
                else ("; cut the distribution off with low=... and high=...")
            )
            refused(scene, one.axis, sorted({float(values.min()), float(values.max())}), remedy)
        except ValueError as fault:
            outside.append(f"{one.key}: {one.distribution} leaves the range of the parameter: {fault}")
    if outside:
        raise SceneError(scene.name, outside)
    return found
