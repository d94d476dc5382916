"""A recording as one page of HTML that is self-contained: no script, no request to any host."""

from __future__ import annotations

import base64
import io
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rig.analysis.recorded.amplitude import stages
from rig.analysis.report import sections as sections
from rig.analysis.report.elements import Html, element
from rig.analysis.report.sections import UNKNOWN
from rig.errors import LogError, RigError
from rig.machine.files import write_file
from rig.record import user_notes
from rig.record.contents import digest
from rig.record.run import Integers, Run
from rig.record.statistics import FRACTION
from rig.record.user_notes import Notes
from rig.results import Result
from rig.scenes.scene import Scene
from rig.view import contact, curves
from rig.view.curves import described

# What the page may load: nothing. A browser then refuses what an escaped text must not have become.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
_OF_A_RIG = ("Energy balance", "Influence of the effects", "Timing and transport", "Controllers", "Values of the scene")
"""Parts of the page that a measurement does not have."""
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


def write(run: Run, log: Path, path: Path) -> int:
    """Write the page of the recording `log`, read as `run`, to the file `path`; return its size [bytes].

    Raises rig.errors.OutputError if it cannot be written.
    """
    content = page(run, log).encode()
    write_file(path, content)
    return len(content)


def page(run: Run, log: Path) -> str:
    """Return the report of the recording `log`, read as `run`, as the text of an HTML page that is self-contained."""
    scene = None
    why = ""
    try:
        scene = Scene.from_json(run.scene_text())
    except RigError as error:
        why = str(error)
    sha = ""
    with suppress(LogError):  # a run that was never a file
        sha = digest(log)
    noted = Notes(user_notes.path_of(log), unreadable=1)
    with suppress(LogError):
        noted = user_notes.read(log)
    modes = _modes(run)
    recorded = described(run.scene)
    title = str(recorded.get("title") or recorded.get("name") or log.stem)
    marks = [stage.begin for stage in stages(run)]
    contents = {
        "What it shows": sections.verdicts(run, modes),
        "The run": _figure(run, modes),
        "Measures of each stage": sections.measures(run, modes),
        "Energy balance": sections.energy(run),
        "Influence of the effects": sections.audit(run),
        "Timing and transport": sections.course(run),
        "Controllers": sections.controllers(run, scene),
        "Sensors": sections.sensors(run, scene, marks),
        "Events": sections.events(run),
        "Mass and contacts": sections.structure(scene),
        "Values of the scene": sections.values(run, scene, why),
        "Provenance": sections.provenance(run, sha),
        "Notes of users": sections.notes(noted),
        "Check and repeat": sections.commands(run, log),
    }
    if run.measured:
        contents = {name: content for name, content in contents.items() if name not in _OF_A_RIG}
    links = []
    parts = []
    for number, (name, content) in enumerate(contents.items(), 1):
        if content:
            key = f"part-{number}"
            links.append(element("a", name, href=f"#{key}"))
            heading = element("h2", name, id=key)
            parts.append(element("section", heading, content, aria_labelledby=key, class_="card stack"))
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
    recorded = described(run.scene)
    facts = [log.name]
    if recorded.get("name"):
        facts.append(f"scene {recorded['name']}")
    if recorded.get("plant"):
        facts.append(f"plant {recorded['plant']}")
    if run.began_ns:
        facts.append(datetime.fromtimestamp(run.began_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC"))
    line = element("p", ", ".join(filter(None, facts)), class_="soft")
    paragraphs = str(recorded.get("about", "")).strip().split("\n\n")
    about = [element("p", part) for part in paragraphs if part]
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
    words = f"Outputs of the plant over {curves.end_of(run):g} s ({names}), phases of the protocol, contact states"
    if share := sections.stick(modes):
        words += f"; {share}"
    source = Html("data:image/png;base64," + base64.b64encode(drawn.getvalue()).decode())
    image = element("img", src=source, alt=words)
    image = element("div", image, class_="wide", role="region", tabindex=0, aria_label="Figure of the run")
    return element("figure", image)
