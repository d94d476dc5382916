"""The picture of the page in README: the demonstration while its controller works.

RIG_SCREENSHOTS=FOLDER writes it: make pictures.
"""

import pytest

from rig import scenes
from rig.bench.live.plant_process import warm

pytestmark = pytest.mark.browser


def test_the_demonstration_runs_as_the_picture_shows_it(page):
    warm(scenes.load("pendulum"))
    page.tools("Emulation.setDeviceMetricsOverride", width=1400, height=900, deviceScaleFactor=1, mobile=False)
    page.choose("pendulum")
    page.press("start")
    page.until_phase("running")
    page.until(lambda: page.time > 9.5)
    page.run("scrollTo(0, 0)")
    page.picture("page")
    assert page.complaints() == []
    page.press("stop")
    page.until_phase("ended")
