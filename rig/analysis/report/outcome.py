"""How a run went: damage, timing verdict, what it did; measures of each stage; energy balance; audit of its effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rig.analysis import amplitude
from rig.analysis.report.html import Html, element, facts, joined, table
from rig.bench import status
from rig.printable import counted
from rig.record import statistics
from rig.record.run import Integers, Reals, Run
from rig.view import contact, timeline

_TERMS = {
    "drive": "supplied by the drive",
    "friction": "dissipated at the contacts",
    "damper": "dissipated in the dampers",
    "forces": "supplied by external forces",
    "normal": "supplied through normal forces",
    "resistor": "dissipated in the resistors of the network",
    "switch": "lost where a switch interrupts a current",
    "edges": "supplied by changes of the stiffness",
    "impulses": "supplied at once: by knocks, and by changes of values",
    "stored": "change of the stored energy",
}
UNKNOWN = -1
"""Contact mode of a sample that a damaged recording has lost."""
_MARKS = {"VALID": "good", "DEGRADED": "doubtful", "INVALID": "bad"}


def plain(found: object) -> Mapping[str, Any]:
    """What a summary says under a key; nothing where an older or damaged recording has something else."""
    return found if isinstance(found, dict) else {}


def verdicts(run: Run, modes: Integers) -> Html:
    """Return what the run shows, in a few lines: damage first, then timing, then what it did, then what proves it."""
    damage = f"The recording is damaged: {run.damage}" if run.damage else ""
    lost = [line for line in (damage, run.recovered, run.untold) if line]
    if run.fault != run.damage:
        lost.insert(0, f"The run stopped early: {run.fault}")
    lines = [element("li", line, class_="bad") for line in lost]
    word, why = timing(run)
    lines.append(element("li", element("strong", word), f" {why}", class_=_MARKS.get(word)))
    if run.window:
        lines.append(element("li", f"A window of a longer run, from {run.begin_ns * 1e-9:g} s on: {run.window}"))
    lines.append(element("li", ", ".join(_course(run, modes))))
    proof = "Checksums prove every byte of the recording."
    if not run.sealed:
        proof = "No checksum proves the whole recording: it is damaged, or an older version recorded it."
    lines.append(element("li", " ".join([proof, *_residual(run)])))
    return element("ul", *lines, class_="verdicts")


def timing(run: Run) -> tuple[str, str]:
    """Return the timing verdict and its reasons, or what is known instead."""
    if "verdict" in run.summary:
        reasons = run.summary.get("reasons", ())
        words = "; ".join(map(str, reasons if isinstance(reasons, list | tuple) else ()))
        return str(run.summary["verdict"]), f"timing: {words or 'no reason is stated'}"
    if run.summary:
        return "Simulated", "without a clock: there is no timing to judge"
    return "No timing verdict", "the recording has no summary of its run"


def _course(run: Run, modes: Integers) -> Iterator[str]:
    plant = plain(run.summary.get("plant"))
    length = timeline.end_of(run) - run.begin_ns * 1e-9
    yield f"{length:g} s at steps of {run.step_ns * 1e-6:g} ms" if run.time.size else "no sample"
    if "method" in plant:
        yield f"method {plant['method']}"
    if "events" in plant:
        yield counted(plant["events"], "event")
    if share := stick(modes):
        yield share
    if points := statistics.contact(run):
        yield points
    if "ended" in run.summary:
        yield f"ended: {run.summary['ended']}"


def stick(modes: Integers) -> str:
    """Return the share of time in stick in words; "" if no contact state is known."""
    known = modes[modes != UNKNOWN]
    return f"stick {np.mean(known == 0):.1%} of the time" if known.size else ""


def _residual(run: Run) -> list[str]:
    if "error" not in run.energy:
        return []
    return [f"Residual of the energy balance: {abs(run.energy['error']):.1e} of its largest term."]


def course(run: Run) -> Html:
    """Return the summary that the run printed at its end: clock, loop, losses, refused messages. Nothing without it."""
    try:
        parts = status.parts({**run.summary, "energy": run.energy, "fault": run.fault})
    except (KeyError, TypeError, AttributeError):  # simulated, or the summary of an older version
        return Html()
    return facts((name, joined(element("p", line) for line in lines if line)) for name, lines in parts if any(lines))


def measures(run: Run, modes: Integers) -> Html:
    """Return tables of each stage: contact and events; mean, amplitude and frequency of each sensor.

    `modes`: index of the contact state at each time (rig.view.contact.NAMES), or UNKNOWN; empty if one mode does not
    define it.
    """
    begin = run.begin_ns * 1e-9
    spans = amplitude.stages(run, begin)
    told = [(event["t_ns"] * 1e-9, str(event["kind"])) for event in run.plant_events]
    named = enumerate(contact.NAMES) if modes.size else ()
    shares = {name: np.where(modes == UNKNOWN, np.nan, modes == i) for i, name in named}
    if statistics.FRACTION in run.signals:
        shares["points closed"] = run.signals[statistics.FRACTION]
    rows = []
    for stage in spans:
        here = (run.time >= stage.begin) & (run.time <= stage.end)
        last = stage is spans[-1]
        kinds = Counter(kind for t, kind in told if stage.begin <= t < stage.end or (last and t >= stage.end))
        words = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())
        rows.append((stage.text, stage.begin, stage.end, *(_mean(v[here]) for v in shares.values()), words or "none"))
    columns = ("stage", "from [s]", "to [s]", *shares, "events")
    found = [
        (row.stage, row.sensor, row.mean, row.found.half if row.found.cycles else float("nan"), row.unit,
         row.found.cycles, row.found.frequency)
        for row in amplitude.measured(run, begin)
    ]  # fmt: skip
    names = ("stage", "sensor", "mean", "amplitude", "unit", "cycles", "frequency [Hz]")
    return joined(
        (
            table("Stages: events, and mean shares of the contact", columns, rows),
            table("Sensors: mean, and half of peak to valley as mean over the cycles", names, found),
        )
    )


def _mean(shares: Reals) -> str:
    known = shares[np.isfinite(shares)]
    return f"{known.mean():.1%}" if known.size else "\N{EN DASH}"


def energy(run: Run) -> Html:
    """Return the terms of the energy balance [J], and its residual in words."""
    terms = [(name, float(value), _TERMS.get(name, "")) for name, value in run.energy.items() if name != "error"]
    found = table("Energy since the start", ("term", "energy [J]", "meaning"), terms)
    return joined((found, *(element("p", line) for line in _residual(run))))


def audit(run: Run) -> Html:
    """Return which effects had no influence in this run and which were missing."""
    found = run.summary.get("audit")
    judged = [one for one in found if plain(one)] if isinstance(found, list) else []
    remarks = [element("li", one.get("text", "")) for one in judged if one.get("noted")]
    rows = [
        (one.get("effect", ""), "on" if one.get("on") else "absent", _share(one.get("share")), one.get("like", ""))
        for one in judged
    ]
    if not judged:
        why = "the run was too short, or no shipped scene of its plant has values for the absent effects"
        return element("p", f"No effect was judged: {why}.")
    return joined(
        (
            element("ul", *remarks)
            if remarks
            else element("p", "Every judged effect had an influence, and none is missing."),
            table("Effects", ("effect", "state", "share of the forces", "values as in scene"), rows),
        )
    )


def _share(value: object) -> str:
    return f"{value:.2g}" if isinstance(value, int | float) else ""
