"""A run or the scene that is chosen is shown, never parts of both; and the first task of the page can be solved."""

import pytest
from selenium.webdriver.support.select import Select

pytestmark = pytest.mark.browser
BELT, TWO = "Mass on a belt", "Mass on a belt with two degrees of freedom"


def shown(page):
    """Title, text, and the steps of the protocol line."""
    steps = page.run("return [...document.querySelectorAll('#steps li')].map((one) => one.title)")
    return page.text("title"), page.text("about")[:20], steps


def pick(page, scene):
    Select(page.show("scene")).select_by_value(scene)
    page.until_known()


def test_a_run_is_shown_whole_until_another_scene_is_chosen_after_its_end(page, tab, server):
    page.choose("belt")
    of_belt = shown(page)
    assert of_belt[0] == BELT
    page.write("duration", "6")
    page.press("start")
    page.until_phase("running")
    second = tab(server.address)
    second.until_phase("running")
    second.go("bench")
    second.until(lambda: (second.text("title"), second.value("scene")) == (BELT, "belt"))
    assert shown(second)[:2] == of_belt[:2]
    pick(second, "two_dof")  # for the next run
    assert shown(second)[:2] == of_belt[:2]
    assert TWO in second.text("next")
    second.until_phase("ended")
    assert shown(second)[:2] == of_belt[:2]
    assert second.text("experiment")
    second.press("show-next")
    second.until(lambda: second.text("title") == TWO)
    assert second.text("experiment") == ""
    assert second.text("contact") == ""
    assert second.run("return document.getElementById('timeline').hidden")
    second.driver.refresh()
    second.until(lambda: second.text("title") == TWO)
    page.front().until_phase("ended")
    assert shown(page)[:2] == of_belt[:2]
    pick(page, "lever")
    assert page.run("return document.getElementById('timeline').hidden")


def test_a_slider_tells_where_it_is_quiet_and_the_run_tells_that_it_became_quiet(page):
    page.press("demo")
    page.until_phase("running")
    assert "quiet below" in page.until(lambda: page.text("says-friction.mu_static"))
    page.until(lambda: "vibrates" in page.text("experiment"))
    page.write("value-friction.mu_static", "0.1")
    page.until(lambda: page.text("experiment").startswith("quiet since"), 60.0)
    assert page.text("experiment").endswith("after friction coefficient at rest 0.1")
    assert "other values" in page.text("says-load.force")  # its map was made with the value of the scene
    page.press("back")
    page.until(lambda: float(page.value("value-friction.mu_static")) == 0.5)
    page.until(lambda: "quiet below" in page.text("says-load.force"))
    page.press("connect-nf")
    page.until(
        lambda: "driven by nf" in page.run("return document.querySelector('[data-key=\"load.force\"]').textContent")
    )
    page.press("stop")
    page.until_phase("ended")
