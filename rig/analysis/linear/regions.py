"""Regions of instability: the least stable mode of steady sliding over two parameters, from eigenvalues alone.

With dither switched on, friction is averaged (rig.analysis.cycles.averaged, to leading order: only inertia resists the
fast motion). Along x the edges are found by root finding (rig.analysis.linear.eigenvalue_curves); a band narrower than
the distance of two values may be missed.
Source: Liu and Ouyang, Meccanica 55 (2020), figures 8 and 12.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.averaged import averaged, not_fast
from rig.analysis.linear.eigenvalue_curves import NOTHING, Growth, limits, none
from rig.analysis.linear.modes import GENERATOR, Slow, missing
from rig.errors import Singular
from rig.results import Column, Result, Table
from rig.scenes.axis import Axis, heading
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene
from rig.scenes.sections import with_values
from rig.stability.linearisation import Steady, sliding_key, steady
from rig.view.palette import page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
_GREY = "#b9b9b9"
_LINEAR = 20.0  # the colours are linear in growth below this part of the largest growth, and logarithmic above


@dataclass(frozen=True)
class Regions(Result):
    """The result of `regions`: `growth` [1/s] and `frequency` [Hz] of the least stable mode, [y, x].

    Growth within rounding is 0. `exists`: whether steady sliding presses the contact; where the contact would have to
    pull, the numbers are those of a contact that can pull, and nan where friction depends on speed. `edges`: for each
    y, the values of x at which unstable sliding begins (True) or ends (False): there it becomes stable, or steady
    sliding ceases to exist.
    """

    FIGURE: ClassVar = "rig.analysis.linear.regions:figure"

    scene: Scene
    x: Axis
    y: Axis
    growth: Array
    frequency: Array
    exists: NDArray[np.bool_]
    edges: tuple[tuple[tuple[float, bool], ...], ...]

    def shown(self) -> Iterator[str | Table]:
        """Yield a row for each y."""
        yield f"{self.scene.name}: where sliding grows into vibration, over {self.x.label}"
        if alone := left_out(self.scene):
            yield f"  {alone}"
        yield ""
        columns = (
            self.y.column(),
            Column("largest growth", "1/s", ".6g"),
            self.x.column("unstable", ".8g"),
            Column("note"),
        )
        rows = []
        for i, value in enumerate(self.y.values):
            known = self.growth[i][np.isfinite(self.growth[i])]
            largest = float(known.max()) if known.size else None
            rows.append((value, largest, [*self._bands(i)], "" if known.size else NOTHING))
        yield Table("rows", columns, rows)
        absent = ~self.exists & np.isfinite(self.growth)
        if absent.any():
            share = 100.0 * absent.mean()
            why = "the contact would pull, or an output exceed its limit"
            yield f"\n  at {share:.2g} % of the points nothing slides steadily: {why}"
        without = np.argwhere(np.isnan(self.growth))
        if len(without):
            row, column = without[0]
            x = self.x.values[column]
            y = self.y.values[row]
            at = f"{self.x.key} = {self.x.text(x)}, {self.y.key} = {self.y.text(y)}"
            why = self._missing({self.y.key: y, self.x.key: x})
            yield f"\n  no steady sliding at {len(without)} of {self.growth.size} points; first at {at}: {why}"
        apart = self.x.text(float(np.abs(np.diff(self.x.values)).max()), 3)
        yield f"\n  sampled every {apart} of {self.x.key}; bands closer together may be missed"

    def _missing(self, values: dict[str, float]) -> str:
        """The reason why there is no steady sliding at these values."""
        try:
            return missing(sliding(self.scene, values))
        except Singular as error:
            return error.why
        except Slow as error:
            return f"the dither of {error}"

    def _bands(self, row: int) -> Iterator[tuple[float, float]]:
        edges = sorted(self.edges[row])
        low, high = sorted((self.x.values[0], self.x.values[-1]))
        first = self.growth[row, int(np.argmin(self.x.values))]  # nan where there is no sliding: not unstable
        start = low if first > 0.0 else None
        for value, unstable in edges:
            if unstable:
                start = value
            elif start is not None:
                yield start, value
                start = None
        if start is not None:
            yield start, high

    def facts(self) -> dict[str, Any]:
        """Return axes, growth, frequencies and edges in SI units."""
        edges = []
        for row in self.edges:
            edges.append([{"x": x, "becomes": "unstable" if unstable else "stable"} for x, unstable in row])
        return {
            "scene": self.scene.name,
            "left_out": left_out(self.scene),
            "x": {"key": self.x.key, "unit": self.x.unit, "values": list(self.x.values)},
            "y": {"key": self.y.key, "unit": self.y.unit, "values": list(self.y.values)},
            "growth": self.growth.tolist(),
            "frequency": self.frequency.tolist(),
            "exists": self.exists.tolist(),
            "edges": edges,
        }

    def listed(self) -> Table:
        """Return a row for each point."""
        columns = (
            self.x.column(),
            self.y.column(),
            Column("growth", "1/s"),
            Column("frequency", "Hz"),
            Column("exists"),
        )
        rows = []
        for j, y in enumerate(self.y.values):
            for i, x in enumerate(self.x.values):
                rows.append([x, y, float(self.growth[j, i]), float(self.frequency[j, i]), int(self.exists[j, i])])
        return Table("points", columns, rows)


def regions(scene: Scene, x: Axis, y: Axis) -> Regions:
    """Compute the least stable mode of `scene` over two axes."""
    return put_together(scene, x, y, {j: along(y.at(scene, value), x) for j, value in enumerate(y.values)})


def put_together(scene: Scene, x: Axis, y: Axis, rows: Mapping[int, Mapping[str, NDArray[Any]]]) -> Regions:
    """Assemble regions from the rows of `along`, by number."""
    in_order = [rows[j] for j in sorted(rows)]
    growth = np.array([row["growth"] for row in in_order])
    frequency = np.array([row["frequency"] for row in in_order])
    exists = np.array([row["exists"] for row in in_order])
    edges = []
    for row in in_order:
        edges.append(tuple((float(value), bool(unstable)) for value, unstable in row["edges"]))
    return Regions(scene, x, y, growth, frequency, exists, tuple(edges))


def along(scene: Scene, x: Axis) -> dict[str, NDArray[Any]]:
    """Compute one row: growth, frequency, exists [x], and edges [edge, (value, unstable sliding begins)]."""

    @cache
    def at(value: float) -> tuple[Growth | None, float, bool]:
        try:
            at_rest = sliding(scene, {x.key: value})
        except (Singular, Slow):
            return None, math.nan, False
        averages = GENERATOR[0] in at_rest.system.names and at_rest.slides and at_rest.inertia > 0.0
        if not (at_rest.counts or averages):  # with dither they are valid also where the contact would open
            return None, math.nan, at_rest.exists
        rates = at_rest.eigenvalues()
        return Growth(rates[:1].real, none(rates)[:1]), abs(rates[0].imag) / (2.0 * math.pi), at_rest.exists

    def growths(value: float) -> Growth | None:
        return at(value)[0]

    points = [at(value) for value in x.values]
    return {
        "growth": np.array([math.nan if growth is None else growth.clear[0] for growth, _, _ in points]),
        "frequency": np.array([frequency for _, frequency, _ in points]),
        "exists": np.array([exists for _, _, exists in points]),
        "edges": np.array(limits(x.values, growths), dtype=np.float64).reshape(-1, 2),
    }


def sliding(scene: Scene, values: dict[str, float]) -> Steady:
    """Return steady sliding of `scene` with these values (SI), with averaged friction if dither is on.

    Raises Slow if the dither is not fast.
    """
    parameters = scene.parameters
    for key, value in values.items():
        parameters = with_values(parameters, {key: value})
    assembly = scene.assemble(parameters)
    system = assembly.system()
    if GENERATOR[0] not in system.names:
        return steady(system, sliding_key(system))
    sine, cosine = (system.names.index(name) for name in GENERATOR)
    amplitude = assembly.inputs["dither.amplitude"].value * assembly.inputs["dither.enable"].value
    why = not_fast(system, sine, cosine) if amplitude else ""
    if why:
        raise Slow(why)
    return averaged(system, sine, cosine, amplitude, leading=True)


def figure(result: Regions) -> Figure:
    """Return the figure of the regions."""
    from matplotlib.colors import ListedColormap, SymLogNorm

    x = result.x.shown_values
    y = result.y.shown_values
    with page(9.6, 5.4, layout="constrained") as figure:
        axes = figure.add_subplot()
        axes.grid(visible=False)
        most = float(np.nanmax(np.abs(result.growth), initial=0.0)) or 1.0
        norm = SymLogNorm(linthresh=most / _LINEAR, vmin=-most, vmax=most)
        mesh = axes.pcolormesh(x, y, result.growth, cmap="RdBu_r", norm=norm, shading="nearest")
        mesh.set_rasterized(True)
        if not result.exists.all():
            absent = np.where(result.exists, np.nan, 1.0)
            axes.pcolormesh(x, y, absent, cmap=ListedColormap([_GREY]), shading="nearest")
            axes.plot([], [], "s", color=_GREY, label="no steady sliding")
        edges = []
        for up, row in zip(y, result.edges):
            edges += [(value / result.x.scale, up) for value, _ in row]
        if edges:
            along, up = np.array(edges).T
            axes.plot(along, up, ".", color="black", ms=3.0, label="sliding loses or gains stability")
        axes.set(xlabel=result.x.title, ylabel=result.y.title)
        axes.margins(0.0)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.11), ncols=2)
        bar = figure.colorbar(mesh, ax=axes, label="growth rate of the least stable mode [1/s]")
        small = most / _LINEAR
        ticks = [-most, -small, 0.0, small, most]
        bar.set_ticks(ticks, labels=[f"{tick:.2g}" for tick in ticks])
        bar.outline.set_visible(False)  # type: ignore[operator]
        heading(figure, result.scene, (result.x, result.y), "where sliding grows into vibration")
    return figure
