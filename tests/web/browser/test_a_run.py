"""A whole run by the page alone: the values, the sliders, the recording; other pages beside it; what goes wrong."""

import re
import time

import pytest

from rig import scenes
from rig.bench.again.verify import verify
from rig.bench.live.plant_process import warm

pytestmark = pytest.mark.browser
Keys = pytest.importorskip("selenium.webdriver.common.keys", reason="needs Selenium: make install").Keys
SCENE, GAIN = "belt_normal_force", "controllers.nf.gain"


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    warm(scenes.load(SCENE))


def contacts(page, seconds):
    """The words of the contact that the page shows over a time."""
    found, end = set(), time.monotonic() + seconds
    while time.monotonic() < end:
        found.add(page.text("contact"))
        time.sleep(0.01)
    return found - {""}


def start(page, scene="belt"):
    page.choose(scene)
    page.write("duration", "300")
    page.press("start")
    page.until_phase("running")


def test_a_slider_kills_the_limit_cycle_and_the_recording_is_downloaded_and_verified(page, server, downloads):
    page.choose(SCENE)
    page.unfold()
    page.change(GAIN, "100")
    page.change("controllers.nf.enable_at", "2 s")
    assert page.run("return document.activeElement.id").startswith("value-")  # the focus outlasts the check
    page.write("duration", "300")
    page.press("start")
    page.until_phase("running")
    page.until(lambda: page.time > 3.0)
    page.show("contact")
    page.until(lambda: page.text("contact") == "stick")

    page.show(f"slider-{GAIN}").send_keys(Keys.END)
    page.until(lambda: float(page.value(f"value-{GAIN}")) == 200.0)
    page.until(lambda: "parameter" in [event["kind"] for event in server.bench.control.events])
    page.show("contact")
    page.until(lambda: contacts(page, 1.0) == {"slip+"})
    page.picture("running")

    page.press("stop")
    page.until_phase("ended")
    assert "stopped by an operator" in page.text("outcome")
    page.press("look-at-it")
    link = page.until(lambda: page.driver.find_elements("css selector", "#view-recordings a[title=MCAP]"))[0]
    page.until(lambda: page.text("recorded-readout").startswith("t = 0 s"))
    page.show("scrub").send_keys(Keys.END)
    page.until(lambda: page.text("recorded-contact") == "slip+")
    page.picture("recording")
    page.run("arguments[0].click()", link)
    log = page.until(lambda: next(downloads.glob("*.mcap"), None))
    found = verify(log)
    assert found.passed, found.text()
    page.press("do-verify")
    page.until(lambda: ": done" in page.text("jobs") or "exit code" in page.text("jobs"), 60.0)
    assert "exit code" not in page.text("jobs"), page.text("jobs")
    page.picture("ended")


def test_a_second_tab_shows_the_same_and_a_page_that_closes_changes_nothing(page, tab, server):
    start(page)
    run = page.text("run")
    second = tab(server.address)
    second.until_phase("running")
    assert second.text("run") == run
    second.show("slider-drive.speed").send_keys(Keys.END)
    moved = float(second.value("value-drive.speed"))
    assert moved == 0.36
    page.front()
    page.until(lambda: float(page.value("value-drive.speed")) == moved)
    second.front()
    second.driver.close()
    page.front()
    before = page.time
    page.until(lambda: page.time > before)
    assert page.text("phase") == "running"
    page.press("pause")
    page.until_phase("paused")
    again = tab(server.address)
    again.until_phase("paused")
    assert float(again.until(lambda: again.value("value-drive.speed"))) == moved
    again.press("emergency")
    page.front()
    page.until_phase("ended")
    assert "emergency stop" in page.text("outcome")


def test_the_first_start_says_that_it_compiles_and_how_far_it_is(page, tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_KERNELS", str(tmp_path / "none"))
    monkeypatch.setenv("RIG_OWN_PROCESS", "1")  # as the command line sets it
    page.choose("belt")
    page.press("start")
    page.until(lambda: "compiling kernels, once for each kind of rig" in page.text("doing"))
    page.until(lambda: re.search(r"compiling kernels: \d+ .*compiled in \d+ s", page.text("doing")))
    assert page.text("phase") == "starting"
    page.picture("compiling")
    page.press("stop")
    page.until_phase("ended")


def test_a_reload_keeps_the_scene_and_the_curves(page):
    page.choose("belt")
    page.unfold()
    page.change("load.force", "21 N")
    start(page)
    page.until(lambda: page.time > 2.0)
    page.press("pause")
    page.until_phase("paused")
    columns = """
        const canvas = document.querySelector("#timeline"), found = new Set();
        const { data, width } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        for (let i = 0; i < data.length; i += 4) if (data[i + 2] > data[i] + 60) found.add((i / 4) % width);
        return found.size;"""  # of the first plot that have a point of a blue curve
    page.show("contact")
    before, shown = page.until(lambda: page.run(columns)), page.time
    page.driver.refresh()
    page.until_phase("paused")
    page.until_known()
    assert page.value("scene") == "belt"
    page.until(lambda: page.value("value-load.force") == "21")
    page.until(lambda: page.time >= shown and page.run(columns) > 0.9 * before)
    page.press("stop")
    page.until_phase("ended")
    assert page.value("value-load.force") == "21"  # with its unit beside it


def test_a_server_that_ended_is_said_and_a_new_one_refuses_the_old_page(page, server, folder):
    from rig.web.server import Server

    start(page)
    server.__exit__()
    page.until(lambda: "rig web has ended" in page.text("phase"))
    assert not page.one("start").is_enabled()
    with Server(server.port, folder, lambda _: None) as later:
        page.until(lambda: "rig web was started again" in page.text("phase"))
        page.picture("older")
        page.open(later.address)
        page.until_phase("no run yet")
    page.until(lambda: "rig web has ended" in page.text("phase"))
    page.complaints()  # of the connection that was refused


def test_a_fault_is_said_at_its_field_and_is_gone_when_mended(page):
    page.choose(SCENE)
    page.unfold()
    page.write("value-load.force", "-3")
    page.until(lambda: "load.force = -3: must be at least 0 N" in page.text("fault-load.force"))
    assert page.text("form-fault") == ""
    assert not page.one("start").is_enabled()
    page.picture("fault")
    page.write("value-load.force", "21 N")
    page.until(lambda: page.text("fault-load.force") == "" and page.one("start").is_enabled())
    page.write("pace", "fast")
    page.press("start")
    page.until(lambda: "the pace " in page.text("form-fault"))
    page.write("pace", "1")
    page.press("start")
    page.until_phase("running")
    page.write("value-drive.speed", "5 N")
    page.until(lambda: "drive.speed" in page.text("fault-drive.speed"))
    page.complaints()  # of the requests that were refused
