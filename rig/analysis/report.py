"""A recording as one page of HTML that is self-contained: no script, no request to any host.

elements  HTML, with every text escaped, unless an element of this module made it
sketch    a small curve over time as SVG, in the colour of the text around it
sections  verdicts, measures, energy, audit; controllers and sensors; events, values, provenance, notes, commands
page      the page: its head, and its sections in order
"""

from __future__ import annotations

import base64
import io
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rig.analysis.recorded.amplitude import measured, stages
from rig.analysis.recorded.comparison import flattened
from rig.bench.live import status
from rig.errors import LogError, RigError
from rig.machine.files import write_file
from rig.printable import counted
from rig.record import statistics, user_notes
from rig.record.contents import digest
from rig.record.run import Commands, Integers, Reals, Run
from rig.record.run_data import period
from rig.record.statistics import FRACTION
from rig.record.user_notes import Notes
from rig.results import Result
from rig.scenes.explain import explain
from rig.scenes.scene import Scene
from rig.scenes.sections import values_of
from rig.view import contact, curves
from rig.view.curves import described

_EMPTY = frozenset({"img", "meta"})
# What UTF-8 or HTML cannot contain, and what changes the direction of the text after it
_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\u202a-\u202e\u2066-\u2069\ufffe\uffff]")
COLUMNS = 480
"""Columns of a curve: in each of them it reaches from its lowest to its highest sample."""
HEIGHT = 100
_GAP = 1.5  # longest distance of neighbouring samples without a gap, in median distances
SHOWN = 200
"""Most events that are shown open; longer lists are folded."""
_COUNTED = "contact"  # kind of events that are only counted: there may be thousands a second
_CLAMPED, _SAFE = 1, 2  # status of a command (`rig.record.run.Commands`)
UNKNOWN = -1
"""Contact mode of a sample that a damaged recording has lost."""
_MARKS = {"VALID": "good", "DEGRADED": "doubtful", "INVALID": "bad"}
# What the page may load: nothing. A browser then refuses what an escaped text must not have become.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def text(content: object) -> Html:
    """Return a text as HTML: escaped, characters that cannot be shown replaced."""
    return content if isinstance(content, Html) else Html(escape(_UNPRINTABLE.sub("\ufffd", str(content))))


def element(name: str, /, *contents: object, **attributes: object) -> Html:
    """Return an element with its contents. An attribute None is left out; `class_` is class."""
    given = ((key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items() if value is not None)
    opening = "".join([name, *(f' {key}="{text(str(value))}"' for key, value in given)])
    return Html(f"<{opening}>" if name in _EMPTY else f"<{opening}>{''.join(map(text, contents))}</{name}>")


def joined(parts: Iterable[object]) -> Html:
    """Return several parts in a row."""
    return Html("".join(map(text, parts)))


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Html:
    """Return a table with a caption. It scrolls by itself where it is wider than the page.

    The first column names the row. Without rows the result is empty.
    """
    body = [element("tr", element("th", first, scope="row"), *map(_cell, others)) for first, *others in rows]
    if not body:
        return Html()
    head = element("tr", *(element("th", column, scope="col") for column in columns))
    made = element("table", element("caption", title), element("thead", head), element("tbody", *body))
    return element("div", made, class_="wide", role="region", tabindex=0, aria_label=title)


def _cell(content: object) -> Html:
    if isinstance(content, float | int) and not isinstance(content, bool):
        return element("td", number(content), class_="number")
    return element("td", "yes" if content is True else "no" if content is False else content)


def number(value: float) -> str:
    """A number with six significant digits; a whole number in full; a dash for one that is not known."""
    if isinstance(value, int):
        return str(value)
    return "\N{EN DASH}" if value != value else f"{value:.6g}"


def facts(rows: Iterable[tuple[str, object]]) -> Html:
    """Return names and what is known under them; without rows the result is empty."""
    terms = joined(joined((element("dt", name), element("dd", what))) for name, what in rows)
    return element("dl", terms) if terms else Html()


def sketch(t_ns: Integers, v: Reals, span: tuple[float, float], marks: list[float], label: str) -> Html:
    """Draw samples `v` at `t_ns` within a `span` [s]: fast vibration as a band, a gap where there is no sample.

    `marks`: times of vertical lines [s]; `label` says in words what is drawn. Nothing for samples that are not numbers.
    """
    here = np.isfinite(v)
    t, v, (begin, end) = t_ns[here] * 1e-9, v[here], span
    if not v.size or end <= begin:
        return Html()
    order = np.argsort(t, kind="stable")
    x, v = COLUMNS * np.clip((t[order] - begin) / (end - begin), 0.0, 1.0), v[order]
    low, high = float(v.min()), float(v.max())
    y = HEIGHT * (0.96 - 0.92 * (v - low) / (high - low)) if high > low else np.full(v.size, 0.5 * HEIGHT)
    inside = [COLUMNS * (mark - begin) / (end - begin) for mark in marks if begin < mark < end]
    lines = [element("path", d=f"M{at:.1f} 0V{HEIGHT}", class_="mark") for at in inside]
    lines.append(element("path", d="".join(_pieces(x, y)), class_="line"))
    box = f"0 0 {COLUMNS} {HEIGHT}"
    return element("svg", *lines, viewBox=box, preserveAspectRatio="none", role="img", aria_label=label)


def _pieces(x: Reals, y: Reals) -> Iterator[str]:
    """The paths between gaps that are wider than a column; of many samples the lowest and highest in each column."""
    steps = np.diff(x)
    longest = max(_GAP * float(np.median(steps)), 1.0) if x.size > 2 else np.inf
    for a, b in pairwise([0, *(np.flatnonzero(steps > longest) + 1).tolist(), x.size]):
        at, ends = x[a:b], y[a:b]
        if x.size > 2 * COLUMNS:
            column = np.minimum(at.astype(np.int64), COLUMNS - 1)
            first = np.flatnonzero(np.diff(column, prepend=-1))
            at = np.repeat(column[first] + 0.5, 2)
            ends = np.stack([np.minimum.reduceat(ends, first), np.maximum.reduceat(ends, first)], axis=1).ravel()
        points = "L".join(f"{u:.1f} {v:.1f}" for u, v in zip(at.tolist(), ends.tolist()))
        yield f"M{points}" if at.size > 1 else f"M{points}h1"


LOOK = Path(__file__).with_name("look.css")
"""The style sheet of reports and of the page of `rig web`."""
_STYLE = """
body { margin: 0 auto; padding: 1rem; max-width: 76rem; }
body > header, main, nav { margin: 0 0 .9rem; }
h1 { font-size: 1.5rem; }
p, header { max-width: 75ch; }
nav a, .skip { display: inline-block; margin-right: 1rem; min-height: 24px; }
.skip:not(:focus) { position: absolute; left: -99rem; }
.bad { font-weight: 600; white-space: pre-line; }
.verdicts { padding-left: 1.2rem; margin: 0; }
.wide { overflow-x: auto; }
.wide > img { display: block; width: 100%; min-width: 44rem; height: auto; }
table { overflow-wrap: break-word; }
th, td { padding-right: .8rem; border-bottom: 1px solid var(--line); max-width: 46ch; }
dl { display: grid; grid-template-columns: minmax(9rem, max-content) 1fr; gap: .15rem 1rem; margin: 0; }
dd p { max-width: none; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 24rem), 1fr)); gap: .9rem; }
.cards figure { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: .6rem; }
svg { display: block; width: 100%; height: 6rem; margin: .4rem 0; color: var(--curve); }
.line, .mark { vector-effect: non-scaling-stroke; stroke: currentColor; fill: none; }
.mark { stroke: var(--soft); stroke-dasharray: 4 3; }
@media (max-width: 40rem) {
  dl { grid-template-columns: 1fr; }
  dd { margin-bottom: .4rem; }
}
@media print {
  body { max-width: none; font-size: 10pt; background: none; }
  nav, .skip { display: none; }
  .card { border: 0; padding: 0; }
  .wide { overflow: visible; }
  .wide > img { min-width: 0; }
  h2, h3 { break-after: avoid; }
  figure, tr { break-inside: avoid; }
}
"""


def events(run: Run) -> Html:
    """Return the events of all processes in order. What a process other than the plant says, it says of itself."""
    shown = [event for event in run.events if event["kind"] != _COUNTED]
    rows = [(f"{event['t_ns'] * 1e-9:.6f}", event["source"], event["kind"], event["text"]) for event in shown]
    listed = table("Events", ("time [s]", "process", "kind", "text"), rows) or element("p", "No event was recorded.")
    if len(shown) > SHOWN:
        kinds = ", ".join(f"{kind} {count}" for kind, count in Counter(event["kind"] for event in shown).most_common())
        listed = element("details", element("summary", f"{counted(len(shown), 'event')}: {kinds}"), listed)
    count = len(run.events) - len(shown)
    contacts = f"{counted(count, 'event')} of contacts (stick, slip, lift-off, contact) left out of the list."
    return joined((listed, element("p", contacts) if count else ""))


def values(run: Run, scene: Scene | None, why: str) -> Html:
    """Return every value of the scene with unit and origin; without a readable scene (`why`), as it was recorded."""
    if scene is not None:
        rows = [
            (row.key, value(row.value), "" if row.unit == "1" else row.unit, row.origin.origin, row.origin.note)
            for row in explain(scene).values
        ]
        return table("Values in SI units", ("key", "value", "unit", "origin", "note"), rows)
    carried = {
        name: content for name, content in described(run.scene).items() if name != "parts"
    }  # their text is no value
    texts = [(key, value(content)) for key, content in flattened(carried)]
    return joined((element("p", why, class_="doubtful"), table("Values as recorded", ("key", "value"), texts)))


def provenance(run: Run, digest: str) -> Html:
    """Return versions, machine, command, seed and commit, and the SHA-256 that the recording states of itself."""
    known = dict(plain(run.provenance)) | ({"SHA-256 of the recording": digest} if digest else {})
    return facts((str(key), str(content)) for key, content in known.items()) or element("p", "Not recorded.")


def notes(noted: user_notes.Notes) -> Html:
    """Return the notes of users on the recording. They are stored beside it; no checksum covers them."""
    rows = [(note.date, note.text, " ".join(f"#{tag}" for tag in note.tags)) for note in noted.found]
    odd = [(len(noted.other), "on another recording that had this name"), (noted.unreadable, "cannot be read")]
    lines = (element("p", f"{counted(count, 'note')} {what}") for count, what in odd if count)
    return joined((table("Notes", ("date", "text", "tags"), rows) or element("p", "None."), *lines))


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
    known = ((key, (set_to, "")) for key, set_to in plain(recorded).items() if set_to is not None)
    return ((str(key), value(*set_to)) for key, set_to in (known if section is None else values_of(section)))


def controllers(run: Run, scene: Scene | None) -> Html:
    """Return each controller with its settings, its numbers from the design, and what happened to its commands."""
    recorded = plain(described(run.scene).get("controllers"))
    counted = plain(run.summary.get("loop", run.summary.get("exchange")))
    parts = []
    for name in dict.fromkeys((*run.commands, *run.controllers, *recorded)):
        section = scene.controllers.get(name) if scene else None
        own = plain(run.controllers.get(name))
        numbers = plain(own.get("numbers"))
        rows = [*settings(section, recorded.get(name) or own.get("section"))]
        rows += [(f"{key} (design)", value(constant)) for key, constant in numbers.items()]
        rows += _loop(run, name, plain(counted.get(name)))
        parts.append(joined((element("h3", name), facts(rows))))
    return joined(parts) or element("p", "No controller took part.")


def _loop(run: Run, name: str, counts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if (commands := run.commands.get(name)) is not None:
        yield "commands", str(commands.tick.size)
        if commands.tick.size:
            yield from _delays(commands, run.frame_ns)
    known = ((key, count) for key, count in counts.items() if key != "taken" and isinstance(count, int) and count)
    yield from ((str(key).replace("_", " "), str(count)) for key, count in known)
    trip = plain(run.summary.get("round_trip"))
    if trip.get("max"):
        times = (f"{float(trip[quantile]) / 1e3:.2f}" for quantile in ("p50", "p99", "max") if quantile in trip)
        yield "latency", f"{' / '.join(times)} ms from step to command (p50, p99, worst; all controllers)"
    lost = plain(run.summary.get("lost")).items()
    yield from (("lost", f"{count} of {topic}") for topic, count in lost if str(topic).endswith(f" to {name}"))


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
    recorded, counted = plain(described(run.scene).get("sensors")), plain(run.summary.get("sensors"))
    end = max([curves.end_of(run), *(float(t_ns[-1]) * 1e-9 for t_ns, _ in run.measurements.values() if t_ns.size)])
    begin = run.begin_ns * 1e-9
    rows, cards = [], []
    for name, (t_ns, v) in run.measurements.items():
        section = scene.sensors.get(name) if scene else None
        raw, counts, unit = plain(recorded.get(name)), plain(counted.get(name)), run.units.get(f"meas/{name}", "")
        known = v[np.isfinite(v)]
        ends = (float(known.min()), float(known.max())) if known.size else (float("nan"),) * 2
        rate = 1e9 / step if (step := period(t_ns)) else float("nan")
        rows.append((name, str(raw.get("kind", "")), str(raw.get("reads", "")), unit, rate, v.size, *ends,
                     counts.get("clipped", ""), counts.get("dropped_out", "")))  # fmt: skip
        words = f"{number(ends[0])} to {value(ends[1], unit)}" if known.size else "no sample"
        curve = sketch(t_ns, v, (begin, end), marks, f"{name} from {begin:g} to {end:g} s: {words}")
        caption = element("figcaption", element("strong", name), f" {words}")
        fields = element("details", element("summary", "settings"), facts(settings(section, raw)))
        cards.append(element("figure", caption, curve, fields))
    columns = ("sensor", "kind", "reads", "unit", "rate [Hz]", "samples", "lowest", "highest", "clipped", "dropped out")
    return joined((table("What each sensor delivered", columns, rows), element("div", *cards, class_="cards")))


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
    word, why = timing(run)
    window = f"A window of a longer run, from {run.begin_ns * 1e-9:g} s on: {run.window}" if run.window else ""
    proof = "Checksums prove every byte of the recording."
    if not run.sealed:
        proof = "No checksum proves the whole recording: it is damaged, or an older version recorded it."
    course, proofs = ", ".join(_course(run, modes)), " ".join([proof, *_residual(run)])
    return element(
        "ul",
        *(element("li", line, class_="bad") for line in (fault, damage, run.recovered, run.untold) if line),
        element("li", element("strong", word), f" {why}", class_=_MARKS.get(word)),
        *(element("li", line) for line in (window, course, proofs) if line),
        class_="verdicts",
    )


def timing(run: Run) -> tuple[str, str]:
    """Return the timing verdict and its reasons, or what is known instead."""
    if run.measured:
        return "Measured", f"on a rig: {run.provenance.get('files', '')}"
    if "verdict" in run.summary:
        reasons = run.summary.get("reasons", ())
        words = "; ".join(map(str, reasons if isinstance(reasons, list | tuple) else ()))
        return str(run.summary["verdict"]), f"timing: {words or 'no reason is stated'}"
    if run.summary:
        return "Simulated", "without a clock: there is no timing to judge"
    return "No timing verdict", "the recording has no summary of its run"


def _course(run: Run, modes: Integers) -> Iterator[str]:
    plant = plain(run.summary.get("plant"))
    length = curves.end_of(run) - run.begin_ns * 1e-9
    parts = (
        f"{length:g} s" + ("" if run.measured else f" at steps of {run.step_ns * 1e-6:g} ms")
        if run.span
        else "no sample",
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
    known = [run.energy["error"]] if "error" in run.energy else []
    return [f"Residual of the energy balance: {abs(error):.1e} of its largest term." for error in known]


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
    spans = stages(run, begin)
    told = [(event["t_ns"] * 1e-9, str(event["kind"])) for event in run.plant_events]
    named = enumerate(contact.NAMES) if modes.size else ()
    shares = {name: np.where(modes == UNKNOWN, np.nan, modes == i) for i, name in named}
    if statistics.FRACTION in run.signals:
        shares["points closed"] = run.signals[statistics.FRACTION]

    def mean(shares: Reals) -> str:
        known = shares[np.isfinite(shares)]
        return f"{known.mean():.1%}" if known.size else "\N{EN DASH}"

    rows = []
    for stage in spans:
        here = (run.time >= stage.begin) & (run.time <= stage.end)
        last = stage is spans[-1]
        kinds = Counter(kind for t, kind in told if stage.begin <= t < stage.end or (last and t >= stage.end))
        words = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())
        rows.append((stage.text, stage.begin, stage.end, *(mean(v[here]) for v in shares.values()), words or "none"))
    columns = ("stage", "from [s]", "to [s]", *shares, "events")
    sizes = [
        (row.stage, row.sensor, row.mean, row.found.half if row.found.cycles else float("nan"), row.unit,
         row.found.cycles, row.found.frequency if row.found.cycles else row.why)
        for row in measured(run, begin)
    ]  # fmt: skip
    names = ("stage", "sensor", "mean", "amplitude", "unit", "cycles", "frequency [Hz]")
    return joined(
        (
            table("Stages: events, and mean shares of the contact", columns, rows),
            table("Sensors: mean, and half of peak to valley as mean over the cycles", names, sizes),
        )
    )


def energy(run: Run) -> Html:
    """Return the terms of the energy balance [J], and its residual in words."""
    terms = [(name, float(value), _TERMS.get(name, "")) for name, value in run.energy.items() if name != "error"]
    listed = table("Energy since the start", ("term", "energy [J]", "meaning"), terms)
    return joined((listed, *(element("p", line) for line in _residual(run))))


def audit(run: Run) -> Html:
    """Return which effects had no influence in this run and which were missing."""
    told = run.summary.get("audit")
    judged = [effect for effect in told if plain(effect)] if isinstance(told, list) else []
    if not judged:
        why = "the run was too short, or no shipped scene of its plant has values for the absent effects"
        return element("p", f"No effect was judged: {why}.")
    shares = ("not judged" if effect.get("unjudged") else effect.get("share") for effect in judged)
    rows = [
        (effect.get("effect", ""), "on" if effect.get("on") else "absent",
         f"{share:.2g}" if isinstance(share, int | float) else share or "", effect.get("like", ""))
        for effect, share in zip(judged, shares)
    ]  # fmt: skip
    remarks = [element("li", effect.get("text", "")) for effect in judged if effect.get("noted")]
    none = element("p", "Every judged effect had an influence, and none is missing.")
    columns = ("effect", "state", "share of the forces (limits: of the time)", "values as in scene")
    return joined((element("ul", *remarks) if remarks else none, table("Effects", columns, rows)))


_OF_A_RIG = ("Energy balance", "Influence of the effects", "Timing and transport", "Controllers", "Values of the scene")
"""Parts of the page that a measurement does not have."""


def write(run: Run, log: Path, path: Path) -> int:
    """Write the page of the recording `log`, read as `run`, to the file `path`; return its size [bytes].

    Raises rig.errors.OutputError if it cannot be written.
    """
    content = page(run, log).encode()
    write_file(path, content)
    return len(content)


def page(run: Run, log: Path) -> str:
    """Return the report of the recording `log`, read as `run`, as the text of an HTML page that is self-contained."""
    scene, why, sha, noted = None, "", "", Notes(user_notes.path_of(log), unreadable=1)
    try:
        scene = Scene.from_json(run.scene_text())
    except RigError as error:
        why = str(error)
    with suppress(LogError):  # a run that was never a file
        sha = digest(log)
    with suppress(LogError):
        noted = user_notes.read(log)
    modes, told = _modes(run), described(run.scene)
    title = str(told.get("title") or told.get("name") or log.stem)
    marks = [stage.begin for stage in stages(run)]
    sections = {
        "What it shows": verdicts(run, modes),
        "The run": _figure(run, modes),
        "Measures of each stage": measures(run, modes),
        "Energy balance": energy(run),
        "Influence of the effects": audit(run),
        "Timing and transport": course(run),
        "Controllers": controllers(run, scene),
        "Sensors": sensors(run, scene, marks),
        "Events": events(run),
        "Values of the scene": values(run, scene, why),
        "Provenance": provenance(run, sha),
        "Notes of users": notes(noted),
        "Check and repeat": commands(run, log),
    }
    if run.measured:
        sections = {name: what for name, what in sections.items() if name not in _OF_A_RIG}
    shown = {f"part-{i}": section for i, section in enumerate(sections.items(), 1) if section[1]}
    links = [element("a", name, href=f"#{key}") for key, (name, _) in shown.items()]
    parts = [
        element("section", element("h2", name, id=key), what, aria_labelledby=key, class_="card stack")
        for key, (name, what) in shown.items()
    ]
    skip = element("a", "Skip to the content", href="#part-1", class_="skip")
    nav = element("nav", *links, aria_label="Parts")
    return _document(title, skip, _header(run, log, title), nav, element("main", *parts, class_="stack"))


def result_page(result: Result, title: str) -> str:
    """Return the page of a result: its text as tables, and its figure."""
    return _document(title, element("main", element("h1", title), Html(result._repr_html_()), class_="card stack"))


def _document(title: str, *body: Html) -> str:
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        element("title", f"{title}: report"),
        element("style", Html(LOOK.read_text(encoding="utf-8") + _STYLE)),
    )
    return f"<!DOCTYPE html>\n{element('html', head, element('body', *body), lang='en')}\n"


def _header(run: Run, log: Path, title: str) -> Html:
    told = described(run.scene)
    began = datetime.fromtimestamp(run.began_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC") if run.began_ns else ""
    known = [f"{word} {told[key]}" for word, key in (("scene", "name"), ("plant", "plant")) if told.get(key)]
    line = element("p", ", ".join(filter(None, (log.name, *known, began))), class_="soft")
    about = [element("p", part) for part in str(told.get("about", "")).strip().split("\n\n") if part]
    return element("header", element("h1", title), line, *about)


def _modes(run: Run) -> Integers:
    """Index of the contact state at each time; empty if it was not recorded or the rig cannot be assembled.

    Empty too for a contact of many points, which open, stick and slip by themselves.
    """
    system = None
    with suppress(RigError):  # of a plant whose code the user has not trusted
        system = None if FRACTION in run.signals else contact.system_of(run.scene)
    if system is None:
        return np.empty(0, np.int64)
    return np.where(run.mode < 0, UNKNOWN, contact.Modes(system).indices(run.mode))


def _figure(run: Run, modes: Integers) -> Html:
    try:
        figure = run.plot()
    except RigError as error:  # e.g. of a plant whose code the user has not trusted
        return element("p", f"The run was not drawn: {error}", class_="doubtful")
    from matplotlib import rc_context

    drawn = io.BytesIO()
    with rc_context({"agg.path.chunksize": 300}):  # a curve that fills its panel takes a quarter of the time
        figure.savefig(drawn, format="png")
    names = ", ".join(name.replace("_", " ") for name in list(run.signals)[:6])
    held = f"; {share}" if (share := stick(modes)) else ""
    words = (
        f"Outputs of the plant over {curves.end_of(run):g} s ({names}), phases of the protocol, contact states{held}"
    )
    source = Html("data:image/png;base64," + base64.b64encode(drawn.getvalue()).decode())
    image = element("img", src=source, alt=words)
    image = element("div", image, class_="wide", role="region", tabindex=0, aria_label="Figure of the run")
    return element("figure", image)
