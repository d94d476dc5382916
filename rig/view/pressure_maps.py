"""Maps of the pressure of a film for figures: x along, y across, one scale for all maps, open points white."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rig.record.film_points import Points
from rig.record.run import Reals
from rig.view import pressure_colours

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

_CENTRE = "#e4322b"


def draw_map(axes: Axes, points: Points, pressures: Reals, scale: float, centre: Sequence[float]) -> None:
    """Draw `pressures` [along, across] in Pa on a scale from 0 to `scale`, with its `centre` [m]; axes in mm."""
    half_x, half_y = 500.0 * points.length, 500.0 * points.width
    axes.imshow(
        pressure_colours.colours(pressures.T, scale), origin="lower", extent=(-half_x, half_x, -half_y, half_y),
        aspect="equal", interpolation="nearest",
    )  # fmt: skip
    axes.grid(visible=False)
    dx, dy = 2.0 * half_x / points.along, 2.0 * half_y / points.across
    for i, j in np.argwhere(~(pressures > 0.0)).tolist():  # a diagonal line, visible in black and white too
        x, y = -half_x + i * dx, -half_y + j * dy
        axes.plot([x, x + dx], [y, y + dy], color="#b0b0b0", lw=0.5)
    if np.isfinite(centre).all() and (pressures > 0.0).any():
        axes.plot(1e3 * centre[0], 1e3 * centre[1], "o", ms=5.0, mfc=_CENTRE, mec="white", mew=0.9)
    axes.set_xlim(-half_x, half_x)
    axes.set_ylim(-half_y, half_y)
    for side in axes.spines.values():
        side.set_visible(True)
        side.set_color("#9a9a9a")


def draw_scale(axes: Axes, scale: float, beyond: bool, **placed: Any) -> None:
    """Draw a colour bar for maps beside `axes`; `beyond`: whether pressures above its end occur."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    shades = ScalarMappable(Normalize(0.0, 1e-6 * scale), ListedColormap(pressure_colours.table() / 255.0))
    bar = axes.figure.colorbar(shades, extend="max" if beyond else "neither", **placed)
    between = "\n" if placed.get("location") == "bottom" else "; "
    bar.set_label(f"pressure [MPa]{between}white, crossed: open; dot: pressure centre", fontsize=9)
    bar.outline.set_visible(False)  # type: ignore[operator]
