"""The eigenvalues of a rig along one of its parameters: branches, and the critical values where growth changes sign."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.axis import Axis
from rig.analysis.critical_values import Critical, Gap, search
from rig.analysis.eigenvalue_curves import Spectra, Spectrum, equilibrium, follow
from rig.analysis.fixed_parameters import fixed
from rig.analysis.growth_crossings import ROUNDING, none
from rig.analysis.modes import dithers
from rig.analysis.modes_report import shape_text
from rig.analysis.text_table import columns
from rig.results import Result
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Sweep(Result):
    """Eigenvalues `rates` [value, branch] at the values of `axis`; NaN where a branch does not exist.

    `shapes` [value, branch, state]: amplitudes in the order of `states`. `exists` [value]: whether the rig slides
    steadily, and `notes` [value] what makes the eigenvalues invalid. `gaps`: ranges without steady sliding, and why.
    `resolution`: critical values closer together than this may be missed. `loop`: the controller whose loop is closed,
    "" for none. `fixed`: the main parameters that the sweep holds constant, in words.
    `friction`: how a scene with dither is analysed, in words.
    """

    FIGURE: ClassVar = "rig.analysis.sweep_figure:figure"

    scene: str
    axis: Axis
    rates: Complex
    shapes: Complex
    states: tuple[str, ...]
    exists: NDArray[np.bool_]
    notes: tuple[str, ...]
    critical: tuple[Critical, ...]
    gaps: tuple[Gap, ...]
    resolution: float
    loop: str = ""
    fixed: str = ""
    friction: str = ""

    @property
    def growth(self) -> Array:
        """Growth rates [value, branch] in 1/s; of a complex pair only the upper one."""
        return np.where(self._upper, self.rates.real, np.nan)

    @property
    def frequency(self) -> Array:
        """Frequencies [value, branch] in Hz."""
        return np.where(self._upper, self.rates.imag / (2.0 * math.pi), np.nan)

    @property
    def _upper(self) -> NDArray[np.bool_]:
        return np.asarray(self.rates.imag >= -ROUNDING * np.abs(self.rates))

    @property
    def largest(self) -> Array:
        """The largest growth rate at each value [1/s]."""
        return np.array([max(row[np.isfinite(row)], default=math.nan) for row in self.rates.real])

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; a number that is not there is null."""
        growth, frequency = self.growth, self.frequency
        return {
            "scene": self.scene,
            "loop": self.loop or None,
            "friction": self.friction or None,
            "key": self.axis.key,
            "unit": self.axis.unit,
            "values": list(self.axis.values),
            "exists": self.exists.tolist(),
            "notes": list(self.notes),
            "largest": self.largest.tolist(),
            "branches": [
                {"growth": g.tolist(), "frequency": f.tolist()}
                for g, f in zip(growth.T, frequency.T)
                if np.isfinite(g).any()
            ],
            "critical": [
                {**vars(one), "shape": {name: [v.real, v.imag] for name, v in one.shape.items()}}
                for one in self.critical
            ],
            "gaps": [gap._asdict() for gap in self.gaps],
            "resolution": self.resolution,
        }

    def text(self) -> str:
        """Return the report as text."""
        axis = self.axis
        what = f"the loop of {self.loop}" if self.loop else "steady sliding"
        what += f", {self.friction}," if self.friction else ""
        lines = [f"{self.scene}: {what} over {axis.label}"]
        for one in self.critical:
            at = f" at {one.frequency:.6g} Hz" if one.frequency else ""
            what = one.sides if one.kind == "jamming" else f"{one.kind}{at}, {one.sides}"
            lines += [f"  {axis.text(one.value, 12)}: {what}"]
            lines += [f"    {shape_text(one.shape, one.energy)} (share of the energy)"] if one.energy else []
        if not self.critical:
            lines += [f"  no critical value {'where the rig slides steadily' if self.gaps else 'between these ends'}"]
        lines += [f"  {gap.note} {self._span(gap)}{f': {gap.why}' * bool(gap.why)}" for gap in self.gaps]
        lines += [f"  sampled every {axis.text(self.resolution, 3)}; critical values closer together may be missed"]
        rows = [(axis.label, "largest growth 1/s", "frequency Hz", "growing modes", "")]
        for value, row, note in zip(axis.values, self.rates, self.notes):
            if not np.isfinite(row).any():
                rows += [(axis.text(value), "", "", "", note)]
                continue
            top = row[int(np.nanargmax(row.real))]
            there = row[np.isfinite(row)]
            count = int(np.count_nonzero((there.real > none(there)) & (there.imag >= 0.0)))
            hertz = abs(top.imag) / (2.0 * math.pi)
            rows += [(axis.text(value), f"{top.real:.6g}", f"{hertz:.6g}", f"{count or ''}", note)]
        return "\n".join([*lines, "", *columns(rows, "<>>><")])

    def _span(self, gap: Gap) -> str:
        start, end = (self.axis.text(value) for value in gap[:2])
        return f"at {start}" if start == end else f"from {start} to {end}"


def sweep(scene: Scene, axis: Axis) -> Sweep:
    """Compute the eigenvalues of `scene` at its sliding equilibrium over `axis`, and the critical values between its
    ends. With a key of the dither, or if the scene switches its dither on, the friction is averaged over it.
    """
    dithered = dithers(scene, axis.key)

    def spectrum(value: float) -> Spectrum:
        return equilibrium(axis.at(scene, value), bool(dithered))

    how = {None: "", True: "friction averaged over the dither", False: "without the dither"}[dithered]
    return replace(along(scene.name, axis, spectrum, fixed=fixed(scene, [axis])), friction=how)


def along(name: str, axis: Axis, spectrum_at: Spectra, loop: str = "", fixed: str = "") -> Sweep:
    """Compute the sweep of anything that has a spectrum at each value of an axis."""
    spectra = lru_cache(maxsize=4096)(spectrum_at)
    found = [spectra(value) for value in axis.values]
    rates, order = _branches(axis.values, found, spectra)
    critical = search(axis.values, rates, spectra)
    states = tuple(dict.fromkeys(name for one in found for name in one.names))
    shapes = np.zeros((*rates.shape, len(states)), dtype=np.complex128)
    for row, one, places in zip(shapes, found, order):
        columns = [states.index(state) for state in one.names]
        for i, place in places.items():
            row[place, columns] = one.right[:, i]
    return Sweep(
        scene=name,
        axis=axis,
        rates=rates,
        shapes=shapes,
        states=states,
        exists=np.array([one.exists for one in found]),
        notes=tuple(one.note for one in found),
        critical=critical.critical,
        gaps=critical.gaps,
        resolution=critical.resolution,
        loop=loop,
        fixed=fixed,
    )


def _branches(
    values: tuple[float, ...], found: list[Spectrum], spectra: Spectra
) -> tuple[Complex, list[dict[int, int]]]:
    """Rates [value, branch], and for each value the branch of each of its rates."""
    order: list[dict[int, int]] = []
    count = 0
    for k, one in enumerate(found):
        here: dict[int, int] = {}
        if k and one.counts and found[k - 1].counts:
            on = follow(spectra, values[k - 1], found[k - 1], values[k], one)
            here = {int(on[i]): place for i, place in order[-1].items() if on[i] >= 0}
        for i in range(len(one.rates) if one.counts else 0):
            if i not in here:
                here[i] = count
                count += 1
        order.append(here)
    rates = np.full((len(found), count), complex(math.nan, math.nan))
    for row, one, places in zip(rates, found, order):
        for i, place in places.items():
            row[place] = one.rates[i]
    return rates, order
