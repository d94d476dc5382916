"""The page: its head, and its sections in order."""

from __future__ import annotations

import base64
import io
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rig.analysis.amplitude import stages
from rig.analysis.report import account, devices, outcome
from rig.analysis.report.html import Html, element
from rig.analysis.report.style import STYLE
from rig.errors import LogError, RigError
from rig.record import user_notes
from rig.record.contents import digest
from rig.record.run import Integers, Run
from rig.record.statistics import FRACTION
from rig.record.user_notes import Notes
from rig.scenes.scene import Scene
from rig.user_files import write_file
from rig.view import contact, timeline
from rig.view.caption import scene_of

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
"""What the page may load: nothing. A browser then refuses what an escaped text must not have become."""


def write(run: Run, log: Path, path: Path) -> int:
    """Write the page of the recording `log`, read as `run`, to the file `path`; return its size [bytes].

    Raises rig.errors.OutputError if it cannot be written.
    """
    content = page(run, log).encode()
    write_file(path, content)
    return len(content)


def page(run: Run, log: Path) -> str:
    """Return the report of the recording `log`, read as `run`, as the text of an HTML page that is self-contained."""
    scene, why = _scene(run)
    modes = _modes(run)
    marks = [stage.begin for stage in stages(run)]
    sections = {
        "What it shows": outcome.verdicts(run, modes),
        "The run": _figure(run, modes),
        "Measures of each stage": outcome.measures(run, modes),
        "Energy balance": outcome.energy(run),
        "Influence of the effects": outcome.audit(run),
        "Timing and transport": outcome.course(run),
        "Controllers": devices.controllers(run, scene),
        "Sensors": devices.sensors(run, scene, marks),
        "Events": account.events(run),
        "Values of the scene": account.values(run, scene, why),
        "Provenance": account.provenance(run, _digest(log)),
        "Notes of users": account.notes(_notes(log)),
        "Check and repeat": account.commands(run, log),
    }
    shown = {f"part-{i}": one for i, one in enumerate(sections.items(), 1) if one[1]}
    links = [element("a", name, href=f"#{key}") for key, (name, _) in shown.items()]
    parts = [
        element("section", element("h2", name, id=key), what, aria_labelledby=key)
        for key, (name, what) in shown.items()
    ]
    title = _title(run, log)
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        element("title", f"{title}: report"),
        element("style", Html(STYLE)),
    )
    skip = element("a", "Skip to the content", href="#part-1", class_="skip")
    body = element(
        "body", skip, _header(run, log, title), element("nav", *links, aria_label="Parts"), element("main", *parts)
    )
    return f"<!DOCTYPE html>\n{element('html', head, body, lang='en')}\n"


def _title(run: Run, log: Path) -> str:
    told = scene_of(run)
    return str(told.get("title") or told.get("name") or log.stem)


def _header(run: Run, log: Path, title: str) -> Html:
    told = scene_of(run)
    began = datetime.fromtimestamp(run.began_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC") if run.began_ns else ""
    known = [f"{word} {told[key]}" for word, key in (("scene", "name"), ("plant", "plant")) if told.get(key)]
    line = element("p", ", ".join(filter(None, (log.name, *known, began))), class_="soft")
    about = [element("p", one) for one in str(told.get("about", "")).strip().split("\n\n") if one]
    return element("header", element("h1", title), line, *about)


def _scene(run: Run) -> tuple[Scene | None, str]:
    """The scene, or why it cannot be read."""
    try:
        return Scene.from_json(run.scene_text()), ""
    except RigError as error:
        return None, str(error)


def _modes(run: Run) -> Integers:
    """Index of the contact state at each time; empty if it was not recorded or the rig cannot be assembled.

    Empty too for a contact of many points, which open, stick and slip by themselves.
    """
    if FRACTION in run.signals:
        return np.empty(0, np.int64)
    try:
        system = contact.system_of(run.scene)
    except RigError:  # of a plant whose code the user has not trusted
        system = None
    if system is None:
        return np.empty(0, np.int64)
    return np.where(run.mode < 0, outcome.UNKNOWN, contact.Modes(system).indices(run.mode))


def _notes(log: Path) -> Notes:
    try:
        return user_notes.read(log)
    except LogError:
        return Notes(user_notes.path_of(log), unreadable=1)


def _digest(log: Path) -> str:
    try:
        return digest(log)
    except LogError:  # a run that was never a file
        return ""


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
    stick = f"; {share}" if (share := outcome.stick(modes)) else ""
    words = (
        f"Outputs of the plant over {timeline.end_of(run):g} s ({names}), phases of the protocol, contact states{stick}"
    )
    source = Html("data:image/png;base64," + base64.b64encode(drawn.getvalue()).decode())
    image = element("img", src=source, alt=words)
    image = element("div", image, class_="wide", role="region", tabindex=0, aria_label="Figure of the run")
    return element("figure", image)
