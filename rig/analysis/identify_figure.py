"""The measurements of an identification experiment as a picture, with the model that was fitted to them."""

from __future__ import annotations

from pathlib import Path

from rig.analysis.identify import Identified
from rig.view.palette import BLUE, VERMILION
from rig.view.run_figure import STYLE
from rig.view.save_figure import put

_MEASURED, _MODEL = BLUE, VERMILION


def draw(found: Identified, path: Path | str) -> None:
    """Draw `found` into the file `path` (PNG, SVG or PDF by its suffix).

    The title has the identified parameters. Raises rig.errors.OutputError if the file cannot be written.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    fit = found.fit
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(7.0, 4.2), dpi=125, facecolor="white", layout="constrained")
        FigureCanvasAgg(figure)
        values = ", ".join(f"{one.key} = {one.found:.4g}{_unit(one.unit)}" for one in found.parameters)
        figure.suptitle(f"{found.scene}: {found.experiment}\n{values}", ha="center")
        axes = figure.add_subplot()
        axes.plot(fit.x, fit.y, "o", color=_MEASURED, markersize=3, label="measured")
        axes.plot(fit.model_x, fit.model_y, color=_MODEL, linewidth=1.2, label="fitted")
        axes.set_xlabel(fit.x_name)
        axes.set_ylabel(fit.y_name)
        axes.legend()
        put(figure, path)


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"
