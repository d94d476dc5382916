"""Chromium without a window, driven by Selenium; without them the tests are skipped, with the remedy."""

import importlib.util
import os
import shutil
import time
from contextlib import ExitStack, contextmanager

import pytest

REMEDY = (
    "needs Chromium, its driver and Selenium: apt-get install chromium chromium-driver (or as your system calls them), "
    "then make install"
)
_BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_DRIVER = shutil.which("chromedriver")


class Page:
    """One tab, used as a person does: by what is written on it, by clicks and keys."""

    def __init__(self, driver):
        self.driver = driver
        self.tab = driver.current_window_handle

    def front(self):
        self.driver.switch_to.window(self.tab)
        return self

    def open(self, address):
        self.driver.get(address)
        return self

    def one(self, name):
        """The element with this id, as soon as it is there."""
        return self.until(lambda: self.driver.find_elements("id", name))[0]

    def show(self, name):
        """The same, scrolled into the middle of the window."""
        found = self.one(name)
        self.run("arguments[0].scrollIntoView({block: 'center'})", found)
        return found

    def text(self, name):
        return self.run("return document.getElementById(arguments[0])?.textContent ?? ''", name)

    def value(self, name):
        return self.run("return document.getElementById(arguments[0])?.value ?? ''", name)

    def run(self, script, *arguments):
        return self.driver.execute_script(script, *arguments)

    def tools(self, command, **parameters):
        """A command of Chromium's developer tools."""
        return self.driver.execute_cdp_cmd(command, parameters)

    def until(self, true, seconds=30.0):
        """What `true()` returns, when that is something."""
        deadline = time.monotonic() + seconds
        while not (found := true()):
            assert time.monotonic() < deadline, f"{self.text('phase')} | {self.text('fault')} | {self.complaints()}"
            time.sleep(0.05)
        return found

    def until_phase(self, phase, seconds=60.0):
        self.until(lambda: self.text("phase") == phase, seconds)

    def write(self, name, text):
        """Replace what a field contains, and leave it."""
        from selenium.webdriver.common.keys import Keys

        self.until_known()
        self.until(lambda: self.run("return document.getElementById(arguments[0])?.disabled === false", name))
        field = self.show(name)
        field.click()
        field.send_keys(Keys.CONTROL, "a")
        field.send_keys(text + Keys.TAB)

    def until_known(self):
        """Wait until the form shows the scene and the values that are chosen: it is built anew then."""
        self.until(lambda: self.run("return document.getElementById('values')?.ariaBusy === 'false'"))

    def change(self, key, text):
        """Change a value of the form, which is then checked by the server and built anew."""
        self.write(f"value-{key}", text)
        self.until(
            lambda: (
                self.run("return document.getElementById(arguments[0])?.className", f"value-{key}") == "value changed"
            )
        )

    def press(self, name):
        """Click the button with this id, as soon as it can be used."""
        self.until(lambda: self.run("return document.getElementById(arguments[0])?.disabled === false", name))
        self.show(name).click()

    def go(self, view):
        """Show a view of the page."""
        self.run("location.hash = arguments[0]", view)
        self.until(
            lambda: self.run(
                "return document.getElementById('view-' + arguments[0])?.hidden === false", view.partition("/")[0]
            )
        )

    def choose(self, scene):
        from selenium.webdriver.support.select import Select

        self.go("bench")
        self.until(lambda: self.run("return document.querySelectorAll('#scene option').length > 3"))
        self.until_known()
        if self.value("scene") == scene:
            return
        title = self.text("title")
        Select(self.one("scene")).select_by_value(scene)
        self.until(lambda: self.text("title") not in ("", title))
        self.until_known()

    @property
    def time(self):
        """Simulated time that the page shows [s]; -1 before the first frame."""
        said = self.text("time").split()
        return float(said[2]) if said else -1.0

    def unfold(self):
        """Open everything that can be opened, and wait for what it loads."""
        self.run("for (const one of document.querySelectorAll('details')) one.open = true")

    def complaints(self):
        """What the console of the page has of errors since the last call."""
        return [line["message"] for line in self.driver.get_log("browser") if line["level"] == "SEVERE"]

    def picture(self, name):
        """A screenshot, kept if RIG_SCREENSHOTS names a folder."""
        if folder := os.environ.get("RIG_SCREENSHOTS"):
            self.driver.save_screenshot(f"{folder}/{name}.png")


@contextmanager
def _browser_of(language):
    """A browser whose interface and pages are in a language. Skips the test where none is installed."""
    if not (_BROWSER and _DRIVER and importlib.util.find_spec("selenium")):
        pytest.skip(REMEDY)
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = _BROWSER
    for argument in ("--headless=new", "--disable-dev-shm-usage", "--window-size=1400,1000", "--no-first-run"):
        options.add_argument(argument)
    if os.geteuid() == 0:  # Chromium refuses its sandbox to root
        options.add_argument("--no-sandbox")
    options.add_argument(f"--lang={language}")
    options.add_experimental_option("prefs", {"intl.accept_languages": language})
    options.set_capability("acceptInsecureCerts", True)  # of a class: no public authority knows its certificate
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = webdriver.ChromeService(_DRIVER, env={**os.environ, "LANGUAGE": language.replace("-", "_")})
    driver = webdriver.Chrome(options, service)
    try:
        yield driver
    finally:
        driver.quit()


@pytest.fixture(scope="session")
def _browser():
    with _browser_of("en-GB") as driver:
        yield driver


@pytest.fixture
def in_language(server):
    """Starts another browser in a language, and returns the page of the server in it."""
    with ExitStack() as stack:

        def started(language):
            found = Page(stack.enter_context(_browser_of(language)))
            found.tools("Emulation.setLocaleOverride", locale=language)  # Debian's Chromium has no data of languages
            return found.open(server.address)

        yield started


@pytest.fixture
def browser(_browser):
    """The driver, without cookies, with one empty tab."""
    first, *others = _browser.window_handles
    for tab in others:
        _browser.switch_to.window(tab)
        _browser.close()
    _browser.switch_to.window(first)
    _browser.get("about:blank")
    _browser.execute_cdp_cmd("Network.clearBrowserCookies", {})
    _browser.get_log("browser")
    yield _browser
    _browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.fixture
def page(browser, server):
    """The page of the server, opened by its address."""
    found = Page(browser).open(server.address)
    found.until(lambda: found.text("phase") == "no run yet")
    yield found
    assert found.front().complaints() == []


@pytest.fixture
def tab(browser):
    """Opens further tabs."""

    def tab(address):
        browser.switch_to.new_window("tab")
        return Page(browser).open(address)

    return tab


@pytest.fixture
def downloads(page, tmp_path):
    """The folder into which the page downloads."""
    folder = tmp_path / "downloads"
    folder.mkdir()
    page.tools("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
    return folder
