"""What belongs to a run beside its numbers: events, values of the scene, provenance, notes, and how to repeat it."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rig.analysis.report.devices import value
from rig.analysis.report.html import Html, element, facts, joined, table
from rig.analysis.report.outcome import plain
from rig.printable import counted
from rig.record import user_notes
from rig.record.run import Run
from rig.scenes.explain import explain
from rig.scenes.scene import Scene
from rig.view.caption import scene_of

SHOWN = 200
"""Most events that are shown open; longer lists are folded."""
_COUNTED = "contact"
"""Kind of events that are only counted: there may be thousands a second."""


def events(run: Run) -> Html:
    """Return the events of all processes in order. What a process other than the plant says, it says of itself."""
    shown = [event for event in run.events if event["kind"] != _COUNTED]
    rows = [(f"{event['t_ns'] * 1e-9:.6f}", event["source"], event["kind"], event["text"]) for event in shown]
    found = table("Events", ("time [s]", "process", "kind", "text"), rows) or element("p", "No event was recorded.")
    if len(shown) > SHOWN:
        kinds = ", ".join(f"{kind} {count}" for kind, count in Counter(event["kind"] for event in shown).most_common())
        found = element("details", element("summary", f"{counted(len(shown), 'event')}: {kinds}"), found)
    count = len(run.events) - len(shown)
    contacts = f"{counted(count, 'event')} of contacts (stick, slip, lift-off, contact) left out of the list."
    return joined((found, element("p", contacts) if count else ""))


def values(run: Run, scene: Scene | None, why: str) -> Html:
    """Return every value of the scene with unit and origin; without a readable scene (`why`), as it was recorded."""
    if scene is not None:
        rows = [
            (one.key, value(one.value), "" if one.unit == "1" else one.unit, one.origin.origin, one.origin.note)
            for one in explain(scene).values
        ]
        return table("Values in SI units", ("key", "value", "unit", "origin", "note"), rows)
    found = [(key, value(one)) for key, one in _flat(scene_of(run), "")]
    return joined((element("p", why, class_="doubtful"), table("Values as recorded", ("key", "value"), found)))


def _flat(content: Any, key: str) -> Iterator[tuple[str, Any]]:
    if isinstance(content, dict) and key != "parts":  # of parts that it carries the text is no value
        for name, one in content.items():
            yield from _flat(one, f"{key}.{name}" if key else str(name))
    elif isinstance(content, list) and any(isinstance(one, dict | list) for one in content):
        for i, one in enumerate(content, 1):
            yield from _flat(one, f"{key}[{i}]")
    elif key != "parts":
        yield key, content


def provenance(run: Run, digest: str) -> Html:
    """Return versions, machine, command, seed and commit, and the SHA-256 that the recording states of itself."""
    known = dict(plain(run.provenance)) | ({"SHA-256 of the recording": digest} if digest else {})
    return facts((str(key), str(one)) for key, one in known.items()) or element("p", "Not recorded.")


def notes(found: user_notes.Notes) -> Html:
    """Return the notes of users on the recording. They are stored beside it; no checksum covers them."""
    rows = [(one.date, one.text, " ".join(f"#{tag}" for tag in one.tags)) for one in found.found]
    odd = [(len(found.other), "on another recording that had this name"), (found.unreadable, "cannot be read")]
    lines = [f"{count} {'note' if count == 1 else 'notes'} {what}" for count, what in odd if count]
    return joined(
        (table("Notes", ("date", "text", "tags"), rows) or element("p", "None."), *(element("p", one) for one in lines))
    )


def commands(run: Run, log: Path) -> Html:
    """Return the commands that check and repeat the run."""
    name = shlex.quote(log.name)
    repeated = str(plain(run.provenance).get("command", ""))
    rows = [
        ("check: the same bits when it is simulated again", f"rig verify {name}"),
        ("play it back to viewers and controllers", f"rig replay {name}"),
        ("recover what is left", f"rig recover {name}") if run.damage else ("look at it", f"rig view {name}"),
        ("the command that made it", repeated),
    ]
    return facts((what, element("code", command)) for what, command in rows if command)
