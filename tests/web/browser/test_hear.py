"""What the page computes of a scene, and the sound of a run; whether a loudspeaker plays it no test can tell."""

import pytest

from rig import scenes
from rig.bench.live.plant_process import warm

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    warm(scenes.load("belt"))


def test_a_fast_sensor_is_heard(page, server):
    scene = server.bench.catalogue.scene("belt", {"sensors.vibrometer.rate": 10_000})
    server.bench.control.start(scene, "belt", {"sensors.vibrometer.rate": "10000"}, duration=60.0)
    page.until_phase("running")
    page.one("hear-open").click()
    page.press("hear")
    page.until(lambda: "dB (0 dB is 1e-9 m/s)" in page.text("hear-told"))
    page.picture("sound")
    page.press("hear")
    assert (page.text("hear"), page.text("hear-fault")) == ("Listen", "")
