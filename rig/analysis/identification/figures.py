"""The figure of an identification: mean cycles with band and model, residuals over the phase, measures, predictions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.identification.answer import Identified, RunFit, phases
from rig.analysis.identification.cycles import BINS, CycleRun
from rig.analysis.identification.features import lines, responses
from rig.analysis.identification.slips import MEASURES
from rig.printable import counted
from rig.view.curves import largest, plain, scaled
from rig.view.palette import BLUE, GREY, VERMILION, headline, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 6  # runs that are drawn


def identified_figure(identified: Identified) -> Figure:
    """Return the figure of an identification by its best law."""
    best = identified.best
    runs = best.runs[:_MOST]
    cycles = any(isinstance(run.evidence, CycleRun) for run in best.runs)
    rows = 2 if best.repeats and cycles else 1
    with page(3.6 * max(len(runs), 2), 0.5 + 3.0 * (rows + cycles), layout="constrained") as figure:
        law = f", law {best.law.name}" if best.law.name else ""
        state = "" if best.fits else ": does not fit"
        headline(figure, f"{identified.task.scene.name}: {counted(len(best.runs), 'run')}{law}{state}")
        grid = figure.add_gridspec(rows + cycles, len(runs))
        for i, run in enumerate(runs):
            mean = figure.add_subplot(grid[0, i])
            _mean(mean, run, best.repeats)
            if best.repeats and isinstance(run.evidence, CycleRun):
                _residual(figure.add_subplot(grid[1, i], sharex=mean), run)
        if cycles:
            _measures(figure.add_subplot(grid[rows, :]), [*best.runs, *best.predicted], identified)
    return figure


def _mean(axes: Axes, run: RunFit, repeats: bool) -> None:
    """The first column over the phase: mean cycle with the band of one standard deviation, and the model."""
    column = run.evidence.run.columns[0]
    if not isinstance(run.evidence, CycleRun):
        (_features if run.evidence.run.input is None else _response)(axes, run)
        return
    t, mean, spread, model = next(phases(run))
    factor, unit = scaled(column.unit, largest(mean))
    band = factor * (mean - spread), factor * (mean + spread)
    axes.fill_between(t, *band, color=BLUE, alpha=0.25, lw=0, label="standard deviation")
    axes.plot(t, factor * mean, color=BLUE, lw=1.2, label="measured")
    if repeats:
        axes.plot(t, factor * model, color=VERMILION, lw=1.0, ls="--", label="model")
    axes.set_title(run.name, fontsize=9)
    axes.set(xlabel="phase [1]", ylabel=f"{plain(column.output)} [{unit}]")
    axes.legend(fontsize=7)


def _features(axes: Axes, run: RunFit) -> None:
    """Measured features over those of the model, relative to their size."""
    measured = np.concatenate(run.evidence.values)
    errors = np.concatenate(run.evidence.errors)
    left = run.left.ravel()[: measured.size]
    size = np.maximum(np.abs(measured), 1e-300)
    percent = 100.0 * left * errors / size
    axes.errorbar(range(measured.size), percent, 196.0 * errors / size, fmt="o", color=BLUE, markersize=3)
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.set_xticks(range(measured.size) if measured.size < 10 else range(0, measured.size, measured.size // 5))
    axes.set(title=run.name, xlabel="number of the feature [1]", ylabel="measured - model [%]")


def _response(axes: Axes, run: RunFit) -> None:
    """The frequency response of the first column, measured and of the model."""
    evidence = run.evidence
    column = evidence.run.columns[0]
    f, drive, _ = lines(evidence.run.input, column, column.v)
    measured = evidence.values[0]
    model = measured - run.left[:, : measured.shape[1]] * evidence.errors[0]
    for v, colour, label in ((measured, BLUE, "measured"), (model, VERMILION, "model")):
        Z = np.ascontiguousarray(v).view(complex)
        axes.loglog(f, np.abs(responses(drive, Z)), color=colour, lw=1, label=label)
    unit = f"{column.unit} over {evidence.run.input.unit}"
    axes.set(title=run.name, xlabel="frequency [Hz]", ylabel=f"{plain(column.output)} [{unit}]")
    axes.legend(fontsize=7)


def _residual(axes: Axes, run: RunFit) -> None:
    """The mean residual over the noise, with the error of the mean in each phase."""
    width = run.evidence.samples[0].shape[1]
    left = run.left[:, :width]
    t = run.evidence.times[0].mean(axis=0) / run.evidence.period
    axes.plot(t, left.mean(axis=0), color=GREY, lw=0.8)
    pieces = np.array_split(left, BINS, axis=1)
    at = [float(part.mean()) for part in np.array_split(t, BINS)]
    means = np.array([piece.mean(axis=1) for piece in pieces])
    bar = 1.96 * means.std(axis=1, ddof=1) / math.sqrt(len(left))
    axes.errorbar(at, means.mean(axis=1), bar, fmt="o", color=VERMILION, markersize=4, capsize=3)
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.set(xlabel="phase [1]", ylabel="residual over noise [1]")


def _measures(axes: Axes, runs: list[RunFit], identified: Identified) -> None:
    """Measured over modelled measures of each run; with bars of 95 % where a run is predicted or deviates."""
    names = MEASURES[:4]
    deviation = identified.best.deviation
    marks = "osD^"
    for k, name in enumerate(names):
        for i, run in enumerate(runs):
            if run.response is None or not isinstance(run.evidence, CycleRun):
                continue
            ratio = math.exp(float(run.measures[k] - run.model[k]))
            predicted = i >= len(identified.best.runs)
            half = float(run.band[k])
            if not predicted:
                error = float(run.evidence.covariance(identified.task.seed)[k, k])
                half = 1.96 * math.sqrt(float(deviation[k]) ** 2 + error)
            bar = [[ratio - ratio * math.exp(-half)], [ratio * math.exp(half) - ratio]]
            axes.errorbar(
                [i + 0.15 * (k - 1.5)],
                [ratio],
                bar,
                fmt=marks[k],
                markersize=4,
                capsize=2,
                color=VERMILION if predicted else BLUE,
                label=name if i == 0 else None,
            )
    axes.axhline(1.0, color=GREY, lw=0.8)
    labels = [run.name + (" (not fitted)" if i >= len(identified.best.runs) else "") for i, run in enumerate(runs)]
    axes.set_xticks(range(len(runs)), labels, fontsize=8)
    axes.set(xlabel="run", ylabel="measured over model [1]")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=7, ncols=4)
