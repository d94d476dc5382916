"""The measurements of an identification experiment as a picture, with the model that was fitted to them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.analysis.identify import Identified
from rig.view.palette import BLUE, VERMILION
from rig.view.run_figure import STYLE
from rig.view.save_figure import page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MEASURED, _MODEL = BLUE, VERMILION


def figure(found: Identified) -> Figure:
    """Return the figure of `found`; its title has the identified parameters."""
    fit = found.fit
    with page(STYLE, 7.0, 4.2, layout="constrained") as figure:
        values = ", ".join(f"{one.key} = {one.found:.4g}{_unit(one.unit)}" for one in found.parameters)
        figure.suptitle(f"{found.scene}: {found.experiment}\n{values}", ha="center")
        axes = figure.add_subplot()
        axes.plot(fit.x, fit.y, "o", color=_MEASURED, markersize=3, label="measured")
        axes.plot(fit.model_x, fit.model_y, color=_MODEL, linewidth=1.2, label="fitted")
        axes.set_xlabel(fit.x_name)
        axes.set_ylabel(fit.y_name)
        axes.legend()
    return figure


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"
