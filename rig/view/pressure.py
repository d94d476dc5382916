"""Contact pressure in figures: its colours, maps, and their scale.

Colours of pressure: dark violet at zero to yellow at the upper end of the scale; white for open points. A point that
just touches is dark and an open point is bright, so that they cannot be confused. One scale serves all maps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Reals
from rig.view.contact import rgb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from rig.plants.structures.contact_map import Surface

OPEN = "#f4f4f4"
_STOPS = ("#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725")
"""viridis (matplotlib, public domain) at even steps."""
COUNT = 256
_CENTRE = "#e4322b"
_BETWEEN = 0.3  # gap between two contacts on a map, over the width of the widest


def table() -> NDArray[np.uint8]:
    """The colours of the scale from its lower to its upper end: uint8 [COUNT, rgb]."""
    stops = np.array([rgb(stop) for stop in _STOPS], np.float64)
    at = np.linspace(0.0, 1.0, len(stops))
    share = np.linspace(0.0, 1.0, COUNT)
    return np.stack([np.interp(share, at, stops[:, i]) for i in range(3)], axis=1).round().astype(np.uint8)


def colours(pressures: NDArray[np.float64], scale: float) -> NDArray[np.uint8]:
    """The colours [..., rgb] of `pressures` on a scale from 0 to `scale`; larger ones have its last colour."""
    share = np.clip(np.nan_to_num(pressures) / scale, 0.0, 1.0)
    coloured: NDArray[np.uint8] = table()[np.rint(share * (COUNT - 1)).astype(np.int64)]
    coloured[~(pressures > 0.0)] = rgb(OPEN)
    return coloured


def draw_map(axes: Axes, surfaces: Sequence[Surface], maps: Sequence[Reals], scale: float) -> None:
    """Draw the pressures in Pa of each contact, on a scale from 0 to `scale`, with their centres; axes in mm.

    Several contacts lie side by side, over their names and shares of closed points.
    """
    from matplotlib.collections import PolyCollection

    widest = max(1e3 * float(np.ptp(surface.corners[:, :, 0])) for surface in surfaces)
    begin = 0.0
    middles: list[float] = []
    for surface, pressures in zip(surfaces, maps):
        cells = 1e3 * surface.corners
        pressed = pressures.ravel()
        left = float(cells[:, :, 0].min())
        right = float(cells[:, :, 0].max())
        by = begin - left if len(surfaces) > 1 else 0.0
        cells = cells + np.array([by, 0.0])
        begin = by + right + _BETWEEN * widest
        middles.append(by + 0.5 * (left + right))
        shades = colours(pressed, scale) / 255.0
        axes.add_collection(PolyCollection(list(cells), facecolors=shades, edgecolors=shades, linewidths=0.3))
        for cell in cells[~(pressed > 0.0)]:  # a diagonal line, visible in black and white too
            axes.plot(*cell[[0, 2]].T, color="#b0b0b0", lw=0.5)
        x, y = surface.centre(pressures)
        if np.isfinite((x, y)).all():
            axes.plot(1e3 * x + by, 1e3 * y, "o", ms=5.0, mfc=_CENTRE, mec="white", mew=0.9)
    axes.grid(visible=False)
    axes.autoscale_view()
    axes.margins(0.0)
    axes.set_aspect("equal")
    if len(surfaces) > 1:
        names = [f"{s.name}\n{100 * (pressed > 0.0).mean():.0f} %" for s, pressed in zip(surfaces, maps)]
        axes.set_xticks(middles, names)
        axes.tick_params(axis="x", length=0.0)
    for side in axes.spines.values():
        side.set_visible(len(surfaces) == 1)
        side.set_color("#9a9a9a")


def where(surfaces: Sequence[Surface]) -> tuple[str, str]:
    """The titles of the axes of a map."""
    x, y = surfaces[0].axes
    if surfaces[0].name == "film":
        return f"{x} on the slider [mm]", f"{y} on the slider [mm]"
    return f"position {x} [mm]" if len(surfaces) == 1 else "", f"position {y} [mm]"


def draw_scale(axes: Axes, scale: float, beyond: bool, **placed: Any) -> None:
    """Draw a colour bar for maps beside `axes`; `beyond`: whether pressures above its end occur."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    shades = ScalarMappable(Normalize(0.0, 1e-6 * scale), ListedColormap(table() / 255.0))
    bar = axes.figure.colorbar(shades, extend="max" if beyond else "neither", **placed)
    between = "\n" if placed.get("location") == "bottom" else "; "
    bar.set_label(f"pressure [MPa]{between}white, crossed: open; dot: pressure centre", fontsize=9)
    bar.outline.set_visible(False)  # type: ignore[operator]
