"""The caption of a figure: what the run was, and how it went."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rig.record.run import Integers, Run
from rig.view import timeline

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def scene_of(run: Run) -> dict[str, Any]:
    """The scene of a run from its JSON text; empty if the text is no JSON object."""
    try:
        found = json.loads(run.scene)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def caption(axes: Axes, run: Run, modes: Integers) -> None:
    """Write the caption of `run`; the stick share comes from `modes`, the contact states [contact, row]."""
    axes.set_axis_off()
    rows = [("scene", scene_of(run).get("name", "")), *_rows(run, modes)]
    for i, (name, text) in enumerate(rows):
        y = 1.0 - i / 6.2
        axes.text(-0.04, y, name, transform=axes.transAxes, ha="right", va="top", fontsize=9.5, color="#777777")
        axes.text(0.0, y, text, transform=axes.transAxes, va="top", fontsize=9.5, color="#111111")


def _rows(run: Run, modes: Integers) -> list[tuple[str, str]]:
    """Rows (name, text) of the caption."""
    summary = run.summary
    plant = summary.get("plant", {}) if isinstance(summary.get("plant"), dict) else {}
    steps = f"{run.step_ns / 1e6:g} ms"
    rows = [("integration", f"{plant.get('method', 'unknown')}, {steps} samples, {plant.get('events', 0)} events")]
    if modes.size:
        mean = f", mean of {len(modes)} contacts" if len(modes) > 1 else ""
        rows.append(("stick share", f"{(modes == 0).mean():.1%} of {timeline.end_of(run):g} s{mean}"))
    if run.energy:
        supplied = run.energy.get("drive", run.energy.get("supplied", 0.0))
        rows.append(("energy", f"{supplied:.4g} J from the drive, residual {abs(run.energy.get('error', 0.0)):.0e}"))
    timing = summary.get("timing", {})
    if "verdict" in summary:
        worst = f", worst frame {timing['worst_us'] / 1e3:.3g} ms late" if timing else ""
        rows.append(("timing", f"{summary['verdict']}{worst}"))
    else:
        rows.append(("timing", "simulated without a clock"))
    if provenance := {k: run.provenance[k] for k in ("commit", "version") if run.provenance.get(k)}:
        rows.append(("made with", ", ".join(f"{k} {v[:12]}" for k, v in provenance.items())))
    return rows
