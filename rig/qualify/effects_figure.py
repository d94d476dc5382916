"""Effects of a scene as a picture: the cost of each per step, and the change if it is dropped or added."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rig.errors import UsageError
from rig.qualify.cost.figure import sheet, tick_labels
from rig.qualify.effects_measured import Part
from rig.record.provenance import provenance
from rig.scenes.scene import Scene
from rig.view.palette import BLUE
from rig.view.save_figure import put

ON, ABSENT = BLUE, "#9aa5b1"


def draw(parts: Sequence[Part], scene: Scene, path: Path) -> None:
    """Draw bars: ns per step on the left, changes by measure on the right; absent effects are grey."""
    measured = [(one, one.paired.closed or one.paired) for one in reversed(parts)]
    shown = [(one, paired) for one, paired in measured if not math.isnan(paired.tick.value)]
    if not shown:
        raise UsageError("--figure: nothing to draw, none of its effects can be left out or added alone")
    with sheet(f"{scene.name}: its effects, on or absent", provenance(scene.seed)) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        left.set_axisbelow(True)
        for place, (one, paired) in enumerate(shown):
            colour, tick = (ON if one.on else ABSENT), paired.shown_cost
            left.barh(place, tick.value, color=colour)
            spread = [[max(tick.value - tick.low, 0.0)], [max(tick.high - tick.value, 0.0)]]
            left.errorbar(tick.value, place, xerr=spread, color="black", lw=0.8, capsize=2)
            for change in paired.changes:
                if change.significant:
                    right.plot(change.size, place, "o", ms=5, color=colour)
            worst = paired.worst
            if worst is not None:
                at = (worst.size, place)
                right.annotate(
                    worst.measure.replace("_", " "), at, (0, 8), textcoords="offset points", ha="right", fontsize=8.5
                )
            else:
                right.annotate(
                    "no change", (0.02, place), xycoords=("axes fraction", "data"), va="center", fontsize=8.5
                )
        handles = [left.barh(0, 0, color=colour) for colour in (ON, ABSENT)]
        figure.legend(handles, ["on: if it is dropped", "absent: if it is added"], loc="outside lower left", ncols=2)
        labels = [f"{one.name.replace('_', ' ')}\n{'on' if one.on else 'absent'}" for one, _ in shown]
        left.set_yticks(range(len(shown)), labels)
        whole = max((p.whole for one, p in shown if one.on), default=max(p.whole for _, p in shown))
        noise = max(p.noise for _, p in shown)
        left.set(xlabel=f"compute that it adds to a step of {whole:.0f} ns [ns]; noise up to {noise:.0f} ns")
        right.set(xscale="log", xlabel="change if left out or added: share of the larger value")
        tick_labels(right)
        figure.supxlabel("\n", fontsize=8.5)  # room for the machine
    put(figure, path)
