"""The page of a class: it shows the rig, has no operation, and gets it from the page of the user."""

import pytest
from ports import own_port

from rig.web.server import Server

pytestmark = pytest.mark.browser
pytest.importorskip("cryptography")
SHOWN = "return [...document.querySelectorAll('button, input')].filter((one) => one.offsetParent).map((one) => one.id)"


@pytest.fixture
def server(folder):
    with Server(0, folder, lambda _: None, f"127.0.0.1:{own_port()}") as running:
        yield running


def test_a_watcher_sees_the_rig_move_asks_operates_and_gives_the_operation_back(page, tab, server):
    page.choose("belt_normal_force")
    page.press("start")
    page.until_phase("running")
    watcher = tab(server.share.address)
    watcher.until(lambda: watcher.time > 1.0)
    begin = watcher.run("return document.getElementById('rig-picture').toDataURL()")
    watcher.until(lambda: watcher.run("return document.getElementById('rig-picture').toDataURL()") != begin)
    operation = {"start", "emergency", "pause", "stop", "knock", "give-back", "impulse", "scene", "find"}
    assert operation.isdisjoint(watcher.run(SHOWN))
    assert watcher.text("who") == "You watch."
    watcher.picture("class_watches")
    watcher.write("your-name", "Ada")
    watcher.press("ask")
    watcher.until(lambda: watcher.text("who") == "You have asked to operate.")
    page.front()
    page.until(lambda: "Ada" in page.text("class"))
    page.picture("class_asked")
    page.driver.find_element("css selector", "[id^=hand-]").click()
    page.until(lambda: page.run(SHOWN).count("take-back"))
    watcher.front()
    watcher.until(lambda: watcher.text("who") == "You operate the run.")
    watcher.press("pause")
    watcher.until_phase("paused")
    watcher.picture("class_operates")
    assert "emergency" in watcher.run(SHOWN)
    watcher.press("pause")
    watcher.until_phase("running")
    watcher.press("give-back")
    watcher.until(lambda: watcher.text("who") == "You watch.")
    assert operation.isdisjoint(watcher.run(SHOWN))
    assert watcher.complaints() == []
    page.front().press("stop")
    page.until_phase("ended")
