"""What a figure over one or two parameters holds constant."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

from rig.analysis.axis import Axis, in_words, sweepable
from rig.scenes.scene import Scene

_LETTERS = 12.0
"""Letters of the second line in an inch."""

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def fixed(scene: Scene, axes: Iterable[Axis]) -> str:
    """Return the main parameters of `scene` that are on none of the axes, with their values.

    Main are those whose field declares words for them: speed of the drive, load, coefficients of friction.
    """
    varied, values = {axis.key for axis in axes}, scene.values()
    shown = []
    for key, unit in sweepable(scene.parameters):
        words = in_words(key, scene, declared=True)
        if words and key not in varied and values[key][0] is not None:
            shown.append(f"{words} {values[key][0]:.4g}{'' if unit == '1' else f' {unit}'}")
    return ", ".join(shown)


def heading(figure: Figure, scene: Scene, axes: Iterable[Axis], title: str = "") -> None:
    """Write a title (by default that of the scene) and below it what is held constant."""
    constant = fixed(scene, axes)
    figure.suptitle(title or scene.title, x=0.01, ha="left", fontsize=13, fontweight="bold")
    if constant:
        text = textwrap.fill(f"fixed: {constant}", round(_LETTERS * figure.get_figwidth()))
        figure.get_axes()[0].set_title(text, loc="left", fontsize=10)
