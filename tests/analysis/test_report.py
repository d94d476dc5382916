"""The page about a recording: it stands alone, escapes what others wrote, and has the numbers of the run."""

import json
import re
import shutil
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import rig as laboratory
from rig.analysis.recorded.amplitude import measured
from rig.analysis.report.page import page
from rig.record import user_notes
from rig.record.contents import digest
from rig.record.run import Commands, Run, Samples
from rig.record.save_run import save

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden" / "pendulum.mcap"
EVIL = "<script>document.title='taken'</script><img src=https://example.org/x onerror=alert(1)>\"'&amp;$_{$"
UNSHOWN = EVIL + "\u202e\x00\ud800"
"""The same with what reverses text, what HTML does not allow, and what UTF-8 cannot contain."""
EMPTY = {"meta", "img", "br", "hr", "link", "input"}


class Page(HTMLParser):
    """A page taken apart: elements, tables by caption, texts by section; what does not belong there fails."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.ids = [], [], Counter()
        self.texts, self.tables, self.section = {}, {}, ""
        self.feed(text)
        self.close()
        assert self.open == []
        assert max(self.ids.values()) == 1
        names = Counter(name for name, _ in self.elements)
        assert not names.keys() & {"script", "iframe", "object", "embed", "link", "base", "form"}
        for name, given in self.elements:
            assert not [key for key in given if key.startswith("on")], given
            for key in given.keys() & {"src", "href", "xlink:href", "srcset", "data", "action"}:
                assert given[key].startswith(("data:image/png;base64,", "#")), given[key][:80]
                assert not given[key].startswith("#") or self.ids[given[key][1:]] == 1
            if name == "img":
                assert given["alt"]
            if name == "svg":
                assert given["role"] == "img"
                assert given["aria-label"]

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.elements.append((tag, given))
        if "id" in given:
            self.ids[given["id"]] += 1
        if tag == "tr":
            self.tables.setdefault(self.caption, []).append([])
        elif tag in ("td", "th"):
            self.tables[self.caption][-1].append("")
        elif tag == "caption":
            self.caption = ""
        elif tag == "h2":
            self.section = ""
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert tag not in EMPTY
        assert self.open.pop() == tag
        if tag == "h2":
            self.texts[self.section] = ""

    def handle_data(self, data):
        if "style" in self.open:
            assert "url(" not in data
            assert "@import" not in data
        elif "caption" in self.open:
            self.caption += data
        elif self.open[-1:] == ["h2"]:
            self.section += data
        elif self.open and self.open[-1] in ("td", "th"):
            self.tables[self.caption][-1][-1] += data
        if self.section in self.texts:
            self.texts[self.section] += data + " "


@pytest.fixture(scope="module")
def golden():
    run = laboratory.open(GOLDEN)
    return run, Page(page(run, GOLDEN))


@pytest.fixture
def unreadable_figures(_figures):
    """Texts of this test fit into no figure."""
    yield
    _figures.clear()


def hostile():
    """A run in which everybody wrote what is no text."""
    time = np.arange(500) * 1e-3
    t_ns = np.arange(500, dtype=np.int64) * 1_000_000
    tick = np.arange(500, dtype=np.int64)
    event = {"tick": 0, "text": EVIL, "data": {}}
    told = [("guest", EVIL), ("plant", "mark"), ("plant", EVIL), ("nf", "parameter")]
    scene = {
        **dict.fromkeys(("title", "name", "about", "plant"), EVIL),
        "sensors": {EVIL: {"kind": EVIL, "reads": EVIL}},
        "controllers": {EVIL: {"kind": EVIL, EVIL: EVIL}},
    }
    return Run(
        scene=json.dumps(scene),
        step_ns=1_000_000,
        frame_ns=1_000_000,
        time=time,
        signals={EVIL: np.sin(40 * time)},
        units={EVIL: EVIL, f"meas/{EVIL}": EVIL},
        measurements={EVIL: Samples(t_ns, np.cos(40 * time))},
        commands={EVIL: Commands(tick, tick, tick * 0, np.ones((500, 1)))},
        events=[event | {"t_ns": i * 10**8, "source": who, "kind": kind} for i, (who, kind) in enumerate(told)],
        energy={EVIL: 1.0, "error": 1e-9},
        provenance={EVIL: EVIL, "command": EVIL},
        fault=EVIL,
        damage="",
        controllers={EVIL: {"section": {EVIL: EVIL}, "numbers": {EVIL: 1.0}}},
        summary={
            "verdict": EVIL,
            "reasons": [EVIL],
            "ended": EVIL,
            "plant": {"method": EVIL, "events": EVIL},
            "audit": [{"effect": EVIL, "on": True, "share": 0.0, "like": EVIL, "noted": True, "text": EVIL}],
            "sensors": {EVIL: {"clipped": EVIL}},
            "loop": {EVIL: {EVIL: 3}},
            "lost": {EVIL: 1},
        },
    )


def test_the_page_of_a_recording_stands_alone(golden):
    _, found = golden
    assert [name for name, _ in found.elements][:2] == ["html", "head"]
    policy = [
        given["content"] for name, given in found.elements if given.get("http-equiv") == "Content-Security-Policy"
    ]
    assert policy[0].startswith("default-src 'none'")
    order = (
        "What it shows",
        "The run",
        "Measures of each stage",
        "Energy balance",
        "Influence of the effects",
        "Timing and transport",
        "Controllers",
        "Sensors",
        "Events",
        "Values of the scene",
        "Provenance",
        "Notes of users",
        "Check and repeat",
    )
    assert tuple(found.texts) == order
    assert len([name for name, _ in found.elements if name == "img"]) == 1
    assert len([name for name, _ in found.elements if name == "svg"]) == 4


def test_the_page_has_the_numbers_of_the_run(golden):
    run, found = golden
    assert "VALID timing: nothing lost" in " ".join(found.texts["What it shows"].split())
    assert f"Residual of the energy balance: {run.energy['error']:.1e}" in found.texts["What it shows"]
    stages = found.tables["Stages: events, and mean shares of the contact"][1:]
    assert [row[0] for row in stages] == ["before", "accelerate", "feedback on"]
    begin, end = float(stages[1][1]), float(stages[1][2])
    stuck = (np.abs(run.signals["slip_speed"]) < 1e-15)[(run.time >= begin) & (run.time <= end)]
    assert stages[1][3] == f"{stuck.mean():.1%}"
    sensors = found.tables["Sensors: mean, and half of peak to valley as mean over the cycles"][1:]
    rows = list(measured(run))
    assert [(row[0], row[1]) for row in sensors] == [(row.stage, row.sensor) for row in rows]
    for shown, row in zip(sensors, rows):
        assert float(shown[2]) == pytest.approx(row.mean, rel=1e-5)
        assert int(shown[5]) == row.found.cycles
        assert (shown[3] != "–") == (row.found.cycles > 0)
    terms = {row[0]: float(row[1]) for row in found.tables["Energy since the start"][1:]}
    assert terms == pytest.approx({name: v for name, v in run.energy.items() if name != "error"}, rel=1e-5)
    sensors = {row[0]: row for row in found.tables["What each sensor delivered"][1:]}
    assert sensors["vibrometer"][4:6] == ["1000", "9001"]
    assert sensors["vibrometer"][9] == str(run.summary["sensors"]["vibrometer"]["dropped_out"])
    assert len(found.tables["Events"]) - 1 == len(run.events)
    values = {row[0]: row[1:] for row in found.tables["Values in SI units"][1:]}
    assert values["body.inertia"] == ["0.2", "kg*m^2", "calibrated", "m r^2: 3.56 Hz"]
    assert run.provenance["commit"] in found.texts["Provenance"]
    assert digest(GOLDEN) in found.texts["Provenance"]
    assert "rig verify pendulum.mcap" in found.texts["Check and repeat"]
    assert f"{run.commands['nf'].tick.size}" in found.texts["Controllers"]
    assert "300 N*s/m" in found.texts["Controllers"]


@pytest.mark.parametrize("name", ["plate", "lever"])
def test_golden_recordings_of_other_kinds_have_a_page(name):
    log = GOLDEN.with_name(f"{name}.mcap")
    run = laboratory.open(log)
    text = page(run, log)
    found = Page(text)
    assert len(text) < 2_000_000
    assert "Checksums prove every byte" in found.texts["What it shows"]
    assert len([name for name, _ in found.elements if name == "svg"]) == len(run.measurements)
    [head, *stages] = found.tables["Stages: events, and mean shares of the contact"]
    if "contact_fraction" in run.signals:  # of many points one contact state says nothing
        assert head[3:-1] == ["points closed"]
        assert len(stages) > 1 or stages[0][3] == f"{run.signals['contact_fraction'].mean():.1%}"
    else:
        assert sum(float(share.rstrip("%")) for share in stages[0][3:7]) == pytest.approx(100.0, abs=0.25)


@pytest.mark.usefixtures("unreadable_figures")
def test_what_others_wrote_is_text(tmp_path):
    log = tmp_path / "run.mcap"
    save(laboratory.simulate("belt", 0.02), log)
    note = {"date": UNSHOWN, "text": UNSHOWN, "tags": [UNSHOWN]}
    user_notes.path_of(log).write_text(json.dumps(note) + "\n")
    run = hostile()
    run.provenance = {UNSHOWN: UNSHOWN, "command": UNSHOWN}
    text = page(run, log)
    found = Page(text)
    assert "<script" not in text
    assert not set(text) & {"\u202e", "\x00", "\ud800"}
    for section in found.texts.keys() - {"The run", "Timing and transport"}:
        assert EVIL in found.texts[section], section
    for section in ("Notes of users", "Provenance"):
        assert EVIL + "\ufffd" * 3 in found.texts[section]
    assert text.encode()


def test_damage_comes_first_and_a_recovered_recording_says_so(tmp_path):
    data = GOLDEN.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    run = laboratory.open(cut)
    text = page(run, cut)
    first = re.search(r'<ul class="verdicts"><li class="bad">(.*?)</li>', text)
    assert first[1] == f"The recording is damaged: {run.damage}"
    found = Page(text)
    assert "No timing verdict" in found.texts["What it shows"]
    assert "rig recover cut.mcap" in found.texts["Check and repeat"]
    assert "No checksum proves the whole recording" in found.texts["What it shows"]
    healed = replace(run, damage="", fault="", recovered="recovered from a damaged recording; lost: 3")
    assert '<li class="bad">recovered from a damaged recording; lost: 3</li>' in page(healed, cut)


def test_any_run_has_a_page(tmp_path):
    run = laboratory.simulate("belt", 0.05)
    outputs = {name: v[:1] for name, v in run.signals.items()}
    sensors = {name: Samples(t_ns[:1], v[:1]) for name, (t_ns, v) in run.measurements.items()}
    lost = {name: Samples(t_ns, v * np.nan) for name, (t_ns, v) in run.measurements.items()}
    for poor in (
        Run("", 1_000_000, 1_000_000, np.empty(0), {}, {}),
        replace(run, time=run.time[:1], mode=run.mode[:1], signals=outputs, measurements=sensors),
        replace(run, scene="", damage="its scene is damaged", fault="its scene is damaged"),
        replace(run, measurements=lost),
    ):
        assert Page(page(poor, tmp_path / "gone.mcap")).texts["What it shows"]


def test_the_command_writes_the_page_beside_the_recording(rig, tmp_path):
    log = tmp_path / "a run.mcap"
    shutil.copy(GOLDEN, log)
    code, out, err = rig("report", log)
    assert (code, out.strip(), err) == (0, str(tmp_path / "a run.html"), "")
    Page((tmp_path / "a run.html").read_text(encoding="utf-8"))
    code, out, err = rig("report", log)
    assert (code, "add --force" in err) == (2, True)
    code, out, _ = rig("report", log, "--force", "--json")
    assert json.loads(out) == {
        "path": str(tmp_path / "a run.html"),
        "bytes": (tmp_path / "a run.html").stat().st_size,
        "damage": [],
    }
