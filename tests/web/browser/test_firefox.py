"""The page in Firefox, driven by WebDriver BiDi, which Firefox speaks itself; skipped without Firefox."""

import json
import shutil
import socket
import subprocess
import time

import pytest
from patience import wait_for
from ports import own_port
from websockets.sync.client import connect

from rig import scenes
from rig.bench.live.plant_process import warm

pytestmark = pytest.mark.browser
PLACE = "JSON.stringify(document.getElementById('emergency').getBoundingClientRect())"
FIREFOX = shutil.which("firefox") or shutil.which("firefox-esr")


class Tab:
    """One tab: scripts in it."""

    def __init__(self, socket):
        self.socket, self.count = socket, 0
        self.ask("session.new", capabilities={})
        self.tab = self.ask("browsingContext.getTree")["contexts"][0]["context"]

    def ask(self, method, **parameters):
        self.count += 1
        self.socket.send(json.dumps({"id": self.count, "method": method, "params": parameters}))
        while (answer := json.loads(self.socket.recv(60.0))).get("id") != self.count:
            pass
        assert answer["type"] == "success", answer
        return answer["result"]

    def open(self, address):
        self.ask("browsingContext.navigate", context=self.tab, url=address, wait="complete")

    def run(self, script):
        """The value of an expression: a text, a number or a truth value."""
        how = {"target": {"context": self.tab}, "expression": script, "awaitPromise": False}
        return self.ask("script.evaluate", **how)["result"].get("value")

    def until(self, script, seconds=60.0):
        deadline = time.monotonic() + seconds
        while not (value := self.run(script)):
            assert time.monotonic() < deadline, (script, self.run("document.getElementById('phase').textContent"))
            time.sleep(0.05)
        return value


def listening(port):
    """Whether a program listens there."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture
def tab(tmp_path):
    if FIREFOX is None:
        pytest.skip("needs Firefox: apt-get install firefox-esr (or as your system calls it)")
    profile = tmp_path / "firefox"
    profile.mkdir()
    port = own_port()
    command = [FIREFOX, "--headless", "--profile", str(profile), "--remote-debugging-port", str(port), "about:blank"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_for(lambda: listening(port))
        with connect(f"ws://127.0.0.1:{port}/session", max_size=None) as connected:
            yield Tab(connected)
    finally:
        process.terminate()
        process.wait(20.0)


def test_a_rig_is_started_moved_by_hand_and_played_again(tab, server):
    warm(scenes.load("belt"))
    tab.open(server.address)
    tab.until("document.querySelectorAll('.cards canvas[data-painted]').length > 3")
    tab.run("location.hash = 'bench/belt'")
    tab.until("document.getElementById('title').textContent === 'Mass on a belt'")
    tab.until("document.getElementById('start').disabled === false && (document.getElementById('start').click(), true)")
    tab.until("document.getElementById('phase').textContent === 'running'")
    tab.until("document.getElementById('contact').textContent === 'stick'")
    tab.run("""(() => { const one = document.getElementById('slider-load.force'); one.value = 0;
      one.dispatchEvent(new Event('input')); })()""")
    tab.until("document.getElementById('value-load.force').value === '0'")
    tab.until("/N = 0.0 N/.test(document.getElementById('rig-text').textContent)")
    tab.run("""(() => { const one = document.getElementById('value-load.force'); one.value = '15,5 N';
      one.dispatchEvent(new Event('change')); })()""")
    tab.until("/N = 15.5 N/.test(document.getElementById('rig-text').textContent)")
    for view in ("rigs", "analysis", "lessons", "bench"):
        tab.run(f"location.hash = '{view}'")
        tab.until(f"!document.getElementById('view-{view}').hidden")
        tab.run(f"(window.places ??= new Set()).add({PLACE})")
    assert tab.run("window.places.size") == 1  # the emergency stop never moves
    tab.run("document.getElementById('stop').click()")
    tab.until("document.getElementById('phase').textContent === 'ended'")
    tab.until("!document.getElementById('look-at-it').hidden && (document.getElementById('look-at-it').click(), true)")
    tab.until("document.getElementById('recorded-readout').textContent.startsWith('t = 0 s')")
    tab.run("document.getElementById('play').click()")
    tab.until("Number(document.getElementById('scrub').value) > 50")
