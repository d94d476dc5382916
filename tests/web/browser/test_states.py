"""States of the page at three widths: nothing sticks out, all can be hit, the layout holds still; the catalogue.

RIG_SCREENSHOTS=FOLDER keeps a picture of each: make screenshots.
"""

import json
import re
from pathlib import Path

import pytest

import rig
from rig import scenes
from rig.analysis.branches.figure import SYMBOLS
from rig.analysis.branches.result import WORDS
from rig.bench.live.plant_process import warm
from rig.machine.files import RUNS
from rig.plants import PLANTS
from rig.quantities import ORIGINS
from rig.view import contact
from rig.view.channels import Channels
from rig.web.form import form

pytestmark = pytest.mark.browser
ROOT = Path(__file__).parents[3]
PAGE = ROOT / "rig" / "web" / "page"
WIDE = """
    const limit = document.documentElement.clientWidth;
    return [document.documentElement.scrollWidth - limit, ...[...document.querySelectorAll('main *, header *')]
      .filter((one) => { const box = one.getBoundingClientRect(); return box.right > limit + 1 || box.left < -1; })
      .filter((one) => !one.closest('nav, pre, .scroll, .lesson table, [hidden]'))
      .map((one) => one.outerHTML.slice(0, 90))].slice(0, 6)"""
SMALL = """
    return [...document.querySelectorAll('button, input, select, summary, nav a')]
      .filter((one) => one.checkVisibility())
      .filter((one) => { const box = one.getBoundingClientRect(); return box.width < 24 || box.height < 24; })
      .map((one) => one.outerHTML.slice(0, 90))"""
SHIFTS = """
    window.shifts = [];
    new PerformanceObserver((list) => {
      for (const one of list.getEntries()) {
        const moved = one.sources.map(({ node, previousRect: from, currentRect: to }) =>
          [node?.outerHTML?.slice(0, 60), from.top, to.top, from.height, to.height].join(" "));
        window.shifts.push([one.value, moved]);
      }
    }).observe({ type: "layout-shift", buffered: true });"""
BARE = """
    const bare = [], what = NodeFilter.SHOW_ELEMENT | NodeFilter.SHOW_TEXT;
    const walk = document.createTreeWalker(document.body, what);
    const words = (text) => /[A-Za-z]{3}/.test(text.replace(/⟦[^⟧]*⟧/g, ""));
    for (let node = walk.currentNode; node; node = walk.nextNode()) {
      const element = node.nodeType === 3 ? node.parentElement : node;
      if (node.nodeType === 3) {
        if (!element.closest('[translate=no], noscript, .lesson') && words(node.data)) bare.push(node.data);
        continue;
      }
      for (const name of ["aria-label", "title", "placeholder"]) {
        const text = element.getAttribute(name);
        if (text && !element.closest("[translate=no]") && words(text)) bare.push(name + ": " + text);
      }
    }
    return bare"""


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    for name in ("belt", "belt_normal_force"):
        warm(scenes.load(name))


@pytest.mark.parametrize(("width", "height"), [(360, 740), (800, 1100), (1500, 950)])
def test_every_state_fits_its_screen(page, folder, width, height):
    (folder / RUNS).mkdir(parents=True)
    rig.simulate("belt", duration=2.0).save(folder / RUNS / "belt.mcap")
    shape = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    page.tools("Emulation.setDeviceMetricsOverride", **shape)
    faults, places = {}, set()

    def look(state):
        page.picture(f"{state}-{width}")
        places.add(page.run("return JSON.stringify(document.getElementById('emergency').getBoundingClientRect())"))
        found = [*page.run(SMALL), *([wide] if (wide := page.run(WIDE)) != [0] else [])]
        if found:
            faults[state] = found

    page.go("rigs")
    page.until(lambda: page.run("return document.querySelectorAll('canvas[data-painted]').length > 1"))
    look("rigs")
    page.one("search").send_keys("squeal brake")
    page.until(lambda: page.run("return document.querySelectorAll('#found a').length") > 2)
    look("search")
    page.choose("belt")
    page.run("scrollTo(0, 0)")
    look("rest")
    page.show("value-load.force")
    page.write("value-load.force", "-3")
    page.until(lambda: page.text("fault-load.force"))
    page.run("scrollTo(0, 0)")
    look("fault")
    page.write("value-load.force", "15,5 N")
    page.until(lambda: page.text("fault-load.force") == "")
    page.write("duration", "300")
    page.press("start")
    page.until_phase("running")
    page.until(lambda: page.time > 2.0)
    page.run("scrollTo(0, 0)")
    assert page.value("value-load.force") == "15.5"
    look("running")
    page.press("hold")
    page.run("document.getElementById('timeline').focus()")
    page.driver.switch_to.active_element.send_keys("+\ue012\ue012")
    page.until(lambda: page.text("readout").startswith("t = "))
    look("cursor")
    page.show("verdict").click()
    page.until(lambda: "99 of 100" in page.text("trust"))
    look("trust")
    page.run("document.getElementById('all').open = true")
    page.show("find").send_keys("mass")
    look("values")
    page.press("stop")
    page.until_phase("ended")
    page.run("scrollTo(0, 0)")
    look("ended")
    page.go("recordings/belt.mcap")
    page.until(lambda: page.text("recorded-readout").startswith("t = 0 s"))
    look("recording")
    page.go("analysis")
    page.until(lambda: page.run("return document.querySelector('#studies').textContent"))
    look("analysis")
    page.go("lessons/1")
    page.until(lambda: "Falling friction" in page.text("lesson"))
    look("lesson")
    page.complaints()  # of the value that was refused
    assert faults == {}
    assert len(places) == 1, places  # the emergency stop never moves


@pytest.mark.parametrize(("width", "height"), [(360, 740), (1500, 950)])
def test_the_layout_holds_still_while_a_run_begins_and_ends(page, width, height):
    """Nobody touches the page, so that every shift counts, however slow the machine is."""
    shape = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    page.tools("Emulation.setDeviceMetricsOverride", **shape)
    page.go("bench/belt")
    page.driver.refresh()
    page.run(SHIFTS)
    page.until(lambda: page.text("title") == "Mass on a belt")
    page.until_known()
    post = "fetch(arguments[0], { method: 'POST', body: JSON.stringify(arguments[1]) })"
    page.run(post, "/api/run", {"scene": "belt", "duration": 300})
    page.until_phase("running")
    page.until(lambda: page.time > 2.0)
    page.run(post, "/api/run/command", {"do": "stop"})
    page.until_phase("ended")
    shifts = sorted(page.run("return window.shifts"), key=lambda one: -one[0])
    assert sum(size for size, _ in shifts) < 0.05, shifts[:6]


def test_every_text_of_the_page_is_in_the_catalogue(page):
    """In a language in which its texts stand between brackets no text of the page is without them."""
    page.run("localStorage.setItem('language', 'qps')")
    try:
        page.driver.refresh()
        page.until(lambda: page.text("phase") == "⟦no run yet⟧")
        page.choose("belt_normal_force")
        for view in ("recordings", "analysis", "lessons", "bench"):
            page.go(view)
        assert page.run(BARE) == []
        page.write("duration", "300")
        page.press("start")
        page.until_phase("⟦running⟧")
        page.until(lambda: page.time > 1.0)
        page.show("verdict").click()
        page.until(lambda: "late" in page.text("trust"))
        assert page.run(BARE) == []
        page.press("stop")
        page.until_phase("⟦ended⟧")
        assert page.run(BARE) == []
    finally:
        page.run("localStorage.clear()")


def test_the_german_catalogue_is_complete():
    """Every text that the page looks up, every word of a plant, name of a channel, and text of a scene."""
    sections = json.loads((PAGE / "german.json").read_text(encoding="utf-8"))
    known, shapes = {text for entries in sections.values() for text in entries}, []
    for text in sections["messages"]:
        named = re.sub(r"\\\{(\w+)\\\}", r"(?P<\1>.+?)", re.escape(text))
        shapes += [re.compile(named)] if "{" in text else []
    wanted = {
        text
        for path in PAGE.rglob("*.js")
        for text in re.findall(r'\bt\(\s*"((?:[^"\\]|\\.)*)"', path.read_text(encoding="utf-8"))
    }
    wanted |= {
        *contact.NAMES,
        *ORIGINS,
        *(WORDS.get(kind, kind) for kind in SYMBOLS),
        *(hand.words for plant in PLANTS.shipped for hand in getattr(PLANTS[plant], "HANDS", {}).values()),
    }
    for name in scenes.names():
        scene = scenes.load(name)
        assembly, shown = scene.assemble(), form(scene)
        outputs, sensors = (
            {key: one.unit for key, one in known_by.items()} for known_by in (assembly.outputs, scene.sensors)
        )
        for panel in Channels((scene, assembly), outputs, sensors).panels:
            names = (panel.title.partition(" [")[0], *panel.outputs, *panel.sensors)
            wanted |= {name.replace("_", " ") for name in names}
        wanted |= {shown["title"], re.sub(r"([^\n])\n(?=\S)", r"\1 ", shown["about"]), shown["slow"], *shown["notes"]}
        wanted |= {line for text in shown["warnings"] for line in text.splitlines()}
        wanted |= {text for effect in shown["effects"] for text in (effect["name"], effect["about"])}
        wanted |= {*steps(shown["protocol"])}
        keys = [entry["key"] for table in shown["sections"] for entry in table["values"]]
        wanted |= {part.replace("_", " ") for key in keys for part in key.split(".") if part not in scene.controllers}
    missing = wanted - known - {""}
    assert {text for text in missing if not any(shape.fullmatch(text) for shape in shapes)} == set()
    assert len(wanted) > 700


def steps(protocol):
    for step in protocol:
        yield from [step] if isinstance(step, str) else steps(step["steps"])
