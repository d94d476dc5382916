"""The figure of the friction laws of a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.errors import UsageError
from rig.stability.linearisation import sliding_key, steady
from rig.view.curves import plain
from rig.view.palette import LINES, drawn, headline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rig.scenes.scene import Scene

_FASTEST = 1.0  # largest slip speed in the figure of a rig whose surfaces stand still [m/s]. # chosen


@drawn(8.4, 4.6, layout="constrained")
def scene_figure(figure: Figure, scene: Scene) -> None:
    """Draw the friction coefficient of each contact of `scene` over its slip speed; dots: the static coefficients.

    A law with memory is drawn in steady slip, under the load of steady sliding. One that deflects instead of sticking
    has no static coefficient.

    Raises UsageError for a rig without friction.
    """
    system = scene.assemble().system()
    if not system.patches:
        raise UsageError("nothing to draw: the rig has no contact with friction")
    sliding = steady(system, sliding_key(system))
    x = sliding.x.copy()
    x[: 2 * len(system.coordinates)] = 0.0
    surfaces = np.abs(system.slip_rows @ x)
    top = 2.0 * float(surfaces.max()) or _FASTEST
    speeds = np.linspace(0.0, top, 400)[1:]
    axes = figure.add_subplot()
    for i, (patch, surface, load) in enumerate(zip(system.patches, surfaces, sliding.load.tolist())):
        colour = LINES[i % len(LINES)]
        for law, dashes, way in zip(patch.law.directions, ("-", "--"), ("", " backward")):
            under = f", steady slip under {load:.3g} N" if law.states else ""
            label = plain(patch.name) + way + under
            axes.plot(speeds, law.over(speeds, load), color=colour, ls=dashes, label=label)
            if law.sticks:
                axes.plot(0.0, law.at_rest(load), "o", color=colour)
        if surface:
            axes.axvline(surface, color=colour, lw=0.9, ls=":")
    moving = "; dotted: speed of the surface" if surfaces.any() else ""
    axes.set(
        xlabel=f"slip speed [m/s]{moving}", ylabel="friction coefficient", xlim=(-0.01 * top, top), ylim=(0.0, None)
    )
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.2)
    headline(figure, f"{scene.name}: friction")
