"""The sections of the report of a recording, as HTML.

They are verdicts, measures, energy, audit; controllers and sensors; events, values, provenance, notes, commands. Where
nothing is known, a section is empty or says so.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rig.analysis.recorded.amplitude import measured, stages
from rig.analysis.recorded.comparison import flattened
from rig.analysis.report.elements import Html, element, facts, joined, number, sketch, table
from rig.bench.live import status
from rig.errors import SceneError
from rig.printable import counted
from rig.record import statistics, user_notes
from rig.record.run import Commands, Integers, Reals, Run
from rig.record.run_data import period
from rig.scenes.explain import explain
from rig.scenes.scene import Scene
from rig.scenes.sections import values_of
from rig.view import contact, curves
from rig.view.curves import described

SHOWN = 200
"""Most events that are shown open; longer lists are folded."""
UNKNOWN = -1
"""Contact mode of a sample that a damaged recording has lost."""
_COUNTED = "contact"  # kind of events that are only counted: there may be thousands a second
_CLAMPED = 1  # status of a command (`rig.record.run.Commands`): clamped or completed
_SAFE = 2  # and: safe values
_MARKS = {"VALID": "good", "DEGRADED": "doubtful", "INVALID": "bad"}
_TERMS = {
    "drive": "supplied by the drive",
    "friction": "dissipated at the contacts",
    "bristles": "of friction: stored in the contacts",
    "heat": "of friction: turned into heat",
    "damper": "dissipated in the dampers",
    "forces": "supplied by external forces",
    "normal": "supplied through normal forces",
    "resistor": "dissipated in the resistors of the network",
    "switch": "lost where a switch interrupts a current",
    "edges": "supplied by changes of the stiffness",
    "impulses": "supplied at once: by knocks, and by changes of values",
    "stored": "change of the stored energy",
}


def plain(content: object) -> Mapping[str, Any]:
    """What a summary says under a key; nothing where an older or damaged recording has something else."""
    return content if isinstance(content, dict) else {}


def verdicts(run: Run, modes: Integers) -> Html:
    """Return what the run shows, in a few lines: damage first, then timing, then what it did, then what proves it."""
    damage = f"The recording is damaged: {run.damage}" if run.damage else ""
    fault = f"The run stopped early: {run.fault}" if run.fault != run.damage else ""
    lines = [element("li", line, class_="bad") for line in (fault, damage, run.recovered, run.untold) if line]
    word, why = timing(run)
    lines.append(element("li", element("strong", word), f" {why}", class_=_MARKS.get(word)))
    if run.window:
        lines.append(element("li", f"A window of a longer run, from {run.begin_ns * 1e-9:g} s on: {run.window}"))
    if course := ", ".join(_course(run, modes)):
        lines.append(element("li", course))
    proof = "Checksums prove every byte of the recording."
    if not run.sealed:
        proof = "No checksum proves the whole recording: it is damaged, or an older version recorded it."
    lines.append(element("li", " ".join([proof, *_residual(run)])))
    return element("ul", *lines, class_="verdicts")


def timing(run: Run) -> tuple[str, str]:
    """Return the timing verdict and its reasons, or what is known instead."""
    if run.measured:
        return "Measured", f"on a rig: {run.provenance.get('files', '')}"
    if "verdict" in run.summary:
        reasons = run.summary.get("reasons", ())
        words = "; ".join(map(str, reasons)) if isinstance(reasons, list | tuple) else ""
        return str(run.summary["verdict"]), f"timing: {words or 'no reason is stated'}"
    if run.summary:
        return "Simulated", "without a clock: there is no timing to judge"
    return "No timing verdict", "the recording has no summary of its run"


def _course(run: Run, modes: Integers) -> Iterator[str]:
    plant = plain(run.summary.get("plant"))
    length = "no sample"
    if run.span:
        length = f"{curves.end_of(run) - run.begin_ns * 1e-9:g} s"
        if not run.measured:
            length += f" at steps of {run.step_ns * 1e-6:g} ms"
    parts = (
        length,
        f"method {plant['method']}" if "method" in plant else "",
        counted(plant["events"], "event") if "events" in plant else "",
        stick(modes),
        statistics.contact(run),
        f"ended: {run.summary['ended']}" if "ended" in run.summary else "",
    )
    return filter(None, parts)


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
    rows = []
    for name, lines in parts:
        if any(lines):
            rows.append((name, joined([element("p", line) for line in lines if line])))
    return facts(rows)


def measures(run: Run, modes: Integers) -> Html:
    """Return tables of each stage: contact and events; mean, amplitude and frequency of each sensor.

    `modes`: index of the contact state at each time (rig.view.contact.NAMES), or UNKNOWN; empty if one mode does not
    define it.
    """
    begin = run.begin_ns * 1e-9
    columns = ("stage", "sensor", "mean", "amplitude", "unit", "cycles", "frequency [Hz]")
    rows = []
    for row in measured(run, begin):
        cycles = row.found.cycles
        amplitude = row.found.half if cycles else float("nan")
        frequency = row.found.frequency if cycles else row.why
        rows.append((row.stage, row.sensor, row.mean, amplitude, row.unit, cycles, frequency))
    sizes = table("Sensors: mean, and half of peak to valley as mean over the cycles", columns, rows)
    return joined((_stages(run, modes, begin), sizes))


def _stages(run: Run, modes: Integers, begin: float) -> Html:
    """The table of the stages from `begin` [s] on: mean shares of the contact, and the number of events by kind."""
    spans = stages(run, begin)
    times = [(event["t_ns"] * 1e-9, str(event["kind"])) for event in run.plant_events]
    shares: dict[str, Reals] = {}
    if modes.size:
        for i, name in enumerate(contact.NAMES):
            shares[name] = np.where(modes == UNKNOWN, np.nan, modes == i)
    if statistics.FRACTION in run.signals:
        shares["points closed"] = run.signals[statistics.FRACTION]
    rows = []
    for stage in spans:
        within = (run.time >= stage.begin) & (run.time <= stage.end)
        means = [_mean_share(share[within]) for share in shares.values()]
        last = stage is spans[-1]
        kinds = Counter(kind for t, kind in times if stage.begin <= t < stage.end or (last and t >= stage.end))
        rows.append((stage.text, stage.begin, stage.end, *means, _counts(kinds) or "none"))
    columns = ("stage", "from [s]", "to [s]", *shares, "events")
    return table("Stages: events, and mean shares of the contact", columns, rows)


def _mean_share(shares: Reals) -> str:
    known = shares[np.isfinite(shares)]
    return f"{known.mean():.1%}" if known.size else "\N{EN DASH}"


def energy(run: Run) -> Html:
    """Return the terms of the energy balance [J], and its residual in words."""
    terms = [(name, float(value), _TERMS.get(name, "")) for name, value in run.energy.items() if name != "error"]
    listed = table("Energy since the start", ("term", "energy [J]", "meaning"), terms)
    return joined((listed, *(element("p", line) for line in _residual(run))))


def audit(run: Run) -> Html:
    """Return which effects had no influence in this run and which were missing."""
    recorded = run.summary.get("audit")
    judged = [effect for effect in recorded if plain(effect)] if isinstance(recorded, list) else []
    if not judged:
        why = "the run was too short, or no shipped scene of its plant has values for the absent effects"
        return element("p", f"No effect was judged: {why}.")
    rows = []
    for effect in judged:
        share = "not judged" if effect.get("unjudged") else effect.get("share")
        words = f"{share:.2g}" if isinstance(share, int | float) else share or ""
        state = "on" if effect.get("on") else "absent"
        rows.append((effect.get("effect", ""), state, words, effect.get("like", "")))
    remarks = [element("li", effect.get("text", "")) for effect in judged if effect.get("noted")]
    if remarks:
        summary = element("ul", *remarks)
    else:
        summary = element("p", "Every judged effect had an influence, and none is missing.")
    columns = ("effect", "state", "share of the forces (limits: of the time)", "values as in scene")
    return joined((summary, table("Effects", columns, rows)))


def events(run: Run) -> Html:
    """Return the events of all processes in order. What a process other than the plant says, it says of itself."""
    shown = [event for event in run.events if event["kind"] != _COUNTED]
    rows = [(f"{event['t_ns'] * 1e-9:.6f}", event["source"], event["kind"], event["text"]) for event in shown]
    listed = table("Events", ("time [s]", "process", "kind", "text"), rows) or element("p", "No event was recorded.")
    if len(shown) > SHOWN:
        kinds = Counter(event["kind"] for event in shown)
        head = element("summary", f"{counted(len(shown), 'event')}: {_counts(kinds)}")
        listed = element("details", head, listed)
    left_out = len(run.events) - len(shown)
    if not left_out:
        return listed
    contacts = f"{counted(left_out, 'event')} of contacts (stick, slip, lift-off, contact) left out of the list."
    return joined((listed, element("p", contacts)))


def _counts(kinds: Counter[str]) -> str:
    return ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())


def values(run: Run, scene: Scene | None, why: str) -> Html:
    """Return every value of the scene with unit and origin; without a readable scene (`why`), as it was recorded."""
    if scene is not None:
        rows = []
        for row in explain(scene).values:
            unit = "" if row.unit == "1" else row.unit
            rows.append((row.key, value(row.value), unit, row.origin.origin, row.origin.note))
        return table("Values in SI units", ("key", "value", "unit", "origin", "note"), rows)
    recorded = described(run.scene)
    carried = {name: content for name, content in recorded.items() if name != "parts"}  # their text is no value
    texts = [(key, value(content)) for key, content in flattened(carried)]
    return joined((element("p", why, class_="doubtful"), table("Values as recorded", ("key", "value"), texts)))


def structure(scene: Scene | None) -> Html:
    """Return mass and contacts of a meshed structure, and what may be wrong; empty for other rigs."""
    try:
        stated = scene.stated if scene is not None else None
    except SceneError:  # the recording has no model, and the files are not there
        return Html()
    if stated is None:
        return Html()
    warnings = [element("p", f"{word}: {text}", class_="doubtful") for word, text in stated.warnings()]
    return joined((facts(stated.lines()), *warnings))


def provenance(run: Run, digest: str) -> Html:
    """Return versions, machine, command, seed and commit, and the SHA-256 that the recording states of itself."""
    known = dict(plain(run.provenance))
    if digest:
        known["SHA-256 of the recording"] = digest
    return facts((str(key), str(content)) for key, content in known.items()) or element("p", "Not recorded.")


def notes(noted: user_notes.Notes) -> Html:
    """Return the notes of users on the recording. They are stored beside it; no checksum covers them."""
    rows = []
    for note in noted.entries:
        tags = " ".join([f"#{tag}" for tag in note.tags])
        rows.append((note.date, note.text, tags))
    parts = [table("Notes", ("date", "text", "tags"), rows) or element("p", "None.")]
    if noted.other:
        parts.append(element("p", f"{counted(len(noted.other), 'note')} on another recording that had this name"))
    if noted.unreadable:
        parts.append(element("p", f"{counted(noted.unreadable, 'note')} cannot be read"))
    return joined(parts)


def commands(run: Run, log: Path) -> Html:
    """Return the commands that check and repeat the run."""
    name = shlex.quote(log.name)
    repeated = str(plain(run.provenance).get("command", ""))
    rows = [
        ("check: the same bits when it is simulated again", f"rig verify {name}"),
        ("play it back to viewers and controllers", f"rig live replay {name}"),
        ("recover what is left", f"rig recover {name}") if run.damage else ("look at it", f"rig view {name}"),
        ("the command that made it", repeated),
    ]
    return facts((what, element("code", command)) for what, command in rows if command)


def value(content: object, unit: str = "") -> str:
    """A value of a scene with its unit, in words."""
    if isinstance(content, list | tuple):
        return ", ".join(value(part, unit) for part in content)
    if isinstance(content, bool):
        return "yes" if content else "no"
    words = number(content) if isinstance(content, int | float) else str(content)
    return f"{words} {unit}".strip() if unit != "1" else words


def settings(section: Any, recorded: object) -> Iterator[tuple[str, str]]:
    """Return the settings of an instrument or a controller with units; without its section, as they were recorded."""
    if section is None:
        known = [(key, (set_to, "")) for key, set_to in plain(recorded).items() if set_to is not None]
    else:
        known = [*values_of(section)]
    for key, (set_to, unit) in known:
        yield str(key), value(set_to, unit)


def controllers(run: Run, scene: Scene | None) -> Html:
    """Return each controller with its settings, its numbers from the design, and what happened to its commands."""
    recorded = plain(described(run.scene).get("controllers"))
    counts = plain(run.summary.get("loop", run.summary.get("exchange")))
    parts = []
    for name in dict.fromkeys((*run.commands, *run.controllers, *recorded)):
        section = scene.controllers.get(name) if scene else None
        controller = plain(run.controllers.get(name))
        rows = [*settings(section, recorded.get(name) or controller.get("section"))]
        for key, constant in plain(controller.get("numbers")).items():
            rows.append((f"{key} (design)", value(constant)))
        rows += _loop(run, name, plain(counts.get(name)))
        parts.append(element("h3", name))
        parts.append(facts(rows))
    return joined(parts) or element("p", "No controller took part.")


def _loop(run: Run, name: str, counts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if (commands := run.commands.get(name)) is not None:
        yield "commands", str(commands.tick.size)
        if commands.tick.size:
            yield from _delays(commands, run.frame_ns)
    for key, count in counts.items():
        if key != "taken" and isinstance(count, int) and count:
            yield str(key).replace("_", " "), str(count)
    trip = plain(run.summary.get("round_trip"))
    if trip.get("max"):
        times = [f"{float(trip[quantile]) / 1e3:.2f}" for quantile in ("p50", "p99", "max") if quantile in trip]
        yield "latency", f"{' / '.join(times)} ms from step to command (p50, p99, worst; all controllers)"
    for topic, count in plain(run.summary.get("lost")).items():
        if str(topic).endswith(f" to {name}"):
            yield "lost", f"{count} of {topic}"


def _delays(commands: Commands, frame_ns: int) -> Iterator[tuple[str, str]]:
    """What the recorded commands themselves say."""
    answers = commands.status != _SAFE
    if answers.any():
        age = (commands.tick - commands.answered)[answers]
        ages = f"{age.mean():.3g} frames of {frame_ns * 1e-6:g} ms on average, {age.max()} at most"
        yield "age of a command", f"{ages}, from its measurement to its effect"
    yield "clamped or completed", str(np.count_nonzero(commands.status == _CLAMPED))
    yield "safe values", f"{counted(int(np.count_nonzero(~answers)), 'command')}"
    ends = [f"{number(float(v.min()))} to {number(float(v.max()))}" for v in commands.values.T]
    yield "range of the commands", "; ".join(ends)


def sensors(run: Run, scene: Scene | None, marks: list[float]) -> Html:
    """Return a table of all sensors, and each with its curve and its settings. `marks`: begins of stages [s]."""
    if not run.measurements:
        return element("p", "No sensor was recorded.")
    recorded = plain(described(run.scene).get("sensors"))
    counts_of = plain(run.summary.get("sensors"))
    last = [float(t_ns[-1]) * 1e-9 for t_ns, _ in run.measurements.values() if t_ns.size]
    end = max([curves.end_of(run), *last])
    begin = run.begin_ns * 1e-9
    rows = []
    cards = []
    for name, (t_ns, v) in run.measurements.items():
        raw = plain(recorded.get(name))
        counts = plain(counts_of.get(name))
        unit = run.units.get(f"meas/{name}", "")
        step = period(t_ns)
        rate = 1e9 / step if step else float("nan")
        known = v[np.isfinite(v)]
        if known.size:
            low = float(known.min())
            high = float(known.max())
            words = f"{number(low)} to {value(high, unit)}"
        else:
            low = high = float("nan")
            words = "no sample"
        setup = (name, str(raw.get("kind", "")), str(raw.get("reads", "")), unit, rate)
        faults = (counts.get("clipped", ""), counts.get("dropped_out", ""))
        rows.append((*setup, v.size, low, high, *faults))
        curve = sketch(t_ns, v, (begin, end), marks, f"{name} from {begin:g} to {end:g} s: {words}")
        caption = element("figcaption", element("strong", name), f" {words}")
        section = scene.sensors.get(name) if scene else None
        fields = element("details", element("summary", "settings"), facts(settings(section, raw)))
        cards.append(element("figure", caption, curve, fields))
    columns = ("sensor", "kind", "reads", "unit", "rate [Hz]", "samples", "lowest", "highest", "clipped", "dropped out")
    return joined((table("What each sensor delivered", columns, rows), element("div", *cards, class_="cards")))
