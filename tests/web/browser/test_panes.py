"""What single panes show: the picture of every rig, contacts, steps of the protocol, sliders, lessons, other runs."""

import datetime
import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import rig
from rig import scenes
from rig.bench.live.plant_process import warm
from rig.lessons import lessons
from rig.machine.files import RUNS
from rig.plants import PLANTS

pytestmark = pytest.mark.browser
ROOT = Path(__file__).parents[3]
DRAWN = [plant for plant in PLANTS.shipped if getattr(PLANTS[plant], "PICTURES", ())]
COLOURS = """
    const canvas = document.getElementById("rig-picture"), found = new Set();
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    for (let i = 0; i < data.length; i += 4) if (data[i + 3] > 250) found.add(data.slice(i, i + 3).join());
    return [...found];"""
PIXELS = "return document.getElementById('rig-picture').toDataURL()"


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    for name in ("belt", "brake_3400"):
        warm(scenes.load(name))


@pytest.mark.parametrize("plant", [plant for plant in DRAWN if plant != "structure"])  # masses without places
def test_every_rig_is_drawn_at_rest_while_one_chooses(page, plant):
    name = next(name for name in scenes.names() if scenes.load(name).plant == plant)
    page.choose(name)
    page.until(lambda: page.text("rig-text") == "at rest")
    page.show("rig-picture")
    assert len(page.until(lambda: page.run(COLOURS))) > 20  # faces in their shades, lines, arrows
    page.picture(f"rest-{name}")


def test_the_picture_and_all_contacts_move_in_a_run(page):
    page.choose("brake_3400")
    page.write("pace", "0.05")
    page.press("start")
    page.until_phase("running")
    page.show("rig-picture")
    page.until(lambda: "Hz shown at" in page.text("rig-text"))
    seen = set()
    page.until(lambda: seen.add(page.run(PIXELS)) or len(seen) > 3)
    page.show("contact")
    page.until(lambda: page.text("contact").startswith("4 slip+"))
    page.picture("brake-running")


BLOCK = """format = 1
title = "A block"
plant = "structure"
structure.units = "m-kg-s"
structure.nodes = "./block.inp"
structure.rows = "./rows.csv"
structure.parts.M = { of = "mass", file = "./M.npz" }
structure.parts.K = { of = "stiffness", file = "./K.npz" }
reduction = { kind = "whole", up_to = "3 kHz" }
outputs.corner = { node = 8, direction = "z" }
"""


def test_mode_shapes_of_a_structure_move_on_the_page(page, folder):
    corners = [f"{k + 1}, {x}, {y}, {z}" for k, (z, y, x) in enumerate(itertools.product((0.0, 1.0), repeat=3))]
    deck = ["*NODE", *corners, "*ELEMENT, TYPE=C3D8", "1, 1, 2, 4, 3, 5, 6, 8, 7"]
    rows = [f"{node},{direction}" for node in range(1, 9) for direction in "xyz"]
    for name, lines in (("block.toml", [BLOCK]), ("block.inp", deck), ("rows.csv", rows)):
        (folder / name).write_text("\n".join(lines) + "\n")
    sp.save_npz(folder / "M.npz", sp.csr_array(np.eye(24)))
    sp.save_npz(folder / "K.npz", sp.csr_array(1e6 * (3.0 * np.eye(24) - np.eye(24, k=3) - np.eye(24, k=-3))))
    page.driver.refresh()
    page.choose(str(folder / "block.toml"))
    page.go("analysis")
    page.unfold()
    page.press("modes")
    seen = "const i = document.querySelector(\"img[src^='/jobs/']\"); return i?.complete && i.naturalWidth"
    assert page.until(lambda: page.run(seen), 120.0) == 768
    page.picture("mode-shapes")


def test_the_step_of_the_protocol_is_found_in_repeats(page):
    """Against the plant's own order of steps: the line of every step, and the round of every repeat."""
    inner = {"times": 3, "steps": ["c", "d"]}
    steps = ["a", {"times": 2, "steps": ["b", inner]}, "e", {"times": "forever", "steps": ["f", "g"]}]
    lines = ["a", "2", "b", "3", "c", "d", "e", "forever", "f", "g"]

    def walked(steps, rounds=()):
        for step in steps:
            if isinstance(step, str):
                yield step, list(rounds)
            else:
                for k in itertools.count(1) if step["times"] == "forever" else range(1, step["times"] + 1):
                    yield from walked(step["steps"], (*rounds, k))

    wanted = [*itertools.islice(walked(steps), 25)]
    found = page.driver.execute_async_script(
        "const [steps, done] = arguments; import('/page/panes/protocol.js').then(({ place }) => "
        "done(Array.from({ length: 25 }, (_, i) => place(steps, i + 1))))",
        steps,
    )
    assert [(lines[one["line"]], [r["round"] for r in one["rounds"]]) for one in found] == wanted


@pytest.mark.parametrize(
    "slider",
    [
        {"low": 0.0, "high": 1e9, "least": 1e-6},
        {"low": -5.0, "high": 0.0, "least": 1e-3},
        {"low": 0.1, "high": 0.4, "least": 0.0},
    ],
)
def test_a_slider_reaches_its_ends_and_zero_and_comes_back(page, slider):
    found = page.driver.execute_async_script(
        "const [slider, done] = arguments; import('/page/panes/hands.js').then(({ valueAt, placeOf }) => done("
        "Array.from({ length: 1001 }, (_, i) => [valueAt(slider, i), placeOf(slider, valueAt(slider, i))])))",
        slider,
    )
    values, places = zip(*found)
    assert (values[0], values[-1]) == pytest.approx((slider["low"], slider["high"]))
    assert [*values] == sorted(values)
    assert len({*values}) == len(values)
    assert [*places] == pytest.approx(range(1001), abs=1e-6)
    assert (0.0 in values) == (slider["low"] <= 0.0 <= slider["high"])


def test_branches_are_computed_and_show_the_present_state(page):
    page.choose("belt")
    page.show("branches-note")
    page.until(lambda: page.text("branches-note") == "no map yet for these values")
    page.run("document.getElementById('branches-compute').closest('details').open = true")
    assert page.run("return document.getElementById('branches-over').selectedOptions[0].text") == "belt speed"
    page.write("branches-from", "0.1")
    page.write("branches-to", "0.8")
    page.press("branches-compute")
    page.until(lambda: "grazing fold (contact) at 0.67503 m/s" in page.text("branches-note"), 120.0)
    page.picture("branches-rest")
    page.write("duration", "300")
    page.press("start")
    page.until_phase("running")
    page.show("branches-picture")
    page.until(lambda: "dot: the run at" in page.text("branches-note"))
    page.write("value-drive.speed", "0.3")
    page.picture("branches-slider")
    page.show("branches-picture")
    page.until(lambda: "dot: the run at 0.3 m/s" in page.text("branches-note"))
    assert page.text("branches-differ") == ""
    page.write("value-load.force", "15")
    page.show("branches-picture")
    page.until(lambda: "normal force 15 ≠ 20 N" in page.text("branches-differ"))
    page.show("branches-picture")
    page.picture("branches")
    page.press("stop")
    page.until_phase("ended")


def test_a_map_stands_beside_its_slider_with_the_present_values(page):
    page.choose("belt")
    body = {
        "what": "regions",
        "scene": "belt",
        "changes": {},
        "x": "drive.speed=0.05:0.35 m/s:4",
        "y": "load.force=10:30 N:3",
    }
    asked = "{ method: 'POST', body: JSON.stringify(body) }"
    post = f"const [body, done] = arguments; fetch('/api/studies/work', {asked}).then(() => done())"
    page.driver.execute_async_script(post, body)
    ended = "const done = arguments[0]; fetch('/api/jobs').then((a) => a.json()).then((all) => done(all[0]?.state))"
    page.until(lambda: page.driver.execute_async_script(ended) == "done", 120.0)
    page.driver.refresh()
    page.until(lambda: "normal force 20 N, sliding is unstable" in page.text("branches-note"))
    assert "boundaries of belt speed near 0.2 m/s" in page.text("branches-note")
    below = "return document.getElementById('branches-picture').parentElement.previousSibling.dataset.key"
    assert page.run(below) == "drive.speed"
    page.change("drive.speed", "0,3 m/s")
    page.until(lambda: "belt speed 0.3 m/s, normal force 20 N, sliding is stable" in page.text("branches-note"))
    page.change("body.damping", "3")  # of another rig there is no map
    page.until(lambda: page.text("branches-note") == "no map yet for these values")


def test_a_lesson_is_read_its_numbers_compared_and_its_scene_chosen(page):
    page.go("lessons")
    page.until(lambda: page.run("return document.querySelectorAll('#lessons a').length") == len(lessons()))
    for one in lessons():
        page.go(f"lessons/{one.number}")
        page.until(lambda one=one: one.title in page.text("lesson"))
        pictures = (
            "return [...document.querySelectorAll('#lesson img')].every((one) => one.complete && one.naturalWidth)"
        )
        page.run("for (const one of document.querySelectorAll('#lesson details')) one.open = true")
        page.until(lambda pictures=pictures: page.run(pictures))
    page.go("lessons/1")
    page.until(lambda: "Falling friction" in page.text("lesson"))
    assert page.run("return document.querySelector('#lesson details').open") is False  # the solutions
    page.run("document.querySelector('#lesson button.run').click()")
    given = "return [...document.querySelectorAll('#lesson .given')].map((one) => one.textContent)"
    page.until(lambda: page.run(given))
    assert page.run(given)[:2] == ["your run", ""]
    assert "3.65529 1/s" in page.run(given)[2::2]
    assert set(page.run(given)[3::2]) == {"✓ agrees"}
    page.picture("lesson")
    page.go(f"lessons/{lessons()[-1].number}")
    page.until(lambda: lessons()[-1].title in page.text("lesson"))
    page.press("lesson-scene")
    page.until(lambda: page.value("scene") == lessons()[-1].scene)
    page.until_known()


def test_a_recording_of_the_list_has_its_picture_scene_verdict_and_date(page, folder):
    (folder / RUNS).mkdir(parents=True)
    rig.simulate("belt", duration=1.0).save(folder / RUNS / "first.mcap")
    page.go("recordings")
    row = "const row = document.querySelector('#recordings a'); "
    page.until(lambda: page.run(row + "return row && row.textContent"))
    assert page.run(row + "return row.querySelector('strong').textContent") == "Mass on a belt"
    assert "simulated" in page.run(row + "return row.textContent")
    assert str(datetime.date.today().year) in page.run(row + "return row.textContent")
    painted = (
        row
        + "const { width, height } = row.querySelector('canvas'), pen = row.querySelector('canvas').getContext('2d');"
        "return new Set(pen.getImageData(0, 0, width, height).data).size"
    )
    page.until(lambda: page.run(painted) > 20)
    page.picture("recordings")


def test_a_map_is_asked_for_in_words_and_in_the_units_of_the_rig(page):
    page.choose("belt")
    page.go("analysis")
    page.until(lambda: page.value("map-x-over") == "drive.speed")
    texts = "return [...document.querySelectorAll('#map-x-over option')].slice(0, 3).map((one) => one.textContent)"
    assert page.run(texts)[:2] == ["belt speed", "normal force"]
    assert "m/s" in page.run("return document.getElementById('map-x-from').parentElement.textContent")
    page.write("map-x-count", "3")
    page.run("document.getElementById('map-y-over').value = 'load.force'")
    page.run("document.getElementById('map-y-over').dispatchEvent(new Event('change'))")
    page.write("map-y-count", "2")
    page.press("regions")
    page.until(lambda: "belt over drive.speed and load.force" in page.text("studies-jobs"))
    page.until(lambda: "done" in page.text("studies-jobs"), 120.0)
    page.until(lambda: "maps/belt" in page.text("studies"))
    page.picture("analysis")


def test_a_run_of_another_terminal_is_followed(page, folder):
    process = subprocess.Popen(
        [sys.executable, "-m", "rig", "run", "belt", "--duration", "300"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        page.go("bench")
        page.run("document.getElementById('others').closest('details').open = true")

        def offered():
            found = page.driver.find_elements("xpath", "//*[@id='others']//button[text()='Follow']")
            return found or page.run("[...document.querySelectorAll('#others button')].at(-1)?.click()")

        page.until(offered)[0].click()
        page.until_phase("running")
        assert page.text("run").startswith("Mass on a belt")
        page.until(lambda: page.value("value-drive.speed"))
        page.picture("followed")
        page.press("leave")
        page.until_phase("ended")
        assert process.poll() is None
    finally:
        process.kill()
        process.wait()
